//! The two threads of a camera: one fetches frames, one tracks.

use crate::clock_steps::{ClockSteps, Stamped};
use crate::queue::{Queue, locked};
use crate::setup::{CameraSetup, Pace, Tap};
use crate::worker::spawn;
use crate::{FlightClock, Interrupt, LiveError, Next, Source};
use mavsight_geometry::ImageSize;
use mavsight_pipeline::{CameraTracker, TrackedFrame};
use mavsight_pose::TrackedDetection;
use mavsight_vision::Frame;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// Frames that may wait for a tracker; more would come out too late.
const WAITING: usize = 2;
/// Frames that may wait for a tracker where nothing is dropped.
const WAITING_FAST: usize = 8;

/// Pause of a tracker after its report, which leaves the processor to the pose estimate.
const POSE_TIME: Duration = Duration::from_millis(1);

/// Wait before a source that has ended is opened again, twice as long after each failure: where it is back at once, it has
/// cost six frames of thirty a second.
const FIRST_WAIT_NS: i64 = 200_000_000;
/// Longest wait before a source is opened again, after repeated failures.
const LONGEST_WAIT_NS: i64 = 4_000_000_000;

struct Arrival {
    stamp_ns: i64,
    received_ns: i64,
    frame: Arc<Frame>,
}

pub(crate) enum Report {
    /// Its source is open.
    Opened { camera: usize },
    /// Its source has ended or cannot be opened.
    Gone { camera: usize, reason: String },
    /// Something went wrong with a frame.
    Fault { camera: usize, text: String },
    /// Its clock was set.
    ClockSet { camera: usize, by_ns: i64 },
    /// A frame is not later than the one before it.
    WentBack { camera: usize, stamp_ns: i64 },
    /// A frame is passed over while it is open whether the clock was set.
    PassedOver { camera: usize, received_ns: i64 },
    /// A frame shows the image before it once more.
    Repeated { camera: usize, received_ns: i64 },
    /// The detections of a frame.
    Seen(Seen),
    /// The last report.
    Ended { camera: usize },
}

pub(crate) struct Seen {
    pub(crate) camera: usize,
    pub(crate) stamp_ns: i64,
    pub(crate) received_ns: i64,
    pub(crate) tracked_ns: i64,
    pub(crate) dark: bool,
    pub(crate) detections: Vec<TrackedDetection>,
}

/// The part of a flight that all cameras' threads use.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) clock: FlightClock,
    pub(crate) pace: Pace,
    pub(crate) stop: Arc<AtomicBool>,
    pub(crate) reports: SyncSender<Report>,
    pub(crate) taps: Vec<Tap>,
}

pub(crate) struct Camera {
    queue: Arc<Queue<Arrival>>,
    interrupt: Arc<Mutex<Option<Interrupt>>>,
    threads: [JoinHandle<()>; 2],
}

impl Camera {
    pub(crate) fn start(
        camera: usize,
        setup: CameraSetup,
        size: ImageSize,
        tracker: CameraTracker,
        shared: &Shared,
    ) -> Result<Self, LiveError> {
        let waits = shared.pace == Pace::Fast;
        let queue = Arc::new(Queue::new(if waits { WAITING_FAST } else { WAITING }, waits));
        let interrupt = Arc::new(Mutex::new(None));
        let fetch = Fetch {
            camera,
            setup,
            size,
            queue: Arc::clone(&queue),
            interrupt: Arc::clone(&interrupt),
            shared: shared.clone(),
        };
        let (own, other) = (Arc::clone(&queue), shared.clone());
        let fetching = spawn(&format!("fetch {}", camera + 1), move || fetch.run())?;
        let track = move || track(camera, tracker, &own, &other);
        let tracking = spawn(&format!("track {}", camera + 1), track)?;
        Ok(Self { queue, interrupt, threads: [fetching, tracking] })
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.queue.dropped()
    }

    /// Makes a source that hangs return, so that it is opened again.
    pub(crate) fn interrupt(&self) {
        let interrupt = locked(&self.interrupt).clone();
        if let Some(interrupt) = interrupt {
            interrupt();
        }
    }

    /// Makes both threads end soon; they may still send reports.
    pub(crate) fn close(&self) {
        self.queue.close();
        self.interrupt();
    }

    pub(crate) fn finish(self) {
        // A thread that panicked has said so.
        self.threads.into_iter().for_each(|t| drop(t.join()));
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
        let (clock, mut wait_ns) = (self.shared.clock, FIRST_WAIT_NS);
        while !self.stopped() {
            let reason = match (self.setup.open)(clock) {
                Ok(mut source) => {
                    self.set_interrupt(source.interrupt());
                    self.report(Report::Opened { camera: self.camera });
                    let (frames, reason) = self.fetch(source.as_mut());
                    self.set_interrupt(None);
                    if frames > 0 {
                        wait_ns = FIRST_WAIT_NS;
                    }
                    reason
                }
                Err(error) => Some(error.to_string()),
            };
            if self.stopped() {
                break;
            }
            if !self.setup.reopens {
                if let Some(text) = reason {
                    self.report(Report::Fault { camera: self.camera, text });
                }
                break;
            }
            let reason = reason.unwrap_or_else(|| "its source has ended".to_owned());
            self.report(Report::Gone { camera: self.camera, reason });
            clock.wait_until(clock.now_ns() + wait_ns, &self.shared.stop);
            wait_ns = (2 * wait_ns).min(LONGEST_WAIT_NS);
        }
        self.queue.close();
    }

    /// Fetches all frames of an open source; returns their number, and the reason if it ended before its end.
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
                    drop(self.queue.push(Arrival { stamp_ns, received_ns, frame }));
                    if self.queue.is_closed() {
                        break;
                    }
                }
                Next::Fault(text) => self.report(Report::Fault { camera: self.camera, text }),
                Next::Over => break,
                Next::End(reason) => return (frames, Some(reason)),
            }
        }
        (frames, None)
    }

    fn wrong_size(&self, found: ImageSize) -> String {
        format!(
            "{}: its frames are {}×{}, but it was calibrated at {}×{}: set it to the calibrated size, or calibrate again",
            self.setup.name, found.width_px, found.height_px, self.size.width_px, self.size.height_px
        )
    }

    fn set_interrupt(&self, interrupt: Option<Interrupt>) {
        *locked(&self.interrupt) = interrupt;
    }

    fn stopped(&self) -> bool {
        self.shared.stop.load(Ordering::Relaxed)
    }

    fn report(&self, report: Report) {
        // A flight that has ended receives nothing more.
        let _ = self.shared.reports.send(report);
    }
}

fn track(camera: usize, mut tracker: CameraTracker, queue: &Queue<Arrival>, shared: &Shared) {
    // Reports to a flight that has ended are not received, here and below.
    let report = |report| shared.reports.send(report).is_ok();
    let mut steps = ClockSteps::default();
    while !queue.is_over() {
        let Some(Arrival { stamp_ns, received_ns, frame }) = queue.pop(Duration::from_millis(200)) else {
            continue;
        };
        // At another pace frames do not arrive when they are filmed.
        let Stamped { stamp_ns, step_ns } = match shared.pace {
            Pace::Own => steps.stamped(stamp_ns, received_ns),
            Pace::Fast => Stamped { stamp_ns: Some(stamp_ns), step_ns: None },
        };
        if let Some(by_ns) = step_ns {
            report(Report::ClockSet { camera, by_ns });
        }
        let Some(stamp_ns) = stamp_ns else {
            report(Report::PassedOver { camera, received_ns });
            continue;
        };
        let detections = match tracker.see(stamp_ns, Arc::clone(&frame)) {
            TrackedFrame::New(seen) => seen.to_vec(),
            // Nothing new: a camera that only repeats frames has stalled.
            TrackedFrame::Copy => {
                report(Report::Repeated { camera, received_ns });
                continue;
            }
            TrackedFrame::Backward => {
                report(Report::WentBack { camera, stamp_ns });
                continue;
            }
        };
        for tap in &shared.taps {
            tap(camera, stamp_ns, &frame, &detections);
        }
        drop(frame);
        let (tracked_ns, dark) = (shared.clock.now_ns(), tracker.is_dark());
        let seen = Seen { camera, stamp_ns, received_ns, tracked_ns, dark, detections };
        if !report(Report::Seen(seen)) {
            return;
        }
        if shared.pace == Pace::Own {
            std::thread::sleep(POSE_TIME);
        }
        tracker.look_around();
    }
    report(Report::Ended { camera });
}
