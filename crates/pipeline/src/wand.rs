//! A wand from its recordings.

use crate::joined::{JoinedBalls, Seen, balls_of, joined_balls};
use crate::{CameraFeed, PipelineError};
use mavsight_flight::Color;
use mavsight_pose::MovedObject;
use mavsight_vision::BallColor;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Two balls on a stick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wand {
    /// Distance between their centres.
    pub length_m: f64,
    /// Standard deviation of that.
    pub length_std_m: f64,
    /// The balls, of unlike colours.
    pub balls: [WandBall; 2],
}

/// A ball of a wand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WandBall {
    /// Nominal colour.
    pub color: Color,
    /// Diameter.
    pub diameter_m: f64,
}

const BALL_NAMES: [&str; 2] = ["first ball", "second ball"];

/// Finds both balls in every frame of every camera, and joins the frames that are nearest in time; their lags within a
/// frame interval are left to the calibration, with the velocities of the balls.
///
/// # Errors
/// Sources that fail, colours that cannot be distinguished, a camera without frames.
pub fn wand_of(wand: &Wand, feeds: Vec<Option<CameraFeed<'_>>>) -> Result<MovedObject, PipelineError> {
    let color = |k: usize| BallColor { name: BALL_NAMES[k].to_owned(), rgb: wand.balls[k].color.rgb() };
    let colors = [0, 1].map(color);
    let seen = |feed: Option<_>| feed.map_or_else(|| Ok(Vec::new()), |feed| balls_of("wand", &colors, feed));
    let seen: Vec<Seen> = feeds.into_par_iter().map(seen).collect::<Result<_, _>>()?;
    let balls = [0, 1].map(|k| (BALL_NAMES[k], wand.balls[k].diameter_m));
    let JoinedBalls { observations, lags } = joined_balls(&seen, &[Some(0), Some(1)]);
    Ok(MovedObject { lags, ..MovedObject::wand(wand.length_m, wand.length_std_m, balls, observations) })
}
