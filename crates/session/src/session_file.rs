//! The session file as it is written: its sections and their keys.

mod validate;

use crate::logs::LogSection;
use mavsight_link::LiveSection;
use mavsight_pipeline::{Board, Refinement, WandBall};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

pub(crate) use validate::validate;

/// Version of the session file that this crate reads and writes.
pub const SESSION_SCHEMA: u32 = 1;

/// The session file as written; paths may be relative to it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionFile {
    /// Version of the contract: 1.
    pub schema: u32,
    /// Name of the session.
    pub name: String,
    /// Vehicle file.
    pub vehicle: PathBuf,
    /// Table of inputs; left out or empty: there is none, and no parameters are estimated.
    #[serde(default, skip_serializing_if = "is_empty")]
    pub inputs: PathBuf,
    /// The aircraft's own log, of which fields may be inputs.
    pub log: Option<LogSection>,
    /// Table of samples of the sensors that the flight model describes.
    pub sensors: Option<PathBuf>,
    /// Table of truth, for scoring only.
    pub truth: Option<PathBuf>,
    /// Equations to fit in place of those of the vehicle's model, or another flight model.
    pub model: Option<PathBuf>,
    /// Calibration by control points; may be left out where a wand or a board links the cameras.
    pub control: Option<ControlSection>,
    /// Calibration by a wand.
    pub wand: Option<WandSection>,
    /// Calibration by a chessboard.
    pub board: Option<Board>,
    /// Cameras that were calibrated elsewhere, in place of a calibration.
    pub rig: Option<RigSection>,
    /// Whether the light flashed, or a lamp was switched on, once before all cameras: their clocks are then
    /// estimated from there.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub flash: bool,
    /// Whether somebody clapped once for all cameras, whose videos have sound: their clocks are then
    /// estimated from there.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub clap: bool,
    /// What is refined from the flight itself; left out: the cameras, where held-out observations ask for it.
    pub refine: Option<Refinement>,
    /// How the session is flown live.
    pub live: Option<LiveSection>,
    /// Cameras.
    #[serde(default)]
    pub camera: Vec<SessionCamera>,
}

impl SessionFile {
    /// Every file that is named but the vehicle, with its key.
    pub(crate) fn files_mut(&mut self) -> Vec<(String, &mut PathBuf)> {
        let (points, observations) = match &mut self.control {
            Some(control) => (Some(&mut control.points), control.observations.as_mut()),
            None => (None, None),
        };
        let own = [
            ("inputs", Some(&mut self.inputs)),
            ("log.file", self.log.as_mut().map(|log| &mut log.file)),
            ("sensors", self.sensors.as_mut()),
            ("truth", self.truth.as_mut()),
            ("model", self.model.as_mut()),
            ("control.points", points),
            ("control.observations", observations),
            ("rig.file", self.rig.as_mut().map(|r| &mut r.file)),
            ("live.poses", self.live.as_mut().and_then(|l| l.poses.as_mut())),
        ];
        let own = own.into_iter().filter_map(|(key, path)| Some((key.to_owned(), path?)));
        let of_camera =
            self.camera.iter_mut().flat_map(|SessionCamera { name, video, still, wand, board, .. }| {
                let all = [
                    ("video", Some(video)),
                    ("still", still.as_mut()),
                    ("wand", wand.as_mut()),
                    ("board", board.as_mut()),
                ];
                all.into_iter()
                    .filter_map(move |(key, path)| Some((format!("{key} of camera {name}"), path?)))
            });
        own.chain(of_camera).filter(|(_, path)| !is_empty(path)).collect()
    }
}

pub(crate) fn is_empty(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

/// Calibration by control points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSection {
    /// Table of control points.
    pub points: PathBuf,
    /// Table of their pixels, instead of finding them in the stills.
    pub observations: Option<PathBuf>,
}

/// Cameras that were calibrated elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigSection {
    /// The cameras as `rig.toml` has them, for instance by `mavsight convert`; those of the session by their
    /// names.
    pub file: PathBuf,
}

/// Calibration by two balls on a stick, waved through the volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WandSection {
    /// Distance between the centres of the balls.
    pub length_m: f64,
    /// Standard deviation of that; 0 for exact.
    #[serde(default)]
    pub length_std_m: f64,
    /// The two balls, of unlike colours.
    pub ball: Vec<WandBall>,
}

/// One camera of a session.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionCamera {
    /// Name, unique.
    pub name: String,
    /// Video file, or pattern of an image sequence such as `cam1/frame_%05d.png`; may be left out where
    /// `live` is given.
    #[serde(default, skip_serializing_if = "is_empty")]
    pub video: PathBuf,
    /// What ffmpeg opens for `mavsight live`: a device, an address, or its input options and the input, such
    /// as `-f v4l2 -input_format mjpeg -framerate 60 /dev/video0`.
    pub live: Option<String>,
    /// By how much a live frame's time stamp is later than the middle of its exposure, where that is known;
    /// left out: 0.
    pub latency_s: Option<f64>,
    /// Image of the control frame; may be left out when the control pixels come from a table.
    pub still: Option<PathBuf>,
    /// Recording of the wand, for a session with one: a video, or a pattern of an image sequence.
    pub wand: Option<PathBuf>,
    /// Images of the board, for a session with one: a pattern such as `board/cam1_%02d.png`, or a video.
    pub board: Option<PathBuf>,
    /// Frames a second of an image sequence; a video has its own time stamps.
    pub frame_rate_hz: Option<f64>,
    /// How much later than the true instant this camera's time stamps are; left out: estimated from the
    /// flight (0 for the first camera, whose clock is the others' reference).
    pub time_offset_s: Option<f64>,
    /// Standard deviation of `time_offset_s`: it is then where the estimation starts; left out: it is exact.
    pub time_offset_std_s: Option<f64>,
    /// Time from one row of a rolling shutter to the next, 0 for a global shutter; left out: estimated with the
    /// offsets of clocks, and 0 where what the flight shows may be by chance or no offset is estimated.
    pub line_time_s: Option<LineTime>,
    /// Which field of an interlaced recording is the earlier one; left out: it is progressive.
    pub interlaced: Option<FieldOrder>,
}

impl SessionCamera {
    /// Whether it has a recording; one that is only flown live need not.
    pub fn is_recorded(&self) -> bool {
        !is_empty(&self.video)
    }
}

/// The line time of a rolling shutter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "line_time_s is a number of seconds from row to row, for instance 30e-6, or \"estimate\""
)]
pub enum LineTime {
    /// It is known; below 0 where the lower rows come first.
    Known(f64),
    /// The flight is to show it: the word `estimate`.
    Unknown(Estimate),
}

/// The word `estimate`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Estimate {
    /// From the flight.
    Estimate,
}

/// Which rows of an interlaced frame are exposed first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FieldOrder {
    /// Rows 0, 2, 4 and so on.
    TopFirst,
    /// Rows 1, 3, 5 and so on.
    BottomFirst,
}
