//! Bodies that look the same after a turn.

use super::NORMAL_GATE;
use crate::{BodyMarker, PoseError};
use mavsight_geometry::rigid_fit;

/// Refuses a body whose markers of one colour can change places by a rigid motion within what their places
/// are known to.
pub(super) fn refuse_symmetric(
    markers: &[BodyMarker],
    colors: &[usize],
    std_m: f64,
) -> Result<(), PoseError> {
    // The difference of two lengths between four places.
    let needed_m = NORMAL_GATE * 2.0 * std_m;
    let mut places = Vec::with_capacity(markers.len());
    let Some(found) = changed_places(markers, colors, needed_m, &mut places) else { return Ok(()) };
    let moved: Vec<&str> =
        (0..markers.len()).filter(|m| found[*m] != *m).map(|m| markers[m].name.as_str()).collect();
    Err(PoseError::SymmetricMarkers { markers: moved.join(", "), needed_mm: 1e3 * needed_m.max(1e-3) })
}

/// Who stands in whose place, not each in its own, with all lengths kept and without a mirror.
fn changed_places(
    markers: &[BodyMarker],
    colors: &[usize],
    needed_m: f64,
    places: &mut Vec<usize>,
) -> Option<Vec<usize>> {
    let next = places.len();
    if next == markers.len() {
        let moved = places.iter().enumerate().any(|(m, p)| m != *p);
        return (moved && is_turn(markers, places, needed_m)).then(|| places.clone());
    }
    let length = |a: usize, b: usize| (markers[a].marker_in_body_m - markers[b].marker_in_body_m).norm();
    for place in 0..markers.len() {
        if places.contains(&place) || colors[place] != colors[next] {
            continue;
        }
        let same = |m: usize| (length(m, next) - length(places[m], place)).abs() <= needed_m;
        if !(0..next).all(same) {
            continue;
        }
        places.push(place);
        if let Some(found) = changed_places(markers, colors, needed_m, places) {
            return Some(found);
        }
        places.pop();
    }
    None
}

fn is_turn(markers: &[BodyMarker], places: &[usize], needed_m: f64) -> bool {
    let at = |m: usize| markers[m].marker_in_body_m;
    let mut pairs = places.iter().enumerate().map(|(from, to)| (at(from), at(*to)));
    rigid_fit(pairs.clone()).is_ok_and(|f| {
        pairs.all(|(from, to)| (f.rotation * from + f.translation.vector - to).norm() <= needed_m)
    })
}
