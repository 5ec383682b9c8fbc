//! Frames of several cameras that are nearest in time, and the balls of a moved object in them.

use crate::calibrate::diameter_range_px;
use crate::{CameraFeed, PipelineError, usual_interval_ns};
use mavsight_geometry::Vector2;
use mavsight_pose::{MarkerObservation, ObjectLags};
use mavsight_vision::{BallColor, Detection, Tracker};
use std::collections::BTreeMap;

/// What one camera saw: times by its clock as far as that is known, and a ball of each colour.
pub(crate) type Seen = Vec<(i64, Vec<Option<Detection>>)>;

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

/// Balls of all cameras under the time stamps of the first camera that has any.
pub(crate) struct JoinedBalls {
    /// Each where it was at that time, by the velocity of its image.
    pub(crate) observations: Vec<MarkerObservation>,
    /// What the cameras may be out of step by within a frame interval.
    pub(crate) lags: Option<ObjectLags>,
}

/// Joins the frames that are nearest in time, to within half of the slowest camera's interval. Balls that a neighbouring
/// frame does not show are left out, as their velocity is not known.
pub(crate) fn joined_balls(seen: &[Seen], marker_of: &[Option<usize>]) -> JoinedBalls {
    let times_ns = |frames: &Seen| -> Vec<i64> { frames.iter().map(|f| f.0).collect() };
    let first_ns = seen.iter().find(|s| !s.is_empty()).map_or_else(Vec::new, times_ns);
    let intervals_ns = seen.iter().filter_map(|frames| usual_interval_ns(times_ns(frames)));
    let interval_ns = intervals_ns.max().unwrap_or(0);
    let (mut observations, mut velocities_px_s) = (Vec::new(), Vec::new());
    for (camera, frames) in seen.iter().enumerate() {
        let joined = joined_to(&first_ns, &times_ns(frames), interval_ns / 2);
        for (k, t_ns) in joined.iter().enumerate() {
            let (Some(t_ns), Some(three)) =
                (*t_ns, k.checked_sub(1).and_then(|from| frames.get(from..=k + 1)))
            else {
                continue;
            };
            let early_s = 1e-9 * (t_ns - frames[k].0) as f64;
            for (color, marker) in marker_of.iter().enumerate() {
                let Some((marker, (ball, velocity))) = marker.zip(moving(three, color)) else { continue };
                let (pixel, covariance_px2) = (ball.pixel + velocity * early_s, ball.covariance_px2);
                observations.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                velocities_px_s.push(velocity);
            }
        }
    }
    let std_s = lag_std_s(interval_ns);
    JoinedBalls { observations, lags: (std_s > 0.0).then_some(ObjectLags { std_s, velocities_px_s }) }
}

/// A ball in the middle one of three frames, and the velocity of its image by the others.
fn moving(frames: &[(i64, Vec<Option<Detection>>)], color: usize) -> Option<(Detection, Vector2<f64>)> {
    let [(from_ns, from), (_, here), (to_ns, to)] = frames else { return None };
    let [from, here, to] = [from, here, to].map(|balls| balls.get(color).copied().flatten());
    let moved_px = to?.pixel - from?.pixel;
    (to_ns > from_ns).then_some((here?, moved_px / (1e-9 * (to_ns - from_ns) as f64)))
}

/// For each of a camera's times, the time of a grid in rising order that it joins: of several that are nearest to one
/// time of the grid the nearest, if it is within so much of it.
pub(crate) fn joined_to(grid_ns: &[i64], times_ns: &[i64], within_ns: i64) -> Vec<Option<i64>> {
    let mut nearest: BTreeMap<i64, usize> = BTreeMap::new();
    for (k, own_ns) in times_ns.iter().enumerate() {
        let Some(t_ns) = nearest_ns(grid_ns, *own_ns, within_ns) else { continue };
        let best = nearest.entry(t_ns).or_insert(k);
        if (own_ns - t_ns).abs() < (times_ns[*best] - t_ns).abs() {
            *best = k;
        }
    }
    let mut out = vec![None; times_ns.len()];
    nearest.into_iter().for_each(|(t_ns, k)| out[k] = Some(t_ns));
    out
}

/// The standard deviation of each camera's lag where frames join that are nearest in time: a uniform spread over an
/// interval, half of whose variance is of each of two cameras.
pub(crate) fn lag_std_s(interval_ns: i64) -> f64 {
    1e-9 * interval_ns as f64 / 24f64.sqrt()
}

/// The nearest to a time of times in rising order, if it is within so much of it.
fn nearest_ns(times_ns: &[i64], t_ns: i64, within_ns: i64) -> Option<i64> {
    let after = times_ns.partition_point(|t| *t < t_ns);
    let near = times_ns.get(after.saturating_sub(1)..times_ns.len().min(after + 1))?;
    let nearest = near.iter().copied().min_by_key(|t| (t - t_ns).abs())?;
    ((nearest - t_ns).abs() <= within_ns).then_some(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::Matrix2;

    /// A ball whose image moves by one pixel in 100 ns, from so many nanoseconds on, every so often.
    fn seen(from_ns: i64, step_ns: i64, count: i64) -> Seen {
        let frame = |k: i64| from_ns + k * step_ns;
        (0..count).map(|k| (frame(k), vec![Some(ball(0.01 * frame(k) as f64)), None])).collect()
    }

    fn joined(seen: &[Seen]) -> Vec<(usize, i64, f64)> {
        let JoinedBalls { observations, .. } = joined_balls(seen, &[Some(0), Some(1)]);
        let rounded = |px: f64| (px * 1e6).round() * 1e-6;
        observations.iter().map(|o| (o.camera, o.t_ns, rounded(o.pixel.x))).collect()
    }

    #[test]
    fn balls_are_where_they_were_at_the_nearest_time_of_the_first_camera() {
        // Late by a fifth of a frame; the first of its frames comes before the other camera's.
        let all = joined(&[Vec::new(), seen(0, 100, 5), seen(-80, 100, 5)]);
        let own = [(1, 100, 1.0), (1, 200, 2.0), (1, 300, 3.0), (2, 0, 0.0), (2, 100, 1.0), (2, 200, 2.0)];
        assert_eq!(all, own);
    }

    /// Two frames of a camera of twice the rate were two images of one ball at one instant.
    #[test]
    fn of_a_faster_camera_the_nearest_frame_joins() {
        let all = joined(&[seen(0, 100, 4), seen(-35, 50, 9)]);
        assert_eq!(
            all,
            [(0, 100, 1.0), (0, 200, 2.0), (1, 0, 0.0), (1, 100, 1.0), (1, 200, 2.0), (1, 300, 3.0)]
        );
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
