//! Stages joined by bounded queues: the one chain from frames to parameters.
//!
//! Recorded, live and virtual cameras enter as [`CameraFeed`]s; nothing here knows which kind it is handed.

mod associate;
mod board;
mod calibrate;
mod clap;
mod error;
mod feed;
mod flash;
mod join;
mod mixed_up;
mod output_error;
mod progress;
mod reconstruct;
mod refine;
mod sight;
mod solve;
mod stream;
#[cfg(test)]
mod testing;
mod track;
mod wand;
mod watch;

pub use associate::{Identities, Instant};
pub use board::{Board, board_of};
pub use calibrate::{
    ControlStill, calibrate_from_observations, calibrate_from_stills, calibrate_from_stills_and,
};
pub use error::PipelineError;
pub use feed::{CameraFeed, Frames, TimedFrame};
pub use join::{Ahead, JoinedCamera, Joiner};
pub use output_error::{MARKERS_STD_M, output_error_fits};
pub use progress::{Progress, Quiet, Stage};
pub use reconstruct::reconstruct;
pub use refine::{AsFlown, Diameter, Refinement, refine};
pub use sight::{CameraTracker, Look};
pub use solve::{IdentifyOptions, Solution, identify_motion, lasting_to_fit, motion_from_poses, motion_of};
pub use track::{Tracked, body_markers, track, track_and};
pub use wand::{Wand, wand_of};
