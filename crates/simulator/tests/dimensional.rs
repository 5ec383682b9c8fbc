//! The simulated motion of the paper's helicopter against its equations in newtons and newton metres.

use mavsight_flight::Vehicle;
use mavsight_model::Dynamics;
use mavsight_simulator::simulated_values;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::f64::consts::PI;

/// Rotor speeds, upper and lower, and angles of the swash-plate, longitudinal and lateral.
const INPUTS: [f64; 4] = [205.0, 222.0, 0.07, -0.04];

const RADIUS_M: f64 = 0.25;
const THRUST_COEFFICIENTS: [f64; 2] = [7.18e-3, 4.98e-3];
const TORQUE_COEFFICIENTS: [f64; 2] = [8.6e-4, 8.6e-4];
const HEIGHTS_M: [f64; 2] = [0.20, 0.12];
const HUB_STIFFNESS_N_M_RAD: f64 = 0.3;
const DAMPING_N_M_S_RAD: f64 = -0.002;
const DRAG_N_S_M: f64 = 0.05;
const AIR_DENSITY_KG_M3: f64 = 1.14;
const GRAVITY_M_S2: f64 = 9.804;
const MASS_KG: f64 = 0.8;
const INERTIA_KG_M2: [f64; 3] = [6.1e-3, 6.26e-3, 0.93e-3];
const FLAP_TIMES_S: [f64; 2] = [0.05, 3.0];
const SWASHPLATE_GAIN: f64 = 0.91;
const FLYBAR_GAIN: f64 = 0.83;

/// The same constants as a vehicle file of schema 1.
fn vehicle() -> Vehicle {
    let marker = |name: &str, x: f64, y: f64| {
        format!(
            "[[marker]]\nname = \"{name}\"\nposition_m = [{x}, {y}, 0.1]\ndiameter_m = 0.05\ncolor = \"#ff0000\"\n"
        )
    };
    let markers =
        [("a", 0.2, 0.2), ("b", 0.2, -0.2), ("c", -0.2, 0.2)].map(|(name, x, y)| marker(name, x, y));
    let text = format!(
        "name = \"helicopter\"\nmass_kg = {MASS_KG}\ninertia_kg_m2 = {INERTIA_KG_M2:?}\n{}\
         [rotor]\nradius_m = {RADIUS_M}\nthrust_coefficient_upper = {}\nthrust_coefficient_lower = {}\n\
         flap_time_lower_s = {}\nflap_time_flybar_s = {:?}\nswashplate_gain = {SWASHPLATE_GAIN}\n\
         flybar_gain = {FLYBAR_GAIN}\n\
         [environment]\nair_density_kg_m3 = {AIR_DENSITY_KG_M3}\ngravity_m_s2 = {GRAVITY_M_S2}\n\
         [assumption]\nheight_upper_m = {}\nheight_lower_m = {}\ndrag_n_s_m = {DRAG_N_S_M}\n\
         hub_stiffness_n_m_rad = {HUB_STIFFNESS_N_M_RAD}\ntorque_coefficient_upper = {}\n\
         torque_coefficient_lower = {}\nroll_damping_n_m_s_rad = {DAMPING_N_M_S_RAD}\n\
         pitch_damping_n_m_s_rad = {DAMPING_N_M_S_RAD}\nyaw_damping_n_m_s_rad = {DAMPING_N_M_S_RAD}\n",
        markers.join(""),
        THRUST_COEFFICIENTS[0],
        THRUST_COEFFICIENTS[1],
        FLAP_TIMES_S[0],
        FLAP_TIMES_S[1],
        HEIGHTS_M[0],
        HEIGHTS_M[1],
        TORQUE_COEFFICIENTS[0],
        TORQUE_COEFFICIENTS[1],
    );
    toml::from_str(&text).expect("a vehicle")
}

/// The equations of motion: each rotor's thrust tipped with its disc, drag, hub stiffness, torques, damping.
fn dimensional(y: &[f64]) -> Vec<f64> {
    let [omega_u, omega_l, delta_lon, delta_lat] = INPUTS;
    let area_m4 = AIR_DENSITY_KG_M3 * PI * RADIUS_M.powi(4);
    let thrust_u_n = THRUST_COEFFICIENTS[0] * area_m4 * omega_u.powi(2);
    let thrust_l_n = THRUST_COEFFICIENTS[1] * area_m4 * omega_l.powi(2);
    let q = Quaternion::new(y[3], y[4], y[5], y[6]);
    let level_from_body = UnitQuaternion::from_quaternion(q);
    let (velocity, rates) = (Vector3::new(y[7], y[8], y[9]), Vector3::new(y[10], y[11], y[12]));
    let (alpha_u, beta_u) = (FLYBAR_GAIN * y[15], FLYBAR_GAIN * y[16]);
    let force = Vector3::new(
        -thrust_u_n * alpha_u - thrust_l_n * y[13],
        thrust_u_n * beta_u + thrust_l_n * y[14],
        -(thrust_u_n + thrust_l_n),
    ) - velocity * DRAG_N_S_M;
    let upper = thrust_u_n * HEIGHTS_M[0] + HUB_STIFFNESS_N_M_RAD;
    let lower = thrust_l_n * HEIGHTS_M[1] + HUB_STIFFNESS_N_M_RAD;
    let torque = TORQUE_COEFFICIENTS[1] * omega_l.powi(2) - TORQUE_COEFFICIENTS[0] * omega_u.powi(2);
    let moment = Vector3::new(
        upper * beta_u + lower * y[14],
        upper * alpha_u + lower * y[13],
        area_m4 * RADIUS_M * torque,
    ) + rates * DAMPING_N_M_S_RAD;
    let gravity = level_from_body.inverse() * Vector3::new(0.0, 0.0, GRAVITY_M_S2);
    let inertia = Vector3::from(INERTIA_KG_M2);
    let p = level_from_body * velocity;
    let spin = q * Quaternion::from_imag(rates) * 0.5 + q * (1.0 - q.norm_squared()) * 0.5;
    let v = force / MASS_KG + gravity - rates.cross(&velocity);
    let w = (moment - rates.cross(&inertia.component_mul(&rates))).component_div(&inertia);
    let disc = |k: usize, delta: f64, rate: f64| (SWASHPLATE_GAIN * delta - y[k]) / FLAP_TIMES_S[0] - rate;
    let bar = |k: usize, rate: f64| -y[k] / FLAP_TIMES_S[1] - rate;
    let flapping =
        [disc(13, delta_lon, rates.y), disc(14, delta_lat, rates.x), bar(15, rates.y), bar(16, rates.x)];
    let rigid = [p.x, -p.y, -p.z, spin.w, spin.i, spin.j, spin.k, v.x, v.y, v.z, w.x, w.y, w.z];
    rigid.into_iter().chain(flapping).collect()
}

proptest! {
    #[test]
    fn the_vehicles_values_give_the_vehicles_motion(x in proptest::collection::vec(-1.0..1.0, 17)) {
        let vehicle = vehicle();
        let dynamics = Dynamics::new(&vehicle.model, &simulated_values(&vehicle), &[]);
        let y: Vec<f64> = (0..17).map(|k| match k {
            3 => 0.8 + 0.2 * x[3],
            4..=6 => 0.4 * x[k],
            13..=16 => 0.2 * x[k],
            _ => 2.0 * x[k],
        }).collect();
        let (mut motion, mut got) = (dynamics.with(&[]), [0.0; 17]);
        motion.set_inputs(&INPUTS);
        motion.rates(&y, &mut got);
        for (g, w) in got.iter().zip(dimensional(&y)) {
            prop_assert!((g - w).abs() < 1e-10 * (1.0 + w.abs()), "{g} is not {w}");
        }
    }
}
