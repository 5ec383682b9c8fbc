//! What leaves mavsight while an aircraft flies: poses with their covariance, what happens to cameras and tracking, and the
//! protocols that carry them to autopilots, other programs and the browser.
//!
//! Nothing is sent that was not measured: a [`Fix`] without a [`Measured`] says that there is none.

mod event;
mod fix;

pub use event::{CameraState, CameraView, Event, MarkerView, Parameter, PoseEvent, Scene, Sight, Tracking};
pub use fix::{Fix, Measured, Moving};
