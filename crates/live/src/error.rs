//! Errors of a flight.

use std::path::PathBuf;
use thiserror::Error;

/// A flight cannot begin or go on.
#[derive(Debug, Error)]
pub enum LiveError {
    /// The pipeline refused the cameras or the vehicle.
    #[error(transparent)]
    Pipeline(#[from] mavsight_pipeline::PipelineError),
    /// A file of the session cannot be read or written.
    #[error(transparent)]
    Session(#[from] mavsight_session::SessionError),
    /// The motion noise is not finite and positive.
    #[error("motion noise: {0}: give poses of a sound flight as live.poses, or leave it out")]
    Noise(#[from] mavsight_pose::PoseError),
    /// Another number of cameras than the rig has.
    #[error("{sources} cameras for a rig of {cameras}: calibrate the cameras that fly")]
    Cameras {
        /// Sources given.
        sources: usize,
        /// Cameras of the rig.
        cameras: usize,
    },
    /// A recording cannot begin.
    #[error("{}: cannot record there: {detail}", folder.display())]
    Record {
        /// The folder.
        folder: PathBuf,
        /// Reason.
        detail: String,
    },
    /// A thread cannot be started.
    #[error("no thread `{name}` ({source}): end other programs and try again")]
    Thread {
        /// Name of the thread.
        name: String,
        /// The system's error.
        source: std::io::Error,
    },
}
