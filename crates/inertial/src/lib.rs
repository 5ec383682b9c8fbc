//! A log's gyroscope against measured poses: the clock of the log, and how the sensor sits in the body.
//!
//! Poses and log need share neither a clock nor axes: the turns of the aircraft, which both measure, tie them together.

mod alignment;
mod error;
mod gyroscope;
mod rates;

pub use alignment::{LogAlignment, align_log};
pub use error::InertialError;
pub use gyroscope::GyroscopeSeries;
