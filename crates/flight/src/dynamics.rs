//! Forces and moments of the rotors, the equations of motion, and the coefficients they imply.

use crate::flapping::{self, FlapDrive, FlapState};
use crate::{InputSample, Vehicle};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;
use std::f64::consts::PI;

/// Number of states of the equations of motion: position, quaternion, velocity, rates, flapping.
pub(crate) const STATES: usize = crate::FLIGHT_STATES;

/// Thrust of both rotors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thrust {
    /// Upper rotor.
    pub upper_n: f64,
    /// Lower rotor.
    pub lower_n: f64,
}

/// T = C_T ρ π R⁴ ω² of each rotor (equation 5).
pub fn thrust_n(vehicle: &Vehicle, input: &InputSample) -> Thrust {
    let per_omega2 = vehicle.environment.air_density_kg_m3 * PI * vehicle.rotor.radius_m.powi(4);
    Thrust {
        upper_n: vehicle.rotor.thrust_coefficient_upper * per_omega2 * input.omega_u_rad_s.powi(2),
        lower_n: vehicle.rotor.thrust_coefficient_lower * per_omega2 * input.omega_l_rad_s.powi(2),
    }
}

/// The equal speed of both rotors at which thrust balances weight.
pub fn hover_rotor_speed_rad_s(vehicle: &Vehicle) -> f64 {
    let weight_n = vehicle.mass_kg * vehicle.environment.gravity_m_s2;
    let coefficients = vehicle.rotor.thrust_coefficient_upper + vehicle.rotor.thrust_coefficient_lower;
    (weight_n / (coefficients * vehicle.environment.air_density_kg_m3 * PI * vehicle.rotor.radius_m.powi(4)))
        .sqrt()
}

/// Aerodynamic force in body axes: each rotor's thrust tipped with its disc, and drag.
pub fn body_forces_n(
    vehicle: &Vehicle,
    input: &InputSample,
    flap: &FlapState,
    velocity_in_body_m_s: &Vector3<f64>,
) -> Vector3<f64> {
    let t = thrust_n(vehicle, input);
    let (alpha_u, beta_u) = (flap.alpha_u_rad(&vehicle.rotor), flap.beta_u_rad(&vehicle.rotor));
    Vector3::new(
        -t.upper_n * alpha_u - t.lower_n * flap.alpha_l_rad,
        t.upper_n * beta_u + t.lower_n * flap.beta_l_rad,
        -(t.upper_n + t.lower_n),
    ) - velocity_in_body_m_s * vehicle.assumption.drag_n_s_m
}

/// Aerodynamic moment about the centre of gravity in body axes: (T h + hub stiffness) per radian of each disc, the
/// difference of the rotors' torques, and damping.
pub fn body_moments_n_m(
    vehicle: &Vehicle,
    input: &InputSample,
    flap: &FlapState,
    rates_rad_s: &Vector3<f64>,
) -> Vector3<f64> {
    let t = thrust_n(vehicle, input);
    let a = &vehicle.assumption;
    let upper = t.upper_n * a.height_upper_m + a.hub_stiffness_n_m_rad;
    let lower = t.lower_n * a.height_lower_m + a.hub_stiffness_n_m_rad;
    let per_omega2 = vehicle.environment.air_density_kg_m3 * PI * vehicle.rotor.radius_m.powi(5);
    let yaw = per_omega2
        * (a.torque_coefficient_lower * input.omega_l_rad_s.powi(2)
            - a.torque_coefficient_upper * input.omega_u_rad_s.powi(2));
    Vector3::new(
        upper * flap.beta_u_rad(&vehicle.rotor)
            + lower * flap.beta_l_rad
            + a.roll_damping_n_m_s_rad * rates_rad_s.x,
        upper * flap.alpha_u_rad(&vehicle.rotor)
            + lower * flap.alpha_l_rad
            + a.pitch_damping_n_m_s_rad * rates_rad_s.y,
        yaw + a.yaw_damping_n_m_s_rad * rates_rad_s.z,
    )
}

/// The state of the aircraft as the integrator sees it.
pub(crate) struct State {
    pub position_in_world_m: Vector3<f64>,
    pub level_from_body: UnitQuaternion<f64>,
    pub velocity_in_body_m_s: Vector3<f64>,
    pub rates_rad_s: Vector3<f64>,
    pub flap: FlapState,
}

impl State {
    pub(crate) fn pack(&self) -> [f64; STATES] {
        let (p, q, v, w, f) = (
            self.position_in_world_m,
            self.level_from_body,
            self.velocity_in_body_m_s,
            self.rates_rad_s,
            self.flap,
        );
        [
            p.x,
            p.y,
            p.z,
            q.w,
            q.i,
            q.j,
            q.k,
            v.x,
            v.y,
            v.z,
            w.x,
            w.y,
            w.z,
            f.alpha_l_rad,
            f.beta_l_rad,
            f.alpha_f_rad,
            f.beta_f_rad,
        ]
    }

    pub(crate) fn unpack(y: &[f64; STATES]) -> Self {
        Self {
            position_in_world_m: Vector3::new(y[0], y[1], y[2]),
            level_from_body: UnitQuaternion::from_quaternion(Quaternion::new(y[3], y[4], y[5], y[6])),
            velocity_in_body_m_s: Vector3::new(y[7], y[8], y[9]),
            rates_rad_s: Vector3::new(y[10], y[11], y[12]),
            flap: FlapState { alpha_l_rad: y[13], beta_l_rad: y[14], alpha_f_rad: y[15], beta_f_rad: y[16] },
        }
    }
}

/// Time derivatives of velocity and rates in body axes.
pub(crate) fn accelerations(
    vehicle: &Vehicle,
    input: &InputSample,
    s: &State,
) -> (Vector3<f64>, Vector3<f64>) {
    let gravity_in_level = Vector3::new(0.0, 0.0, vehicle.environment.gravity_m_s2);
    let gravity_in_body = s.level_from_body.inverse() * gravity_in_level;
    let force_n = body_forces_n(vehicle, input, &s.flap, &s.velocity_in_body_m_s);
    let velocity_rate =
        force_n / vehicle.mass_kg + gravity_in_body - s.rates_rad_s.cross(&s.velocity_in_body_m_s);
    let inertia = Vector3::from(vehicle.inertia_kg_m2);
    let moment_n_m = body_moments_n_m(vehicle, input, &s.flap, &s.rates_rad_s);
    let momentum = inertia.component_mul(&s.rates_rad_s);
    let rate_rate = (moment_n_m - s.rates_rad_s.cross(&momentum)).component_div(&inertia);
    (velocity_rate, rate_rate)
}

/// The equations of motion: rigid body (Euler's equations, principal axes) with flapping.
///
/// The quaternion's length is drawn back to one with a time constant of one second, which does not change the attitude.
pub(crate) fn derivative(vehicle: &Vehicle, input: &InputSample, y: &[f64; STATES]) -> [f64; STATES] {
    let s = State::unpack(y);
    let (velocity_rate, rate_rate) = accelerations(vehicle, input, &s);
    let velocity_in_level = s.level_from_body * s.velocity_in_body_m_s;
    let q = Quaternion::new(y[3], y[4], y[5], y[6]);
    let spin = Quaternion::from_imag(s.rates_rad_s);
    let q_rate = q * spin * 0.5 + q * (1.0 - q.norm_squared()) * 0.5;
    let drive = FlapDrive {
        p_rad_s: s.rates_rad_s.x,
        q_rad_s: s.rates_rad_s.y,
        delta_lon_rad: input.delta_lon_rad,
        delta_lat_rad: input.delta_lat_rad,
    };
    let flap_rate = flapping::derivative(&s.flap, &drive, &vehicle.rotor);
    let (v, a, w, f) = (velocity_in_level, velocity_rate, rate_rate, flap_rate);
    [
        v.x,
        -v.y,
        -v.z,
        q_rate.w,
        q_rate.i,
        q_rate.j,
        q_rate.k,
        a.x,
        a.y,
        a.z,
        w.x,
        w.y,
        w.z,
        f.alpha_l_rad,
        f.beta_l_rad,
        f.alpha_f_rad,
        f.beta_f_rad,
    ]
}

/// The coefficients that the model implies at constant, equal rotor speeds: what an identification should find.
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

/// Coefficients of [`body_forces_n`] and [`body_moments_n_m`] made dimensionless at the mean speed of both rotors.
pub fn model_coefficients(vehicle: &Vehicle, omega_rad_s: f64) -> ModelCoefficients {
    let input =
        InputSample { omega_u_rad_s: omega_rad_s, omega_l_rad_s: omega_rad_s, ..InputSample::default() };
    let t = thrust_n(vehicle, &input);
    let radius_m = vehicle.rotor.radius_m;
    let force_n =
        0.5 * vehicle.environment.air_density_kg_m3 * PI * radius_m.powi(4) * omega_rad_s * omega_rad_s;
    let moment_n_m = force_n * radius_m;
    let a = &vehicle.assumption;
    ModelCoefficients {
        cx_alpha_u: -t.upper_n / force_n,
        cx_alpha_l: -t.lower_n / force_n,
        cz_hover: -(t.upper_n + t.lower_n) / force_n,
        cm_alpha_u: (t.upper_n * a.height_upper_m + a.hub_stiffness_n_m_rad) / moment_n_m,
        cm_alpha_l: (t.lower_n * a.height_lower_m + a.hub_stiffness_n_m_rad) / moment_n_m,
        cm_q: a.pitch_damping_n_m_s_rad / moment_n_m,
    }
}
