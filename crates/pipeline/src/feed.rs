//! Frames of one camera in order of time.

use crate::PipelineError;
use mavsight_vision::Frame;

/// A frame and the middle of its exposure.
#[derive(Debug, Clone)]
pub struct TimedFrame {
    /// Nanoseconds.
    pub t_ns: i64,
    /// The image.
    pub frame: Frame,
}

/// One camera's frames, from wherever they come.
pub struct CameraFeed<'a> {
    /// Camera name, as in the rig.
    pub name: String,
    /// Number of frames announced, where that is known.
    pub announced: Option<usize>,
    /// The frames.
    pub frames: Box<dyn Iterator<Item = Result<TimedFrame, PipelineError>> + Send + 'a>,
}
