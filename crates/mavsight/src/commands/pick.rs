//! `pick`: a page on which control points and markers are clicked.

mod files;
mod markers;
mod state;

use super::named;
use crate::cli::{Pick, WrongCall};
use crate::out::outln;
use anyhow::Result;
use mavsight_engine::{MarkerPicker, Picker};
use mavsight_geometry::Vector2;
use mavsight_page::{Limits, Reach, Reply, Server};
use mavsight_session::Session;
use std::net::Ipv4Addr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Where the page is when nobody says: beside that of a flight.
const PORT: u16 = 8751;
/// A picture of many megapixels is searched and sent within this time on a slow machine.
const REQUEST_TIME: Duration = Duration::from_secs(60);

pub(crate) fn pick(args: &Pick) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let control = Picker::open(&session)?;
    let has_control = !control.points().is_empty() && control.stills().len() == session.cameras().len();
    let markers = match MarkerPicker::open(&session) {
        Ok(markers) => Some(markers).filter(|m| m.cameras().next().is_some()),
        Err(error) if has_control => {
            eprintln!("no markers can be clicked: {error}");
            None
        }
        Err(error) => return Err(error.into()),
    };
    if !has_control && markers.is_none() {
        let message = format!(
            "{}: name control points ([control] points) and a still of each camera, in which they are clicked, or videos of a flight, in \
             which its markers are",
            session.path.display()
        );
        return Err(WrongCall(message).into());
    }
    let control = has_control.then_some(control);
    let desk = Mutex::new(Desk { session, control, markers });
    let address = args.serve.unwrap_or_else(|| (Ipv4Addr::LOCALHOST, PORT).into());
    let limits = Limits { request_time: REQUEST_TIME, ..Limits::default() };
    let reach = if address.ip().is_loopback() { Reach::Loopback } else { Reach::Network };
    let server = Server::start_site(address, reach, limits, move |path, query| {
        desk.lock().unwrap_or_else(PoisonError::into_inner).answer(path, query)
    })?;
    outln!("Open {} and click on the balls. Ctrl+C ends this.", server.url());
    loop {
        std::thread::park();
    }
}

struct Desk {
    session: Session,
    /// None of a session without control points or stills.
    control: Option<Picker>,
    /// None of a session whose recordings cannot be read, or that has none.
    markers: Option<MarkerPicker>,
}

/// What a request is about: numbers of its query.
#[derive(Clone, Copy)]
struct Asked<'a>(&'a str);

impl Asked<'_> {
    fn place(self, key: &str) -> Option<usize> {
        value(self.0, key)?.parse().ok()
    }

    fn pixel(self) -> Option<Vector2<f64>> {
        let number = |key: &str| value(self.0, key)?.parse::<f64>().ok().filter(|v| v.is_finite());
        Some(Vector2::new(number("u_px")?, number("v_px")?))
    }
}

impl Desk {
    fn answer(&mut self, path: &str, query: &str) -> Option<Reply> {
        let asked = Asked(query);
        match path {
            "" => return Some(reply("text/html; charset=utf-8", include_str!("pick/pick.html"))),
            "pick.js" => return Some(reply("text/javascript; charset=utf-8", include_str!("pick/pick.js"))),
            "pick.css" => return Some(reply("text/css; charset=utf-8", include_str!("pick/pick.css"))),
            _ => {}
        }
        if value(query, "of") == Some("markers") {
            let Some(markers) = &mut self.markers else {
                let said = "no recording of the flight can be read".to_owned();
                return json(&state::State { said, ..state::State::default() }).filter(|_| path == "state");
            };
            return markers::answer(&self.session, markers, path, asked);
        }
        let Some(picker) = &mut self.control else {
            return (path == "state").then(|| json(&state::State::default()))?;
        };
        let said = match path {
            "picture" => {
                let still = picker.stills().get(asked.place("camera")?)?;
                return json(&state::Picture::of(&still.frame, None));
            }
            "state" => String::new(),
            "do/pick" => {
                let picked = picker.pick(asked.place("camera")?, asked.place("point")?, asked.pixel()?);
                picked.map_or_else(|refused| refused.to_string(), |_| String::new())
            }
            "do/forget" => {
                picker.forget(asked.place("camera")?, asked.place("point")?);
                String::new()
            }
            "do/save" => files::save(&self.session, picker).unwrap_or_else(|e| format!("not saved: {e:#}")),
            _ => return None,
        };
        json(&state::of(picker, said))
    }
}

fn json(answer: &impl serde::Serialize) -> Option<Reply> {
    Some(reply("application/json", serde_json::to_string(answer).ok()?))
}

fn reply(media_type: &'static str, text: impl Into<String>) -> Reply {
    Reply { media_type, text: text.into() }
}

/// The value of a key in `a=1&b=2`.
fn value<'a>(query: &'a str, key: &str) -> Option<&'a str> {
    query.split('&').filter_map(|pair| pair.split_once('=')).find(|(k, _)| *k == key).map(|(_, v)| v)
}
