//! What an encoder leaves open that predicts frames from those before and after them.

use crate::statistics::median;
use crate::{PoseEstimate, PoseSample};
use mavsight_geometry::Vector3;
use nalgebra::{Matrix3, Vector6};

/// Measured poses about one from which its second difference is taken: a parabola through seven has a standard deviation of a
/// ninth of a pose's there (least squares; the sum of squares of its weights is 1/84).
const WINDOW: usize = 7;
/// At least so many poses, which determine a parabola with something to spare.
const LEAST: usize = 5;
/// Poses further away belong to another motion.
const LONGEST_S: f64 = 0.5;

/// How far each pose may be displaced because its frames show the mean of their neighbours: one direction in which all poses of a
/// flight err together, as one standard deviation. Position in world axes (m), then a small turn about body axes (rad); zero for a
/// pose without enough neighbours, and where the motion is steady.
///
/// A frame that an encoder predicts from both sides (ITU-T H.264, 8.4.2.3: B slices) and whose residual it drops shows each ball
/// at the mean of where it is in the two frames: half a second difference of its motion from where it was. As all balls of a
/// frame share that, the pose is displaced by half the second difference of the poses, one frame apart. What share of it an
/// encoder drops depends on its bit rate and is much the same over a flight: this is a systematic error, which neither averages
/// out nor says that a pose is worse than its neighbours.
pub fn displacements_of_reordered_frames(poses: &[PoseSample]) -> Vec<Vector6<f64>> {
    let mut displaced = vec![Vector6::zeros(); poses.len()];
    let intervals_s = poses.windows(2).map(|w| (w[1].t_ns - w[0].t_ns) as f64 * 1e-9).collect();
    let Some(interval_s) = median(intervals_s) else { return displaced };
    let measured: Vec<usize> = (0..poses.len()).filter(|k| poses[*k].estimate.is_ok()).collect();
    for (k, pose) in measured.iter().enumerate() {
        if let Some(by) = half_second_difference(poses, &measured, k, interval_s) {
            displaced[*pose] = by;
        }
    }
    displaced
}

fn seconds(poses: &[PoseSample], k: usize) -> f64 {
    poses[k].t_ns as f64 * 1e-9
}

/// The curvature of a parabola through a pose and its neighbours, times the square of the interval: position in the world, turn
/// about the body's axes.
fn half_second_difference(
    poses: &[PoseSample],
    measured: &[usize],
    at: usize,
    interval_s: f64,
) -> Option<Vector6<f64>> {
    let estimate = |k: usize| -> Option<&PoseEstimate> { poses[k].estimate.as_ref().ok() };
    let own = estimate(measured[at])?.world_from_body;
    let own_s = seconds(poses, measured[at]);
    let first = at.saturating_sub(WINDOW / 2).min(measured.len().saturating_sub(WINDOW));
    let near = &measured[first..(first + WINDOW).min(measured.len())];
    let (mut information, mut right) = (Matrix3::zeros(), [Vector3::zeros(); 6]);
    let mut count = 0;
    for k in near {
        let since = seconds(poses, *k) - own_s;
        if since.abs() > LONGEST_S {
            continue;
        }
        let pose = estimate(*k)?.world_from_body;
        let t = since / interval_s;
        let powers = Vector3::new(1.0, t, t * t);
        information += powers * powers.transpose();
        let place = pose.translation.vector - own.translation.vector;
        let turn = (own.rotation.inverse() * pose.rotation).scaled_axis();
        for (axis, value) in place.iter().chain(&turn).enumerate() {
            right[axis] += powers * *value;
        }
        count += 1;
    }
    if count < LEAST {
        return None;
    }
    let covariance = information.try_inverse()?;
    Some(Vector6::from_fn(|axis, _| (covariance * right[axis])[2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PoseError;
    use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion};

    const INTERVAL_S: f64 = 1.0 / 30.0;

    fn poses(acceleration_m_s2: f64, turn_rad_s2: f64) -> Vec<PoseSample> {
        let pose = |k: i64| {
            let t_s = k as f64 * INTERVAL_S;
            let place = Vector3::new(0.5 * acceleration_m_s2 * t_s * t_s, 0.7 * t_s, 1.0);
            let turn = Vector3::y() * (0.5 * turn_rad_s2 * t_s * t_s + 0.2 * t_s);
            let pose = Isometry3::from_parts(place.into(), UnitQuaternion::from_scaled_axis(turn));
            let estimate = PoseEstimate::new(pose, &(Matrix6::identity() * 1e-8));
            PoseSample {
                t_ns: (t_s * 1e9).round() as i64,
                estimate: (k % 6 != 3).then_some(estimate).ok_or(PoseError::NotMeasured),
            }
        };
        (0..20).map(pose).collect()
    }

    /// The mean of two neighbours of a motion of constant acceleration is half of it, times the interval squared, off.
    #[test]
    fn an_accelerated_motion_may_be_off_by_the_mean_of_its_neighbours() {
        let all = poses(2.0, 3.0);
        let displaced = displacements_of_reordered_frames(&all);
        for (by, _) in displaced.iter().zip(&all).filter(|(_, p)| p.estimate.is_ok()) {
            let (place_m, turn_rad) = (0.5 * 2.0 * INTERVAL_S.powi(2), 0.5 * 3.0 * INTERVAL_S.powi(2));
            assert!((by[0] / place_m - 1.0).abs() < 1e-3 && (by[4] / turn_rad - 1.0).abs() < 1e-3, "{by}");
            assert!(by[1].abs() < 1e-3 * place_m && by[3].abs() < 1e-3 * turn_rad, "{by}");
        }
    }

    #[test]
    fn a_steady_motion_and_few_poses_are_displaced_by_nothing() {
        let displaced = displacements_of_reordered_frames(&poses(0.0, 0.0));
        assert!(displaced.len() == 20 && displaced.iter().all(|by| by.amax() < 1e-7));
        assert!(displacements_of_reordered_frames(&[]).is_empty());
        assert_eq!(displacements_of_reordered_frames(&poses(2.0, 3.0)[..3]), [Vector6::zeros(); 3]);
    }
}
