//! The inputs of a flight and its summary.

use crate::source::Replay;
use crate::{FlightClock, InputSource, Latencies, Listeners, Opener, RecorderSlot, Source};
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector2;
use mavsight_link::Event;
use mavsight_pose::{CameraClock, MotionNoise, Rig, TrackedDetection};
use mavsight_vision::Frame;
use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The pace at which frames are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As they arrive; frames that cannot be tracked in time are dropped.
    Own,
    /// As fast as they can be tracked; nothing is dropped, nothing stalls.
    Fast,
}

/// Called with every tracked frame on the camera's own thread: camera, stamp, frame and its detections.
pub type Tap = Arc<dyn Fn(usize, i64, &Arc<Frame>, &[TrackedDetection]) + Send + Sync>;

/// One camera of a flight.
pub struct CameraSetup {
    /// Name.
    pub name: String,
    /// Opens its source.
    pub open: Opener,
    /// Whether the source is opened again when it ends.
    pub reopens: bool,
    /// Clock of its stamps.
    pub clock: CameraClock,
    /// Unit vector in the image along which a rolling shutter moves.
    pub readout: Vector2<f64>,
}

impl CameraSetup {
    /// A camera that shows recorded or rendered frames once, with their stamps, at their own pace or as fast
    /// as possible, until they are over or `stop` is set.
    pub fn replay<I, E>(name: &str, frames: I, pace: Pace, stop: &Arc<AtomicBool>) -> Self
    where
        I: Iterator<Item = Result<(i64, Frame), E>> + Send + 'static,
        E: Display,
    {
        let (mut frames, stop) = (Some(frames), Arc::clone(stop));
        let open = move |clock| {
            let frames = frames.take().ok_or("the recording has ended")?;
            let paced = (pace == Pace::Own).then_some(clock);
            Ok(Box::new(Replay::new(frames, paced, Arc::clone(&stop))) as Box<dyn Source>)
        };
        let (clock, readout) = (CameraClock::default(), Vector2::y());
        Self { name: name.to_owned(), open: Box::new(open), reopens: false, clock, readout }
    }
}

/// The inputs of a flight.
pub struct Setup<'a> {
    /// Name of the session.
    pub name: &'a str,
    /// The calibrated cameras.
    pub rig: &'a Rig,
    /// The aircraft.
    pub vehicle: &'a Vehicle,
    /// Sources of the rig's cameras, in its order.
    pub cameras: Vec<CameraSetup>,
    /// Pace of the frames.
    pub pace: Pace,
    /// The flight's clock.
    pub clock: FlightClock,
    /// Motion noise, if known.
    pub noise: Option<MotionNoise>,
    /// Receivers of instants and events.
    pub listeners: Listeners,
    /// Receivers of tracked frames.
    pub taps: Vec<Tap>,
    /// Recording, if any.
    pub recorder: Arc<RecorderSlot>,
    /// Recorded or commanded inputs, for the parameters.
    pub inputs: Option<Box<dyn InputSource>>,
    /// Equations in place of those of the vehicle's model.
    pub equations: Option<mavsight_identify::EquationFile>,
    /// Ratio of an interval's half width to its value that is small enough.
    pub enough: f64,
    /// Ends the flight when it is set.
    pub stop: Arc<AtomicBool>,
    /// Length of the flight, if limited.
    pub for_ns: Option<i64>,
}

impl Setup<'_> {
    /// Sends an event to all listeners, and records it.
    pub(crate) fn send(&self, event: Event) {
        if let Some(recorder) = self.recorder.current() {
            recorder.sent(&event);
        }
        self.listeners.event(event);
    }
}

/// The summary of a finished flight.
#[derive(Debug, Clone, Default)]
pub struct FlightSummary {
    /// Instants.
    pub instants: u64,
    /// Instants with a pose.
    pub measured: u64,
    /// Instants without a pose after the first that had one.
    pub lost: u64,
    /// Frames of each camera that this computer dropped.
    pub dropped: Vec<u64>,
    /// Frames of each camera that never came, by gaps of its time stamps.
    pub missing: Vec<u64>,
    /// Frames that each camera tracked.
    pub frames: Vec<u64>,
    /// Time from an instant's last frame in hand to its pose sent.
    pub latency: Latencies,
    /// Time from a frame in hand to its detections.
    pub tracking: Latencies,
    /// Messages that each listener lost.
    pub unheard: Vec<u64>,
    /// Instants that were joined without a late camera.
    pub not_waited: u64,
    /// Reason why the recording ended before the flight, if it did.
    pub recording_fault: Option<String>,
}
