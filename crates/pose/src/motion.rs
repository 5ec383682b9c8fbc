//! The smoothed motion.

use mavsight_geometry::{EulerAngles, Isometry3, Matrix3, Matrix6, Vector3};
use nalgebra::SMatrix;

/// State of motion at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSample {
    /// Time of the pose it belongs to.
    pub t_ns: i64,
    /// Smoothed pose.
    pub world_from_body: Isometry3<f64>,
    /// u, v, w.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// What an accelerometer at the body's origin reads: a_x = u̇ + q w - r v + g sin θ; (0, 0, -g) in level hover.
    pub specific_force_m_s2: Vector3<f64>,
    /// ṗ, q̇, ṙ.
    pub angular_acceleration_rad_s2: Vector3<f64>,
    /// Covariance in threes: position (world axes), turn (body axes, R exp δ), velocity (body), rates, specific force,
    /// angular acceleration. SI units.
    pub covariance: SMatrix<f64, 18, 18>,
}

/// A smoothed flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// One per pose sample, measured or not.
    pub samples: Vec<MotionSample>,
    /// Frequency at which the smoother passes one half of a position: H = 1/(1 + (f/fc)⁶).
    pub translation_bandwidth_hz: f64,
    /// The same for a rotation.
    pub rotation_bandwidth_hz: f64,
    /// Median interval of the samples.
    pub sample_interval_s: f64,
}

/// Standard deviations of roll, pitch and yaw from the covariance of a small turn about body axes.
///
/// Infinite or very large for roll and yaw near a pitch of ±90°, where they cannot be told apart.
pub fn euler_std(world_from_body: &Isometry3<f64>, covariance_in_body_rad2: &Matrix3<f64>) -> Vector3<f64> {
    let jacobian = EulerAngles::from_world_from_body(world_from_body).rates_from_body_rates();
    (jacobian * covariance_in_body_rad2 * jacobian.transpose()).diagonal().map(|v| v.max(0.0).sqrt())
}

/// Covariance of position (world axes) and of a small turn about body axes, from standard deviations of x, y, z, roll, pitch and yaw that
/// are independent.
///
/// At a pitch of ±90° the angles say nothing about the turn: they are then taken as the turn itself.
pub fn covariance_from_std(world_from_body: &Isometry3<f64>, stds: &[f64; 6]) -> Matrix6<f64> {
    let var = stds.map(|s| s * s);
    let mut covariance = Matrix6::from_diagonal(&var.into());
    let euler = Matrix3::from_diagonal(&Vector3::new(var[3], var[4], var[5]));
    let rates = EulerAngles::from_world_from_body(world_from_body).rates_from_body_rates();
    let turn = rates.try_inverse().map(|j| j * euler * j.transpose());
    let turn = turn.filter(|t| t.iter().all(|x| x.is_finite())).unwrap_or(euler);
    covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    covariance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{normal, normal3};
    use mavsight_geometry::{UnitQuaternion, world_from_body};

    #[test]
    fn euler_std_is_the_spread_of_many_turns() {
        let angles = EulerAngles { phi_rad: 0.5, theta_rad: -0.8, psi_rad: 2.0 };
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), angles);
        let std = Vector3::new(0.01, 0.02, 0.005);
        let claimed = euler_std(&pose, &Matrix3::from_diagonal(&std.component_mul(&std)));
        let (mut seed, trials) = (3, 20_000);
        let mut sum = Vector3::zeros();
        assert!(normal(&mut seed).is_finite());
        for _ in 0..trials {
            let turn = UnitQuaternion::from_scaled_axis(normal3(&mut seed).component_mul(&std));
            let turned = Isometry3::from_parts(pose.translation, pose.rotation * turn);
            let got = EulerAngles::from_world_from_body(&turned);
            let error = Vector3::new(
                got.phi_rad - angles.phi_rad,
                got.theta_rad - angles.theta_rad,
                got.psi_rad - angles.psi_rad,
            );
            sum += error.component_mul(&error);
        }
        let spread = (sum / f64::from(trials)).map(f64::sqrt);
        assert!(((spread - claimed).component_div(&claimed)).amax() < 0.03, "{spread} against {claimed}");
    }

    #[test]
    fn standard_deviations_survive_the_way_there_and_back() {
        let stds = [1e-3, 2e-3, 3e-3, 0.01, 0.02, 0.005];
        let angles = EulerAngles { phi_rad: 0.5, theta_rad: -0.8, psi_rad: 2.0 };
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), angles);
        let covariance = covariance_from_std(&pose, &stds);
        assert!((0..3).all(|k| (covariance[(k, k)].sqrt() - stds[k]).abs() < 1e-12));
        let back = euler_std(&pose, &covariance.fixed_view::<3, 3>(3, 3).into_owned());
        assert!((0..3).all(|k| (back[k] - stds[3 + k]).abs() < 1e-12), "{back}");
        let upright = EulerAngles { theta_rad: std::f64::consts::FRAC_PI_2, ..angles };
        let level = covariance_from_std(&world_from_body(Vector3::zeros(), upright), &stds);
        assert!(level.iter().all(|x| x.is_finite()));
    }
}
