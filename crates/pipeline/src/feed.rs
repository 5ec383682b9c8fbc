//! Frames of one camera in order of time.

use crate::PipelineError;
use mavsight_geometry::Vector2;
use mavsight_pose::{CameraClock, ClockPrior};
use mavsight_vision::Frame;

/// A frame and the middle of its exposure.
#[derive(Debug, Clone)]
pub struct TimedFrame {
    /// Nanoseconds.
    pub t_ns: i64,
    /// The image.
    pub frame: Frame,
}

/// Frames as they come. An error after the first frame is a fault at that place, which is noted; what comes
/// after it, if anything does, is used.
pub type Frames<'a> = Box<dyn Iterator<Item = Result<TimedFrame, PipelineError>> + Send + 'a>;

/// What the sound of a recording has of a clap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Clap {
    /// By the recording's time stamps, s.
    At(f64),
    /// Nothing in its sound stands out.
    None,
    /// It has no sound.
    Silent,
}

/// One camera's frames, from wherever they come.
pub struct CameraFeed<'a> {
    /// Camera name, as in the rig.
    pub name: String,
    /// Number of frames announced, where that is known.
    pub announced: Option<usize>,
    /// The frames.
    pub frames: Frames<'a>,
    /// What is known of the clock behind their time stamps.
    pub clock: ClockPrior,
    /// Unit vector in the image along which a rolling shutter goes.
    pub readout: Vector2<f64>,
    /// Whether a flash of light, or a lamp switched on, that all cameras saw is where the estimation of
    /// clocks starts.
    pub flash: bool,
    /// The clap in the recording's sound, where the estimation of clocks starts from one that all cameras
    /// heard.
    pub clap: Option<Clap>,
    /// Whether the encoder may have predicted frames from those before and after them.
    pub may_be_reordered: bool,
    /// Whether frames follow each other in time, as those of an image sequence of a board do not.
    pub is_film: bool,
}

impl<'a> CameraFeed<'a> {
    /// A camera whose time stamps are true.
    pub fn new(name: impl Into<String>, announced: Option<usize>, frames: Frames<'a>) -> Self {
        let clock = ClockPrior::known(CameraClock::default());
        Self {
            name: name.into(),
            announced,
            frames,
            clock,
            readout: Vector2::y(),
            flash: false,
            clap: None,
            may_be_reordered: false,
            is_film: true,
        }
    }
}

/// The median time between frames or rows; none of fewer than two.
pub fn usual_interval_ns(times_ns: impl IntoIterator<Item = i64>) -> Option<i64> {
    let times_ns: Vec<i64> = times_ns.into_iter().collect();
    let mut steps: Vec<i64> = times_ns.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).copied()
}
