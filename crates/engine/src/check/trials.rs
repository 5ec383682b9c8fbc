//! What may be wrong with frames, undone: the same calls are made again, and what mends them is the cause.

use super::film::{Film, coded};
use super::{CheckItem, Look};
use crate::EngineError;
use crate::calibration::objects_with;
use mavsight_pipeline::{CameraFeed, Cause, PipelineError, Progress, TimedFrame};
use mavsight_pose::PoseEstimate;
use mavsight_session::Session;
use mavsight_vision::{Frame, linear_light};

/// A feed whose frames pass through a function.
pub(super) fn altered(
    feed: CameraFeed<'static>,
    alter: impl Fn(Frame) -> Frame + Send + 'static,
) -> CameraFeed<'static> {
    let frames = feed
        .frames
        .map(move |item| item.map(|TimedFrame { t_ns, frame }| TimedFrame { t_ns, frame: alter(frame) }));
    CameraFeed { frames: Box::new(frames), ..feed }
}

/// Each code of a frame through a table.
fn by_table(frame: &Frame, table: &[u8; 256]) -> Frame {
    let rgb = frame.to_rgb().into_iter().map(|code| table[usize::from(code)]).collect();
    Frame::from_rgb(frame.size, rgb).unwrap_or_else(|_| frame.clone())
}

/// A board that is found with black and white exchanged alone.
pub(super) fn of_calibration(
    session: &Session,
    error: &EngineError,
    progress: &dyn Progress,
) -> Option<CheckItem> {
    let EngineError::Pipeline(PipelineError::NoBoard { camera, .. }) = error else { return None };
    progress.begin(mavsight_pipeline::Stage::Calibrate, None);
    objects_with(session, |feed| altered(feed, |frame| frame.inverted())).ok()?;
    let text = format!(
        "{camera}: the board is printed with black and white exchanged: it is found in the inverted images, and in none as they are. Set \
         `inverted = true` in `[board]`."
    );
    let index = session.cameras().iter().position(|c| c.name == *camera);
    Some(CheckItem::of_cause(Cause::BoardInverted, index, text))
}

/// A recording whose size is that of its still lying on its side: which quarter turn makes poses of it.
pub(super) fn turned_recording(look: &Look<'_>) -> Option<CheckItem> {
    let Look { session, rig, .. } = look;
    let is_on_its_side = |k: &usize| {
        let Ok(size) = session.image_size(*k) else { return false };
        let own = rig.cameras[*k].camera.size;
        (size.width_px, size.height_px) == (own.height_px, own.width_px) && size != own
    };
    let on_side: Vec<usize> = (0..rig.cameras.len()).filter(is_on_its_side).collect();
    let first = *on_side.first()?;
    let name = &rig.cameras[first].name;
    let mut tried: Vec<(u8, f64)> = Vec::new();
    for quarters in [1u8, 3] {
        let sides = on_side.clone();
        let film = look.film(&session.vehicle, move |k, feed| {
            if sides.contains(&k) { altered(feed, move |frame| frame.turned(quarters)) } else { feed }
        });
        if let Ok(film) = film {
            tried.push((quarters, by_both(&film)));
        }
    }
    tried.sort_by(|a, b| b.1.total_cmp(&a.1));
    let size = session.image_size(first).ok()?;
    let lies = format!(
        "{name} films at {}×{} px, and its still has {}×{}",
        size.width_px, size.height_px, size.height_px, size.width_px
    );
    match tried[..] {
        [(quarters, share), ..]
            if share > 0.5 && tried.get(1).is_none_or(|(_, other)| *other < 0.5 * share) =>
        {
            let way = if quarters == 1 { "clockwise" } else { "counter-clockwise" };
            let text = format!(
                "{lies}: the phone was turned between the two. Turned by 90° {way} the recording fits ({:.0} % of its instants): turn it, \
                 or film still and flight the same way up.",
                100.0 * share
            );
            Some(CheckItem::of_cause(Cause::ImageTurned, Some(first), text))
        }
        _ => {
            let text = format!("{lies}: film still and flight the same way up and calibrate again.");
            Some(CheckItem { harm: super::Harm::Stops, camera: Some(first), ..CheckItem::of_note(text) })
        }
    }
}

/// Share of the instants whose pose fits the cameras to a pixel, with none of them moved or exchanged.
fn by_both(film: &Film) -> f64 {
    if film.tracked.findings.iter().any(|f| f.causes.iter().any(|c| is_of_the_view(*c))) {
        return 0.0;
    }
    let poses = &film.tracked.poses;
    let fits = |e: &PoseEstimate| e.residual_px.is_some_and(|px| px < 1.0);
    let fitting = poses.iter().filter(|p| p.estimate.as_ref().is_ok_and(fits)).count();
    fitting as f64 / poses.len().max(1) as f64
}

fn is_of_the_view(cause: Cause) -> bool {
    matches!(cause, Cause::CameraMoved | Cause::CamerasExchanged | Cause::ImageTurned)
}

/// Share of its frames in which a camera identified its markers, all together.
fn seen(film: &Film, camera: usize) -> f64 {
    let markers = film.tracked.health.get(camera).map_or(&[][..], |h| &h.markers[..]);
    markers.iter().map(|m| m.seen).sum::<f64>() / markers.len().max(1) as f64
}

/// Share of frames with a marker, below which a camera is looked into.
const SEES_LITTLE: f64 = 0.5;

/// Cameras whose markers appear when their light is raised to that of their stills, or of another camera.
pub(super) fn dark_cameras(look: &Look<'_>, film: &Film) -> Vec<CheckItem> {
    let Look { session, rig, .. } = look;
    let is_named = |k: usize| {
        film.tracked.findings.iter().any(|f| f.camera == Some(k) && f.cause() == Some(Cause::CameraDark))
    };
    let mut items = Vec::new();
    for k in (0..rig.cameras.len()).filter(|k| !is_named(*k) && seen(film, *k) < SEES_LITTLE) {
        let Some(own) = film.taps[k].frames.first().map(|(_, frame)| bright_light(frame)) else { continue };
        let still = session.cameras()[k].still.as_ref().and_then(|p| mavsight_session::read_image(p).ok());
        let other = (0..rig.cameras.len())
            .filter(|j| *j != k)
            .filter_map(|j| film.taps[j].frames.first().map(|(_, frame)| bright_light(frame)))
            .fold(0.0, f64::max);
        let wanted = still.as_ref().map_or(other, bright_light).max(other);
        let gain = wanted / own.max(linear_light(1));
        // A stop of light is what cameras of one room differ by.
        if gain < 2.0 {
            continue;
        }
        let table: [u8; 256] = std::array::from_fn(|code| coded(gain * linear_light(code as u8)));
        let lit = look.film(&session.vehicle, move |j, feed| {
            if j == k { altered(feed, move |frame| by_table(&frame, &table)) } else { feed }
        });
        let Ok(lit) = lit else { continue };
        let (before, after) = (seen(film, k), seen(&lit, k));
        if after > SEES_LITTLE && after > 2.0 * before {
            let text = format!(
                "{} is too dark: it shows {:.0} % of the markers, and {:.0} % with its light raised {gain:.0} times. Give it that much more \
                 light, by lamps rather than by a longer exposure.",
                rig.cameras[k].name,
                100.0 * before,
                100.0 * after
            );
            items.push(CheckItem::of_cause(Cause::CameraDark, Some(k), text));
        }
    }
    items
}

/// Linear light that one pixel of a hundred exceeds.
fn bright_light(frame: &Frame) -> f64 {
    let mut counts = [0usize; 256];
    for code in frame.to_rgb().into_iter().skip(1).step_by(3) {
        counts[usize::from(code)] += 1;
    }
    let enough = frame.size.area_px() / 100;
    let mut above = 0;
    let code = (0..=255u8).rev().find(|code| {
        above += counts[usize::from(*code)];
        above > enough
    });
    linear_light(code.unwrap_or(0))
}
