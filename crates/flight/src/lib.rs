//! The vehicle, its rotors and fly-bar, manoeuvres, equations of motion and their integration.
//!
//! Source of the model: Mulyanto, Nurhakim, Muhammad (ICAS 2012), equations 1 to 5 and table 2, with flapping in both
//! axes. Frames and signs are those of `mavsight_geometry` and CONVENTIONS.md.

mod coefficient_model;
mod dynamics;
mod error;
pub mod flapping;
mod inputs;
mod maneuver;
mod simulate;
pub mod staging;
mod vehicle;

pub use coefficient_model::{
    Airframe, COEFFICIENTS, Coefficient, Coefficients, FLIGHT_STATES, Linearisation, StateVector,
};
pub use dynamics::{
    ModelCoefficients, Thrust, body_forces_n, body_moments_n_m, hover_rotor_speed_rad_s, model_coefficients,
    thrust_n,
};
pub use error::FlightError;
pub use flapping::FlapState;
pub use inputs::{InputChannel, InputSample, InputSeries};
pub use maneuver::{Channel, Maneuver, Scenario, Sine};
pub use simulate::{FlightState, InitialState, simulate};
pub use staging::Staging;
pub use vehicle::{Assumption, Color, Environment, Marker, Rotor, Vehicle};
