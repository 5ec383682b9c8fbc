//! Sources of frames during a flight.

use crate::FlightClock;
use mavsight_session::{LiveVideo, SessionError};
use mavsight_vision::Frame;
use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// The next item of a source.
#[derive(Debug)]
pub enum Next {
    /// A frame, and the middle of its exposure by the flight's clock.
    Frame(i64, Arc<Frame>),
    /// A fault after which the source goes on.
    Fault(String),
    /// All frames have been shown.
    Over,
    /// The source has ended early, with the reason.
    End(String),
}

/// Frames of one camera as they arrive.
pub trait Source: Send {
    /// Waits for the next item.
    fn next(&mut self) -> Next;

    /// Makes [`Source::next`] return soon when called from another thread; for sources that may wait long.
    fn interrupt(&self) -> Option<Interrupt> {
        None
    }
}

/// Ends a source's wait.
pub type Interrupt = Arc<dyn Fn() + Send + Sync>;

/// Opens a source; called again for each reopening.
pub type Opener = Box<dyn FnMut(FlightClock) -> Result<Box<dyn Source>, Box<dyn Error>> + Send>;

/// A running camera by the ffmpeg program.
pub struct RunningCamera {
    video: LiveVideo,
    clock: FlightClock,
    latency_ns: i64,
}

impl RunningCamera {
    /// Opens the `live` input of a session's camera; `latency_s` is subtracted from its time stamps.
    ///
    /// # Errors
    /// The message of ffmpeg.
    pub fn open(live: &str, latency_s: f64, clock: FlightClock) -> Result<Self, SessionError> {
        let video = LiveVideo::open(live, &mavsight_session::ffmpeg_program())?;
        Ok(Self { video, clock, latency_ns: mavsight_session::ns_from_s(latency_s) })
    }
}

impl Source for RunningCamera {
    fn next(&mut self) -> Next {
        match self.video.next_frame() {
            Ok((unix_ns, frame)) => Next::Frame(self.clock.flight_ns(unix_ns) - self.latency_ns, frame),
            Err(end) => Next::End(end.to_string()),
        }
    }

    fn interrupt(&self) -> Option<Interrupt> {
        Some(Arc::new(self.video.stopper()))
    }
}

/// A recording, at its own pace or as fast as possible.
pub(crate) struct Replay<I> {
    frames: I,
    /// The clock of the frames' pace; none: as fast as possible.
    pace: Option<FlightClock>,
    stop: Arc<AtomicBool>,
    /// Stamp of the last frame, and the time since the one before it.
    last_ns: Option<(i64, i64)>,
}

/// Share of an interval that is left to the tracker before the next frame is decoded.
const IDLE: f64 = 0.3;

impl<I> Replay<I> {
    /// Replays frames with their stamps; with a clock each frame waits for its time, until `stop` is set.
    pub(crate) fn new(frames: I, pace: Option<FlightClock>, stop: Arc<AtomicBool>) -> Self {
        Self { frames, pace, stop, last_ns: None }
    }

    fn wait_until(&self, t_ns: i64) {
        self.pace.iter().for_each(|clock| clock.wait_until(t_ns, &self.stop));
    }
}

impl<I, E> Source for Replay<I>
where
    I: Iterator<Item = Result<(i64, Frame), E>> + Send,
    E: std::fmt::Display,
{
    fn next(&mut self) -> Next {
        if let Some((last_ns, step_ns)) = self.last_ns {
            self.wait_until(last_ns + (IDLE * step_ns as f64) as i64);
        }
        match self.frames.next() {
            Some(Ok((t_ns, frame))) => {
                let frame = Arc::new(frame);
                self.wait_until(t_ns);
                self.last_ns = Some((t_ns, self.last_ns.map_or(0, |l| (t_ns - l.0).clamp(0, 100_000_000))));
                Next::Frame(t_ns, frame)
            }
            Some(Err(error)) => Next::Fault(error.to_string()),
            None => Next::Over,
        }
    }
}
