//! The cameras of a session.

use crate::EngineError;
use crate::error::input;
use crate::frames::feed_of;
use mavsight_geometry::ImageSize;
use mavsight_pipeline::{
    CameraFeed, ControlStill, Progress, Stage, Wand, board_of, calibrate_from_observations,
    calibrate_from_stills, wand_of,
};
use mavsight_pose::{MovedObject, Rig};
use mavsight_session::{FrameSource, Session, SessionError, read_image};

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
    if pixels.is_some() || points.is_empty() {
        let size = |k: usize| Ok((session.cameras()[k].name.clone(), input(session.image_size(k))?));
        let sizes: Vec<(String, ImageSize)> =
            (0..session.cameras().len()).map(size).collect::<Result<_, EngineError>>()?;
        return Ok(calibrate_from_observations(&sizes, &points, &pixels.unwrap_or_default(), &objects)?);
    }
    let mut stills = Vec::with_capacity(session.cameras().len());
    for camera in session.cameras() {
        if let Some(path) = &camera.still {
            stills.push(ControlStill { camera: camera.name.clone(), frame: input(read_image(path))? });
        }
    }
    Ok(calibrate_from_stills(&stills, &points, &objects)?)
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
        objects.push(wand_of(&wand, feeds_if_any(session, |k| session.open_wand(k))?)?);
    }
    if let Some(board) = &session.file.board {
        let feeds = feeds_if_any(session, |k| session.open_board(k))?;
        let feeds = feeds.into_iter().map(|feed| feed.map(&through)).collect();
        objects.push(board_of(board, feeds)?);
    }
    Ok(objects)
}

fn feeds_if_any(
    session: &Session,
    open: impl Fn(usize) -> Result<Option<FrameSource>, SessionError>,
) -> Result<Vec<Option<CameraFeed<'static>>>, EngineError> {
    let feed = |k: usize| Ok(open(k)?.map(|source| feed_of(&session.cameras()[k], k == 0, source)));
    (0..session.cameras().len()).map(feed).collect()
}
