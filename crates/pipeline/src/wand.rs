//! A wand from its recordings.

use crate::calibrate::diameter_range_px;
use crate::feed::nearest_ns;
use crate::{CameraFeed, PipelineError, usual_interval_ns};
use mavsight_flight::Color;
use mavsight_pose::{MarkerObservation, MovedObject};
use mavsight_vision::{BallColor, Detection, Tracker};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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

/// What one camera saw: times by its clock as far as that is known, and a ball of each colour.
pub(crate) type Seen = Vec<(i64, Vec<Option<Detection>>)>;

/// Finds both balls in every frame of every camera and joins the cameras in time: a frame of each that is within half an
/// interval of one of the first camera's is of the same instant. Nothing says by how much frames are apart: cameras that are not
/// in step by their stamps see a wand that moves at different places.
///
/// # Errors
/// Sources that fail, colours that cannot be distinguished, a camera without frames.
pub fn wand_of(wand: &Wand, feeds: Vec<Option<CameraFeed<'_>>>) -> Result<MovedObject, PipelineError> {
    let color = |k: usize| BallColor { name: BALL_NAMES[k].to_owned(), rgb: wand.balls[k].color.rgb() };
    let colors = [0, 1].map(color);
    let seen = |feed: Option<_>| feed.map_or_else(|| Ok(Vec::new()), |feed| balls_of("wand", &colors, feed));
    let seen: Vec<Seen> = feeds.into_par_iter().map(seen).collect::<Result<_, _>>()?;
    let balls = [0, 1].map(|k| (BALL_NAMES[k], wand.balls[k].diameter_m));
    Ok(MovedObject::wand(wand.length_m, wand.length_std_m, balls, joined(&seen)))
}

/// The ball of each colour in every frame of a camera.
pub(crate) fn balls_of(
    object: &str,
    colors: &[BallColor],
    feed: CameraFeed<'_>,
) -> Result<Seen, PipelineError> {
    let failed = |source| PipelineError::Vision { place: format!("{object}, {}", feed.name), source };
    let mut tracker: Option<Tracker> = None;
    let mut out = Vec::new();
    for frame in feed.frames {
        let frame = frame?;
        let tracker = match &mut tracker {
            Some(tracker) => tracker,
            None => {
                tracker.insert(Tracker::new(colors, diameter_range_px(frame.frame.size)).map_err(failed)?)
            }
        };
        out.push((feed.clock.clock.time_ns(frame.t_ns), tracker.update_preferred(&frame.frame).to_vec()));
    }
    Ok(out)
}

/// Observations of all cameras under the time stamps of the first camera that has any.
fn joined(seen: &[Seen]) -> Vec<MarkerObservation> {
    let Some(first) = seen.iter().find(|s| !s.is_empty()) else { return Vec::new() };
    let first_ns: Vec<i64> = first.iter().map(|f| f.0).collect();
    let within_ns = usual_interval_ns(first_ns.iter().copied()).map_or(0, |n| n / 2);
    let mut out = Vec::new();
    for (camera, frames) in seen.iter().enumerate() {
        let mut nearest: BTreeMap<i64, (i64, &[Option<Detection>])> = BTreeMap::new();
        for (own_ns, balls) in frames {
            let Some(t_ns) = nearest_ns(&first_ns, *own_ns, within_ns) else { continue };
            let apart_ns = (own_ns - t_ns).abs();
            if nearest.get(&t_ns).is_none_or(|(least_ns, _)| apart_ns < *least_ns) {
                nearest.insert(t_ns, (apart_ns, balls));
            }
        }
        for (t_ns, (_, balls)) in nearest {
            for (marker, ball) in balls.iter().enumerate() {
                let Some(Detection { pixel, covariance_px2, .. }) = *ball else { continue };
                out.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Matrix2, Vector2};

    #[test]
    fn frames_join_with_the_nearest_of_the_first_camera() {
        let first: Seen = (0..4).map(|k| (100 * k, vec![Some(ball(k as f64)), None])).collect();
        // Late by a fifth of a frame; the first of its frames comes before the other camera's.
        let second: Seen = (-1..3).map(|k| (100 * k + 20, vec![None, Some(ball(k as f64))])).collect();
        let joined = joined(&[Vec::new(), first, second]);
        let of = |camera: usize| -> Vec<(i64, f64)> {
            joined.iter().filter(|o| o.camera == camera).map(|o| (o.t_ns, o.pixel.x)).collect()
        };
        assert_eq!(of(1), [(0, 0.0), (100, 1.0), (200, 2.0), (300, 3.0)]);
        assert_eq!(of(2), [(0, 0.0), (100, 1.0), (200, 2.0)]);
    }

    /// Two frames of a camera of twice the rate were two images of one ball at one instant.
    #[test]
    fn of_a_faster_camera_the_nearest_frame_joins() {
        let first: Seen = (0..3).map(|k| (100 * k, vec![None, None])).collect();
        let second: Seen = (0..6).map(|k| (50 * k + 15, vec![Some(ball(k as f64)), None])).collect();
        let all: Vec<(i64, f64)> = joined(&[first, second]).iter().map(|o| (o.t_ns, o.pixel.x)).collect();
        assert_eq!(all, [(0, 0.0), (100, 2.0), (200, 4.0)]);
    }

    fn ball(u: f64) -> Detection {
        Detection {
            pixel: Vector2::new(u, 0.0),
            covariance_px2: Matrix2::identity(),
            area_px: 20.0,
            diameter_px: 5.0,
            score: 1.0,
            color: [0; 3],
        }
    }
}
