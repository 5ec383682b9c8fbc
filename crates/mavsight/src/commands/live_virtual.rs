//! The virtual room filmed in real time, with a pilot who flies in it.

use super::demo::control_stills;
use super::live::{Begin, ENOUGH, calibrating, finish, listeners, pace_of, with_page};
use crate::cli::{Live, WrongCall};
use crate::lab;
use crate::progress::Bars;
use anyhow::Result;
use mavsight::pilot::Pilot;
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_live::{
    CameraSetup, FlightClock, InputSource, Next, Pace, RecordedSession, Recorder, RecorderSlot, Setup,
    Source, fly, give_way,
};
use mavsight_pipeline::{ControlStill, Progress, calibrate_from_stills};
use mavsight_pose::{CameraClock, Rig};
use mavsight_scene::{Aircraft, FilmStream, Room, Sensor};
use mavsight_score::VirtualCamera;
use mavsight_session::{
    ControlSection, LiveSection, SESSION_SCHEMA, SessionCamera, SessionFile, make_folder, ns_from_s,
    write_control_points, write_png, write_vehicle,
};
use mavsight_simulator::FlightState;
use mavsight_vision::{Frame, Pixels};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Frames whose memory is used again, as many as may be held at a time.
const POOL: usize = 24;

/// Frames by which a camera may be ahead of the others where nothing is in real time: the pilot still knows
/// where the aircraft was for those that are behind.
const AHEAD: u64 = 32;

/// The pilot, shared by the cameras, the recording and the parameters.
struct Shared {
    pilot: Mutex<Pilot>,
    recorder: Arc<RecorderSlot>,
    /// The frame that each camera films next.
    next: Vec<AtomicU64>,
}

impl Shared {
    fn new(vehicle: &Vehicle, rate_hz: f64, cameras: usize, recorder: &Arc<RecorderSlot>) -> Result<Self> {
        Ok(Self {
            pilot: Mutex::new(Pilot::new(vehicle, rate_hz)?),
            recorder: Arc::clone(recorder),
            next: (0..cameras).map(|_| AtomicU64::new(0)).collect(),
        })
    }

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
    fn at(&self, frame: u64) -> Result<Option<FlightState>, String> {
        let mut pilot = self.pilot();
        let state = pilot.at(frame).map_err(|e| e.to_string())?;
        for input in pilot.fresh() {
            self.recorder.current().iter().for_each(|r| r.input(input));
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

/// One camera of the room.
struct VirtualSource {
    film: FilmStream<'static>,
    camera: VirtualCamera,
    index: usize,
    aircraft: Arc<Aircraft>,
    shared: Arc<Shared>,
    interval_s: f64,
    next: u64,
    last: u64,
    clock: FlightClock,
    pace: Pace,
    stop: Arc<AtomicBool>,
    pool: Vec<Arc<Frame>>,
}

impl VirtualSource {
    fn blank(&self) -> Option<Frame> {
        let size = self.camera.camera.size;
        Frame::from_rgb(size, vec![0; 3 * size.area_px()]).ok()
    }

    /// The camera as a flight opens it.
    fn setup(self) -> CameraSetup {
        let name = self.camera.name.clone();
        let mut source = Some(self);
        let open = move |_| {
            // A camera that runs renders nothing here.
            give_way();
            let source = source.take().ok_or_else(|| "the room is closed".to_owned())?;
            Ok(Box::new(source) as Box<dyn Source>)
        };
        let (clock, readout) = (CameraClock::default(), Vector2::y());
        CameraSetup { name, open: Box::new(open), reopens: false, clock, readout }
    }

    /// A frame that nobody holds.
    fn free(&mut self) -> Option<Arc<Frame>> {
        match self.pool.iter().position(|f| Arc::strong_count(f) == 1) {
            Some(at) => Some(self.pool.swap_remove(at)),
            None => self.blank().map(Arc::new),
        }
    }

    fn film(&mut self, frame: u64) -> Result<Arc<Frame>, String> {
        let no_room = || "a frame has no room".to_owned();
        let state = self.shared.at(frame)?.ok_or("the room is too slow for its cameras")?;
        let mut picture = self.free().ok_or_else(no_room)?;
        let open_s = Sensor::default().exposure_fraction * self.interval_s;
        let pose_at = |share: f64| lab::pose_near(&state, share * open_s);
        match Arc::get_mut(&mut picture).map(|p| &mut p.pixels) {
            Some(Pixels::Rgb(rgb)) => self.film.frame_into(frame, &self.aircraft, pose_at, rgb),
            _ => return Err(no_room()),
        }
        if self.pool.len() < POOL {
            self.pool.push(Arc::clone(&picture));
        }
        Ok(picture)
    }
}

impl Source for VirtualSource {
    fn next(&mut self) -> Next {
        if self.next >= self.last {
            // Nobody waits for a camera that is done.
            self.shared.is_ahead(self.index, u64::MAX);
            return Next::Over;
        }
        let stamp_ns = |frame: u64, interval_s: f64| ns_from_s(frame as f64 * interval_s);
        if self.pace == Pace::Own {
            // A camera that is behind by more than a frame leaves out what it has missed.
            let behind_s = (self.clock.now_ns() - stamp_ns(self.next, self.interval_s)) as f64 * 1e-9;
            self.next += (behind_s / self.interval_s).floor().max(0.0) as u64;
        }
        while self.pace == Pace::Fast
            && !self.stop.load(Ordering::Relaxed)
            && self.shared.is_ahead(self.index, self.next)
        {
            std::thread::sleep(Duration::from_millis(1));
        }
        let frame = self.next;
        self.next += 1;
        let picture = match self.film(frame) {
            Ok(picture) => picture,
            Err(words) => return Next::End(words),
        };
        let t_ns = stamp_ns(frame, self.interval_s);
        while self.pace == Pace::Own && !self.stop.load(Ordering::Relaxed) {
            let left = self.clock.until(t_ns);
            if left.is_zero() {
                break;
            }
            std::thread::sleep(left.min(Duration::from_millis(20)));
        }
        Next::Frame(t_ns, picture)
    }
}

/// `mavsight live --virtual`
pub(super) fn fly_virtual(args: &Live) -> Result<()> {
    if !(args.rate.is_finite() && (1.0..=1000.0).contains(&args.rate)) {
        return Err(WrongCall("--rate wants frames a second, from 1 to 1000".into()).into());
    }
    let bars = Bars::new();
    bars.start("building", None);
    let vehicle = Vehicle::paper();
    let cameras = cameras_of(&args.size)?;
    // The room lives as long as the program: the cameras' threads look at it.
    let room: &'static Room = Box::leak(Box::new(lab::room(&mavsight_simulator::Staging::default())));
    let films: Vec<_> = cameras.iter().enumerate().map(|(k, c)| lab::film(room, c, k, args.seed)).collect();
    bars.begin(mavsight_pipeline::Stage::Calibrate, None);
    let control = lab::control_frame(&lab::control_points());
    let stills = control_stills(&cameras, |k| films[k].still(Some(&control)))?;
    let rig: Rig = calibrate_from_stills(&stills, &lab::control_points())?;
    bars.done();
    let (flown, rate_hz, waits) = (vehicle.clone(), args.rate, args.fast);
    let begin: Begin = Box::new(move |to| record(to, &flown, &stills, rate_hz, waits));
    let recorder = RecorderSlot::with(args.record.as_deref().map(&begin).transpose()?);
    let shared = Arc::new(Shared::new(&vehicle, args.rate, cameras.len(), &recorder)?);
    let stop = Arc::new(AtomicBool::new(false));
    let aircraft = Arc::new(lab::aircraft(&vehicle));
    let clock = FlightClock::starting_at(0);
    let interval_s = 1.0 / args.rate;
    let last = args.seconds.map_or(u64::MAX, |s| (s * args.rate).ceil() as u64);
    let sources = cameras.iter().zip(films).enumerate().map(|(index, (camera, film))| VirtualSource {
        film: FilmStream::new(film),
        camera: camera.clone(),
        index,
        aircraft: Arc::clone(&aircraft),
        shared: Arc::clone(&shared),
        interval_s,
        next: 0,
        last,
        clock,
        pace: pace_of(args),
        stop: Arc::clone(&stop),
        pool: Vec::new(),
    });
    let cameras_of_flight = sources.map(VirtualSource::setup).collect();
    let mut listeners = listeners(args, &stop, &vehicle, &LiveSection::default())?;
    let names = cameras.iter().map(|c| c.name.clone()).collect();
    let on_request = calibrating(names, lab::control_points());
    let taps = with_page(args, &mut listeners, &recorder, begin, on_request)?;
    let setup = Setup {
        name: "virtual",
        rig: &rig,
        vehicle: &vehicle,
        cameras: cameras_of_flight,
        pace: pace_of(args),
        clock,
        noise: None,
        listeners,
        taps,
        recorder,
        inputs: Some(Box::new(Commands(Arc::clone(&shared)))),
        model: None,
        enough: ENOUGH,
        stop,
        for_ns: None,
    };
    let flown = fly(setup)?;
    finish(args, &rig, &flown)
}

/// The paper's cameras with images of another size, and as much of the room from top to bottom.
fn cameras_of(size: &str) -> Result<Vec<VirtualCamera>> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|n| (64..=8192).contains(n));
    let sides = size.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
    let Some((width_px, height_px)) = sides else {
        return Err(WrongCall(format!("--size {size} is no size: give 640x480, 1920x1080 or so")).into());
    };
    let mut cameras = lab::cameras();
    for VirtualCamera { camera, .. } in &mut cameras {
        let scale = f64::from(height_px) / f64::from(camera.size.height_px);
        camera.size = ImageSize { width_px, height_px };
        let middle = mavsight_pose::image_middle(camera.size);
        let k = &mut camera.intrinsics;
        (k.fx_px, k.fy_px) = (k.fx_px * scale, k.fy_px * scale);
        (k.cx_px, k.cy_px) = (middle.x, middle.y);
    }
    Ok(cameras)
}

/// The room as a session, and a recording into it.
fn record(
    to: &Path,
    vehicle: &Vehicle,
    stills: &[ControlStill],
    rate_hz: f64,
    waits: bool,
) -> Result<Recorder> {
    if to.join("session.toml").exists() {
        return Err(
            WrongCall(format!("{} holds a session already: name another folder", to.display())).into()
        );
    }
    make_folder(to)?;
    write_vehicle(&to.join("vehicle.toml"), vehicle)?;
    write_control_points(&to.join("control_points.csv"), &lab::control_points())?;
    let mut camera = Vec::new();
    for still in stills {
        let path = to.join(format!("{}-control.png", still.camera));
        write_png(&path, &still.frame)?;
        camera.push(SessionCamera {
            name: still.camera.clone(),
            still: Some(path),
            ..SessionCamera::default()
        });
    }
    let session = SessionFile {
        schema: SESSION_SCHEMA,
        name: "virtual".into(),
        vehicle: to.join("vehicle.toml"),
        control: Some(ControlSection { points: to.join("control_points.csv"), observations: None }),
        camera,
        ..SessionFile::default()
    };
    Ok(Recorder::begin(RecordedSession {
        folder: to.to_owned(),
        session,
        rate_hz,
        with_inputs: true,
        waits,
    })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_is_ahead_waits_while_the_pilot_still_knows_the_others_frames() {
        let shared = Shared::new(&Vehicle::paper(), 60.0, 2, &RecorderSlot::with(None)).unwrap();
        assert!(!shared.is_ahead(0, AHEAD));
        assert!(shared.at(AHEAD).unwrap().is_some());
        assert!(shared.is_ahead(0, AHEAD + 1));
        assert!(shared.at(0).unwrap().is_some());
        assert!(!shared.is_ahead(1, 1) && !shared.is_ahead(0, AHEAD + 1));
        // One that is done holds nobody up.
        assert!(shared.is_ahead(1, u64::MAX) && !shared.is_ahead(0, 9 * AHEAD));
    }
}
