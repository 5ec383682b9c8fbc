//! Vehicle files of schema 1: the coaxial helicopter, with its rotor and what is assumed of it.

use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Rotors and fly-bar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rotor {
    /// Rotor radius R.
    pub(super) radius_m: f64,
    /// C_Tu of T_u = C_Tu ρ π R⁴ ω_u² (equation 5).
    pub(super) thrust_coefficient_upper: f64,
    /// C_Tl.
    pub(super) thrust_coefficient_lower: f64,
    /// Flapping time constant of the lower rotor, τ_f,l.
    pub(super) flap_time_lower_s: f64,
    /// Flapping time constant of the fly-bar, τ_f,f.
    pub(super) flap_time_flybar_s: f64,
    /// Linkage from swash-plate to lower rotor, K_b.
    pub(super) swashplate_gain: f64,
    /// Linkage from fly-bar to upper rotor, K_u: alpha_u = K_u alpha_f. The paper does not give it.
    pub(super) flybar_gain: f64,
}

/// What the paper leaves open. Each value is an assumption, read by the simulation alone, never by an
/// estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Assumption {
    /// Height of the upper hub above the centre of gravity: the lower hub's plus the 80 mm of section 4.1.
    #[default(0.20)]
    pub(super) height_upper_m: f64,
    /// Height of the lower hub above the centre of gravity: measured off figure 5, to a few centimetres.
    #[default(0.12)]
    pub(super) height_lower_m: f64,
    /// Hub stiffness of each rotor: a teetering rotor has none.
    pub(super) hub_stiffness_n_m_rad: f64,
    /// C_Qu of Q_u = C_Qu ρ π R⁵ ω_u²: induced power C_T^1.5/√2 at a figure of merit of one half.
    #[default(8.6e-4)]
    pub(super) torque_coefficient_upper: f64,
    /// C_Ql; equal to the upper so that hover at equal speeds does not turn.
    #[default(8.6e-4)]
    pub(super) torque_coefficient_lower: f64,
    /// Roll moment per roll rate.
    #[default(-0.002)]
    pub(super) roll_damping_n_m_s_rad: f64,
    /// Pitch moment per pitch rate.
    #[default(-0.002)]
    pub(super) pitch_damping_n_m_s_rad: f64,
    /// Yaw moment per yaw rate.
    #[default(-0.002)]
    pub(super) yaw_damping_n_m_s_rad: f64,
    /// Drag per speed: an indoor flight is slow.
    pub(super) drag_n_s_m: f64,
}

/// What the rotor's constants need to be made dimensionless.
pub(super) struct Surroundings {
    pub(super) weight_n: f64,
    pub(super) air_density_kg_m3: f64,
}

impl Rotor {
    /// The same by the names of the shelf's coaxial helicopter.
    pub(super) fn parameters(&self) -> BTreeMap<String, f64> {
        [
            ("R", self.radius_m),
            ("C_Tu", self.thrust_coefficient_upper),
            ("C_Tl", self.thrust_coefficient_lower),
            ("tau_l", self.flap_time_lower_s),
            ("tau_f", self.flap_time_flybar_s),
            ("K_b", self.swashplate_gain),
            ("K_u", self.flybar_gain),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }
}

impl Assumption {
    /// Coefficients of the shelf's coaxial helicopter that the simulation alone has.
    pub(super) fn simulation(&self, rotor: &Rotor, around: &Surroundings) -> BTreeMap<String, f64> {
        let thrusts = rotor.thrust_coefficient_upper + rotor.thrust_coefficient_lower;
        let hover_rad_s =
            (around.weight_n / (thrusts * around.air_density_kg_m3 * PI * rotor.radius_m.powi(4))).sqrt();
        let force_n = 0.5 * around.air_density_kg_m3 * PI * rotor.radius_m.powi(4) * hover_rad_s.powi(2);
        let moment_n_m = force_n * rotor.radius_m;
        let arm =
            |thrust_coefficient: f64, height_m: f64| 2.0 * thrust_coefficient * height_m / rotor.radius_m;
        [
            ("C_m_alpha_u", arm(rotor.thrust_coefficient_upper, self.height_upper_m)),
            ("C_m_alpha_l", arm(rotor.thrust_coefficient_lower, self.height_lower_m)),
            ("C_m_hub", self.hub_stiffness_n_m_rad / moment_n_m),
            ("C_l_p", self.roll_damping_n_m_s_rad / moment_n_m),
            ("C_m_q", self.pitch_damping_n_m_s_rad / moment_n_m),
            ("C_n_r", self.yaw_damping_n_m_s_rad / moment_n_m),
            ("C_n_u", -2.0 * self.torque_coefficient_upper),
            ("C_n_l", 2.0 * self.torque_coefficient_lower),
            ("d_xy", self.drag_n_s_m),
            ("d_z", self.drag_n_s_m),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into()
    }
}
