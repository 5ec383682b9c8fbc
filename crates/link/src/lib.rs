//! What leaves mavsight while an aircraft flies: poses with their covariance, what happens to cameras and
//! tracking, and the protocols that carry them to autopilots, other programs and the browser.
//!
//! Nothing is sent that was not measured: a [`Fix`] without a [`Measured`] says that there is none.

mod axes;
mod error;
mod event;
mod fix;
pub mod json;
pub mod mavlink;
pub mod natnet;
mod open;
mod options;
mod outlet;
mod peers;
mod priority;
#[doc(hidden)]
pub mod received;
pub mod rerun;
#[cfg(test)]
mod testing;
mod udp;
pub mod vrpn;
mod worker;
#[cfg(feature = "zenoh")]
pub mod zenoh;

#[cfg(feature = "zenoh")]
pub use crate::zenoh::Zenoh;
pub use axes::upper_triangle;
pub use error::LinkError;
pub use event::{
    CameraState, CameraView, DetectedBall, Event, MarkerView, Parameter, PoseEvent, Scene, Tracking,
};
pub use fix::{Fix, Measured, Moving};
pub use json::JsonLines;
pub use mavlink::Mavlink;
pub use natnet::Natnet;
pub use open::open;
pub use options::{
    BodyAxes, JsonOptions, LiveSection, MavlinkOptions, NatnetOptions, VrpnOptions, ZenohOptions,
};
pub use outlet::{Body, Outlet, now_ns};
pub use priority::give_way;
pub use rerun::Rerun;
pub use vrpn::{TURN_S, Vrpn};
