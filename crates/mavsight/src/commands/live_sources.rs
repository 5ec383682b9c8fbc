//! The cameras of a live flight: running ones, and recordings that are replayed.

use super::named;
use crate::cli::WrongCall;
use anyhow::Result;
use mavsight_geometry::Vector2;
use mavsight_live::{CameraSetup, FlightClock, Pace, RunningCamera, Source};
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

pub(super) fn running(session: &Session) -> Result<(Vec<CameraSetup>, FlightClock)> {
    let setup = |camera: &SessionCamera| {
        let Some(live) = camera.live.clone() else {
            let (path, name) = (session.path.display(), &camera.name);
            let remedy = "name what ffmpeg is to open, or give --replay";
            return Err(WrongCall(format!("{path}: camera {name} has no `live`: {remedy}")).into());
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
    let mut cameras = Vec::new();
    let mut begin_ns = None;
    for (k, camera) in session.cameras().iter().enumerate() {
        if camera.video.as_os_str().is_empty() {
            return Err(WrongCall(format!("camera {} has no recording to replay", camera.name)).into());
        }
        let mut frames = named(session.open_camera(k))?;
        let (clock, readout) = (clock_of(camera), frames.readout().into());
        let first = frames.next().transpose()?;
        let first_ns = first.as_ref().map(|(stamp_ns, _)| clock.time_ns(*stamp_ns));
        begin_ns = begin_ns.into_iter().chain(first_ns).min();
        let frames = first.into_iter().map(Ok).chain(frames);
        cameras.push(CameraSetup { clock, readout, ..CameraSetup::replay(&camera.name, frames, pace, stop) });
    }
    Ok((cameras, FlightClock::starting_at(begin_ns.unwrap_or(0))))
}
