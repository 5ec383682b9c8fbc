//! The cameras of a session.

use crate::EngineError;
use crate::error::input;
use crate::frames::{camera_feeds, feed_of};
use mavsight_geometry::{GeometryError, ImageSize};
use mavsight_pipeline::{
    CameraFeed, ControlStill, PipelineError, Progress, Stage, Wand, aircraft_of, board_of,
    calibrate_from_observations, calibrate_from_stills, wand_of,
};
use mavsight_pose::{MovedObject, PoseError, Rig};
use mavsight_session::{FrameSource, Session, SessionCamera, SessionError, read_image};

/// Calibrates the cameras of a session: from stills of its control points or from clicked pixels, together
/// with a wand and a board where it has them. A session that names a rig file has the cameras of that.
///
/// # Errors
/// Files that are wrong, and what the calibration refuses.
pub fn calibrate(session: &Session, progress: &dyn Progress) -> Result<Rig, EngineError> {
    let rig = rig_of(session, progress)?;
    input(sizes_of(session, &rig))?;
    Ok(rig)
}

/// Refuses recordings of another size than their stills.
pub(crate) fn sizes_of(session: &Session, rig: &Rig) -> Result<(), SessionError> {
    let is_by_stills =
        session.file.rig.is_none() && session.file.control.as_ref().is_some_and(|c| c.observations.is_none());
    if is_by_stills { session.require_sizes(rig, &session.path) } else { Ok(()) }
}

/// [`calibrate`], whatever sizes the recordings have.
pub(crate) fn rig_of(session: &Session, progress: &dyn Progress) -> Result<Rig, EngineError> {
    progress.begin(Stage::Calibrate, None);
    if let Some(rig) = input(session.rig())? {
        return Ok(rig);
    }
    let points = input(session.control_points())?;
    let objects = objects_of(session)?;
    let pixels = input(session.control_pixels())?;
    let by_pixels = pixels.is_some() || points.is_empty();
    let (mut sizes, mut stills): (Vec<(String, ImageSize)>, Vec<ControlStill>) = (Vec::new(), Vec::new());
    for (k, camera) in session.cameras().iter().enumerate() {
        if by_pixels {
            sizes.push((camera.name.clone(), input(session.image_size(k))?));
        } else if let Some(path) = &camera.still {
            stills.push(ControlStill { camera: camera.name.clone(), frame: input(read_image(path))? });
        }
    }
    let pixels = pixels.unwrap_or_default();
    let solve = |objects: &[MovedObject]| match by_pixels {
        true => calibrate_from_observations(&sizes, &points, &pixels, objects),
        false => calibrate_from_stills(&stills, &points, objects),
    };
    match solve(&objects) {
        Err(few) if has_too_few(&few) => by_flight(session, objects, few, solve),
        solved => Ok(solved?),
    }
}

/// Whether a camera sees too few control points to be calibrated by them.
fn has_too_few(refused: &PipelineError) -> bool {
    match refused {
        PipelineError::ControlBalls { .. } => true,
        PipelineError::Pose { source: PoseError::Calibration { source, .. }, .. } => {
            matches!(source, GeometryError::TooFewControlPoints { .. })
        }
        _ => false,
    }
}

/// Cameras without which the flight does not calibrate another: two that the control points calibrate, and that one.
const LEAST_BY_FLIGHT: usize = 3;

/// What control points do not determine, the flight may: the aircraft as one more object that was moved before the
/// cameras. A session of two cameras is refused before its recordings are read.
fn by_flight(
    session: &Session,
    mut objects: Vec<MovedObject>,
    few: PipelineError,
    solve: impl Fn(&[MovedObject]) -> Result<Rig, PipelineError>,
) -> Result<Rig, EngineError> {
    if session.cameras().len() < LEAST_BY_FLIGHT {
        return Err(few.into());
    }
    if !session.cameras().iter().all(SessionCamera::is_recorded) {
        return Err(before_flight(few));
    }
    let Ok(feeds) = camera_feeds(session) else { return Err(few.into()) };
    let Ok(aircraft) = aircraft_of(&session.vehicle, feeds) else { return Err(few.into()) };
    objects.push(aircraft);
    solve(&objects).map_err(|refused| match refused {
        PipelineError::Pose { source: PoseError::FewControlPoints { .. }, .. } => refused.into(),
        _ => few.into(),
    })
}

/// A refusal that names the ways out before a flight.
fn before_flight(few: PipelineError) -> EngineError {
    match few {
        PipelineError::ControlBalls { camera, found, wanted, missing } => {
            EngineError::BeforeFlight { camera, found, wanted, missing }
        }
        other => other.into(),
    }
}

fn objects_of(session: &Session) -> Result<Vec<MovedObject>, EngineError> {
    objects_with(session, |feed| feed)
}

/// Wand and board of a session, the images of the board passed through a function.
pub(crate) fn objects_with(
    session: &Session,
    through: impl Fn(CameraFeed<'static>) -> CameraFeed<'static>,
) -> Result<Vec<MovedObject>, EngineError> {
    let mut objects = Vec::new();
    if let Some(wand) = &session.file.wand
        && let [a, b] = wand.ball[..]
    {
        let wand = Wand { length_m: wand.length_m, length_std_m: wand.length_std_m, balls: [a, b] };
        objects.push(wand_of(&wand, feeds_if_any(session, "wand", |k| session.open_wand(k))?)?);
    }
    if let Some(board) = &session.file.board {
        let feeds = feeds_if_any(session, "board", |k| session.open_board(k))?;
        let feeds = feeds.into_iter().map(|feed| feed.map(&through)).collect();
        objects.push(board_of(board, feeds)?);
    }
    Ok(objects)
}

/// What each camera filmed of an object, at the size in which it films the flight.
fn feeds_if_any(
    session: &Session,
    object: &str,
    open: impl Fn(usize) -> Result<Option<FrameSource>, SessionError>,
) -> Result<Vec<Option<CameraFeed<'static>>>, EngineError> {
    let feed = |(k, camera): (usize, &SessionCamera)| {
        let Some(source) = input(open(k))? else { return Ok(None) };
        input(session.require_size_of(object, k, source.size()))?;
        Ok(Some(feed_of(camera, k == 0, source)))
    };
    session.cameras().iter().enumerate().map(feed).collect()
}
