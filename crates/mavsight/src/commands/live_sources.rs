//! The cameras of a live flight: running ones, and recordings that are replayed.

use super::named;
use crate::cli::WrongCall;
use anyhow::Result;
use mavsight_geometry::Vector2;
use mavsight_live::{CameraFile, CameraSetup, FlightClock, Pace, Replay, RunningCamera, Source};
use mavsight_pose::CameraClock;
use mavsight_session::{LineTime, Session, SessionCamera};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What is known of a camera's clock: live, nothing can be estimated from the whole flight.
fn clock_of(camera: &SessionCamera) -> CameraClock {
    let line_time_s = match camera.line_time_s {
        Some(LineTime::Known(line_time_s)) => line_time_s,
        _ => 0.0,
    };
    CameraClock { offset_s: camera.time_offset_s.unwrap_or(0.0), line_time_s, ..CameraClock::default() }
}

/// Running cameras, each opened again when it ends.
pub(super) fn running(session: &Session) -> Result<(Vec<CameraSetup>, FlightClock)> {
    let setup = |camera: &SessionCamera| {
        let Some(live) = camera.live.clone() else {
            let words = format!(
                "{}: camera {} has no `live`: name what ffmpeg is to open, or give --replay",
                session.path.display(),
                camera.name
            );
            return Err(WrongCall(words).into());
        };
        let latency_s = camera.latency_s.unwrap_or(0.0);
        Ok(CameraSetup {
            name: camera.name.clone(),
            open: Box::new(move |clock| {
                let camera = RunningCamera::open(&live, latency_s, clock)?;
                Ok(Box::new(camera) as Box<dyn Source>)
            }),
            reopens: true,
            clock: clock_of(camera),
            readout: Vector2::y(),
        })
    };
    let cameras = session.cameras().iter().map(setup).collect::<Result<Vec<_>>>()?;
    Ok((cameras, FlightClock::starting_at(0)))
}

/// The session's recordings, the flight beginning with the first frame of the earliest.
pub(super) fn replayed(
    session: &Session,
    pace: Pace,
    stop: &Arc<AtomicBool>,
) -> Result<(Vec<CameraSetup>, FlightClock)> {
    let mut files = Vec::new();
    for (k, camera) in session.cameras().iter().enumerate() {
        if camera.video.as_os_str().is_empty() {
            return Err(WrongCall(format!("camera {} has no recording to replay", camera.name)).into());
        }
        let source = named(session.open_camera(k))?;
        let readout = source.readout();
        files.push((camera, readout, CameraFile::open(source)?));
    }
    let first_ns =
        files.iter().filter_map(|(c, _, f)| Some(clock_of(c).time_ns(f.first_ns()?))).min().unwrap_or(0);
    let clock = FlightClock::starting_at(first_ns);
    let setup = |(camera, readout, file): (&SessionCamera, [f64; 2], CameraFile)| {
        let (stop, own) = (Arc::clone(stop), clock_of(camera));
        let mut file = Some(file);
        CameraSetup {
            name: camera.name.clone(),
            open: Box::new(move |clock| {
                let paced = (pace == Pace::Own).then_some(clock);
                let file = file.take().ok_or_else(|| "the recording has ended".to_owned())?;
                Ok(Box::new(Replay::new(file, paced, Arc::clone(&stop))) as Box<dyn Source>)
            }),
            reopens: false,
            clock: own,
            readout: readout.into(),
        }
    };
    Ok((files.into_iter().map(setup).collect(), clock))
}
