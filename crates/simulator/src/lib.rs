//! Flies the virtual aircraft: scenarios of manoeuvres, integration of the equations of motion, and the
//! parameters that an identification of such a flight should find.
//!
//! No crate that estimates depends on this one. The equations are those of the vehicle's flight model
//! (`mavsight_model`); frames and signs are those of CONVENTIONS.md.

mod carried;
mod error;
mod maneuver;
mod packed;
mod pilot;
mod scenario;
mod sensors;
mod simulate;
pub mod staging;
mod state;
mod truth;

pub use carried::Carried;
pub use error::SimulatorError;
pub use maneuver::{AmplitudeUnit, Maneuver, Sine};
pub use pilot::{Command, Pilot};
pub use scenario::Scenario;
pub use sensors::sensed;
pub use simulate::{Simulator, simulate};
pub use staging::Staging;
pub use state::{FlightState, InitialState};
pub use truth::{simulated_values, true_values};
