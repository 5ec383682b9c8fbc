//! Flying: from cameras to whoever listens.

use super::live_links::add_links;
use super::live_sources::{replayed, running};
use super::named;
use crate::cli::{Live, WrongCall};
use crate::out::out;
use crate::progress::Bars;
use anyhow::{Context, Result};
use mavsight_engine::{calibrate, recorded_inputs};
use mavsight_flight::Vehicle;
use mavsight_link::{CameraState, Event, Tracking};
use mavsight_live::{
    FlightSummary, InputSource, Latencies, Listener, Listeners, Pace, Recorded, RecordedSession, Recorder,
    RecorderSlot, Setup, Tap, fly,
};
use mavsight_pipeline::{ControlPointRow, ControlStill, calibrate_from_stills};
use mavsight_pose::{MotionNoise, Rig, motion_noise};
use mavsight_session::{
    LiveSection, Session, SessionFile, make_folder, ns_from_s, read_poses, read_toml, write_rig, write_whole,
};
use mavsight_vision::Frame;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Share of a parameter's value that is seen enough where the session does not say.
pub(super) const ENOUGH: f64 = 0.05;

/// `mavsight live`
pub(crate) fn live(args: &Live) -> Result<()> {
    if args.seconds.is_some_and(|s| !(s.is_finite() && s > 0.0)) {
        return Err(WrongCall("--for wants seconds above zero".into()).into());
    }
    if args.fast && !args.replay && !args.virtual_room {
        return Err(WrongCall(
            "--fast goes with --replay or --virtual: a camera has a pace of its own".into(),
        )
        .into());
    }
    match &args.session {
        Some(path) if !args.virtual_room => of_session(args, path),
        _ => super::live_virtual::fly_virtual(args),
    }
}

/// The pace that was asked for.
pub(super) fn pace_of(args: &Live) -> Pace {
    if args.fast { Pace::Fast } else { Pace::Own }
}

fn of_session(args: &Live, path: &Path) -> Result<()> {
    let session = named(Session::load(path))?;
    let bars = Bars::new();
    let rig = calibrate(&session, &bars)?;
    bars.done();
    let noise = noise_of(&session)?;
    let stop = Arc::new(AtomicBool::new(false));
    let inputs = if args.replay { recorded_inputs(&session)? } else { None };
    let of = recorded(&session, args)?;
    let begin: Begin =
        Box::new(move |to| Ok(Recorder::begin(RecordedSession { folder: to.to_owned(), ..of.clone() })?));
    let recorder = RecorderSlot::with(args.record.as_deref().map(&begin).transpose()?);
    let model = named(session.model())?;
    let (cameras, clock) =
        if args.replay { replayed(&session, pace_of(args), &stop)? } else { running(&session)? };
    let mut listeners = listeners(args, &stop, &session.vehicle, &session.live())?;
    let names = session.cameras().iter().map(|c| c.name.clone()).collect();
    let on_request = calibrating(names, named(session.control_points())?);
    let taps = with_page(args, &mut listeners, &recorder, begin, on_request)?;
    let setup = Setup {
        name: &session.file.name,
        rig: &rig,
        vehicle: &session.vehicle,
        cameras,
        pace: pace_of(args),
        clock,
        noise,
        listeners,
        taps,
        recorder,
        inputs: inputs.map(|i| Box::new(Recorded(i)) as Box<dyn InputSource>),
        model,
        enough: session.live().enough.unwrap_or(ENOUGH),
        stop,
        for_ns: args.seconds.map(ns_from_s),
    };
    let flown = fly(setup)?;
    finish(args, &rig, &flown)
}

/// The motion noise of the flight that the session names.
fn noise_of(session: &Session) -> Result<Option<MotionNoise>> {
    let Some(path) = &session.live().poses else { return Ok(None) };
    let markers: Vec<String> = session.vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let poses = named(read_poses(path, &markers))?;
    motion_noise(&poses).map(Some).with_context(|| format!("{}", path.display()))
}

/// What a recording of a session's flight is of; its folder is still to be said.
fn recorded(session: &Session, args: &Live) -> Result<RecordedSession> {
    let mut file: SessionFile = read_toml(&session.path, "session file")?;
    if !args.replay {
        // They are of another flight.
        file.inputs = PathBuf::new();
    }
    let folder = session.path.parent().unwrap_or(Path::new(""));
    let rate_hz = session.cameras().iter().find_map(|c| c.frame_rate_hz).unwrap_or(30.0);
    let session = with_whole_paths(file, folder);
    Ok(RecordedSession { folder: PathBuf::new(), session, rate_hz, with_inputs: false, waits: args.fast })
}

/// How a recording of the flight begins.
pub(super) type Begin = Box<dyn Fn(&Path) -> Result<Recorder> + Send>;

/// What a calibration from the latest frame of each camera says.
pub(super) type Calibrate = Box<dyn Fn(BTreeMap<usize, Arc<Frame>>) -> Result<String> + Send>;

/// Calibrates from what the cameras show, control points in view, into a rig of its own: the flight goes on
/// with the cameras it has.
pub(super) fn calibrating(names: Vec<String>, points: Vec<ControlPointRow>) -> Calibrate {
    Box::new(move |frames| {
        if points.is_empty() {
            anyhow::bail!("The session has no control points to calibrate from: give it `[control]`.");
        }
        let still = |(camera, frame): (&String, &Arc<Frame>)| ControlStill {
            camera: camera.clone(),
            frame: Frame::clone(frame),
        };
        let seen = names.iter().enumerate().filter_map(|(k, name)| Some((name, frames.get(&k)?)));
        let rig = calibrate_from_stills(&seen.map(still).collect::<Vec<_>>(), &points, &[])?;
        let unused = (1..).map(|k| PathBuf::from(format!("rig-{k}.toml"))).find(|p| !p.exists());
        let path = unused.context("all names rig-N.toml are taken")?;
        write_rig(&path, &rig)?;
        let file = path.display();
        Ok(format!(
            "The cameras are calibrated in {file}: the next flight has them by `[rig] file = \"{file}\"` in place of `[control]`."
        ))
    })
}

/// Serves the page where it is asked for; who must see the frames for it.
#[cfg(feature = "page")]
pub(super) fn with_page(
    args: &Live,
    listeners: &mut Listeners,
    slot: &Arc<RecorderSlot>,
    begin: Begin,
    calibrate: Calibrate,
) -> Result<Vec<Tap>> {
    use super::live_page::{ADDRESS, Duties, serve};
    let Some(address) = args.serve else { return Ok(Vec::new()) };
    let address = address.map_or_else(|| ADDRESS.parse(), Ok)?;
    let (page, tap) = serve(address, Duties { slot: Arc::clone(slot), begin, calibrate })?;
    listeners.add(page)?;
    Ok(vec![tap])
}

/// There is no page in this build.
#[cfg(not(feature = "page"))]
pub(super) fn with_page(
    _: &Live,
    _: &mut Listeners,
    _: &Arc<RecorderSlot>,
    _: Begin,
    _: Calibrate,
) -> Result<Vec<Tap>> {
    Ok(Vec::new())
}

/// A session file that can stand anywhere.
fn with_whole_paths(mut file: SessionFile, folder: &Path) -> SessionFile {
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let whole = |path: &mut PathBuf| {
        if !path.as_os_str().is_empty() {
            *path = folder.join(&*path);
        }
    };
    whole(&mut file.vehicle);
    whole(&mut file.inputs);
    file.model.iter_mut().for_each(whole);
    if let Some(rig) = &mut file.rig {
        whole(&mut rig.file);
    }
    if let Some(control) = &mut file.control {
        whole(&mut control.points);
        control.observations.iter_mut().for_each(whole);
    }
    for camera in &mut file.camera {
        [&mut camera.still, &mut camera.wand, &mut camera.board].into_iter().flatten().for_each(whole);
    }
    file
}

/// The listeners: standard output or the terminal.
pub(super) fn listeners(
    args: &Live,
    stop: &Arc<AtomicBool>,
    vehicle: &Vehicle,
    section: &LiveSection,
) -> Result<Listeners> {
    let mut all = Listeners::default();
    all.waiting = args.fast;
    if args.json {
        all.add(Box::new(Lines { stop: Arc::clone(stop) }))?;
    }
    all.add(Box::new(Words::default()))?;
    add_links(&mut all, vehicle, section, args)?;
    Ok(all)
}

/// Events as JSON, one a line.
struct Lines {
    stop: Arc<AtomicBool>,
}

impl Listener for Lines {
    fn event(&mut self, event: &Event) {
        let Ok(mut line) = serde_json::to_string(event) else { return };
        line.push('\n');
        // Nobody reads any more: the flight has ended.
        if std::io::stdout().lock().write_all(line.as_bytes()).is_err() {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    fn wants_events(&self) -> bool {
        true
    }
}

/// Least time between two messages on the state of a camera that comes and goes.
const CALM: Duration = Duration::from_millis(900);

/// What a user should know, on standard error.
#[derive(Default)]
struct Words {
    names: Vec<String>,
    /// What was last said of each camera, and when.
    cameras: Vec<Option<(CameraState, Instant)>>,
    tracking: Option<Tracking>,
    enough: bool,
    fault: Option<String>,
}

impl Listener for Words {
    fn event(&mut self, event: &Event) {
        match event {
            Event::Scene(scene) => {
                self.names = scene.cameras.iter().map(|c| c.name.clone()).collect();
                self.cameras = vec![None; self.names.len()];
            }
            Event::Camera { camera, state, reason, .. } => {
                let Some(said) = self.cameras.get_mut(*camera) else { return };
                if said.is_some_and(|(last, at)| last == *state || at.elapsed() < CALM) {
                    return;
                }
                let why = reason.as_ref().map_or(String::new(), |r| format!(": {r}"));
                eprintln!("mavsight: {} is {}{why}", self.names[*camera], lower(state));
                *said = Some((*state, Instant::now()));
            }
            Event::Pose(pose) if self.tracking != Some(pose.tracking) => {
                eprintln!("mavsight: {:.3} s: {}", pose.t_s, lower(&pose.tracking));
                self.tracking = Some(pose.tracking);
            }
            Event::Note { t_s, text, .. } => eprintln!("mavsight: {t_s:.3} s: {text}"),
            Event::Parameters { t_s, enough, .. } if *enough && !self.enough => {
                eprintln!("mavsight: {t_s:.1} s: all parameters have been seen enough");
                self.enough = true;
            }
            Event::Recording { fault: Some(fault), .. } if self.fault.as_ref() != Some(fault) => {
                eprintln!("mavsight: recording: {fault}");
                self.fault = Some(fault.clone());
            }
            _ => {}
        }
    }

    fn wants_events(&self) -> bool {
        true
    }
}

fn lower(of: &impl std::fmt::Debug) -> String {
    format!("{of:?}").to_lowercase()
}

/// Prints what became of the flight, and writes it where that was asked for.
pub(super) fn finish(args: &Live, rig: &Rig, flown: &FlightSummary) -> Result<()> {
    let of = |l: &Latencies| serde_json::json!({"median_ms": l.quantile_ms(0.5), "p99_ms": l.quantile_ms(0.99), "most_ms": l.most_ms()});
    let cameras: Vec<_> = (rig.cameras.iter().zip(&flown.frames).zip(&flown.dropped))
        .map(|((c, frames), dropped)| serde_json::json!({"name": c.name, "frames": frames, "dropped": dropped}))
        .collect();
    let figures = serde_json::json!({
        "instants": flown.instants,
        "measured": flown.measured,
        "lost": flown.lost,
        "not_waited_for_a_camera": flown.not_waited,
        "cameras": cameras,
        "latency_to_pose": of(&flown.latency),
        "latency_of_tracking": of(&flown.tracking),
        "unheard": flown.unheard,
        "recording_fault": flown.recording_fault,
    });
    let dropped: u64 = flown.dropped.iter().sum();
    let mut text = format!(
        "{} instants, {} with a pose, {} lost since the first; {dropped} frames dropped\n",
        flown.instants, flown.measured, flown.lost,
    );
    // As fast as it goes frames wait for each other: how long has no meaning.
    let latency = format!(
        "From the last frame in hand to the pose: median {:.2} ms, 99 % {:.2} ms, at most {:.2} ms\n",
        flown.latency.quantile_ms(0.5),
        flown.latency.quantile_ms(0.99),
        flown.latency.most_ms(),
    );
    if !args.fast {
        text += &latency;
    }
    if args.json {
        eprint!("{text}");
    } else {
        out!("{text}");
    }
    if let Some(out) = &args.out {
        make_folder(out)?;
        write_whole(&out.join("live.json"), &serde_json::to_vec_pretty(&figures)?)?;
    }
    if let Some(fault) = &flown.recording_fault {
        anyhow::bail!("the recording is not whole: {fault}");
    }
    if flown.instants == 0 {
        anyhow::bail!("no camera has shown anything: what each lacks is said above");
    }
    if flown.measured == 0 {
        anyhow::bail!("none of {} instants has a pose", flown.instants);
    }
    Ok(())
}
