//! What no session file may say, with the remedy.

use super::{LineTime, SESSION_SCHEMA, SessionCamera, SessionFile, is_empty};
use crate::SessionError;
use mavsight_pipeline::Board;
use std::path::Path;

#[derive(Clone, Copy)]
struct Checks<'a>(&'a Path);

impl Checks<'_> {
    fn require(self, holds: bool, key: &str, detail: impl Into<String>) -> Result<(), SessionError> {
        if holds { Ok(()) } else { Err(SessionError::value(self.0, key, detail)) }
    }

    fn number(
        self,
        value: Option<f64>,
        passes: impl Fn(f64) -> bool,
        key: &str,
        detail: &str,
    ) -> Result<(), SessionError> {
        let Some(value) = value else { return Ok(()) };
        self.require(passes(value), key, format!("{value} {detail}"))
    }
}

fn is_length(length_m: f64) -> bool {
    length_m.is_finite() && length_m > 0.0
}

/// Refuses the first value that cannot be meant.
pub(crate) fn validate(file: &SessionFile, path: &Path) -> Result<(), SessionError> {
    let checks = Checks(path);
    let detail = format!("{} is not known: this version reads schema = {SESSION_SCHEMA}", file.schema);
    checks.require(file.schema == SESSION_SCHEMA, "schema", detail)?;
    let detail = format!("{} found, but a pose needs at least 2: add [[camera]] sections", file.camera.len());
    checks.require(file.camera.len() >= 2, "camera", detail)?;
    if let Some(log) = &file.log {
        log.validate(path)?;
        let detail = "is given, and the [log] has inputs too: leave one of them out";
        checks.require(is_empty(&file.inputs) || !log.has_inputs(), "inputs", detail)?;
    }
    let refine = file.refine.unwrap_or_default();
    let detail = "is not above zero: a ruler is good to 0.001 or 0.002";
    checks.number(refine.markers_std_m, is_length, "refine.markers_std_m", detail)?;
    checks.require(
        file.refine.is_none() || refine.is_asked_for() || (refine.rig == Some(false) && !refine.diameters),
        "refine",
        "asks for nothing: give markers_std_m, rig = true or false, or leave the section out",
    )?;
    let detail = "is no share between 0 and 1: give 0.05 for intervals of 5 %";
    let enough = file.live.as_ref().and_then(|l| l.enough);
    checks.number(enough, |e| e > 0.0 && e < 1.0, "live.enough", detail)?;
    validate_calibration(file, checks)?;
    for (k, camera) in file.camera.iter().enumerate() {
        let is_free = !file.camera[..k].iter().any(|c| c.name == camera.name);
        let detail = format!("{:?} is empty or taken: give each camera its own name", camera.name);
        checks.require(!camera.name.is_empty() && is_free, &format!("camera {}: name", k + 1), detail)?;
        let needs_still = file.control.as_ref().is_some_and(|c| c.observations.is_none());
        validate_camera(camera, needs_still, checks)?;
    }
    Ok(())
}

fn validate_camera(
    camera: &SessionCamera,
    needs_still: bool,
    checks: Checks<'_>,
) -> Result<(), SessionError> {
    let key = |key: &str| format!("camera {}: {key}", camera.name);
    checks.require(
        camera.still.is_some() || !needs_still,
        &key("still"),
        "is missing: name the image of the control frame, or give control.observations",
    )?;
    checks.require(
        !is_empty(&camera.video) || camera.live.as_ref().is_some_and(|l| !l.trim().is_empty()),
        &key("video"),
        "is missing: name the recording, or what ffmpeg is to open as live",
    )?;
    let line_time_s = match camera.line_time_s {
        Some(LineTime::Known(line_time_s)) => Some(line_time_s),
        _ => None,
    };
    // A frame of so few rows that a line time is longer has none.
    let line = "is no line time: give seconds a row, for instance 30e-6, or \"estimate\"";
    let rate = "is no rate of a camera: give frames a second, for instance 30.0";
    let std = "is no standard deviation of a clock: give a nanosecond or more, in seconds, or leave it out";
    for (name, value, range, detail) in [
        ("frame_rate_hz", camera.frame_rate_hz, crate::RATES_HZ, rate),
        ("latency_s", camera.latency_s, 0.0..10.0, "is no delay: give seconds from 0 to 10"),
        ("time_offset_s", camera.time_offset_s, -1e9..1e9, "is not a time: give seconds"),
        ("time_offset_std_s", camera.time_offset_std_s, 1e-9..1e9, std),
        ("line_time_s", line_time_s, -1e-3..1e-3, line),
    ] {
        checks.number(value, |x| range.contains(&x), &key(name), detail)?;
    }
    Ok(())
}

fn validate_calibration(file: &SessionFile, checks: Checks<'_>) -> Result<(), SessionError> {
    let calibrates = file.control.is_some() || file.wand.is_some() || file.board.is_some();
    let detail = "is missing: the cameras need control points, a [wand], a [board] or the file of a [rig]";
    checks.require(calibrates || file.rig.is_some(), "control", detail)?;
    let detail = "holds the cameras already: leave it out, or [control], [wand] and [board]";
    checks.require(!calibrates || file.rig.is_none(), "rig", detail)?;
    if let Some(wand) = &file.wand {
        let (length_m, std_m) = (wand.length_m, wand.length_std_m);
        let detail = format!("{length_m} is no length: give metres, for instance 0.5");
        checks.require(is_length(length_m), "wand.length_m", detail)?;
        let detail = format!("{std_m} is not from 0 to the length: give metres");
        checks.require(std_m >= 0.0 && std_m < length_m, "wand.length_std_m", detail)?;
        let are_two = wand.ball.len() == 2 && wand.ball.iter().all(|b| is_length(b.diameter_m));
        let detail = format!(
            "{} given: give two balls, each with a color and a diameter_m above zero",
            wand.ball.len()
        );
        checks.require(are_two, "wand.ball", detail)?;
        let detail = "is named by fewer than two cameras: give each camera that saw it its recording";
        let named = file.camera.iter().filter(|c| c.wand.is_some()).count();
        checks.require(named >= 2, "camera: wand", detail)?;
    }
    if let Some(board) = &file.board {
        validate_board(board, checks)?;
        let detail = "is named by no camera: give each its images of it";
        checks.require(file.camera.iter().any(|c| c.board.is_some()), "camera: board", detail)?;
    }
    Ok(())
}

fn validate_board(board: &Board, checks: Checks<'_>) -> Result<(), SessionError> {
    let (columns, rows) = (board.columns, board.rows);
    let detail = format!("{} is no length: give metres, for instance 0.03", board.square_m);
    checks.require(is_length(board.square_m), "board.square_m", detail)?;
    // Markers identify the corners; without them unlike numbers of columns and rows do.
    if board.coded().map_err(|e| SessionError::content(checks.0, e))?.is_some() {
        return Ok(());
    }
    let detail = format!(
        "{columns} by {rows} inner corners: give 3 or more of each, and unlike numbers, so that a board is not taken for one turned"
    );
    checks.require(columns.min(rows) >= 3 && columns != rows, "board.columns, board.rows", detail)?;
    checks.require(
        !board.together || (columns + rows) % 2 == 1,
        "board.together",
        "cannot be seen from its corners where the numbers of columns and rows are both even or both odd: \
         use a board of, for instance, 9 by 6, or show it to each camera by itself",
    )
}
