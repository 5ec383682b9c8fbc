//! Turns between measured poses.

use mavsight_geometry::{Matrix3, UnitQuaternion};
use mavsight_pose::PoseSample;

/// Poses further apart are not compared: the gyroscope's own errors add up meanwhile.
const LONGEST_S: f64 = 0.5;

/// The turn from one pose to the next.
#[derive(Debug, Clone)]
pub(super) struct PoseTurn {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    /// The later body's attitude in the earlier body's axes.
    pub(super) turned: UnitQuaternion<f64>,
    /// Of the poses' attitudes, each about its own body axes: what is new in each.
    before_rad2: Matrix3<f64>,
    after_rad2: Matrix3<f64>,
}

impl PoseTurn {
    fn back(&self) -> Matrix3<f64> {
        self.turned.inverse().to_rotation_matrix().into_inner()
    }

    /// Of the turn, about the later body's axes.
    pub(super) fn covariance(&self) -> Matrix3<f64> {
        let back = self.back();
        back * self.before_rad2 * back.transpose() + self.after_rad2
    }

    /// Covariance of the turn before, which ends at the pose where this one begins, with this one.
    pub(super) fn shared_with_before(&self) -> Matrix3<f64> {
        -self.before_rad2 * self.back().transpose()
    }
}

/// The turns between poses that follow each other.
pub(super) fn pose_turns(poses: &[PoseSample]) -> Vec<PoseTurn> {
    let measured: Vec<_> = poses.iter().filter_map(|p| Some((p.t_ns, p.estimate.as_ref().ok()?))).collect();
    let turn = |pair: &[(i64, &mavsight_pose::PoseEstimate)]| {
        let [(from_ns, before), (to_ns, after)] = [pair[0], pair[1]];
        let attitude =
            |e: &mavsight_pose::PoseEstimate| e.own_covariance().fixed_view::<3, 3>(3, 3).into_owned();
        PoseTurn {
            from_s: from_ns as f64 * 1e-9,
            to_s: to_ns as f64 * 1e-9,
            turned: before.world_from_body.rotation.inverse() * after.world_from_body.rotation,
            before_rad2: attitude(before),
            after_rad2: attitude(after),
        }
    };
    let all = measured.windows(2).map(turn);
    all.filter(|t| t.to_s > t.from_s && t.to_s - t.from_s <= LONGEST_S).collect()
}
