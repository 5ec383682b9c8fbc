//! The vehicle with its flight model, recorded inputs and sensors, and responses of first order.
//!
//! Frames and signs are those of `mavsight_geometry` and CONVENTIONS.md.

mod color;
mod error;
mod inputs;
pub mod response;
mod sensors;
mod vehicle;

pub use color::Color;
pub use error::FlightError;
pub use inputs::{InputSeries, Interpolation};
pub use sensors::SensorSeries;
pub use vehicle::{Environment, Marker, Vehicle, VehicleFile};
