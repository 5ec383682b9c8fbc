//! A flight: cameras in, poses out.

mod cameras;
mod report;

use crate::camera::{Camera, Report, Seen, Shared};
use crate::motion::MotionFilter;
use crate::parameters::Parameters;
use crate::setup::{CameraSetup, FlightSummary, Pace, Setup};
use crate::status::CameraStatus;
use crate::tracking::TrackingState;
use crate::{LiveError, LivePipeline, events};
use mavsight_geometry::UnitQuaternion;
use mavsight_link::Event;
use mavsight_pipeline::CameraTracker;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Reports that may wait: a second of two cameras at 60 Hz.
const WAITING: usize = 128;
/// Longest wait for a report between checks of the states.
const CHECK: Duration = Duration::from_millis(10);

/// Flies until all recordings have ended, `stop` is set or the time is over.
///
/// # Errors
/// Another number of cameras than the rig has, a vehicle that the pipeline refuses, no threads.
pub fn fly(mut setup: Setup<'_>) -> Result<FlightSummary, LiveError> {
    let (own, cameras) = (std::mem::take(&mut setup.cameras), setup.rig.cameras.len());
    if own.len() != cameras {
        return Err(LiveError::Cameras { sources: own.len(), cameras });
    }
    let (reports_out, reports) = sync_channel(WAITING);
    let mut taps = std::mem::take(&mut setup.taps);
    taps.push(setup.recorder.tap());
    let (clock, pace, stop) = (setup.clock, setup.pace, Arc::clone(&setup.stop));
    let shared = Shared { clock, pace, stop, reports: reports_out, taps };
    let status = |c: &CameraSetup| {
        let mut status = CameraStatus::new(setup.vehicle.marker.len());
        status.is_played = !c.reopens;
        status
    };
    let status = own.iter().map(status).collect();
    let clocks: Vec<_> = own.iter().map(|c| (c.clock, c.readout)).collect();
    let tracker = |k| CameraTracker::new(setup.rig, k, setup.vehicle);
    let trackers = (0..cameras).map(tracker).collect::<Result<Vec<_>, _>>()?;
    let pipeline = LivePipeline::new(setup.rig, setup.vehicle, &clocks)?;
    let motion = MotionFilter::new(setup.noise.take(), setup.vehicle.environment.gravity_m_s2)?;
    let (inputs, equations, enough) = (setup.inputs.take(), setup.equations.take(), setup.enough);
    let start = |inputs| Parameters::start(inputs, setup.vehicle.clone(), equations, enough);
    let parameters = inputs.map(start).transpose()?;
    let mut flying = Vec::with_capacity(cameras);
    for (k, (own, tracker)) in own.into_iter().zip(trackers).enumerate() {
        flying.push(Camera::start(k, own, setup.rig.cameras[k].camera.size, tracker, &shared)?);
    }
    drop(shared);
    let mut flight = Flight {
        until_ns: setup.for_ns.map(|n| setup.clock.from_ns().saturating_add(n)),
        parameters,
        status,
        cameras: flying,
        pipeline,
        motion,
        tracking: TrackingState::default(),
        is_fit_checked: false,
        is_mixed_up: false,
        attitude: None,
        received_ns: 0,
        latest_ns: i64::MIN,
        first_ns: None,
        reported_ns: None,
        summary: FlightSummary { frames: vec![0; cameras], ..FlightSummary::default() },
        setup,
    };
    let scene = events::scene(flight.setup.name, flight.setup.rig, flight.setup.vehicle);
    flight.setup.send(Event::Scene(scene));
    flight.run(&reports);
    Ok(flight.finish(&reports))
}

struct Flight<'a> {
    setup: Setup<'a>,
    until_ns: Option<i64>,
    parameters: Option<Parameters>,
    status: Vec<CameraStatus>,
    cameras: Vec<Camera>,
    pipeline: LivePipeline,
    motion: MotionFilter,
    tracking: TrackingState,
    /// Whether the fit of the detections to the body has been checked.
    is_fit_checked: bool,
    /// Whether recordings were found to be those of other cameras, mirrored or turned.
    is_mixed_up: bool,
    /// Attitude of the latest pose.
    attitude: Option<UnitQuaternion<f64>>,
    /// When the latest frame was in hand.
    received_ns: i64,
    latest_ns: i64,
    /// When the first frame was in hand.
    first_ns: Option<i64>,
    /// When rates and latencies were last reported.
    reported_ns: Option<i64>,
    summary: FlightSummary,
}

impl Flight<'_> {
    /// The time now by the clock, or at [`Pace::Fast`] that of the latest frame.
    fn now_ns(&self) -> i64 {
        let Setup { pace, clock, .. } = &self.setup;
        if *pace == Pace::Fast { self.latest_ns.max(clock.from_ns()) } else { clock.now_ns() }
    }

    fn run(&mut self, reports: &Receiver<Report>) {
        loop {
            match reports.recv_timeout(self.patience()) {
                Ok(report) => self.take(report),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.report_instants();
            self.report_misfit();
            if self.setup.pace == Pace::Own {
                self.check_cameras();
            }
            self.report_rates();
            let is_over = self.until_ns.is_some_and(|until| self.now_ns() >= until);
            if is_over || self.setup.stop.load(Ordering::Relaxed) || self.status.iter().all(|s| s.ended) {
                break;
            }
        }
    }

    fn take(&mut self, report: Report) {
        match report {
            Report::Seen(seen) => self.take_seen(&seen),
            Report::Opened { camera } => {
                let now_ns = self.now_ns();
                self.status[camera].opened(now_ns);
            }
            Report::Gone { camera, reason } => {
                self.status[camera].gone(reason);
                self.leave_out(camera);
            }
            Report::Fault { camera, text } => {
                let name = &self.setup.rig.cameras[camera].name;
                self.note(true, format!("{name}: {text}."));
            }
            Report::ClockSet { camera, by_ns } => self.take_clock_step(camera, by_ns),
            Report::WentBack { camera, stamp_ns } => self.take_backward(camera, stamp_ns),
            Report::PassedOver { camera, received_ns } => self.status[camera].passed_over(received_ns),
            Report::Repeated { camera, received_ns } => self.status[camera].repeated(received_ns),
            Report::Ended { camera } => {
                self.status[camera].ended = true;
                self.leave_out(camera);
                self.report_ended();
            }
        }
    }

    fn take_seen(&mut self, seen: &Seen) {
        let &Seen { camera, stamp_ns, received_ns, tracked_ns, dark, .. } = seen;
        let t_ns = self.pipeline.time_ns(camera, stamp_ns);
        if self.setup.pace == Pace::Own && self.has_other_clock(camera, t_ns, received_ns) {
            return;
        }
        self.report_lacking(camera, t_ns);
        let status = &mut self.status[camera];
        status.arrived(t_ns, received_ns, dark);
        status.latency.add_ns(tracked_ns - received_ns);
        self.summary.tracking.add_ns(tracked_ns - received_ns);
        self.summary.frames[camera] += 1;
        if std::mem::take(&mut status.is_left_out) {
            self.pipeline.wait_again(camera);
        }
        self.latest_ns = self.latest_ns.max(t_ns);
        self.received_ns = received_ns;
        self.first_ns.get_or_insert(received_ns);
        self.report_ended();
        self.pipeline.push(camera, stamp_ns, &seen.detections);
        if let Some(interval_s) = self.pipeline.interval_s(camera) {
            self.status[camera].interval_ns = (interval_s * 1e9) as i64;
        }
    }

    /// Ends the cameras, and reports the instants that still waited.
    fn finish(mut self, reports: &Receiver<Report>) -> FlightSummary {
        self.setup.stop.store(true, Ordering::Relaxed);
        self.cameras.iter().for_each(Camera::close);
        let all_ended = self.status.iter().all(|s| s.ended);
        loop {
            match reports.recv_timeout(Duration::from_millis(20)) {
                // Frames after the end of a flight that was stopped are not part of it.
                Ok(report) if all_ended => self.take(report),
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => self.cameras.iter().for_each(Camera::interrupt),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        self.pipeline.begin();
        (0..self.status.len()).for_each(|c| self.pipeline.go_without(c, i64::MAX));
        self.report_instants();
        self.summary.dropped = self.cameras.iter().map(Camera::dropped).collect();
        self.summary.missing = self.status.iter().map(|s| s.missing).collect();
        self.cameras.into_iter().for_each(Camera::finish);
        if let Some(event) = self.parameters.and_then(Parameters::finish) {
            self.setup.send(event);
        }
        if let Some(recorder) = self.setup.recorder.current() {
            recorder.finish();
            self.summary.recording_fault = recorder.fault();
            self.setup.listeners.event(recorder.event());
        }
        self.summary.unheard = self.setup.listeners.dropped();
        self.setup.listeners.finish();
        self.summary
    }
}
