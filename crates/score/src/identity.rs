//! Correctness of associations, and the share of measurable frames with a pose.

use crate::truth_at;
use mavsight_geometry::{Point3, Vector3};
use mavsight_pose::PoseSample;
use mavsight_simulator::FlightState;
use serde::Serialize;

/// Share of a ball's face from which it counts as visible.
const VISIBLE_SHARE: f64 = 0.75;
/// Standard deviations that a marker may be off in addition to its radius.
const MOST_STD: f64 = 4.0;

/// Numbers of frames by result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct IdentityScore {
    /// Instants with a truth.
    pub frames: usize,
    /// Of those, instants in which three balls are visible to two cameras.
    pub measurable: usize,
    /// Of those, instants with a pose.
    pub measured: usize,
    /// Poses with a used marker off its ball by more than its radius and four standard deviations.
    pub wrong: usize,
    /// Poses equal to the one before to the last digit.
    pub frozen: usize,
}

/// Judges the identities of poses. Markers are places on the body and radii; `visible` holds the share of
/// each ball's face that each camera sees, by instant of the truth, camera and marker.
pub fn score_identity(
    poses: &[PoseSample],
    truth: &[FlightState],
    markers: &[(Vector3<f64>, f64)],
    visible: &[Vec<Vec<f64>>],
) -> IdentityScore {
    let mut score = IdentityScore::default();
    let mut before = None;
    for sample in poses {
        let t_s = sample.t_ns as f64 * 1e-9;
        let Some(row) = truth_at(truth, t_s) else { continue };
        score.frames += 1;
        let index = truth.partition_point(|r| r.t_s < row.t_s);
        let measurable = visible.get(index).is_some_and(|cameras| is_measurable(cameras, markers.len()));
        score.measurable += usize::from(measurable);
        let Ok(estimate) = &sample.estimate else { continue };
        score.measured += usize::from(measurable);
        let real = row.pose();
        let std2 = |from: usize| estimate.covariance().fixed_view::<3, 3>(from, from).trace();
        let is_off = |marker: usize| {
            let Some((place, radius_m)) = markers.get(marker) else { return true };
            let at = Point3::from(*place);
            let std_m = (std2(0) + std2(3) * place.norm_squared()).sqrt();
            (estimate.world_from_body * at - real * at).norm() > radius_m + MOST_STD * std_m
        };
        score.wrong += usize::from(estimate.markers_used.iter().any(is_off));
        score.frozen += usize::from(before == Some(estimate.world_from_body));
        before = Some(estimate.world_from_body);
    }
    score
}

/// Whether three balls are visible to two cameras each.
fn is_measurable(cameras: &[Vec<f64>], markers: usize) -> bool {
    let seen = |m: &usize| cameras.iter().filter(|c| c.get(*m).is_some_and(|s| *s >= VISIBLE_SHARE)).count();
    (0..markers).filter(|m| seen(m) > 1).count() > 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{EulerAngles, Isometry3, Matrix6, world_from_body};
    use mavsight_pose::PoseEstimate;

    #[test]
    fn wrong_and_frozen_poses_are_counted() {
        let truth: Vec<FlightState> = (0..5)
            .map(|k| FlightState {
                t_s: f64::from(k),
                position_in_world_m: Vector3::x() * (0.1 * f64::from(k)),
                ..Default::default()
            })
            .collect();
        let markers = [[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2]].map(|[x, y]| (Vector3::new(x, y, 0.0), 0.025));
        let real = |k: usize| world_from_body(Vector3::new(0.1 * k as f64, 0.0, 0.0), EulerAngles::default());
        let sample = |k: usize, pose: Option<Isometry3<f64>>| PoseSample {
            t_ns: k as i64 * 1_000_000_000,
            estimate: pose.ok_or(mavsight_pose::PoseError::NotMeasured).map(|world_from_body| {
                PoseEstimate::new(world_from_body, &(Matrix6::identity() * 1e-8)).by_markers(
                    (0..3).collect(),
                    Default::default(),
                    Some(0.1),
                )
            }),
        };
        // Right; a quarter turn, as of balls that changed places; none; the one of the third second again;
        // not to be measured.
        let turned = real(1) * nalgebra::UnitQuaternion::from_scaled_axis(Vector3::z() * 1.571);
        let poses = [
            sample(0, Some(real(0))),
            sample(1, Some(turned)),
            sample(2, None),
            sample(3, Some(turned)),
            sample(4, Some(real(4))),
        ];
        let mut visible = vec![vec![vec![1.0; 3]; 2]; 5];
        visible[4][1][2] = 0.5;
        let score = score_identity(&poses, &truth, &markers, &visible);
        assert_eq!(score, IdentityScore { frames: 5, measurable: 4, measured: 3, wrong: 2, frozen: 1 });
    }
}
