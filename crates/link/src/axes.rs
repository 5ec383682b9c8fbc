//! Poses in the axes of other programs.

use crate::{BodyAxes, Fix, Measured, Moving};
use mavsight_geometry::{
    EulerAngles, Isometry3, Matrix3, Matrix6, UnitQuaternion, Vector3, world_from_level,
};

/// A pose and its covariance in the level frame N (x forward, y right, z down: MAVLink's LOCAL_FRD).
pub(crate) struct LevelPose {
    pub(crate) level_from_body: Isometry3<f64>,
    /// Of position in level axes (m²), then of roll, pitch and yaw (rad²).
    pub(crate) covariance: Matrix6<f64>,
}

/// Nearer to ±90° of pitch than this cosine, roll and yaw have variances as if at it: large, but finite.
const LEAST_COS_PITCH: f64 = 1e-3;

/// The pose in the level frame. Roll, pitch and yaw move with a small turn δ about body axes as E(φ, θ) δ
/// (equation 1c of the paper).
pub(crate) fn level_pose(measured: &Measured) -> LevelPose {
    let level_from_world = world_from_level().inverse();
    let level_from_body = level_from_world * measured.world_from_body;
    let mut euler = EulerAngles::from_level_from_body(&level_from_body.rotation);
    if euler.theta_rad.cos() < LEAST_COS_PITCH {
        euler.theta_rad = LEAST_COS_PITCH.acos().copysign(euler.theta_rad);
    }
    let turn: Matrix3<f64> = level_from_world.to_rotation_matrix().into_inner();
    let mut change = Matrix6::zeros();
    change.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    change.fixed_view_mut::<3, 3>(3, 3).copy_from(&euler.rates_from_body_rates());
    LevelPose { level_from_body, covariance: change * measured.covariance * change.transpose() }
}

/// The 21 elements of the upper triangle, row by row.
pub fn upper_triangle(m: &Matrix6<f64>) -> [f64; 21] {
    let mut places = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
    std::array::from_fn(|_| places.next().map_or(0.0, |at| m[at]))
}

impl BodyAxes {
    fn frd_from_these(self) -> UnitQuaternion<f64> {
        match self {
            Self::Flu => world_from_level(),
            Self::Frd => UnitQuaternion::identity(),
        }
    }

    /// The pose of a body with these axes, in the same world.
    pub(crate) fn pose(self, world_from_body: &Isometry3<f64>) -> Isometry3<f64> {
        let turned = world_from_body.rotation * self.frd_from_these();
        Isometry3::from_parts(world_from_body.translation, turned)
    }

    /// A point of the body in these axes.
    pub(crate) fn point(self, in_body_m: [f64; 3]) -> Vector3<f64> {
        self.frd_from_these().inverse() * Vector3::from(in_body_m)
    }
}

/// The pose, where there is one and all that would be sent of it is a number.
pub(crate) fn sound(fix: &Fix) -> Option<&Measured> {
    fix.measured.as_ref().filter(|m| {
        m.world_from_body.translation.vector.iter().all(|v| v.is_finite())
            && m.world_from_body.rotation.coords.iter().all(|v| v.is_finite())
            && m.covariance.iter().all(|v| v.is_finite())
    })
}

/// The motion, where it is known and all that would be sent of it is a number.
pub(crate) fn sound_motion(measured: &Measured) -> Option<&Moving> {
    measured.moving.as_ref().filter(|m| {
        let values = m.velocity_in_body_m_s.iter().chain(m.rates_rad_s.iter()).chain(m.covariance.iter());
        values.into_iter().all(|v| v.is_finite())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::measured;
    use mavsight_geometry::world_from_body;

    fn euler(phi: f64, theta: f64, psi: f64) -> EulerAngles {
        EulerAngles { phi_rad: phi, theta_rad: theta, psi_rad: psi }
    }

    /// PX4's and MAVROS's own numbers for yaw 30°, pitch 10°, roll -5°.
    #[test]
    fn the_check_value_of_px4() {
        let angles = euler((-5f64).to_radians(), 10f64.to_radians(), 30f64.to_radians());
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), angles);
        let level = level_pose(&measured(pose, Matrix6::identity())).level_from_body;
        let q = level.rotation;
        for (a, b) in [q.w, q.i, q.j, q.k].iter().zip([0.9604, -0.0645, 0.0729, 0.2613]) {
            assert!((a * q.w.signum() - b).abs() < 6e-5, "{q}");
        }
        assert!((level.translation.vector - Vector3::new(1.0, -2.0, -3.0)).norm() < 1e-12);
    }

    /// Level and nose along X: nothing is turned. Nose along -Y: a turn of -90° about Z.
    #[test]
    fn forward_left_up_turns_about_z_alone() {
        for psi in [0.0, std::f64::consts::FRAC_PI_2] {
            let pose = BodyAxes::Flu.pose(&world_from_body(Vector3::zeros(), euler(0.0, 0.0, psi)));
            let want = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -psi);
            assert!(pose.rotation.angle_to(&want) < 1e-12, "{psi}");
        }
        assert!((BodyAxes::Flu.point([1.0, 2.0, 3.0]) - Vector3::new(1.0, -2.0, -3.0)).norm() < 1e-12);
        assert!((BodyAxes::Frd.point([1.0, 2.0, 3.0]) - Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
    }

    /// The covariance is J P Jᵀ with J from differences of the angles and positions themselves.
    #[test]
    fn covariance_goes_by_the_derivative() {
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), euler(0.4, -0.6, 2.0));
        let root =
            Matrix6::from_fn(|i, j| 0.01 * ((i * 5 + j * 3) % 7) as f64 + if i == j { 0.05 } else { 0.0 });
        let covariance = root * root.transpose();
        let at = |d: &nalgebra::Vector6<f64>| {
            let turn = UnitQuaternion::from_scaled_axis(d.fixed_rows::<3>(3).into_owned());
            let moved = pose.translation.vector + d.fixed_rows::<3>(0);
            let level =
                world_from_level().inverse() * Isometry3::from_parts(moved.into(), pose.rotation * turn);
            let e = EulerAngles::from_level_from_body(&level.rotation);
            let p = level.translation.vector;
            nalgebra::Vector6::new(p.x, p.y, p.z, e.phi_rad, e.theta_rad, e.psi_rad)
        };
        let h = 1e-6;
        let mut j = Matrix6::zeros();
        for k in 0..6 {
            let mut d = nalgebra::Vector6::zeros();
            d[k] = h;
            j.set_column(k, &((at(&d) - at(&-d)) / (2.0 * h)));
        }
        let got = level_pose(&measured(pose, covariance)).covariance;
        assert!((got - j * covariance * j.transpose()).norm() < 1e-9, "{got}");
        let upper = upper_triangle(&got);
        for (k, (a, b)) in [(0, (0, 0)), (5, (0, 5)), (6, (1, 1)), (15, (3, 3)), (17, (3, 5)), (20, (5, 5))] {
            assert_eq!(upper[k], got[(a, b)]);
        }
    }

    #[test]
    fn straight_up_is_finite() {
        for theta in [1.0, -1.0] {
            let pose =
                world_from_body(Vector3::zeros(), euler(0.0, theta * std::f64::consts::FRAC_PI_2, 0.0));
            let covariance = level_pose(&measured(pose, Matrix6::identity() * 1e-4)).covariance;
            assert!(covariance.iter().all(|v| v.is_finite()) && covariance[(5, 5)] > 10.0);
        }
    }
}
