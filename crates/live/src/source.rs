//! Where frames come from while a flight goes on.

use crate::FlightClock;
use mavsight_session::{FrameSource, LiveVideo};
use mavsight_vision::Frame;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Longest sleep between looks at whether the flight has ended.
const LOOK: Duration = Duration::from_millis(20);

/// What a source yields.
#[derive(Debug)]
pub enum Next {
    /// A frame, and the middle of its exposure by the flight's clock.
    Frame(i64, Arc<Frame>),
    /// Something went wrong and it goes on.
    Fault(String),
    /// All of it has been shown.
    Over,
    /// It has ended before that, and why.
    End(String),
}

/// Frames of one camera as they come.
pub trait Source: Send {
    /// Waits for the next.
    fn next(&mut self) -> Next;

    /// What makes [`Source::next`] return soon from another thread, where it may wait long.
    fn interrupt(&self) -> Option<Interrupt> {
        None
    }
}

/// Makes a source's wait end.
pub type Interrupt = Arc<dyn Fn() + Send + Sync>;

/// Opens a source, each time that it is wanted; an error says in words why it cannot.
pub type Opener = Box<dyn FnMut(FlightClock) -> Result<Box<dyn Source>, String> + Send>;

/// A running camera by the ffmpeg program.
pub struct RunningCamera {
    video: LiveVideo,
    clock: FlightClock,
    latency_ns: i64,
}

impl RunningCamera {
    /// Opens what a session's camera names as `live`; `latency_s` is taken off its time stamps.
    ///
    /// # Errors
    /// In words: what ffmpeg says.
    pub fn open(live: &str, latency_s: f64, clock: FlightClock) -> Result<Self, String> {
        let video = LiveVideo::open(live, &mavsight_session::ffmpeg_program()).map_err(|e| e.to_string())?;
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

/// The first frame of a recording, and the others behind it.
pub struct CameraFile {
    first: Option<(i64, Frame)>,
    rest: FrameSource,
}

impl CameraFile {
    /// Reads the first frame.
    ///
    /// # Errors
    /// A recording without one.
    pub fn open(mut source: FrameSource) -> Result<Self, mavsight_session::SessionError> {
        let first = source.next().transpose()?;
        Ok(Self { first, rest: source })
    }

    /// Stamp of the first frame.
    pub fn first_ns(&self) -> Option<i64> {
        self.first.as_ref().map(|f| f.0)
    }
}

impl Iterator for CameraFile {
    type Item = Result<(i64, Frame), mavsight_session::SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.first.take().map(Ok).or_else(|| self.rest.next())
    }
}

/// A recording, at its own pace or as fast as it is taken.
pub struct Replay<I> {
    frames: I,
    /// The clock that frames wait for; none: they do not.
    pace: Option<FlightClock>,
    stop: Arc<AtomicBool>,
    /// Stamp of the last frame, and the time since the one before it.
    last_ns: Option<(i64, i64)>,
}

/// Share of an interval after a frame before the next is read and decoded: the last one is looked at meanwhile, as it would be with a
/// camera that decodes nothing.
const IDLE: f64 = 0.3;

impl<I> Replay<I> {
    /// Frames with their stamps; with a clock each waits for its time, until `stop` is set.
    pub fn new(frames: I, pace: Option<FlightClock>, stop: Arc<AtomicBool>) -> Self {
        Self { frames, pace, stop, last_ns: None }
    }

    /// Waits for a time, where frames wait for theirs.
    fn wait_until(&self, t_ns: i64) {
        while let Some(clock) = &self.pace {
            let left = clock.until(t_ns);
            if left.is_zero() || self.stop.load(Ordering::Relaxed) {
                return;
            }
            std::thread::sleep(left.min(LOOK));
        }
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
