//! Thrust of the rotors.

use crate::{HelicopterInput, Vehicle};
use std::f64::consts::PI;

/// Thrust of both rotors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thrust {
    /// Upper rotor.
    pub upper_n: f64,
    /// Lower rotor.
    pub lower_n: f64,
}

/// ½ρπR⁴, N s²: what makes a force dimensionless is this times the square of a rotor speed; for a moment also
/// times R (equation 4).
pub fn force_per_speed2(vehicle: &Vehicle) -> f64 {
    0.5 * vehicle.environment.air_density_kg_m3 * PI * vehicle.rotor.radius_m.powi(4)
}

/// T = C_T ρ π R⁴ ω² of each rotor (equation 5).
pub fn thrust_n(vehicle: &Vehicle, input: &HelicopterInput) -> Thrust {
    let rotor = &vehicle.rotor;
    let of = |coefficient: f64, omega_rad_s: f64| {
        2.0 * coefficient * force_per_speed2(vehicle) * omega_rad_s.powi(2)
    };
    Thrust {
        upper_n: of(rotor.thrust_coefficient_upper, input.omega_u_rad_s),
        lower_n: of(rotor.thrust_coefficient_lower, input.omega_l_rad_s),
    }
}

/// The equal speed of both rotors at which thrust balances weight.
pub fn hover_rotor_speed_rad_s(vehicle: &Vehicle) -> f64 {
    let weight_n = vehicle.mass_kg * vehicle.environment.gravity_m_s2;
    let coefficients = vehicle.rotor.thrust_coefficient_upper + vehicle.rotor.thrust_coefficient_lower;
    (weight_n / (2.0 * coefficients * force_per_speed2(vehicle))).sqrt()
}
