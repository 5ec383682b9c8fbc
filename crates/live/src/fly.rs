//! A flight: cameras in, poses out, as long as it lasts.

mod cameras;
mod tell;

use crate::camera::{Camera, Report, Seen, Shared};
use crate::parameters::{InputSource, Parameters};
use crate::seat::{LATENESS_FRAMES, Seat};
use crate::{
    FlightClock, Latencies, Listeners, LiveChain, LiveError, MotionFilter, Opener, RecorderSlot,
    TrackingState, events,
};
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector2;
use mavsight_link::{Event, Tracking};
use mavsight_pipeline::CameraTracker;
use mavsight_pose::{CameraClock, MotionNoise, Rig, TrackedDetection};
use mavsight_vision::Frame;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Reports that may wait for the chain: a second of two cameras at 60 Hz.
const WAITING: usize = 128;
/// Longest wait for a report between looks at the states.
const LOOK: Duration = Duration::from_millis(10);

/// At what pace frames are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As they come; what cannot be looked at in time is dropped.
    Own,
    /// As fast as they can be looked at; nothing is dropped, nothing stalls.
    Fast,
}

/// Sees every frame that is tracked, on the camera's own thread: camera, stamp, frame, and what was seen in it.
pub type Tap = Arc<dyn Fn(usize, i64, &Arc<Frame>, &[TrackedDetection]) + Send + Sync>;

/// One camera of a flight.
pub struct CameraSetup {
    /// Its name.
    pub name: String,
    /// Opens it.
    pub open: Opener,
    /// Whether it is opened again when it ends.
    pub reopens: bool,
    /// Its clock.
    pub clock: CameraClock,
    /// Unit vector in the image along which a rolling shutter goes.
    pub readout: Vector2<f64>,
}

/// What a flight needs.
pub struct Setup<'a> {
    /// Name of the session.
    pub name: &'a str,
    /// The cameras as calibrated.
    pub rig: &'a Rig,
    /// The aircraft.
    pub vehicle: &'a Vehicle,
    /// The same cameras as sources.
    pub cameras: Vec<CameraSetup>,
    /// At what pace.
    pub pace: Pace,
    /// The flight's clock.
    pub clock: FlightClock,
    /// Motion noise, where it is known.
    pub noise: Option<MotionNoise>,
    /// Who is told.
    pub listeners: Listeners,
    /// Who sees frames.
    pub taps: Vec<Tap>,
    /// Where it is recorded, if it is.
    pub recorder: Arc<RecorderSlot>,
    /// What is commanded, for the parameters.
    pub inputs: Option<Box<dyn InputSource>>,
    /// Model of the parameters; equation 3 where left out.
    pub model: Option<mavsight_identify::Model>,
    /// Share of a value at which the half width of its interval is small enough.
    pub enough: f64,
    /// Ends the flight when it is set.
    pub stop: Arc<AtomicBool>,
    /// Length of the flight, where it has one.
    pub for_ns: Option<i64>,
}

/// What became of a flight.
#[derive(Debug, Clone, Default)]
pub struct Flown {
    /// Instants.
    pub instants: u64,
    /// Those with a pose.
    pub measured: u64,
    /// Those without one after the first that had one.
    pub lost: u64,
    /// Frames each camera dropped.
    pub dropped: Vec<u64>,
    /// Frames each camera tracked.
    pub frames: Vec<u64>,
    /// From the last frame in hand to the pose handed on.
    pub latency: Latencies,
    /// From a frame in hand to what is seen in it.
    pub tracking: Latencies,
    /// Poses that listeners lost.
    pub unheard: Vec<u64>,
    /// Instants that were joined without a camera that was late.
    pub not_waited: u64,
    /// What ended the recording before the flight, where something did.
    pub recording_fault: Option<String>,
}

/// Flies until all recordings have ended, `stop` is set or the time is over.
///
/// # Errors
/// Cameras that are not those of the rig, a vehicle that the chain refuses, no threads.
pub fn fly(setup: Setup<'_>) -> Result<Flown, LiveError> {
    let (sources, cameras) = (setup.cameras.len(), setup.rig.cameras.len());
    if sources != cameras {
        return Err(LiveError::Cameras { sources, cameras });
    }
    let (reports_out, reports) = sync_channel(WAITING);
    let mut taps = setup.taps;
    taps.push(setup.recorder.tap());
    let shared = Shared {
        clock: setup.clock,
        pace: setup.pace,
        stop: Arc::clone(&setup.stop),
        reports: reports_out,
        taps,
    };
    let clocks: Vec<_> = setup.cameras.iter().map(|c| (c.clock, c.readout)).collect();
    let trackers = (0..cameras)
        .map(|k| CameraTracker::new(setup.rig, k, setup.vehicle))
        .collect::<Result<Vec<_>, _>>()?;
    let chain = LiveChain::new(setup.rig, setup.vehicle, &clocks)?;
    let motion = MotionFilter::new(setup.noise, setup.vehicle.environment.gravity_m_s2)?;
    let parameters = setup
        .inputs
        .map(|inputs| Parameters::start(inputs, setup.vehicle.clone(), setup.model, setup.enough))
        .transpose()?;
    let mut flying = Vec::with_capacity(cameras);
    for (k, (own, tracker)) in setup.cameras.into_iter().zip(trackers).enumerate() {
        let size = setup.rig.cameras[k].camera.size;
        flying.push(Camera::start(k, (own, size), tracker, &shared)?);
    }
    drop(shared.reports);
    let mut flight = Flight {
        rig: setup.rig,
        vehicle: setup.vehicle,
        pace: setup.pace,
        clock: setup.clock,
        stop: setup.stop,
        until_ns: setup.for_ns.map(|n| setup.clock.from_ns().saturating_add(n)),
        listeners: setup.listeners,
        recorder: setup.recorder,
        parameters,
        seats: (0..cameras).map(|_| Seat::new(setup.vehicle.marker.len())).collect(),
        cameras: flying,
        chain,
        motion,
        tracking: TrackingState::default(),
        last: Tracking::Acquiring,
        moved: 0,
        is_fit_told: false,
        received_ns: 0,
        latest_ns: i64::MIN,
        first_ns: None,
        told_ns: i64::MIN,
        spent: Vec::with_capacity(cameras + 1),
        told: 0,
        flown: Flown { dropped: vec![0; cameras], frames: vec![0; cameras], ..Flown::default() },
    };
    flight.listeners.event(Event::Scene(events::scene(setup.name, setup.rig, setup.vehicle)));
    flight.go(&reports);
    Ok(flight.finish(&reports))
}

struct Flight<'a> {
    rig: &'a Rig,
    vehicle: &'a Vehicle,
    pace: Pace,
    clock: FlightClock,
    stop: Arc<AtomicBool>,
    until_ns: Option<i64>,
    listeners: Listeners,
    recorder: Arc<RecorderSlot>,
    parameters: Option<Parameters>,
    seats: Vec<Seat>,
    cameras: Vec<Camera>,
    chain: LiveChain,
    motion: MotionFilter,
    tracking: TrackingState,
    last: Tracking,
    moved: usize,
    /// Whether it was looked at how well sights fit.
    is_fit_told: bool,
    /// When the latest frame was in hand.
    received_ns: i64,
    /// The latest frame's own time.
    latest_ns: i64,
    /// When the first frame was in hand.
    first_ns: Option<i64>,
    told_ns: i64,
    /// Lists of sights to be given back, by camera.
    spent: Vec<(usize, Vec<TrackedDetection>)>,
    /// Instants told when lists were last looked at.
    told: u64,
    flown: Flown,
}

impl Flight<'_> {
    /// Now: by the clock, or where nothing is in real time by the frames.
    fn now_ns(&self) -> i64 {
        if self.pace == Pace::Fast { self.latest_ns.max(self.clock.from_ns()) } else { self.clock.now_ns() }
    }

    fn go(&mut self, reports: &Receiver<Report>) {
        let mut scratch = Vec::with_capacity(LATENESS_FRAMES);
        loop {
            match reports.recv_timeout(self.patience()) {
                Ok(report) => self.take(report, &mut scratch),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.tell_instants();
            self.tell_misfit();
            self.give_back();
            if self.pace == Pace::Own {
                self.look_at_cameras();
            }
            self.tell_rates();
            let is_over = self.until_ns.is_some_and(|until| self.now_ns() >= until);
            if is_over || self.stop.load(Ordering::Relaxed) || self.seats.iter().all(|s| s.ended) {
                break;
            }
        }
    }

    /// Gives lists of sights back once an instant is told: the trackers, which go on looking around when they have them, would take
    /// the processor from who tells it.
    fn give_back(&mut self) {
        let told = self.flown.instants;
        if told > self.told || self.spent.len() > self.cameras.len() {
            self.spent.drain(..).for_each(|(camera, sights)| self.cameras[camera].give_back(sights));
        }
        self.told = told;
    }

    fn take(&mut self, report: Report, scratch: &mut Vec<i64>) {
        match report {
            Report::Seen(seen) => self.take_seen(seen, scratch),
            Report::Opened { camera } => {
                self.seats[camera].states.opened();
                self.seats[camera].opened_ns = Some(self.now_ns());
            }
            Report::Gone { camera, reason } => {
                self.seats[camera].states.gone(reason);
                self.leave(camera);
            }
            Report::Fault { camera, text } => {
                let name = &self.rig.cameras[camera].name;
                self.note(true, format!("{name}: {text}."));
            }
            Report::WentBack { camera, stamp_ns } => self.tell_back(camera, stamp_ns),
            Report::Ended { camera } => {
                self.seats[camera].ended = true;
                self.leave(camera);
            }
        }
    }

    fn take_seen(&mut self, seen: Seen, scratch: &mut Vec<i64>) {
        let Seen { camera, stamp_ns, received_ns, tracked_ns, dark, sights } = seen;
        let t_ns = self.chain.time_ns(camera, stamp_ns);
        let seat = &mut self.seats[camera];
        seat.states.frame(received_ns, dark);
        seat.came(received_ns - t_ns, scratch);
        seat.frames += 1;
        seat.latest_ns = t_ns;
        seat.latency.add_ns(tracked_ns - received_ns);
        self.flown.tracking.add_ns(tracked_ns - received_ns);
        self.flown.frames[camera] += 1;
        if std::mem::take(&mut seat.is_left) {
            self.chain.wait_again(camera);
            self.tracking.cut();
        }
        self.latest_ns = self.latest_ns.max(t_ns);
        self.received_ns = received_ns;
        self.first_ns.get_or_insert(received_ns);
        self.tell_outlived(t_ns);
        let had_begun = self.chain.has_begun();
        self.chain.push(camera, stamp_ns, &sights);
        if !had_begun && self.chain.has_begun() {
            self.set_intervals();
        }
        self.spent.push((camera, sights));
    }

    /// The chain begins with what it has, if it has not.
    fn begin(&mut self) {
        if !self.chain.has_begun() {
            self.chain.begin();
            self.set_intervals();
        }
    }

    fn set_intervals(&mut self) {
        for (k, seat) in self.seats.iter_mut().enumerate() {
            self.chain.interval_s(k).into_iter().for_each(|s| seat.states.set_interval_s(s));
        }
    }

    /// Ends the cameras, and tells what still waited.
    fn finish(mut self, reports: &Receiver<Report>) -> Flown {
        self.stop.store(true, Ordering::Relaxed);
        self.cameras.iter().for_each(Camera::close);
        let mut scratch = Vec::new();
        let all_ended = self.seats.iter().all(|s| s.ended);
        loop {
            match reports.recv_timeout(Duration::from_millis(20)) {
                // What comes after the end of a flight that was ended is not part of it.
                Ok(report) if all_ended => self.take(report, &mut scratch),
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => self.cameras.iter().for_each(Camera::interrupt),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        self.chain.begin();
        (0..self.seats.len()).for_each(|c| self.chain.go_without(c, i64::MAX));
        self.tell_instants();
        for (dropped, camera) in self.flown.dropped.iter_mut().zip(&self.cameras) {
            *dropped = camera.dropped();
        }
        self.cameras.into_iter().for_each(Camera::finish);
        if let Some(event) = self.parameters.and_then(Parameters::finish) {
            self.listeners.event(event);
        }
        if let Some(recorder) = self.recorder.current() {
            recorder.finish();
            self.flown.recording_fault = recorder.fault();
            self.listeners.event(recorder.event());
        }
        self.flown.unheard = self.listeners.dropped();
        self.listeners.finish();
        self.flown
    }
}
