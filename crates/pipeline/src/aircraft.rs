//! The aircraft in flight as an object that is moved before the cameras, for cameras that see too few control points.

use crate::feed::nearest_ns;
use crate::markers::{MARKERS_STD_M, MarkerColors, body_markers};
use crate::wand::{Seen, balls_of};
use crate::{CameraFeed, PipelineError, usual_interval_ns};
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector2;
use mavsight_pose::{MarkerObservation, MovedObject, ObjectDoubt, ObjectLags};
use mavsight_vision::Detection;
use rayon::prelude::*;

/// Finds the ball of each colour in every frame of every camera, and joins the frames that are nearest in time; their
/// lags within a frame interval are left to the calibration, with the velocities of the balls. Markers that share a
/// colour are left out, as they cannot be distinguished before the cameras are known.
///
/// Markers are uncertain by half a millimetre a coordinate, centres by a constant error as large as the standard
/// deviation that they claim: more would contradict the claim.
///
/// # Errors
/// Sources that fail, colours that cannot be distinguished.
pub fn aircraft_of(vehicle: &Vehicle, feeds: Vec<CameraFeed<'_>>) -> Result<MovedObject, PipelineError> {
    let colors = MarkerColors::of(vehicle);
    let seen: Vec<Seen> = feeds
        .into_par_iter()
        .map(|feed| balls_of("flight", &colors.balls, feed))
        .collect::<Result<_, _>>()?;
    let marker_of: Vec<Option<usize>> = colors
        .counts()
        .into_iter()
        .enumerate()
        .map(|(color, count)| colors.of_marker.iter().position(|c| *c == color).filter(|_| count == 1))
        .collect();
    let first_ns: Vec<i64> = seen.first().into_iter().flatten().map(|frame| frame.0).collect();
    let intervals_ns = seen.iter().filter_map(|frames| usual_interval_ns(frames.iter().map(|f| f.0)));
    let interval_ns = intervals_ns.max().unwrap_or(0);
    let (mut observations, mut velocities_px_s) = (Vec::new(), Vec::new());
    for (camera, frames) in seen.iter().enumerate() {
        for k in 1..frames.len().saturating_sub(1) {
            let own_ns = frames[k].0;
            let Some(t_ns) = nearest_ns(&first_ns, own_ns, interval_ns / 2) else { continue };
            for (color, marker) in marker_of.iter().enumerate() {
                let Some((marker, (ball, velocity))) = marker.zip(moving(&frames[k - 1..=k + 1], color))
                else {
                    continue;
                };
                let pixel = ball.pixel + velocity * (1e-9 * (t_ns - own_ns) as f64);
                let covariance_px2 = ball.covariance_px2;
                observations.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                velocities_px_s.push(velocity);
            }
        }
    }
    let variances_px2 = observations.iter().map(|o| 0.5 * o.covariance_px2.trace());
    let centres_std_px = (variances_px2.sum::<f64>() / observations.len().max(1) as f64).sqrt();
    // A uniform spread over an interval, half of its variance in each of two cameras.
    let std_s = 1e-9 * interval_ns as f64 / 24f64.sqrt();
    Ok(MovedObject {
        name: "aircraft".to_owned(),
        points: body_markers(vehicle),
        scale_std: 0.0,
        doubt: ObjectDoubt { points_std_m: MARKERS_STD_M, centres_std_px },
        observations,
        lags: (std_s > 0.0).then_some(ObjectLags { std_s, velocities_px_s }),
        images: Vec::new(),
    })
}

/// A ball in the middle one of three frames, and the velocity of its image by the others.
fn moving(frames: &[(i64, Vec<Option<Detection>>)], color: usize) -> Option<(Detection, Vector2<f64>)> {
    let [(from_ns, from), (_, here), (to_ns, to)] = frames else { return None };
    let [from, here, to] = [from, here, to].map(|balls| balls.get(color).copied().flatten());
    let moved_px = to?.pixel - from?.pixel;
    (to_ns > from_ns).then_some((here?, moved_px / (1e-9 * (to_ns - from_ns) as f64)))
}
