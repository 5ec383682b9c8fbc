//! The aircraft in flight as an object that is moved before the cameras, for cameras that see too few control points.

use crate::joined::{JoinedBalls, Seen, balls_of, joined_balls};
use crate::markers::{MARKERS_STD_M, MarkerColors, body_markers};
use crate::{CameraFeed, PipelineError};
use mavsight_flight::Vehicle;
use mavsight_pose::{MovedObject, ObjectDoubt};
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
    let JoinedBalls { observations, lags } = joined_balls(&seen, &marker_of);
    let variances_px2 = observations.iter().map(|o| 0.5 * o.covariance_px2.trace());
    let centres_std_px = (variances_px2.sum::<f64>() / observations.len().max(1) as f64).sqrt();
    Ok(MovedObject {
        name: "aircraft".to_owned(),
        points: body_markers(vehicle),
        scale_std: 0.0,
        doubt: ObjectDoubt { points_std_m: MARKERS_STD_M, centres_std_px },
        observations,
        lags,
        images: Vec::new(),
    })
}
