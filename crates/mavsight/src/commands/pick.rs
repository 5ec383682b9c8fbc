//! `pick`: a page on which control points are clicked.

mod files;
mod state;

use super::named;
use crate::cli::{Pick, WrongCall};
use crate::out::outln;
use anyhow::Result;
use mavsight_engine::Picker;
use mavsight_geometry::Vector2;
use mavsight_page::{Limits, Reach, Reply, Server};
use mavsight_report::picture_address;
use mavsight_session::Session;
use std::net::Ipv4Addr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Where the page is when nobody says: beside that of a flight.
const PORT: u16 = 8751;
/// Stills are shown with all their pixels up to this width.
const MOST_WIDTH_PX: u32 = 8192;
/// A still of many megapixels is searched and sent within this time on a slow machine.
const REQUEST_TIME: Duration = Duration::from_secs(60);

pub(crate) fn pick(args: &Pick) -> Result<()> {
    let path = if args.session.is_dir() { args.session.join("session.toml") } else { args.session.clone() };
    let session = named(Session::load(&path))?;
    let picker = Picker::open(&session)?;
    if picker.points().is_empty() || picker.stills().len() < session.cameras().len() {
        let message = format!(
            "{}: name control points ([control] points) and a still of each camera, in which they are clicked",
            path.display()
        );
        return Err(WrongCall(message).into());
    }
    let desk = Mutex::new(Desk { session, picker });
    let address = args.serve.unwrap_or_else(|| (Ipv4Addr::LOCALHOST, PORT).into());
    let limits = Limits { request_time: REQUEST_TIME, ..Limits::default() };
    let reach = if address.ip().is_loopback() { Reach::Loopback } else { Reach::Network };
    let server = Server::start_site(address, reach, limits, move |path, query| {
        desk.lock().unwrap_or_else(PoisonError::into_inner).answer(path, query)
    })?;
    outln!("Open {} and click on the control points. Ctrl+C ends this.", server.url());
    loop {
        std::thread::park();
    }
}

struct Desk {
    session: Session,
    picker: Picker,
}

impl Desk {
    fn answer(&mut self, path: &str, query: &str) -> Option<Reply> {
        let number = |key: &str| value(query, key)?.parse::<f64>().ok().filter(|v| v.is_finite());
        let place = |key: &str| value(query, key)?.parse::<usize>().ok();
        let said = match path {
            "" => return Some(reply("text/html; charset=utf-8", include_str!("pick/pick.html"))),
            "pick.js" => return Some(reply("text/javascript; charset=utf-8", include_str!("pick/pick.js"))),
            "pick.css" => return Some(reply("text/css; charset=utf-8", include_str!("pick/pick.css"))),
            "still" => {
                let still = self.picker.stills().get(place("camera")?)?;
                return Some(reply(
                    "text/plain; charset=utf-8",
                    picture_address(&still.frame, MOST_WIDTH_PX).ok()?,
                ));
            }
            "state" => String::new(),
            "do/pick" => {
                let at = Vector2::new(number("u_px")?, number("v_px")?);
                match self.picker.pick(place("camera")?, place("point")?, at) {
                    Ok(_) => String::new(),
                    Err(refused) => refused.to_string(),
                }
            }
            "do/forget" => {
                self.picker.forget(place("camera")?, place("point")?);
                String::new()
            }
            "do/save" => {
                files::save(&self.session, &self.picker).unwrap_or_else(|e| format!("not saved: {e:#}"))
            }
            _ => return None,
        };
        Some(reply("application/json", serde_json::to_string(&state::of(&self.picker, said)).ok()?))
    }
}

fn reply(media_type: &'static str, text: impl Into<String>) -> Reply {
    Reply { media_type, text: text.into() }
}

/// The value of a key in `a=1&b=2`.
fn value<'a>(query: &'a str, key: &str) -> Option<&'a str> {
    query.split('&').filter_map(|pair| pair.split_once('=')).find(|(k, _)| *k == key).map(|(_, v)| v)
}
