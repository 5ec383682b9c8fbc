//! The virtual room filmed in real time, with a pilot who flies in it.

use super::demo::control_still;
use super::live_flight::{Begin, fly_with};
use crate::cli::{Live, WrongCall};
use crate::lab;
use crate::progress::Bars;
use anyhow::{Context, Result};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::ImageSize;
use mavsight_link::give_way;
use mavsight_live::{
    CameraSetup, FlightClock, InputSource, Listeners, Pace, RecordedSession, Recorder, RecorderSlot, Setup,
};
use mavsight_pipeline::{ControlStill, Progress, calibrate_from_stills};
use mavsight_scene::{Aircraft, Film, FilmStream, Room, Sensor};
use mavsight_score::VirtualCamera;
use mavsight_session::{
    ControlSection, LiveSection, SESSION_SCHEMA, SessionCamera, SessionFile, make_folder, ns_from_s,
    write_control_points, write_png, write_vehicle,
};
use mavsight_simulator::{FlightState, Pilot};
use mavsight_vision::Frame;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Frames by which a camera may be ahead: the pilot still knows where the aircraft was for the others.
const AHEAD: u64 = 32;

struct Shared {
    pilot: Mutex<Pilot>,
    recorder: Arc<RecorderSlot>,
    next: Vec<AtomicU64>,
}

impl Shared {
    fn pilot(&self) -> MutexGuard<'_, Pilot> {
        self.pilot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes which frame a camera films next; whether it is too far ahead of another.
    fn is_ahead(&self, camera: usize, frame: u64) -> bool {
        if let Some(own) = self.next.get(camera) {
            own.store(frame, Ordering::Relaxed);
        }
        let last = self.next.iter().map(|n| n.load(Ordering::Relaxed)).min();
        last.is_some_and(|last| frame > last.saturating_add(AHEAD))
    }

    /// The aircraft at a frame, and what was commanded on the way to it into the recording.
    fn at(&self, frame: u64) -> Result<Option<FlightState>> {
        let mut pilot = self.pilot();
        let state = pilot.at(frame)?;
        for input in pilot.fresh() {
            self.recorder.current().iter().for_each(|r| r.input(input.t_s, &input.values));
        }
        Ok(state)
    }
}

struct Commands(Arc<Shared>);

impl InputSource for Commands {
    fn span(&mut self, from_s: f64, to_s: f64) -> Option<InputSeries> {
        self.0.pilot().span(from_s, to_s)
    }
}

struct VirtualFrames {
    film: FilmStream<'static>,
    camera: VirtualCamera,
    index: usize,
    aircraft: Arc<Aircraft>,
    shared: Arc<Shared>,
    interval_s: f64,
    next: u64,
    last: u64,
    /// The clock of the flight, if it is in real time.
    clock: Option<FlightClock>,
    stop: Arc<AtomicBool>,
}

impl VirtualFrames {
    fn stamp_ns(&self, frame: u64) -> i64 {
        ns_from_s(frame as f64 * self.interval_s)
    }

    fn film(&mut self, frame: u64) -> Result<(i64, Frame)> {
        let state = self.shared.at(frame)?.context("the room is too slow for its cameras")?;
        let open_s = Sensor::default().exposure_fraction * self.interval_s;
        let pose_at = |share: f64| lab::pose_near(&state, share * open_s);
        let size = self.camera.camera.size;
        let mut rgb = vec![0; 3 * size.area_px()];
        self.film.frame_into(frame, &self.aircraft, pose_at, &mut rgb);
        Ok((self.stamp_ns(frame), Frame::from_rgb(size, rgb)?))
    }
}

impl Iterator for VirtualFrames {
    type Item = Result<(i64, Frame)>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == 0 {
            // A camera that runs renders nothing here.
            give_way();
        }
        if self.next >= self.last {
            // Nobody waits for a camera that is done.
            self.shared.is_ahead(self.index, u64::MAX);
            return None;
        }
        if let Some(clock) = self.clock {
            // A camera that is behind by more than a frame leaves out what it has missed.
            let behind_s = (clock.now_ns() - self.stamp_ns(self.next)) as f64 * 1e-9;
            self.next += (behind_s / self.interval_s).floor().max(0.0) as u64;
        }
        while self.clock.is_none()
            && !self.stop.load(Ordering::Relaxed)
            && self.shared.is_ahead(self.index, self.next)
        {
            std::thread::sleep(Duration::from_millis(1));
        }
        let frame = self.next;
        self.next += 1;
        let filmed = self.film(frame);
        if filmed.is_err() {
            self.last = 0;
        }
        Some(filmed)
    }
}

pub(super) fn fly_virtual(args: &Live, pace: Pace, enough: f64) -> Result<()> {
    if !(args.rate.is_finite() && (1.0..=1000.0).contains(&args.rate)) {
        return Err(WrongCall("--rate wants frames a second, from 1 to 1000".into()).into());
    }
    let bars = Bars::new();
    bars.start("building", None);
    let (vehicle, points) = (Vehicle::paper(), lab::control_points());
    let cameras = cameras_of(args.size)?;
    // The room lives as long as the program: the cameras' threads look at it.
    let room: &'static Room = Box::leak(Box::new(Room::meeting_room()));
    let films: Vec<_> = cameras.iter().enumerate().map(|(k, c)| lab::film(room, c, k, args.seed)).collect();
    bars.begin(mavsight_pipeline::Stage::Calibrate, None);
    let control = lab::control_frame(&points);
    let still = |(camera, film): (_, &Film<'_>)| control_still(camera, film.still(Some(&control)));
    let stills = cameras.iter().zip(&films).map(still).collect::<Result<Vec<_>>>()?;
    let rig = calibrate_from_stills(&stills, &points, &[])?;
    bars.done();
    let (flown, rate_hz, waits) = (vehicle.clone(), args.rate, args.fast);
    let begin: Begin = Box::new(move |to| record(to, &flown, &stills, rate_hz, waits));
    let recorder = RecorderSlot::with(args.record.as_deref().map(&begin).transpose()?);
    let shared = Arc::new(Shared {
        pilot: Mutex::new(Pilot::new(&vehicle, args.rate)?),
        recorder: Arc::clone(&recorder),
        next: cameras.iter().map(|_| AtomicU64::new(0)).collect(),
    });
    let stop = Arc::new(AtomicBool::new(false));
    let aircraft = Arc::new(lab::aircraft(&vehicle));
    let clock = FlightClock::starting_at(0);
    let setup_of = |(index, (camera, film)): (usize, (&VirtualCamera, _))| {
        let frames = VirtualFrames {
            film: FilmStream::new(film),
            camera: camera.clone(),
            index,
            aircraft: Arc::clone(&aircraft),
            shared: Arc::clone(&shared),
            interval_s: 1.0 / args.rate,
            next: 0,
            last: args.seconds.map_or(u64::MAX, |s| (s * args.rate).ceil() as u64),
            clock: (pace == Pace::Own).then_some(clock),
            stop: Arc::clone(&stop),
        };
        let frames = frames.map(|frame| frame.map_err(|e| format!("{e:#}")));
        CameraSetup::replay(&camera.name, frames, pace, &stop)
    };
    let setup = Setup {
        name: "virtual",
        rig: &rig,
        vehicle: &vehicle,
        cameras: cameras.iter().zip(films).enumerate().map(setup_of).collect(),
        pace,
        clock,
        noise: None,
        listeners: Listeners::default(),
        taps: Vec::new(),
        recorder,
        inputs: Some(Box::new(Commands(Arc::clone(&shared)))),
        equations: None,
        enough,
        stop: Arc::clone(&stop),
        for_ns: None,
    };
    fly_with(args, &LiveSection::default(), points, begin, setup)
}

/// The paper's cameras with images of another size, and as much of the room from top to bottom.
fn cameras_of(size: ImageSize) -> Result<Vec<VirtualCamera>, WrongCall> {
    if [size.width_px, size.height_px].iter().any(|n| !(64..=8192).contains(n)) {
        let message = "--size wants sides of 64 to 8192 pixels, such as 640x480 or 1920x1080";
        return Err(WrongCall(message.into()));
    }
    let mut cameras = lab::cameras();
    for VirtualCamera { camera, .. } in &mut cameras {
        let scale = f64::from(size.height_px) / f64::from(camera.size.height_px);
        camera.size = size;
        let middle = mavsight_pose::image_middle(camera.size);
        let k = &mut camera.intrinsics;
        (k.fx_px, k.fy_px) = (k.fx_px * scale, k.fy_px * scale);
        (k.cx_px, k.cy_px) = (middle.x, middle.y);
    }
    Ok(cameras)
}

fn record(
    to: &Path,
    vehicle: &Vehicle,
    stills: &[ControlStill],
    rate_hz: f64,
    waits: bool,
) -> Result<Recorder> {
    if to.join("session.toml").exists() {
        let message = format!("{} holds a session already: name another folder", to.display());
        return Err(WrongCall(message).into());
    }
    make_folder(to)?;
    write_vehicle(&to.join("vehicle.toml"), vehicle)?;
    write_control_points(&to.join("control_points.csv"), &lab::control_points())?;
    let mut camera = Vec::new();
    for ControlStill { camera: name, frame } in stills {
        let still = format!("{name}-control.png");
        write_png(&to.join(&still), frame)?;
        let still = Some(still.into());
        camera.push(SessionCamera { name: name.clone(), still, ..SessionCamera::default() });
    }
    let session = SessionFile {
        schema: SESSION_SCHEMA,
        name: "virtual".into(),
        vehicle: "vehicle.toml".into(),
        control: Some(ControlSection { points: "control_points.csv".into(), observations: None }),
        camera,
        ..SessionFile::default()
    };
    let inputs = Some(vehicle.input_columns().into_iter().map(str::to_owned).collect());
    let of = RecordedSession { session, base: to.to_owned(), rate_hz, inputs, waits };
    Ok(Recorder::begin(to, of)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_is_ahead_waits_while_the_pilot_still_knows_the_others_frames() {
        let shared = Shared {
            pilot: Mutex::new(Pilot::new(&Vehicle::paper(), 60.0).unwrap()),
            recorder: RecorderSlot::with(None),
            next: (0..2).map(|_| AtomicU64::new(0)).collect(),
        };
        assert!(!shared.is_ahead(0, AHEAD));
        assert!(shared.at(AHEAD).unwrap().is_some());
        assert!(shared.is_ahead(0, AHEAD + 1));
        assert!(shared.at(0).unwrap().is_some());
        assert!(!shared.is_ahead(1, 1) && !shared.is_ahead(0, AHEAD + 1));
        // One that is done holds nobody up.
        assert!(shared.is_ahead(1, u64::MAX) && !shared.is_ahead(0, 9 * AHEAD));
    }
}
