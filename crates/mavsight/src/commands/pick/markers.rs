//! Markers that are clicked in frames of the flight.

use super::state::{BallState, CameraState, FoundState, Picture, PointState, State};
use super::{Asked, files, json};
use mavsight_engine::{EngineError, MarkerPicker, PickedMarker};
use mavsight_page::Reply;
use mavsight_session::Session;

/// Answers a request; none where there is nothing.
pub(super) fn answer(
    session: &Session,
    picker: &mut MarkerPicker,
    path: &str,
    asked: Asked<'_>,
) -> Option<Reply> {
    let (camera, frame) = (asked.place("camera")?, asked.place("frame")?);
    let said = match path {
        "picture" => {
            picker.cameras().nth(camera)?;
            return json(&picture(picker, camera, frame));
        }
        "state" => String::new(),
        "do/pick" => {
            let picked = picker.pick(camera, frame, asked.place("point")?, asked.pixel()?);
            picked.map_or_else(|refused| refused.to_string(), |_| String::new())
        }
        "do/forget" => {
            picker.forget(camera, frame, asked.place("point")?);
            String::new()
        }
        "do/save" => files::save_colors(session, picker).unwrap_or_else(|e| format!("not saved: {e:#}")),
        _ => return None,
    };
    json(&state(picker, (camera, frame), said))
}

fn picture(picker: &mut MarkerPicker, camera: usize, frame: usize) -> Picture {
    let refused = |error: EngineError| Picture { refused: Some(error.to_string()), ..Picture::default() };
    match picker.frame(camera, frame) {
        Ok(Some((t_ns, image))) => Picture::of(image, Some(*t_ns as f64 * 1e-9)),
        Ok(None) => Picture { t_s: picker.time_read_s(camera), ..Picture::default() },
        Err(error) => refused(error),
    }
}

fn state(picker: &MarkerPicker, (camera, frame): (usize, usize), said: String) -> State {
    let (vehicle, mut wrong) = (picker.vehicle(), Vec::new());
    let found = picker.found(camera, frame).unwrap_or_else(|error| {
        wrong.push(error.to_string());
        Vec::new()
    });
    let missed = picker.missed().unwrap_or_default();
    let name = |camera: usize| picker.cameras().nth(camera).map_or("", |(name, _)| name);
    wrong.extend(missed.iter().map(|p| not_found(name(p.camera), &vehicle.marker[p.marker].name, p)));
    let balls = picker.picked().iter().map(|p| BallState {
        wrong: missed.contains(&p),
        ..BallState::of(p.camera, p.frame, p.marker, &p.ball)
    });
    let cameras = picker.cameras().enumerate().map(|(k, (name, frames))| CameraState {
        verdict: verdict(picker, name, k),
        name: name.to_owned(),
        frames,
    });
    let point = |m: &mavsight_flight::Marker| PointState { name: m.name.clone(), color: m.color.to_string() };
    State {
        said,
        cameras: cameras.collect(),
        points: vehicle.marker.iter().map(point).collect(),
        picked: balls.collect(),
        wrong,
        found: found
            .into_iter()
            .map(|(point, ball)| FoundState {
                point,
                u_px: ball.pixel.x,
                v_px: ball.pixel.y,
                diameter_px: ball.diameter_px,
            })
            .collect(),
    }
}

fn not_found(camera: &str, marker: &str, picked: &PickedMarker) -> String {
    format!(
        "{camera}, frame {}: by these colours the ball clicked as {marker} is not found as {marker}: its clicks are of unlike colours, or \
         another marker's is nearer",
        picked.frame + 1
    )
}

/// How many clicks a camera has, in words.
fn verdict(picker: &MarkerPicker, name: &str, camera: usize) -> String {
    let own: Vec<&PickedMarker> = picker.picked().iter().filter(|p| p.camera == camera).collect();
    let mut markers: Vec<usize> = own.iter().map(|p| p.marker).collect();
    markers.sort_unstable();
    markers.dedup();
    format!(
        "{name}: {} of {} markers clicked; a click in each camera, or in light and shade, makes a colour fit both.",
        markers.len(),
        picker.vehicle().marker.len()
    )
}
