//! The vehicle, its rotors and fly-bar, recorded inputs, and the equations of motion in dimensionless
//! coefficients.
//!
//! Source of the model: Mulyanto, Nurhakim, Muhammad (ICAS 2012), equations 1 to 5 and table 2, with flapping
//! in both axes. Frames and signs are those of `mavsight_geometry` and CONVENTIONS.md.

mod coefficient_model;
mod error;
pub mod flapping;
mod helicopter_input;
mod inputs;
mod thrust;
mod vehicle;

pub use coefficient_model::{
    Airframe, COEFFICIENTS, Coefficient, Coefficients, FLIGHT_STATES, Linearisation, StateVector,
};
pub use error::FlightError;
pub use flapping::FlapState;
pub use helicopter_input::HelicopterInput;
pub use inputs::InputSeries;
pub use thrust::{Thrust, force_per_speed2, hover_rotor_speed_rad_s, thrust_n};
pub use vehicle::{Assumption, Color, Environment, Marker, Rotor, Vehicle};
