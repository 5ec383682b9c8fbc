//! The session file and the vehicle file that it names.

use crate::error::require_file;
use crate::toml_file::read_toml;
use crate::video::{Clap, FrameSource, find_clap, sequence_exists};
use crate::{ControlPixel, ControlPointRow, SessionError, TruthRow, tables};
use mavsight_flight::{Color, InputSeries, Vehicle};
use mavsight_identify::Model;
use mavsight_link::{JsonOptions, LinkOptions, MavlinkOptions, NatnetOptions, VrpnOptions, ZenohOptions};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Version of the session file that this crate reads and writes.
pub const SESSION_SCHEMA: u32 = 1;

/// The session file as written; paths may be relative to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Table of truth, for scoring only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<PathBuf>,
    /// Output equations to fit; those of equation 3 where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// Calibration by control points; may be left out where a wand or a board links the cameras.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlSection>,
    /// Calibration by a wand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wand: Option<WandSection>,
    /// Calibration by a chessboard.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<BoardSection>,
    /// Cameras that were calibrated elsewhere, in place of a calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<RigSection>,
    /// Whether the light flashed, or a lamp was switched on, once before all cameras: their clocks are then estimated from there.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub flash: bool,
    /// Whether somebody clapped once for all cameras, whose videos have sound: their clocks are then estimated from there.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub clap: bool,
    /// What is refined from the flight itself; left out: nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refine: Option<RefineSection>,
    /// How the session is flown live.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub live: Option<LiveSection>,
    /// Cameras.
    #[serde(default)]
    pub camera: Vec<SessionCamera>,
}

fn is_empty(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

/// How a session is flown live.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LiveSection {
    /// Poses of an earlier flight (`pose.csv`), whose motion noise is gone by; left out: that of this flight's first seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<PathBuf>,
    /// Half width of a parameter's interval, as a share of its value, at which enough has been seen of it; left out: 0.05.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enough: Option<f64>,
    /// To an autopilot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mavlink: Option<MavlinkOptions>,
    /// To clients of OptiTrack's Motive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub natnet: Option<NatnetOptions>,
    /// To clients of VRPN.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vrpn: Option<VrpnOptions>,
    /// Events as lines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub json: Option<JsonOptions>,
    /// Events by Zenoh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zenoh: Option<ZenohOptions>,
}

impl LiveSection {
    /// The outlets that are switched on.
    pub fn links(&self) -> LinkOptions {
        LinkOptions {
            mavlink: self.mavlink.clone(),
            natnet: self.natnet.clone(),
            vrpn: self.vrpn.clone(),
            json: self.json.clone(),
            zenoh: self.zenoh.clone(),
        }
    }
}

/// Calibration by control points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSection {
    /// Table of control points.
    pub points: PathBuf,
    /// Table of their pixels, instead of finding them in the stills.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub observations: Option<PathBuf>,
}

/// Cameras that were calibrated elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigSection {
    /// The cameras as `rig.toml` has them, for instance by `mavsight convert`; those of the session by their names.
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

/// A ball of a wand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WandBall {
    /// Nominal colour.
    pub color: Color,
    /// Diameter.
    pub diameter_m: f64,
}

/// Calibration by a chessboard.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardSection {
    /// Inner corners along a row.
    pub columns: usize,
    /// Rows of inner corners.
    pub rows: usize,
    /// Side of a square.
    pub square_m: f64,
    /// Whether images of the same number show the board at the same place to all cameras.
    #[serde(default)]
    pub together: bool,
}

/// Refinement of cameras and markers from the flight itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefineSection {
    /// Whether the cameras are refined; they are wherever the markers are.
    #[serde(default)]
    pub rig: bool,
    /// Standard deviation of each coordinate in the vehicle file: a ruler is good to 0.001 or 0.002. Left out: the markers are
    /// as in the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub markers_std_m: Option<f64>,
    /// Whether the balls' diameters are measured too, from their images.
    #[serde(default)]
    pub diameters: bool,
}

/// One camera of a session.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionCamera {
    /// Name, unique.
    pub name: String,
    /// Video file, or pattern of an image sequence such as `cam1/frame_%05d.png`; may be left out where `live` is given.
    #[serde(default, skip_serializing_if = "is_empty")]
    pub video: PathBuf,
    /// What ffmpeg opens for `mavsight live`: a device, an address, or its input options and the input, such as
    /// `-f v4l2 -input_format mjpeg -framerate 60 /dev/video0`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub live: Option<String>,
    /// By how much a live frame's time stamp is later than the middle of its exposure, where that is known; left out: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency_s: Option<f64>,
    /// Image of the control frame; may be left out when the control pixels come from a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub still: Option<PathBuf>,
    /// Recording of the wand, for a session with one: a video, or a pattern of an image sequence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wand: Option<PathBuf>,
    /// Images of the board, for a session with one: a pattern such as `board/cam1_%02d.png`, or a video.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<PathBuf>,
    /// Frames a second of an image sequence; a video has its own time stamps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_rate_hz: Option<f64>,
    /// How much later than the true instant this camera's time stamps are; left out: estimated from the flight (0 for the
    /// first camera, whose clock is the others' reference).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_offset_s: Option<f64>,
    /// Standard deviation of `time_offset_s`: it is then where the estimation starts; left out: it is exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_offset_std_s: Option<f64>,
    /// Time from one row of a rolling shutter to the next; left out: all rows are exposed together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line_time_s: Option<LineTime>,
    /// Which field of an interlaced recording is the earlier one; left out: it is progressive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interlaced: Option<FieldOrder>,
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

impl LineTime {
    /// A known one must be shorter than a thousandth of a second: a frame of so few rows that it is longer has none.
    fn is_sound(&self) -> bool {
        match self {
            Self::Known(line_time_s) => line_time_s.is_finite() && line_time_s.abs() < 1e-3,
            Self::Unknown(_) => true,
        }
    }
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

/// A session with every path made whole and every file that it names seen to exist.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// The session file.
    pub path: PathBuf,
    /// Name of the session.
    pub name: String,
    /// Vehicle file.
    pub vehicle_path: PathBuf,
    /// The vehicle, validated.
    pub vehicle: Vehicle,
    /// Table of inputs.
    pub inputs_path: PathBuf,
    /// Table of truth, for scoring only.
    pub truth_path: Option<PathBuf>,
    /// Output equations to fit.
    pub model_path: Option<PathBuf>,
    /// Table of control points, where there is one.
    pub control_points_path: Option<PathBuf>,
    /// Table of control pixels.
    pub control_pixels_path: Option<PathBuf>,
    /// The wand, where one was waved.
    pub wand: Option<WandSection>,
    /// The board, where one was shown.
    pub board: Option<BoardSection>,
    /// Cameras in place of a calibration.
    pub rig_path: Option<PathBuf>,
    /// Whether a flash is where the estimation of clocks starts.
    pub flash: bool,
    /// Whether a clap is.
    pub clap: bool,
    /// What is refined from the flight, where something is.
    pub refine: Option<RefineSection>,
    /// How it is flown live, with whole paths.
    pub live: LiveSection,
    /// Cameras, at least two, with whole paths.
    pub cameras: Vec<SessionCamera>,
}

impl Session {
    /// Reads a session file and the vehicle, and checks that every file named is there.
    ///
    /// # Errors
    /// Names the file, the line or key, and what to do.
    pub fn load(path: &Path) -> Result<Self, SessionError> {
        let file: SessionFile = read_toml(path, "session file")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        validate(&file, path)?;
        let vehicle_path = folder.join(&file.vehicle);
        let vehicle = load_vehicle(&vehicle_path)?;
        let session = Self {
            path: path.to_owned(),
            name: file.name,
            vehicle_path,
            vehicle,
            inputs_path: if is_empty(&file.inputs) { file.inputs } else { folder.join(file.inputs) },
            truth_path: file.truth.map(|p| folder.join(p)),
            model_path: file.model.map(|p| folder.join(p)),
            control_points_path: file.control.as_ref().map(|c| folder.join(&c.points)),
            control_pixels_path: file.control.and_then(|c| c.observations).map(|p| folder.join(p)),
            wand: file.wand,
            board: file.board,
            rig_path: file.rig.map(|r| folder.join(r.file)),
            flash: file.flash,
            clap: file.clap,
            refine: file.refine,
            live: file
                .live
                .map(|l| LiveSection { poses: l.poses.map(|p| folder.join(p)), ..l })
                .unwrap_or_default(),
            cameras: file
                .camera
                .into_iter()
                .map(|c| SessionCamera {
                    video: if is_empty(&c.video) { c.video.clone() } else { folder.join(&c.video) },
                    still: c.still.as_ref().map(|p| folder.join(p)),
                    wand: c.wand.as_ref().map(|p| folder.join(p)),
                    board: c.board.as_ref().map(|p| folder.join(p)),
                    ..c
                })
                .collect(),
        };
        session.require_files()?;
        Ok(session)
    }

    fn require_files(&self) -> Result<(), SessionError> {
        let role = |key: &str| format!("{key} in {}", self.path.display());
        if self.has_inputs() {
            require_file(&self.inputs_path, &role("inputs"))?;
        }
        if let Some(path) = &self.live.poses {
            require_file(path, &role("live.poses"))?;
        }
        if let Some(path) = &self.control_points_path {
            require_file(path, &role("control.points"))?;
        }
        if let Some(path) = &self.truth_path {
            require_file(path, &role("truth"))?;
        }
        if let Some(path) = &self.model_path {
            require_file(path, &role("model"))?;
        }
        if let Some(path) = &self.control_pixels_path {
            require_file(path, &role("control.observations"))?;
        }
        if let Some(path) = &self.rig_path {
            require_file(path, &role("rig.file"))?;
        }
        for camera in &self.cameras {
            if !is_empty(&camera.video) && !sequence_exists(&camera.video) {
                require_file(&camera.video, &role(&format!("video of camera {}", camera.name)))?;
            }
            for (what, path) in [("wand", &camera.wand), ("board", &camera.board)] {
                if let Some(path) = path.as_ref().filter(|p| !sequence_exists(p)) {
                    require_file(path, &role(&format!("{what} of camera {}", camera.name)))?;
                }
            }
            if let Some(still) = &camera.still {
                require_file(still, &role(&format!("still of camera {}", camera.name)))?;
            }
        }
        Ok(())
    }

    /// Opens one camera's frames, with the time stamps of the file; fields of an interlaced recording one by one.
    ///
    /// # Errors
    /// A file that cannot be read, or a camera index beyond the list.
    pub fn open_camera(&self, camera: usize) -> Result<FrameSource, SessionError> {
        let camera = self.camera(camera)?;
        Ok(in_fields(camera, FrameSource::open(&camera.video, camera.frame_rate_hz)?))
    }

    /// The clap in the sound of one camera's recording; `None` where the session tells of no clap.
    ///
    /// # Errors
    /// Those of [`find_clap`], or a camera index beyond the list.
    pub fn clap_of(&self, camera: usize) -> Result<Option<Clap>, SessionError> {
        let camera = self.camera(camera)?;
        if !self.clap {
            return Ok(None);
        }
        // Images have no sound.
        if camera.frame_rate_hz.is_some() {
            Ok(Some(Clap::Silent))
        } else {
            find_clap(&camera.video).map(Some)
        }
    }

    /// Opens one camera's recording of the wand as [`Self::open_camera`] does that of the flight; `None` where it has none.
    ///
    /// # Errors
    /// A file that cannot be read, or a camera index beyond the list.
    pub fn open_wand(&self, camera: usize) -> Result<Option<FrameSource>, SessionError> {
        let camera = self.camera(camera)?;
        let Some(path) = &camera.wand else { return Ok(None) };
        Ok(Some(in_fields(camera, FrameSource::open(path, camera.frame_rate_hz)?)))
    }

    /// Opens one camera's images of the board; `None` where it has none. Images of a sequence are a second apart.
    ///
    /// # Errors
    /// A file that cannot be read, or a camera index beyond the list.
    pub fn open_board(&self, camera: usize) -> Result<Option<FrameSource>, SessionError> {
        let path = &self.camera(camera)?.board;
        path.as_ref().map(|path| FrameSource::open(path, Some(1.0))).transpose()
    }

    fn camera(&self, camera: usize) -> Result<&SessionCamera, SessionError> {
        self.cameras.get(camera).ok_or_else(|| SessionError::Value {
            path: self.path.clone(),
            key: "camera".into(),
            detail: format!("there is no camera number {camera}: the session has {}", self.cameras.len()),
        })
    }

    /// Whether there is a table of inputs.
    pub fn has_inputs(&self) -> bool {
        !is_empty(&self.inputs_path)
    }

    /// Reads the inputs.
    ///
    /// # Errors
    /// Names row and column; a session without inputs.
    pub fn inputs(&self) -> Result<InputSeries, SessionError> {
        if !self.has_inputs() {
            let detail = "is missing: name the table of what was commanded".into();
            return Err(SessionError::Value { path: self.path.clone(), key: "inputs".into(), detail });
        }
        tables::read_inputs(&self.inputs_path)
    }

    /// Reads the control points; none where the session has no table of them.
    ///
    /// # Errors
    /// Names row and column.
    pub fn control_points(&self) -> Result<Vec<ControlPointRow>, SessionError> {
        self.control_points_path.as_deref().map_or_else(|| Ok(Vec::new()), tables::read_control_points)
    }

    /// Reads the control pixels, where the session has a table of them; names are checked against the session.
    ///
    /// # Errors
    /// Names row and column.
    pub fn control_pixels(&self) -> Result<Option<Vec<ControlPixel>>, SessionError> {
        let Some(path) = &self.control_pixels_path else { return Ok(None) };
        let points = self.control_points()?;
        let cameras: Vec<&str> = self.cameras.iter().map(|c| c.name.as_str()).collect();
        let names: Vec<&str> = points.iter().map(|p| p.name.as_str()).collect();
        tables::read_control_pixels(path, &cameras, &names).map(Some)
    }

    /// Reads the output equations, where the session names them.
    ///
    /// # Errors
    /// Names the file and the line or key.
    pub fn model(&self) -> Result<Option<Model>, SessionError> {
        self.model_path.as_deref().map(load_model).transpose()
    }

    /// Reads the truth, where the session has it.
    ///
    /// # Errors
    /// Names row and column.
    pub fn truth(&self) -> Result<Option<Vec<TruthRow>>, SessionError> {
        self.truth_path.as_deref().map(tables::read_truth).transpose()
    }

    /// Shares of the balls' faces that were visible, by instant, camera and marker, for scoring only; none where no such
    /// file stands beside the truth.
    ///
    /// # Errors
    /// Names the file, row and column.
    pub fn visibility(&self) -> Result<Option<Vec<Vec<Vec<f64>>>>, SessionError> {
        let path = self.truth_path.as_deref().map(|t| t.with_file_name(crate::VISIBILITY));
        let markers: Vec<String> = self.vehicle.marker.iter().map(|m| m.name.clone()).collect();
        let read = |p: std::path::PathBuf| crate::read_visibility(&p, self.cameras.len(), &markers);
        path.filter(|p| p.is_file()).map(read).transpose()
    }
}

/// The fields one by one, where a camera is interlaced.
fn in_fields(camera: &SessionCamera, source: FrameSource) -> FrameSource {
    match camera.interlaced {
        Some(order) => source.fields(order),
        None => source,
    }
}

/// Reads a model file. Whether its signals exist is seen when it is used.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_model(path: &Path) -> Result<Model, SessionError> {
    require_file(path, "model file")?;
    let text = std::fs::read_to_string(path).map_err(|e| SessionError::io(path, "read it", e))?;
    Model::parse(&text).map_err(|source| SessionError::Model { path: path.to_owned(), source })
}

/// Reads and validates a vehicle file.
///
/// # Errors
/// Names the file and the line or key.
pub fn load_vehicle(path: &Path) -> Result<Vehicle, SessionError> {
    let vehicle: Vehicle = read_toml(path, "vehicle file")?;
    vehicle.validate().map_err(|source| SessionError::Flight { path: path.to_owned(), source })?;
    Ok(vehicle)
}

fn validate(file: &SessionFile, path: &Path) -> Result<(), SessionError> {
    let refuse =
        |key: String, detail: String| Err(SessionError::Value { path: path.to_owned(), key, detail });
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
    validate_objects(file).or_else(|(key, detail)| refuse(key, detail))?;
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
        if let Some(rate) = camera.frame_rate_hz.filter(|r| !(r.is_finite() && *r > 0.0)) {
            let detail = format!("{rate} is not a rate: give frames a second, for instance 30.0");
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
        if let Some(std) = camera.time_offset_std_s.filter(|s| !(s.is_finite() && *s > 0.0)) {
            let detail = format!("{std} is no standard deviation: give seconds above 0, or leave it out");
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
fn validate_objects(file: &SessionFile) -> Result<(), (String, String)> {
    let refuse = |key: &str, detail: String| Err((key.to_owned(), detail));
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
        if board.columns < 3 || board.rows < 3 || board.columns == board.rows {
            let detail = format!(
                "{} by {} inner corners: give 3 or more of each, and unlike numbers, so that a board is not taken for one turned",
                board.columns, board.rows
            );
            return refuse("board.columns, board.rows", detail);
        }
        if board.together && (board.columns + board.rows) % 2 == 0 {
            let detail = "cannot be seen from its corners where the numbers of columns and rows are both even or both odd: \
                          use a board of, for instance, 9 by 6, or show it to each camera by itself";
            return refuse("board.together", detail.to_owned());
        }
        if !(board.square_m.is_finite() && board.square_m > 0.0) {
            return refuse(
                "board.square_m",
                format!("{} is no length: give metres, for instance 0.03", board.square_m),
            );
        }
        if file.camera.iter().all(|c| c.board.is_none()) {
            return refuse("camera: board", "is named by no camera: give each its images of it".to_owned());
        }
    }
    Ok(())
}
