//! The whole pipeline as a library: a recorded session in, its results out.
//!
//! [`run`] carries a session through calibration, tracking, association, poses, smoothing and
//! identification. Each stage can be called by itself: [`calibrate`], [`track`], [`solve`],
//! [`identify_from_poses`]. Nothing here prints, writes a report or reads a truth file; what cannot be had
//! of a flight is a note in the results.

mod calibration;
mod check;
mod colors;
mod equation_error;
mod error;
mod frames;
mod identification;
mod input_range;
mod log_alone;
mod log_clock;
mod look;
mod means;
mod parts;
mod pick;
mod solution;
mod tracking;
mod weight;

pub use calibration::calibrate;
pub use check::{CameraCheck, CheckItem, ControlBall, Exposure, Harm, SessionCheck, Shot, Spot, check};
pub use colors::colors_in_pictures;
pub use error::EngineError;
pub use frames::{camera_feeds, first_frames};
pub use identification::{identify_from_motion, identify_from_poses};
pub use log_alone::identify_from_log;
pub use look::{FilmLook, look_at};
pub use pick::{MarkerPicker, PickError, PickedBall, PickedMarker, Picker};
pub use solution::{
    Flight, Options, log_gyroscope, log_sensors, recorded_inputs, recorded_sensors, run, smooth_tracked,
    solve,
};
pub use tracking::{TrackedFlight, track};
