//! Stages joined by bounded queues: the one chain from frames to parameters.
//!
//! Recorded, live and virtual cameras enter as [`CameraFeed`]s; nothing here knows which kind it is handed.

mod associate;
mod calibrate;
mod error;
mod feed;
mod output_error;
mod progress;
mod reconstruct;
mod refine;
mod solve;
mod track;
mod watch;

pub use calibrate::{ControlStill, calibrate_from_observations, calibrate_from_stills};
pub use error::PipelineError;
pub use feed::{CameraFeed, TimedFrame};
pub use output_error::{MARKERS_STD_M, output_error_fits};
pub use progress::{Progress, Quiet, Stage};
pub use reconstruct::reconstruct;
pub use refine::{BodyAsBuilt, Diameter, Refinement, refine_body};
pub use solve::{IdentifyOptions, Solution, body_markers, identify_motion, motion_from_poses};
pub use track::{Tracked, track};
