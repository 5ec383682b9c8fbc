//! Thrust of the rotors.

use crate::{InputSample, Vehicle};
use std::f64::consts::PI;

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
