//! The coefficients that a vehicle's constants imply: the truth of a simulated flight.

use mavsight_flight::{Coefficient as C, Coefficients, Vehicle, force_per_speed2};
use serde::Serialize;

/// The coefficients that a vehicle's constants and assumptions imply, made dimensionless at a reference rotor
/// speed (Mulyanto, Nurhakim & Muhammad 2012, equation 5 for thrust).
pub fn true_coefficients(vehicle: &Vehicle, reference_speed_rad_s: f64) -> Coefficients {
    let (r, a) = (&vehicle.rotor, &vehicle.assumption);
    let force_n = force_per_speed2(vehicle) * reference_speed_rad_s.powi(2);
    let moment_n_m = force_n * r.radius_m;
    let mut c = Coefficients::default();
    for (which, value) in [
        (C::CxAlphaU, -2.0 * r.thrust_coefficient_upper),
        (C::CxAlphaL, -2.0 * r.thrust_coefficient_lower),
        (C::CzU, -2.0 * r.thrust_coefficient_upper),
        (C::CzL, -2.0 * r.thrust_coefficient_lower),
        (C::CmAlphaU, 2.0 * r.thrust_coefficient_upper * a.height_upper_m / r.radius_m),
        (C::CmAlphaL, 2.0 * r.thrust_coefficient_lower * a.height_lower_m / r.radius_m),
        (C::CmHub, a.hub_stiffness_n_m_rad / moment_n_m),
        (C::ClP, a.roll_damping_n_m_s_rad / moment_n_m),
        (C::CmQ, a.pitch_damping_n_m_s_rad / moment_n_m),
        (C::CnR, a.yaw_damping_n_m_s_rad / moment_n_m),
        (C::CnUpper, -2.0 * a.torque_coefficient_upper),
        (C::CnLower, 2.0 * a.torque_coefficient_lower),
        (C::CxU, -a.drag_n_s_m / force_n),
        (C::TauLower, r.flap_time_lower_s),
        (C::TauFlybar, r.flap_time_flybar_s),
        (C::SwashplateGain, r.swashplate_gain),
        (C::FlybarGain, r.flybar_gain),
    ] {
        c.set(which, value);
    }
    c
}

/// The coefficients of longitudinal motion at constant, equal rotor speeds: what a regression on such a
/// flight should find.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ModelCoefficients {
    /// C_X,αu.
    pub cx_alpha_u: f64,
    /// C_X,αl.
    pub cx_alpha_l: f64,
    /// C_Z in hover.
    pub cz_hover: f64,
    /// C_m,αu.
    pub cm_alpha_u: f64,
    /// C_m,αl.
    pub cm_alpha_l: f64,
    /// C_m,q, seconds.
    pub cm_q: f64,
}

/// Sums up [`true_coefficients`] where both rotors turn at the reference speed.
pub fn model_coefficients(vehicle: &Vehicle, omega_rad_s: f64) -> ModelCoefficients {
    let c = true_coefficients(vehicle, omega_rad_s);
    ModelCoefficients {
        cx_alpha_u: c.get(C::CxAlphaU),
        cx_alpha_l: c.get(C::CxAlphaL),
        cz_hover: c.get(C::CzU) + c.get(C::CzL),
        cm_alpha_u: c.get(C::CmAlphaU) + c.get(C::CmHub),
        cm_alpha_l: c.get(C::CmAlphaL) + c.get(C::CmHub),
        cm_q: c.get(C::CmQ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use mavsight_flight::{Airframe, HelicopterInput, StateVector, hover_rotor_speed_rad_s, thrust_n};
    use nalgebra::{Quaternion, UnitQuaternion, Vector3};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    #[test]
    fn coefficients_are_those_of_the_independent_model() {
        let vehicle = Vehicle::paper();
        let c = model_coefficients(&vehicle, hover_rotor_speed_rad_s(&vehicle));
        assert_relative_eq!(c.cx_alpha_u, -0.01436, epsilon = 1e-12);
        assert_relative_eq!(c.cx_alpha_l, -0.00996, epsilon = 1e-12);
        assert_relative_eq!(c.cz_hover, -0.02432, epsilon = 1e-12);
        assert_relative_eq!(c.cm_alpha_u, 0.011488, epsilon = 1e-12);
        assert_relative_eq!(c.cm_alpha_l, 0.0047808, epsilon = 1e-12);
        assert_relative_eq!(c.cm_q, -2.480_620_155e-5, epsilon = 1e-10);
    }

    /// The equations of motion in newtons and newton metres: each rotor's thrust tipped with its disc, drag,
    /// hub stiffness, torques and damping.
    fn dimensional(vehicle: &Vehicle, input: &HelicopterInput, y: &StateVector) -> StateVector {
        let (t, a, r) = (thrust_n(vehicle, input), &vehicle.assumption, &vehicle.rotor);
        let q = Quaternion::new(y[3], y[4], y[5], y[6]);
        let level_from_body = UnitQuaternion::from_quaternion(q);
        let (velocity, rates) = (Vector3::new(y[7], y[8], y[9]), Vector3::new(y[10], y[11], y[12]));
        let (alpha_u, beta_u) = (r.flybar_gain * y[15], r.flybar_gain * y[16]);
        let force = Vector3::new(
            -t.upper_n * alpha_u - t.lower_n * y[13],
            t.upper_n * beta_u + t.lower_n * y[14],
            -(t.upper_n + t.lower_n),
        ) - velocity * a.drag_n_s_m;
        let upper = t.upper_n * a.height_upper_m + a.hub_stiffness_n_m_rad;
        let lower = t.lower_n * a.height_lower_m + a.hub_stiffness_n_m_rad;
        let per_omega2 = vehicle.environment.air_density_kg_m3 * PI * r.radius_m.powi(5);
        let torque = a.torque_coefficient_lower * input.omega_l_rad_s.powi(2)
            - a.torque_coefficient_upper * input.omega_u_rad_s.powi(2);
        let moment = Vector3::new(
            upper * beta_u + lower * y[14] + a.roll_damping_n_m_s_rad * rates.x,
            upper * alpha_u + lower * y[13] + a.pitch_damping_n_m_s_rad * rates.y,
            per_omega2 * torque + a.yaw_damping_n_m_s_rad * rates.z,
        );
        let gravity = level_from_body.inverse() * Vector3::new(0.0, 0.0, vehicle.environment.gravity_m_s2);
        let inertia = Vector3::from(vehicle.inertia_kg_m2);
        let p = level_from_body * velocity;
        let spin = q * Quaternion::from_imag(rates) * 0.5 + q * (1.0 - q.norm_squared()) * 0.5;
        let v = force / vehicle.mass_kg + gravity - rates.cross(&velocity);
        let w = (moment - rates.cross(&inertia.component_mul(&rates))).component_div(&inertia);
        let disc =
            |k: usize, delta: f64, rate: f64| (r.swashplate_gain * delta - y[k]) / r.flap_time_lower_s - rate;
        let bar = |k: usize, rate: f64| -y[k] / r.flap_time_flybar_s - rate;
        [
            p.x,
            -p.y,
            -p.z,
            spin.w,
            spin.i,
            spin.j,
            spin.k,
            v.x,
            v.y,
            v.z,
            w.x,
            w.y,
            w.z,
            disc(13, input.delta_lon_rad, rates.y),
            disc(14, input.delta_lat_rad, rates.x),
            bar(15, rates.y),
            bar(16, rates.x),
        ]
    }

    proptest! {
        #[test]
        fn the_vehicles_coefficients_give_the_vehicles_motion(x in proptest::collection::vec(-1.0..1.0, 17)) {
            let mut vehicle = Vehicle::paper();
            vehicle.assumption.drag_n_s_m = 0.05;
            vehicle.assumption.hub_stiffness_n_m_rad = 0.3;
            let input = HelicopterInput {
                t_s: 0.0,
                omega_u_rad_s: 205.0,
                omega_l_rad_s: 222.0,
                delta_lon_rad: 0.07,
                delta_lat_rad: -0.04,
            };
            let y: StateVector = std::array::from_fn(|k| match k {
                3 => 0.8 + 0.2 * x[3],
                4..=6 => 0.4 * x[k],
                13..=16 => 0.2 * x[k],
                _ => 2.0 * x[k],
            });
            let airframe = Airframe::of_vehicle(&vehicle).expect("a vehicle");
            let c = true_coefficients(&vehicle, airframe.reference_speed_rad_s());
            let (got, want) = (airframe.derivative(&c, &input, &y), dimensional(&vehicle, &input, &y));
            for (g, w) in got.iter().zip(want) {
                prop_assert!((g - w).abs() < 1e-10 * (1.0 + w.abs()), "{g} is not {w}");
            }
        }
    }
}
