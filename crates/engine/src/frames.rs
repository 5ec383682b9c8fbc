//! The frames of a session's cameras, with what is known of their clocks.

use crate::EngineError;
use crate::error::input;
use mavsight_geometry::ImageSize;
use mavsight_pipeline::{CameraFeed, PipelineError, TimedFrame};
use mavsight_pose::{CameraClock, ClockPrior};
use mavsight_session::{FrameSource, LineTime, Session, SessionCamera};

/// No sensor takes longer for all its rows.
const LONGEST_READOUT_S: f64 = 1.0 / 30.0;

/// The frames of every camera, in the order of the session.
///
/// # Errors
/// A recording that cannot be opened.
pub fn camera_feeds(session: &Session) -> Result<Vec<CameraFeed<'static>>, EngineError> {
    let is_open = session.cameras().iter().skip(1).any(|camera| !has_exact_offset(camera));
    let feed = |(k, camera): (usize, &SessionCamera)| {
        let clap = input(session.clap_of(k))?;
        let source = session.open_camera(k)?;
        let height_px = source.size().height_px;
        let mut feed = feed_of(camera, k == 0, source);
        // Beside an offset that is wrong and taken as exact, a line time would stand in for it.
        let is_estimated = if k == 0 { is_open } else { !has_exact_offset(camera) };
        if camera.line_time_s.is_none() && is_estimated {
            feed.clock.line_time_std_s = longest_line_time_s(height_px);
        }
        Ok(CameraFeed { flash: session.file.flash, clap, ..feed })
    };
    session.cameras().iter().enumerate().map(feed).collect()
}

pub(crate) fn feed_of(camera: &SessionCamera, is_first: bool, source: FrameSource) -> CameraFeed<'static> {
    let name = camera.name.clone();
    let (announced, readout, size) = (source.declared_frames(), source.readout(), source.size());
    let may_be_reordered = source.may_be_reordered();
    let is_film = !source.is_images();
    let frames = source.map(move |item| {
        item.map(|(t_ns, frame)| TimedFrame { t_ns, frame })
            .map_err(|e| PipelineError::Source { camera: name.clone(), source: Box::new(e) })
    });
    let (clock, readout) = (clock_of(camera, is_first, size), readout.into());
    CameraFeed {
        clock,
        readout,
        may_be_reordered,
        is_film,
        ..CameraFeed::new(camera.name.clone(), announced, Box::new(frames))
    }
}

fn has_exact_offset(camera: &SessionCamera) -> bool {
    camera.time_offset_s.is_some() && camera.time_offset_std_s.is_none()
}

fn longest_line_time_s(height_px: u32) -> f64 {
    LONGEST_READOUT_S / f64::from(height_px.max(1))
}

/// What a session says of a camera's clock. The first camera's is the reference.
fn clock_of(camera: &SessionCamera, is_first: bool, size: ImageSize) -> ClockPrior {
    let mut prior = if is_first || has_exact_offset(camera) {
        ClockPrior::known(CameraClock::default())
    } else {
        ClockPrior::unknown()
    };
    prior.clock.offset_s = camera.time_offset_s.unwrap_or(0.0);
    if let Some(std_s) = camera.time_offset_std_s.filter(|_| !is_first) {
        prior.offset_std_s = std_s;
    }
    match camera.line_time_s {
        Some(LineTime::Known(line_time_s)) => prior.clock.line_time_s = line_time_s,
        Some(LineTime::Unknown(_)) => prior.line_time_std_s = longest_line_time_s(size.height_px),
        None => {}
    }
    prior
}

/// The first frame of each camera at its time by the common clock, in the order of the session. None where a clock is
/// missing or a camera has no frame: a picture is a camera's by its place in the list.
///
/// # Errors
/// A recording that cannot be read.
pub fn first_frames(session: &Session, clocks: &[CameraClock]) -> Result<Vec<TimedFrame>, EngineError> {
    if clocks.len() != session.cameras().len() {
        return Ok(Vec::new());
    }
    let mut frames = Vec::with_capacity(clocks.len());
    for (k, clock) in clocks.iter().enumerate() {
        let Some(first) = session.open_camera(k)?.next() else { return Ok(Vec::new()) };
        let (stamp_ns, frame) = first?;
        frames.push(TimedFrame { t_ns: clock.time_ns(stamp_ns), frame });
    }
    Ok(frames)
}
