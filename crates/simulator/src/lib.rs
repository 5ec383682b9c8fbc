//! Flies the virtual aircraft: scenarios of manoeuvres, integration of the equations of motion, and the
//! coefficients that an identification of such a flight should find.
//!
//! No crate that estimates depends on this one. The model is that of `mavsight_flight`; frames and signs are
//! those of CONVENTIONS.md.

mod coefficients;
mod error;
mod maneuver;
mod pilot;
mod scenario;
mod simulate;
pub mod staging;

pub use coefficients::{ModelCoefficients, model_coefficients, true_coefficients};
pub use error::SimulatorError;
pub use maneuver::{Channel, Maneuver, Sine};
pub use pilot::Pilot;
pub use scenario::Scenario;
pub use simulate::{FlightState, InitialState, simulate};
pub use staging::Staging;
