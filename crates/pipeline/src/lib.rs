//! Stages joined by bounded queues: the one chain from frames to parameters.
//!
//! Recorded, live and virtual cameras enter as [`CameraFeed`]s; nothing here knows which kind it is handed.

mod aircraft;
mod associate;
mod board;
mod calibrate;
mod cause;
mod clicked;
mod clock_start;
mod clock_step;
mod control;
mod detected;
mod error;
mod feed;
mod health;
mod joined;
mod markers;
mod misfit;
mod poses;
mod progress;
mod pushed;
mod reconstruct;
mod refine;
mod sharpness;
mod solve;
mod spread;
mod stream;
mod synchronize;
#[cfg(test)]
mod testing;
mod track;
mod tracked;
mod tracker;
mod wand;
mod watch;

pub use aircraft::aircraft_of;
pub use associate::{FlightAssociator, Instant};
pub use board::{Board, board_of};
pub use calibrate::{ControlStill, calibrate_from_observations, calibrate_from_stills};
pub use cause::{Cause, Finding};
pub use clicked::{REACH_PX, ball_at, balls_of_markers};
pub use control::{CLICKED_STD_PX, ControlPixel, ControlPointRow};
pub use detected::{DetectedFrame, DetectionFeed, track_detections};
pub use error::PipelineError;
pub use feed::{CameraFeed, Clap, Frames, TimedFrame, usual_interval_ns};
pub use health::{CameraHealth, CentreQuality, MarkerHealth};
pub use markers::{MARKERS_STD_M, body_markers};
pub use progress::{NoProgress, Progress, Stage};
pub use pushed::{FrameTime, Push, PushWatch};
pub use reconstruct::reconstruct;
pub use refine::{Diameter, RefinedBody, Refinement, refine};
pub use sharpness::edge_px as picture_edge_px;
pub use solve::{
    IdentifyOptions, Solution, identify_motion, motion_from_poses, motion_of, systematic_columns,
};
pub use stream::PRESUMED_INTERVAL_S;
pub use synchronize::{CameraTiming, Lookahead, Synchronizer};
pub use track::{track, track_with};
pub use tracked::Tracked;
pub use tracker::{CameraTracker, TrackedFrame};
pub use wand::{Wand, WandBall, wand_of};
