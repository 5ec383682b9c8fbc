//! Flying: from cameras to whoever listens.

use super::live_flight::{Begin, fly_with};
use super::live_sources::{replayed, running};
use super::named;
use crate::cli::{Live, WrongCall};
use crate::progress::Bars;
use anyhow::{Context, Result};
use mavsight_engine::{calibrate, recorded_inputs};
use mavsight_live::{InputSource, Listeners, Pace, Recorded, RecordedSession, Recorder, RecorderSlot, Setup};
use mavsight_pose::{MotionNoise, motion_noise};
use mavsight_session::{Session, SessionFile, ns_from_s, read_poses, read_toml};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Share of a parameter's value that is seen enough where the session does not say.
const ENOUGH: f64 = 0.05;

pub(crate) fn live(args: &Live) -> Result<()> {
    if args.seconds.is_some_and(|s| !(s.is_finite() && s > 0.0)) {
        return Err(WrongCall("--for wants seconds above zero".into()).into());
    }
    if args.fast && !args.replay && !args.virtual_room {
        let message = "--fast goes with --replay or --virtual: a camera has a pace of its own";
        return Err(WrongCall(message.into()).into());
    }
    let pace = if args.fast { Pace::Fast } else { Pace::Own };
    match &args.session {
        Some(path) if !args.virtual_room => of_session(args, path, pace),
        _ => super::live_virtual::fly_virtual(args, pace, ENOUGH),
    }
}

fn of_session(args: &Live, path: &Path, pace: Pace) -> Result<()> {
    let session = named(Session::load(path))?;
    let bars = Bars::new();
    let rig = calibrate(&session, &bars)?;
    bars.done();
    let noise = noise_of(&session)?;
    let stop = Arc::new(AtomicBool::new(false));
    let inputs = if args.replay { recorded_inputs(&session)? } else { None };
    let of = recorded(&session, args)?;
    let begin: Begin = Box::new(move |to| Ok(Recorder::begin(to, of.clone())?));
    let recorder = RecorderSlot::with(args.record.as_deref().map(&begin).transpose()?);
    let (cameras, clock) = if args.replay { replayed(&session, pace, &stop)? } else { running(&session)? };
    let setup = Setup {
        name: &session.file.name,
        rig: &rig,
        vehicle: &session.vehicle,
        cameras,
        pace,
        clock,
        noise,
        listeners: Listeners::default(),
        taps: Vec::new(),
        recorder,
        inputs: inputs.map(|i| Box::new(Recorded(i)) as Box<dyn InputSource>),
        equations: named(session.equations())?,
        enough: session.live().enough.unwrap_or(ENOUGH),
        stop,
        for_ns: args.seconds.map(ns_from_s),
    };
    fly_with(args, &session.live(), named(session.control_points())?, begin, setup)
}

fn noise_of(session: &Session) -> Result<Option<MotionNoise>> {
    let Some(path) = &session.live().poses else { return Ok(None) };
    let markers: Vec<String> = session.vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let poses = named(read_poses(path, &markers))?;
    motion_noise(&poses).map(Some).with_context(|| format!("{}", path.display()))
}

fn recorded(session: &Session, args: &Live) -> Result<RecordedSession> {
    let mut file: SessionFile = read_toml(&session.path, "session file")?;
    if !args.replay {
        // They are of another flight.
        (file.inputs, file.log, file.sensors) = (PathBuf::new(), None, None);
    }
    let folder = session.path.parent().unwrap_or(Path::new(""));
    let base = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let rate_hz = session.cameras().iter().find_map(|c| c.frame_rate_hz).unwrap_or(30.0);
    Ok(RecordedSession { session: file, base, rate_hz, inputs: None, waits: args.fast })
}
