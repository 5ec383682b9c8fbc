//! What no session file may say, with the remedy.

use super::{LineTime, RefusedKey, SESSION_SCHEMA, SessionFile, is_empty};
use crate::SessionError;
use std::path::Path;

/// Refuses the first value that cannot be meant.
pub(crate) fn validate(file: &SessionFile, path: &Path) -> Result<(), SessionError> {
    let refuse = |key: String, detail: String| Err(SessionError::value(path, key, detail));
    if file.schema != SESSION_SCHEMA {
        let detail = format!("{} is not known: this version reads schema = {SESSION_SCHEMA}", file.schema);
        return refuse("schema".into(), detail);
    }
    if file.camera.len() < 2 {
        let detail =
            format!("{} found, but a pose needs at least 2: add [[camera]] sections", file.camera.len());
        return refuse("camera".into(), detail);
    }
    let refine = file.refine.unwrap_or_default();
    if let Some(std_m) = refine.markers_std_m.filter(|s| !(s.is_finite() && *s > 0.0)) {
        let detail = format!("{std_m} is not above zero: a ruler is good to 0.001 or 0.002");
        return refuse("refine.markers_std_m".into(), detail);
    }
    if file.refine.is_some() && !refine.rig && refine.markers_std_m.is_none() {
        let detail = "asks for nothing: give markers_std_m, rig = true, or leave the section out";
        return refuse("refine".into(), detail.into());
    }
    if let Some(enough) = file.live.as_ref().and_then(|l| l.enough).filter(|e| !(*e > 0.0 && *e < 1.0)) {
        let detail = format!("{enough} is no share between 0 and 1: give 0.05 for intervals of 5 %");
        return refuse("live.enough".into(), detail);
    }
    validate_objects(file).or_else(|wrong| refuse(wrong.key, wrong.detail))?;
    for (k, camera) in file.camera.iter().enumerate() {
        if camera.name.is_empty() || file.camera[..k].iter().any(|c| c.name == camera.name) {
            let detail = format!("{:?} is empty or taken: give each camera its own name", camera.name);
            return refuse(format!("camera {}: name", k + 1), detail);
        }
        if camera.still.is_none() && file.control.as_ref().is_some_and(|c| c.observations.is_none()) {
            let detail =
                "is missing: name the image of the control frame, or give control.observations".into();
            return refuse(format!("camera {}: still", camera.name), detail);
        }
        if let Some(rate) = camera.frame_rate_hz.filter(|r| !(0.01..=1e5).contains(r)) {
            let detail = format!("{rate} is no rate of a camera: give frames a second, for instance 30.0");
            return refuse(format!("camera {}: frame_rate_hz", camera.name), detail);
        }
        if is_empty(&camera.video) && camera.live.as_ref().is_none_or(|l| l.trim().is_empty()) {
            let detail = "is missing: name the recording, or what ffmpeg is to open as live".into();
            return refuse(format!("camera {}: video", camera.name), detail);
        }
        if let Some(latency) = camera.latency_s.filter(|l| !(l.is_finite() && (0.0..10.0).contains(l))) {
            let detail = format!("{latency} is no delay: give seconds from 0 to 10");
            return refuse(format!("camera {}: latency_s", camera.name), detail);
        }
        if let Some(offset) = camera.time_offset_s.filter(|o| !o.is_finite() || o.abs() >= 1e9) {
            let detail = format!("{offset} is not a time: give seconds");
            return refuse(format!("camera {}: time_offset_s", camera.name), detail);
        }
        if let Some(std) = camera.time_offset_std_s.filter(|s| !(1e-9..1e9).contains(s)) {
            let detail = format!(
                "{std} is no standard deviation of a clock: give a nanosecond or more, in seconds, or leave it out"
            );
            return refuse(format!("camera {}: time_offset_std_s", camera.name), detail);
        }
        if let Some(LineTime::Known(line)) = camera.line_time_s.filter(|l| !l.is_sound()) {
            let detail =
                format!("{line} is no line time: give seconds a row, for instance 30e-6, or \"estimate\"");
            return refuse(format!("camera {}: line_time_s", camera.name), detail);
        }
    }
    Ok(())
}

/// What is wrong with the wand or the board: key and remedy.
fn validate_objects(file: &SessionFile) -> Result<(), RefusedKey> {
    let refuse = |key: &str, detail: String| Err(RefusedKey { key: key.to_owned(), detail });
    let calibrates = file.control.is_some() || file.wand.is_some() || file.board.is_some();
    if !calibrates && file.rig.is_none() {
        let detail =
            "is missing: the cameras need control points, a [wand], a [board] or the file of a [rig]";
        return refuse("control", detail.to_owned());
    }
    if calibrates && file.rig.is_some() {
        let detail = "holds the cameras already: leave it out, or [control], [wand] and [board]".to_owned();
        return refuse("rig", detail);
    }
    if let Some(wand) = &file.wand {
        if !(wand.length_m.is_finite() && wand.length_m > 0.0) {
            return refuse(
                "wand.length_m",
                format!("{} is no length: give metres, for instance 0.5", wand.length_m),
            );
        }
        let std_m = wand.length_std_m;
        if !(std_m >= 0.0 && std_m < wand.length_m) {
            return refuse("wand.length_std_m", format!("{std_m} is not from 0 to the length: give metres"));
        }
        if wand.ball.len() != 2 || wand.ball.iter().any(|b| !(b.diameter_m.is_finite() && b.diameter_m > 0.0))
        {
            let detail = format!(
                "{} given: give two balls, each with a color and a diameter_m above zero",
                wand.ball.len()
            );
            return refuse("wand.ball", detail);
        }
        if file.camera.iter().filter(|c| c.wand.is_some()).count() < 2 {
            let detail =
                "is named by fewer than two cameras: give each camera that saw it its recording".to_owned();
            return refuse("camera: wand", detail);
        }
    }
    if let Some(board) = &file.board {
        if !(board.square_m.is_finite() && board.square_m > 0.0) {
            return refuse(
                "board.square_m",
                format!("{} is no length: give metres, for instance 0.03", board.square_m),
            );
        }
        // Markers identify the corners; without them unlike numbers of columns and rows do.
        let is_plain = board.coded()?.is_none();
        if is_plain && (board.columns < 3 || board.rows < 3 || board.columns == board.rows) {
            let detail = format!(
                "{} by {} inner corners: give 3 or more of each, and unlike numbers, so that a board is not taken for one turned",
                board.columns, board.rows
            );
            return refuse("board.columns, board.rows", detail);
        }
        if is_plain && board.together && (board.columns + board.rows) % 2 == 0 {
            let detail = "cannot be seen from its corners where the numbers of columns and rows are both even or both odd: \
                          use a board of, for instance, 9 by 6, or show it to each camera by itself";
            return refuse("board.together", detail.to_owned());
        }
        if file.camera.iter().all(|c| c.board.is_none()) {
            return refuse("camera: board", "is named by no camera: give each its images of it".to_owned());
        }
    }
    Ok(())
}
