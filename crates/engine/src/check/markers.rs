//! Markers that no camera has seen: of another colour than the file says, or not there.

use super::film::{Film, coded, ring_light};
use super::{CheckItem, Look};
use mavsight_flight::{Color, Vehicle};
use mavsight_geometry::Vector2;
use mavsight_pipeline::Cause;
use mavsight_pose::{Rig, median};
use mavsight_vision::{LEAST_CHROMA, hue};

/// Share of a camera's frames up to which a marker counts as never seen: met by chance.
const NEVER: f64 = 0.1;
/// Share from which on it counts as seen.
pub(super) const SEEN: f64 = 0.5;
/// Standard errors by which the colour at a marker's place must differ from that around it.
const SURE: f64 = 4.0;

/// An item on each marker that no camera has seen while poses by the others show where it must be.
pub(super) fn never_seen(look: &Look<'_>, film: &Film) -> Vec<CheckItem> {
    let vehicle = &look.session.vehicle;
    let most = |marker: usize| {
        let of = |h: &mavsight_pipeline::CameraHealth| h.markers.get(marker).map_or(0.0, |m| m.seen);
        film.tracked.health.iter().map(of).fold(0.0, f64::max)
    };
    let unseen = (0..vehicle.marker.len()).filter(|m| most(*m) <= NEVER);
    unseen.filter_map(|marker| explained(look, film, marker)).collect()
}

fn explained(look: &Look<'_>, film: &Film, marker: usize) -> Option<CheckItem> {
    let Look { session, rig, .. } = look;
    let name = &session.vehicle.marker[marker].name;
    let nominal = session.vehicle.marker[marker].color;
    let (light, is_sure, looks) = colour_there(rig, film, &session.vehicle, marker)?;
    if is_sure {
        let [r, g, b] = light.map(coded);
        let proposed = Color::new(r, g, b);
        let mut vehicle = session.vehicle.clone();
        vehicle.marker[marker].color = proposed;
        // The same frames once more, by the colour that they have there.
        if let Ok(again) = look.film(&vehicle, |_, feed| feed) {
            let seen = again.tracked.health.iter().filter_map(|h| h.markers.get(marker)).map(|m| m.seen);
            let seen = seen.fold(0.0, f64::max);
            if seen >= SEEN {
                let text = format!(
                    "{name} is never seen as {nominal}; as {proposed}, the colour where the other balls have it, it is seen in {:.0} % of the \
                     frames: write color = \"{proposed}\" in the vehicle file.",
                    100.0 * seen
                );
                return Some(CheckItem::of_cause(Cause::MarkerColor, None, text));
            }
        }
    }
    let elsewhere = moving_share(film, &session.vehicle, marker);
    if elsewhere > NEVER {
        let text = format!(
            "{name} is not where the other balls have it, but a ball of its colour moves elsewhere in {:.0} % of the frames: correct its \
             position in the vehicle file.",
            100.0 * elsewhere
        );
        return Some(CheckItem::of_note(text));
    }
    let text = format!(
        "{name} is not there: no ball of its colour moves in any camera, and in {looks} pictures its place by the other balls shows none of \
         another colour either. Mount it, or take it out of the vehicle file."
    );
    Some(CheckItem::of_cause(Cause::MarkerMissing, None, text))
}

/// Largest share of a camera's frames in which something of a marker's colour moves that is no marker.
fn moving_share(film: &Film, vehicle: &Vehicle, marker: usize) -> f64 {
    let mut colors: Vec<Color> = Vec::new();
    for own in &vehicle.marker[..=marker] {
        if !colors.contains(&own.color) {
            colors.push(own.color);
        }
    }
    let own = colors.iter().position(|c| *c == vehicle.marker[marker].color);
    let share = |(camera, tap): (usize, &super::film::Taken)| {
        let is_other = |s: &&super::film::Seen| {
            let d = &s.detection;
            d.camera == camera && Some(d.color) == own && !d.is_static && s.marker.is_none()
        };
        film.seen.iter().filter(is_other).count() as f64 / tap.stamps_ns.len().max(1) as f64
    };
    film.taps.iter().enumerate().map(share).fold(0.0, f64::max)
}

/// Mean linear light where the poses have a marker, whether it differs from that around it, and in how many pictures
/// that was looked at; none without a pose.
fn colour_there(rig: &Rig, film: &Film, vehicle: &Vehicle, marker: usize) -> Option<([f64; 3], bool, usize)> {
    let (mut discs, mut differences) = (Vec::new(), Vec::new());
    for camera in 0..rig.cameras.len() {
        for (stamp_ns, frame) in &film.taps[camera].frames {
            let t_ns = film.time_ns(camera, *stamp_ns);
            let Some((pixel, diameter_px)) = film.predicted(camera, marker, t_ns, vehicle, rig) else {
                continue;
            };
            let inside_px = (0.5 * diameter_px - 1.0).max(1.0);
            let disc = ring_light(frame, pixel, 0.0, inside_px);
            let ring = ring_light(frame, pixel, 0.5 * diameter_px + 2.0, 0.5 * diameter_px + 5.0);
            if let (Some(disc), Some(ring)) = (disc, ring) {
                discs.push(disc);
                differences.push(hue(disc) - hue(ring));
            }
        }
    }
    if differences.len() < 3 {
        return None;
    }
    let count = differences.len() as f64;
    let mean = differences.iter().sum::<Vector2<f64>>() / count;
    let var = differences.iter().map(|d| (d - mean).norm_squared()).sum::<f64>() / (count - 1.0);
    let usual = |k: usize| median(discs.iter().map(|d| d[k]).collect());
    // A ball is seen before many backgrounds: its own colour is the same.
    let is_sure = mean.norm() > SURE * (var / count).sqrt() && mean.norm() > f64::from(LEAST_CHROMA);
    Some(([usual(0)?, usual(1)?, usual(2)?], is_sure, differences.len()))
}
