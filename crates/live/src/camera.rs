//! The two threads of a camera: one fetches frames, one tracks.

use crate::fly::{CameraSetup, Pace, Tap};
use crate::{FlightClock, Interrupt, LiveError, Next, Popped, Queue, Source};
use mavsight_geometry::ImageSize;
use mavsight_pipeline::{CameraTracker, Sight, TrackedFrame};
use mavsight_vision::Frame;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Frames that may wait for a tracker: one that is being looked at is behind it, one beside it is what may still be looked at in
/// time. More would only be late.
const WAITING: usize = 2;
/// The same where nothing is dropped.
const WAITING_FAST: usize = 8;

/// How long a tracker waits after telling, at most, for what it told to be taken in: so that what comes next does not take
/// the processor from the thread that everybody waits for.
const TAKEN_IN: Duration = Duration::from_millis(2);

/// Waits before a source is opened again: the first, and the longest after it has failed over and over.
const AGAIN: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(4));

/// A frame in hand.
struct Arrival {
    stamp_ns: i64,
    received_ns: i64,
    frame: Arc<Frame>,
}

/// What a camera's threads tell.
pub(crate) enum Report {
    /// Its source is open.
    Opened { camera: usize },
    /// Its source has ended or cannot be opened.
    Gone { camera: usize, reason: String },
    /// Something went wrong with a frame.
    Fault { camera: usize, text: String },
    /// A frame is not later than the one before it.
    WentBack { camera: usize, stamp_ns: i64 },
    /// What was seen in a frame.
    Seen(Seen),
    /// There will be nothing more.
    Ended { camera: usize },
}

/// What was seen in a frame.
pub(crate) struct Seen {
    pub(crate) camera: usize,
    pub(crate) stamp_ns: i64,
    pub(crate) received_ns: i64,
    pub(crate) tracked_ns: i64,
    pub(crate) dark: bool,
    pub(crate) sights: Vec<Sight>,
}

/// What a camera's threads share with the flight.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) clock: FlightClock,
    pub(crate) pace: Pace,
    pub(crate) stop: Arc<AtomicBool>,
    pub(crate) reports: SyncSender<Report>,
    pub(crate) taps: Vec<Tap>,
}

/// A running camera.
pub(crate) struct Camera {
    queue: Arc<Queue<Arrival>>,
    interrupt: Arc<Mutex<Option<Interrupt>>>,
    /// Where used lists of sights go back.
    spent: Sender<Vec<Sight>>,
    threads: [JoinHandle<()>; 2],
}

impl Camera {
    pub(crate) fn start(
        camera: usize,
        (setup, size): (CameraSetup, ImageSize),
        tracker: CameraTracker,
        shared: &Shared,
    ) -> Result<Self, LiveError> {
        let waiting = if shared.pace == Pace::Fast { WAITING_FAST } else { WAITING };
        let queue = Arc::new(Queue::new(waiting));
        let interrupt = Arc::new(Mutex::new(None));
        let (spent, unused) = channel();
        let fetch = Fetch {
            camera,
            setup,
            size,
            queue: Arc::clone(&queue),
            interrupt: Arc::clone(&interrupt),
            shared: shared.clone(),
        };
        let (own, other) = (Arc::clone(&queue), shared.clone());
        let thread = |what: &'static str| move |source| LiveError::Thread { what, source };
        let builder = |what: &str| std::thread::Builder::new().name(format!("{what} {}", camera + 1));
        let fetching = builder("fetch").spawn(move || fetch.run()).map_err(thread("a camera"))?;
        let tracking = builder("track")
            .spawn(move || track(camera, tracker, (&own, &unused), &other))
            .map_err(thread("a tracker"))?;
        Ok(Self { queue, interrupt, spent, threads: [fetching, tracking] })
    }

    /// Frames dropped so far.
    pub(crate) fn dropped(&self) -> u64 {
        self.queue.dropped()
    }

    /// Gives back a list of sights for use again.
    pub(crate) fn give_back(&self, sights: Vec<Sight>) {
        // A tracker that has ended wants none.
        let _ = self.spent.send(sights);
    }

    /// Makes a source that hangs end, so that it is opened again.
    pub(crate) fn interrupt(&self) {
        let interrupt = self.interrupt.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(interrupt) = interrupt {
            interrupt();
        }
    }

    /// Ends both threads; the flight's stop is set.
    pub(crate) fn finish(self) {
        self.queue.close();
        while !self.threads[0].is_finished() {
            self.interrupt();
            std::thread::sleep(Duration::from_millis(5));
        }
        self.threads.into_iter().for_each(|t| {
            // A thread that panicked has said so.
            let _ = t.join();
        });
    }

    /// Both threads have ended or are about to, whatever they still tell.
    pub(crate) fn close(&self) {
        self.queue.close();
        self.interrupt();
    }
}

struct Fetch {
    camera: usize,
    setup: CameraSetup,
    size: ImageSize,
    queue: Arc<Queue<Arrival>>,
    interrupt: Arc<Mutex<Option<Interrupt>>>,
    shared: Shared,
}

impl Fetch {
    fn run(mut self) {
        let mut wait = AGAIN.0;
        while !self.stopped() {
            let reason = match (self.setup.open)(self.shared.clock) {
                Ok(mut source) => {
                    self.hold(source.interrupt());
                    self.tell(Report::Opened { camera: self.camera });
                    let (frames, reason) = self.fetch(source.as_mut());
                    self.hold(None);
                    if frames > 0 {
                        wait = AGAIN.0;
                    }
                    reason
                }
                Err(reason) => Some(reason),
            };
            if self.stopped() {
                break;
            }
            if !self.setup.reopens {
                if let Some(text) = reason {
                    self.tell(Report::Fault { camera: self.camera, text });
                }
                break;
            }
            let reason = reason.unwrap_or_else(|| "its source has ended".to_owned());
            self.tell(Report::Gone { camera: self.camera, reason });
            self.sleep(wait);
            wait = (2 * wait).min(AGAIN.1);
        }
        self.queue.close();
    }

    /// All frames of an open source: how many, and why it ended before its end.
    fn fetch(&self, source: &mut dyn Source) -> (u64, Option<String>) {
        let mut frames = 0;
        while !self.stopped() {
            match source.next() {
                Next::Frame(stamp_ns, frame) => {
                    if frame.size != self.size {
                        return (frames, Some(self.wrong_size(frame.size)));
                    }
                    frames += 1;
                    let received_ns = self.shared.clock.now_ns();
                    let arrival = Arrival { stamp_ns, received_ns, frame };
                    if self.shared.pace == Pace::Own {
                        drop(self.queue.push(arrival));
                    } else if !self.queue.push_waiting(arrival) {
                        break;
                    }
                }
                Next::Fault(text) => self.tell(Report::Fault { camera: self.camera, text }),
                Next::Over => break,
                Next::End(reason) => return (frames, Some(reason)),
            }
        }
        (frames, None)
    }

    fn wrong_size(&self, size: ImageSize) -> String {
        LiveError::FrameSize {
            camera: self.setup.name.clone(),
            width_px: size.width_px,
            height_px: size.height_px,
            wanted_width_px: self.size.width_px,
            wanted_height_px: self.size.height_px,
        }
        .to_string()
    }

    fn hold(&self, interrupt: Option<Interrupt>) {
        *self.interrupt.lock().unwrap_or_else(PoisonError::into_inner) = interrupt;
    }

    fn stopped(&self) -> bool {
        self.shared.stop.load(Ordering::Relaxed)
    }

    fn tell(&self, report: Report) {
        // A flight that has ended hears nothing more.
        let _ = self.shared.reports.send(report);
    }

    fn sleep(&self, wait: Duration) {
        let step = Duration::from_millis(10);
        let mut left = wait;
        while !left.is_zero() && !self.stopped() {
            std::thread::sleep(step.min(left));
            left = left.saturating_sub(step);
        }
    }
}

fn track(
    camera: usize,
    mut tracker: CameraTracker,
    (queue, unused): (&Queue<Arrival>, &Receiver<Vec<Sight>>),
    shared: &Shared,
) {
    let mut sights = Vec::new();
    loop {
        let Arrival { stamp_ns, received_ns, frame } = match queue.pop(Duration::from_millis(200)) {
            Popped::Item(arrival) => arrival,
            Popped::Nothing => continue,
            Popped::Closed => break,
        };
        sights.clear();
        let look = tracker.see(stamp_ns, Arc::clone(&frame));
        let seen = match look {
            TrackedFrame::New(seen) => seen,
            // It shows nothing new: a camera that does no more has stalled.
            TrackedFrame::Copy => continue,
            TrackedFrame::Backward => {
                // A flight that has ended hears nothing more.
                let _ = shared.reports.send(Report::WentBack { camera, stamp_ns });
                continue;
            }
        };
        sights.extend_from_slice(seen);
        for tap in &shared.taps {
            tap(camera, stamp_ns, &frame, seen);
        }
        drop(frame);
        let (tracked_ns, dark) = (shared.clock.now_ns(), tracker.is_dark());
        // What came back late is not what is waited for below.
        while shared.pace == Pace::Own && unused.try_recv().is_ok() {}
        let report = Report::Seen(Seen { camera, stamp_ns, received_ns, tracked_ns, dark, sights });
        if shared.reports.send(report).is_err() {
            return;
        }
        let patience = if shared.pace == Pace::Own { TAKEN_IN } else { Duration::ZERO };
        sights = unused.recv_timeout(patience).unwrap_or_default();
        // Nobody waits for this.
        tracker.look_around();
    }
    // As above.
    let _ = shared.reports.send(Report::Ended { camera });
}
