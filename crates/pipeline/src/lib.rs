//! Stages joined by bounded queues: the one chain from frames to parameters.
//!
//! Recorded, live and virtual cameras enter as [`CameraFeed`]s; nothing here knows which kind it is handed.

mod associate;
mod board;
mod calibrate;
mod clap;
mod control;
mod error;
mod feed;
mod flash;
mod health;
mod mixed_up;
mod progress;
mod reconstruct;
mod refine;
mod solve;
mod stream;
mod synchronize;
#[cfg(test)]
mod testing;
mod track;
mod tracker;
mod wand;
mod watch;

pub use associate::{FlightAssociator, Instant};
pub use board::{Board, board_of};
pub use calibrate::{
    ControlStill, calibrate_from_observations, calibrate_from_stills, calibrate_from_stills_and_objects,
};
pub use clap::Clap;
pub use control::{ControlPixel, ControlPointRow};
pub use error::PipelineError;
pub use feed::{CameraFeed, Frames, TimedFrame, usual_interval_ns};
pub use health::{CameraHealth, CentreQuality, MarkerHealth};
pub use progress::{NoProgress, Progress, Stage};
pub use reconstruct::reconstruct;
pub use refine::{Diameter, MARKERS_STD_M, RefinedBody, Refinement, refine};
pub use solve::{
    IdentifyOptions, Solution, identify_motion, motion_from_poses, motion_of, systematic_columns,
};
pub use synchronize::{CameraTiming, Lookahead, Synchronizer};
pub use track::{Tracked, body_markers, track, track_with};
pub use tracker::{CameraTracker, TrackedFrame};
pub use wand::{Wand, WandBall, wand_of};
