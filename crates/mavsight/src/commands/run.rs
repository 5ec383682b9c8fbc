//! The whole chain on a recorded session.

use super::fit::with_motion;
use super::{named, require_folder};
use crate::cli::{Interval, Run, WrongCall};
use crate::out::{out, outln};
use crate::page::{Page, write_page};
use crate::progress::Bars;
use crate::summary::Summary;
use anyhow::{Context, Result};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::ImageSize;
use mavsight_identify::output_error::telling_stretch_s;
use mavsight_pipeline::{
    AsFlown, Board, CameraFeed, ControlStill, IdentifyOptions, PipelineError, Progress, Refinement,
    TimedFrame, Tracked, Wand, board_of, calibrate_from_observations, calibrate_from_stills_and,
    lasting_to_fit, motion_of, refine, wand_of,
};
use mavsight_pose::{CameraClock, ClockPrior, MarkerObservation, MovedObject, PoseEstimate, Rig};
use mavsight_score::{Scores, score_motion, score_poses};
use mavsight_session::{
    FrameSource, LineTime, MarkerAsBuilt, RunResults, Session, SessionCamera, TruthRow, read_image,
    results::names, write_markers_early, write_results,
};
use mavsight_vision::Frame;
use std::path::Path;

/// `mavsight run`
pub(crate) fn run(args: &Run) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    require_folder(&args.out)?;
    let (inputs, truth) = (inputs_of(&session)?, named(session.truth())?);
    let bars = Bars::new();
    let rig = rig_of(&session, &bars)?;
    // What decoding them takes is free again before a long flight needs it.
    let frames = first_frames(&session)?;
    let mut tracked = mavsight_pipeline::track(feeds(&session)?, &rig, &session.vehicle, &bars)?;
    let refined = refined(&session, rig, &mut tracked)?;
    let mut flight = Flight::of_session(&session, inputs.as_ref(), truth.as_deref())?;
    flight.options.equation_error_only |= args.equation_error_only;
    flight.options.lag_s = args.lag;
    flight.options.fit.held_out_s = args.hold_out.map(|Interval(from_s, to_s)| (from_s, to_s));
    let (results, mut notes) = solve(&flight, refined.rig, tracked, refined.body, (Some(&args.out), &bars))?;
    notes.extend(refined.note);
    let mut scores = truth.as_deref().map(|t| scores_of(&results, t));
    if let (Some(scores), Some(truth), Some(visible)) =
        (scores.as_mut(), truth.as_deref(), named(session.visibility())?)
    {
        let markers = super::demo::markers_of(&session.vehicle);
        scores.identity = Some(mavsight_score::score_identity(&results.poses, truth, &markers, &visible));
    }
    bars.done();
    finish(&flight, results, notes, scores, frames, &args.out)
}

/// The inputs of a session, where it has any.
pub(super) fn inputs_of(session: &Session) -> Result<Option<InputSeries>> {
    session.has_inputs().then(|| named(session.inputs())).transpose()
}

/// What is known of a flight beside its frames.
pub(crate) struct Flight<'a> {
    /// Name of the session.
    pub(crate) name: &'a str,
    /// The aircraft.
    pub(crate) vehicle: &'a Vehicle,
    /// Recorded inputs, where there are any.
    pub(crate) inputs: Option<&'a InputSeries>,
    /// Truth, for scoring and plots alone.
    pub(crate) truth: Option<&'a [TruthRow]>,
    /// How parameters are estimated.
    pub(crate) options: IdentifyOptions,
}

impl<'a> Flight<'a> {
    /// That of a session, with its model.
    pub(crate) fn of_session(
        session: &'a Session,
        inputs: Option<&'a InputSeries>,
        truth: Option<&'a [TruthRow]>,
    ) -> Result<Self> {
        let mut options = IdentifyOptions::default();
        options.table.model = named(session.model())?;
        // The equations of motion are a coaxial helicopter's; a model of one's own is of another aircraft.
        options.equation_error_only = options.table.model.is_some();
        Ok(Self { name: &session.name, vehicle: &session.vehicle, inputs, truth, options })
    }
}

/// Solves for the cameras by stills or by clicked pixels, and by what was moved before them.
pub(crate) fn rig_of(session: &Session, bars: &Bars) -> Result<Rig> {
    bars.begin(mavsight_pipeline::Stage::Calibrate, None);
    if let Some(rig) = named(session.rig())? {
        return Ok(rig);
    }
    let points = named(session.control_points())?;
    let objects = objects_of(session)?;
    let pixels = named(session.control_pixels())?;
    if pixels.is_some() || points.is_empty() {
        let sizes = session
            .cameras
            .iter()
            .enumerate()
            .map(|(k, c)| Ok((c.name.clone(), named(session.image_size(k))?)))
            .collect::<Result<Vec<(String, ImageSize)>>>()?;
        return Ok(calibrate_from_observations(&sizes, &points, &pixels.unwrap_or_default(), &objects)?);
    }
    let mut stills = Vec::with_capacity(session.cameras.len());
    for camera in &session.cameras {
        if let Some(path) = &camera.still {
            stills.push(ControlStill { camera: camera.name.clone(), frame: named(read_image(path))? });
        }
    }
    let rig = calibrate_from_stills_and(&stills, &points, &objects)?;
    named(session.require_sizes(&rig, &session.path))?;
    Ok(rig)
}

/// The wand and the board of a session, where it has them.
fn objects_of(session: &Session) -> Result<Vec<MovedObject>> {
    let mut objects = Vec::new();
    if let Some(wand) = &session.wand
        && let [a, b] = wand.ball[..]
    {
        let feeds = (0..session.cameras.len())
            .map(|k| Ok(session.open_wand(k)?.map(|source| feed_of(&session.cameras[k], k == 0, source))))
            .collect::<Result<Vec<_>>>()?;
        let wand = Wand {
            length_m: wand.length_m,
            length_std_m: wand.length_std_m,
            colors: [a.color.rgb(), b.color.rgb()],
            diameters_m: [a.diameter_m, b.diameter_m],
        };
        objects.push(wand_of(&wand, feeds)?);
    }
    if let Some(board) = &session.board {
        let feeds = (0..session.cameras.len())
            .map(|k| Ok(session.open_board(k)?.map(|source| feed_of(&session.cameras[k], k == 0, source))))
            .collect::<Result<Vec<_>>>()?;
        let board = Board {
            columns: board.columns,
            rows: board.rows,
            square_m: board.square_m,
            together: board.together,
            coded: board.coded().map_err(|(key, detail)| WrongCall(format!("{key} {detail}")))?,
        };
        objects.push(board_of(&board, feeds)?);
    }
    Ok(objects)
}

/// Cameras and markers as the flight has shown them.
pub(crate) struct Refined {
    pub(crate) rig: Rig,
    /// Empty where the markers are those of the file.
    pub(crate) body: Vec<MarkerAsBuilt>,
    /// What could not be refined, and why.
    pub(crate) note: Option<String>,
}

/// The cameras, and the markers where the session asks for that, as the flight has shown them, and poses with them; or a note
/// why not.
pub(crate) fn refined(session: &Session, rig: Rig, tracked: &mut Tracked) -> Result<Refined> {
    let Some(how) = refinement_of(session) else {
        return Ok(Refined { rig, body: Vec::new(), note: None });
    };
    match refine(tracked, &rig, &session.vehicle, how) {
        Ok(flown) => {
            let is_new = how.markers_std_m.is_some() && flown.kept.is_none();
            let body = if is_new { as_built(&flown) } else { Vec::new() };
            let note = flown.kept.map(|why| format!("The markers are those of the vehicle file: {why}."));
            Ok(Refined { rig: flown.refined.rig, body, note })
        }
        Err(PipelineError::Pose { source, .. }) => {
            let note = format!("Cameras and markers are not refined from the flight: {source}.");
            Ok(Refined { rig, body: Vec::new(), note: Some(note) })
        }
        Err(other) => Err(other.into()),
    }
}

/// What a session asks to refine.
pub(crate) fn refinement_of(session: &Session) -> Option<Refinement> {
    session.refine.map(|r| Refinement { markers_std_m: r.markers_std_m, diameters: r.diameters })
}

fn as_built(body: &AsFlown) -> Vec<MarkerAsBuilt> {
    let row = |(k, marker): (usize, &mavsight_pose::BodyMarker)| MarkerAsBuilt {
        name: marker.name.clone(),
        position_m: marker.marker_in_body_m,
        position_std_m: body.refined.markers_std_m[k],
        diameter_m: 2.0 * marker.radius_m,
        diameter_std_m: body.diameters.get(k).copied().flatten().and_then(|d| d.std_m),
    };
    body.refined.markers.iter().enumerate().map(row).collect()
}

/// Every camera's frames.
pub(crate) fn feeds(session: &Session) -> Result<Vec<CameraFeed<'static>>> {
    let feed = |(k, camera): (usize, &SessionCamera)| {
        let clap = named(session.clap_of(k))?;
        Ok(feed_of(camera, k == 0, session.open_camera(k)?).with_flash(session.flash).with_clap(clap))
    };
    session.cameras.iter().enumerate().map(feed).collect()
}

fn feed_of(camera: &SessionCamera, is_first: bool, source: FrameSource) -> CameraFeed<'static> {
    let name = camera.name.clone();
    let (announced, readout, size) = (source.declared_frames(), source.readout(), source.size());
    let frames = source.map(move |item| {
        item.map(|(t_ns, frame)| TimedFrame { t_ns, frame })
            .map_err(|e| PipelineError::Source { camera: name.clone(), source: Box::new(e) })
    });
    let feed = CameraFeed::new(camera.name.clone(), announced, Box::new(frames));
    feed.with_clock(clock_of(camera, is_first, size), readout.into())
}

/// What a session tells of a camera's clock. The first camera's is the reference.
fn clock_of(camera: &SessionCamera, is_first: bool, size: ImageSize) -> ClockPrior {
    let mut prior = if is_first || (camera.time_offset_s.is_some() && camera.time_offset_std_s.is_none()) {
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
        // No sensor takes longer than a thirtieth of a second for all its rows.
        Some(LineTime::Unknown(_)) => prior.line_time_std_s = 1.0 / 30.0 / f64::from(size.height_px.max(1)),
        None => {}
    }
    prior
}

/// The first frame of each camera, for the figures.
pub(crate) fn first_frames(session: &Session) -> Result<Vec<Frame>> {
    let mut frames = Vec::with_capacity(session.cameras.len());
    for k in 0..session.cameras.len() {
        if let Some(first) = session.open_camera(k)?.next() {
            frames.push(first?.1);
        }
    }
    Ok(frames)
}

/// Motion and parameters of what was tracked, with notes on what could not be had.
pub(crate) fn solve(
    flight: &Flight<'_>,
    rig: Rig,
    mut tracked: Tracked,
    body: Vec<MarkerAsBuilt>,
    (out, bars): (Option<&Path>, &Bars),
) -> Result<(RunResults, Vec<String>)> {
    let motion = motion_of(&tracked, flight.vehicle, bars);
    // Nobody asks for the diameters of an hour's balls any more.
    drop(std::mem::take(&mut tracked.diameters_px));
    let centres = tracked.centre_quality();
    let lasting = lasting_to_fit(&tracked);
    let mut results = RunResults {
        session: flight.name.to_owned(),
        camera_names: rig.cameras.iter().map(|c| c.name.clone()).collect(),
        marker_names: flight.vehicle.marker.iter().map(|m| m.name.clone()).collect(),
        rig: Some(rig),
        body,
        poses: tracked.poses,
        camera_clocks: tracked.clocks,
        camera_health: tracked.health,
        centres,
        ..RunResults::default()
    };
    let mut notes = tracked.notes;
    let seen = tracked.observations;
    match out.zip(telling_stretch_s(&results.poses)) {
        // From here on only output error looks at images, and of a long flight at a minute.
        Some((out, (from_s, to_s))) => {
            let is_needed = |o: &MarkerObservation| (from_s..=to_s).contains(&(o.t_ns as f64 * 1e-9));
            write_markers_early(out, &mut results, &seen, is_needed)?;
        }
        None => results.markers = seen.iter().collect(),
    }
    drop(seen);
    let is_lasting: Vec<usize> = lasting.iter().map(|(k, _)| *k).collect();
    for (k, columns) in lasting {
        let pose = &mut results.poses[k];
        pose.estimate = pose.estimate.take().map(|e| e.with_systematic(&columns));
    }
    notes.extend(with_motion(&mut results, motion, flight, bars)?);
    // Nobody asks any more how they err together.
    for k in is_lasting {
        let pose = &mut results.poses[k];
        pose.estimate = pose.estimate.take().map(PoseEstimate::condensed);
    }
    Ok((results, notes))
}

/// Errors of poses and motion against truth.
pub(crate) fn scores_of(results: &RunResults, truth: &[TruthRow]) -> Scores {
    Scores {
        poses: score_poses(&results.poses, truth),
        motion: results.motion.as_ref().and_then(|m| score_motion(m, truth)),
        ..Scores::default()
    }
}

/// Writes every result file and the report, and prints the summary.
pub(crate) fn finish(
    flight: &Flight<'_>,
    mut results: RunResults,
    notes: Vec<String>,
    scores: Option<Scores>,
    frames: Vec<Frame>,
    out: &Path,
) -> Result<()> {
    let summary = Summary::of(&results, scores.as_ref(), &notes);
    results.summary = summary.json();
    let page = Page { flight, results: &results, summary: &summary, frames: &frames };
    write_results(out, &results)?;
    remove_stale(&results, out)?;
    write_page(&page, out)?;
    out!("{}", summary.text());
    outln!("\nResults: {}", out.display());
    require_a_pose(&results)
}

/// Removes what an earlier run left in the folder of which this one has nothing.
fn remove_stale(results: &RunResults, out: &Path) -> Result<()> {
    let has_parameters = results.identification.is_some() || results.output_error.named().next().is_some();
    for (name, is_there) in [
        (names::BODY, !results.body.is_empty()),
        (names::MOTION, results.motion.is_some()),
        (names::COEFFICIENTS, results.coefficients.is_some()),
        (names::PARAMETERS, has_parameters),
    ] {
        let path = out.join(name);
        if !is_there && path.exists() {
            std::fs::remove_file(&path).with_context(|| format!("{}", path.display()))?;
        }
    }
    Ok(())
}

/// Refuses a flight of which nothing was measured.
pub(crate) fn require_a_pose(results: &RunResults) -> Result<()> {
    let none = !results.poses.is_empty() && results.poses.iter().all(|p| p.estimate.is_none());
    if none {
        let reason = results.poses.iter().find_map(|p| p.reason.clone()).unwrap_or_default();
        anyhow::bail!("none of {} instants has a pose; the first: {reason}", results.poses.len());
    }
    Ok(())
}
