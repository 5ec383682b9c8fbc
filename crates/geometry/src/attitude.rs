//! Euler angles of the aerospace 3-2-1 sequence and the turn between world and level axes.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Roll, pitch and yaw of the 3-2-1 sequence: v_N = Rz(psi) Ry(theta) Rx(phi) v_B, from body B to level axes
/// N.
///
/// psi > 0 turns the nose from world +X towards -Y, theta > 0 lifts it, phi > 0 lowers the right side.
/// Source: Mulyanto, Nurhakim, Muhammad (2012), equation 1b.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EulerAngles {
    /// Roll.
    pub phi_rad: f64,
    /// Pitch, from -pi/2 to pi/2.
    pub theta_rad: f64,
    /// Yaw.
    pub psi_rad: f64,
}

impl EulerAngles {
    /// The rotation that takes body components into level components.
    pub fn level_from_body(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(self.phi_rad, self.theta_rad, self.psi_rad)
    }

    /// The angles of a rotation from body to level axes. At theta = ±pi/2 only phi - psi or phi + psi is
    /// determined, and phi is returned as 0.
    pub fn from_level_from_body(level_from_body: &UnitQuaternion<f64>) -> Self {
        let r = level_from_body.to_rotation_matrix().into_inner();
        let sin_theta = (-r[(2, 0)]).clamp(-1.0, 1.0);
        let cos_theta = r[(0, 0)].hypot(r[(1, 0)]);
        let theta_rad = sin_theta.atan2(cos_theta);
        if cos_theta < 1e-9 {
            return Self { phi_rad: 0.0, theta_rad, psi_rad: (-r[(0, 1)]).atan2(r[(1, 1)]) };
        }
        Self { phi_rad: r[(2, 1)].atan2(r[(2, 2)]), theta_rad, psi_rad: r[(1, 0)].atan2(r[(0, 0)]) }
    }

    /// The angles of a pose in the world.
    pub fn from_world_from_body(world_from_body: &Isometry3<f64>) -> Self {
        Self::from_level_from_body(&(world_from_level().inverse() * world_from_body.rotation))
    }

    /// d(phi, theta, psi)/dt = E(phi, theta) (p, q, r): equation 1c of the paper. Infinite at theta = ±pi/2.
    pub fn rates_from_body_rates(&self) -> Matrix3<f64> {
        let (sp, cp) = self.phi_rad.sin_cos();
        let (tan_theta, cos_theta) = (self.theta_rad.tan(), self.theta_rad.cos());
        Matrix3::new(1.0, sp * tan_theta, cp * tan_theta, 0.0, cp, -sp, 0.0, sp / cos_theta, cp / cos_theta)
    }
}

/// The half turn about X between level axes N (z down) and world axes W (Z up).
pub fn world_from_level() -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0))
}

/// The pose of a body whose origin is at `position_in_world_m` with the given attitude.
pub fn world_from_body(position_in_world_m: Vector3<f64>, attitude: EulerAngles) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(position_in_world_m),
        world_from_level() * attitude.level_from_body(),
    )
}

/// The right Jacobian of SO(3): exp(φ + δ) = exp(φ) exp(J_r(φ) δ) to first order (Chirikjian 2012, eq.
/// 10.86).
pub fn right_jacobian(phi_rad: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi_rad.norm();
    let k = phi_rad.cross_matrix();
    let (a, b) = if angle < 1e-4 {
        (0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0)
    } else {
        ((1.0 - angle.cos()) / (angle * angle), (angle - angle.sin()) / angle.powi(3))
    };
    Matrix3::identity() - k * a + k * k * b
}

/// A rotation as a plain matrix.
pub fn matrix_of(rotation: &UnitQuaternion<f64>) -> Matrix3<f64> {
    Rotation3::from(*rotation).into_inner()
}

/// The rotation of a matrix that is orthonormal with determinant 1, which is not checked.
pub fn rotation_of(matrix: Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    #[test]
    fn signs_are_those_of_the_conventions() {
        let nose = |e: EulerAngles| world_from_body(Vector3::zeros(), e).rotation * Vector3::x();
        let right = |e: EulerAngles| world_from_body(Vector3::zeros(), e).rotation * Vector3::y();
        assert!(
            nose(EulerAngles { psi_rad: 0.1, ..Default::default() }).y < -0.09,
            "psi > 0: nose towards -Y"
        );
        assert!(
            nose(EulerAngles { theta_rad: 0.1, ..Default::default() }).z > 0.09,
            "theta > 0 lifts the nose"
        );
        assert!(
            right(EulerAngles { phi_rad: 0.1, ..Default::default() }).z < -0.09,
            "phi > 0 lowers the right"
        );
    }

    #[test]
    fn matches_the_matrix_printed_in_equation_1b() {
        let e = EulerAngles { phi_rad: 0.3, theta_rad: -0.5, psi_rad: 1.1 };
        let (sf, cf) = e.phi_rad.sin_cos();
        let (st, ct) = e.theta_rad.sin_cos();
        let (sp, cp) = e.psi_rad.sin_cos();
        let printed = Matrix3::new(
            ct * cp,
            sf * st * cp - cf * sp,
            cf * st * cp + sf * sp,
            ct * sp,
            sf * st * sp + cf * cp,
            cf * st * sp - sf * cp,
            -st,
            sf * ct,
            cf * ct,
        );
        assert_relative_eq!(matrix_of(&e.level_from_body()), printed, epsilon = 1e-14);
    }

    #[test]
    fn gimbal_lock_keeps_the_rotation() {
        let e = EulerAngles { phi_rad: 0.4, theta_rad: PI / 2.0, psi_rad: 0.9 };
        let back = EulerAngles::from_level_from_body(&e.level_from_body());
        assert!(back.level_from_body().angle_to(&e.level_from_body()) < 1e-7);
    }

    proptest! {
        #[test]
        fn angles_survive_the_round_trip(phi in -3.1..3.1, theta in -1.5..1.5, psi in -3.1..3.1) {
            let e = EulerAngles { phi_rad: phi, theta_rad: theta, psi_rad: psi };
            let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), e);
            let back = EulerAngles::from_world_from_body(&pose);
            prop_assert!((back.phi_rad - phi).abs() < 1e-9);
            prop_assert!((back.theta_rad - theta).abs() < 1e-9);
            prop_assert!((back.psi_rad - psi).abs() < 1e-9);
        }

        #[test]
        fn euler_rates_match_a_numeric_derivative(phi in -1.0..1.0, theta in -1.2..1.2, psi in -3.0..3.0,
            p in -1.0..1.0, q in -1.0..1.0, r in -1.0..1.0)
        {
            let e = EulerAngles { phi_rad: phi, theta_rad: theta, psi_rad: psi };
            let rates = Vector3::new(p, q, r);
            let h = 1e-6;
            let ahead = e.level_from_body() * UnitQuaternion::from_scaled_axis(rates * h);
            let behind = e.level_from_body() * UnitQuaternion::from_scaled_axis(-rates * h);
            let (a, b) = (EulerAngles::from_level_from_body(&ahead), EulerAngles::from_level_from_body(&behind));
            let wrap = |d: f64| d - 2.0 * PI * (d / (2.0 * PI)).round();
            let numeric = Vector3::new(
                wrap(a.phi_rad - b.phi_rad), wrap(a.theta_rad - b.theta_rad), wrap(a.psi_rad - b.psi_rad),
            ) / (2.0 * h);
            prop_assert!((e.rates_from_body_rates() * rates - numeric).norm() < 1e-7);
        }

        #[test]
        fn right_jacobian_matches_a_numeric_derivative(x in -2.0..2.0, y in -2.0..2.0, z in -2.0..2.0, axis in 0usize..3) {
            let phi = Vector3::new(x, y, z);
            let h = 1e-6;
            let step = Vector3::ith(axis, h);
            let at = UnitQuaternion::from_scaled_axis(phi).inverse();
            let ahead = (at * UnitQuaternion::from_scaled_axis(phi + step)).scaled_axis();
            let behind = (at * UnitQuaternion::from_scaled_axis(phi - step)).scaled_axis();
            let numeric = (ahead - behind) / (2.0 * h);
            prop_assert!((right_jacobian(&phi).column(axis) - numeric).norm() < 1e-8);
        }
    }
}
