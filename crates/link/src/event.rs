//! What a user sees of a running flight, as JSON: one object an event, whose kind `event` names.
//!
//! Positions are metres in world axes, quaternions (w, x, y, z), angles radians, times seconds since the
//! flight began unless a name says otherwise. Newline JSON and the browser page carry the same objects.

use serde::Serialize;

/// One event.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// What stands still; the first that a listener gets.
    Scene(Scene),
    /// One instant.
    Pose(Box<PoseEvent>),
    /// The balls that one camera detected in one frame.
    Detections {
        /// Index into the scene's cameras.
        camera: usize,
        /// Instant.
        t_s: f64,
        /// Balls.
        seen: Vec<DetectedBall>,
    },
    /// How a camera does; about once a second, and whenever its state changes.
    Camera {
        /// Index into the scene's cameras.
        camera: usize,
        /// State of the camera.
        state: CameraState,
        /// Frames a second over the last second.
        rate_hz: f64,
        /// Median time from frame in hand to its detections, over the last second.
        latency_ms: f64,
        /// Frames that never came, by gaps of its time stamps, since the start.
        missing: u64,
        /// Frames dropped because a later one had come, since the start.
        dropped: u64,
        /// For each marker the share of the last second's frames in which it was seen.
        markers: Vec<f64>,
        /// Why it is in this state, and what to do.
        reason: Option<String>,
    },
    /// Parameters by recursive least squares so far.
    Parameters {
        /// Instant.
        t_s: f64,
        /// One each.
        parameters: Vec<Parameter>,
        /// Whether all have been seen as exactly as was asked for.
        enough: bool,
    },
    /// Whether a recording is being written, and how much of it is on the disk itself, so that neither a kill
    /// nor a power cut takes it.
    Recording {
        /// Where; none where none is being written.
        folder: Option<String>,
        /// From the first instant of which a pose, or that there was none, was sent, to the last that is whole:
        /// frames, detections, inputs and what was sent.
        seconds: f64,
        /// Bytes of frames, detections, inputs and events.
        bytes: u64,
        /// What went wrong, such as a full disk.
        fault: Option<String>,
    },
    /// The answer to a self-check or calibration that was asked for, or anything else that a user should
    /// read.
    Note {
        /// Instant.
        t_s: f64,
        /// Whether it is a fault.
        fault: bool,
        /// Sentence.
        text: String,
    },
}

/// One instant of the flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PoseEvent {
    /// Instant, seconds since the flight began.
    pub t_s: f64,
    /// Counts instants.
    pub sequence: u64,
    /// Middle of the exposure, nanoseconds of the UNIX epoch.
    pub captured_ns: i64,
    /// Whether a pose was measured; what follows is empty where not.
    pub valid: bool,
    /// Where tracking stands.
    pub tracking: Tracking,
    /// Position.
    pub position_m: Option<[f64; 3]>,
    /// Attitude `world_from_body`, (w, x, y, z).
    pub attitude: Option<[f64; 4]>,
    /// Roll, pitch, yaw.
    pub euler_rad: Option<[f64; 3]>,
    /// Upper triangle by rows of the 6×6 covariance: position in world axes, then turn about body axes.
    pub covariance: Option<[f64; 21]>,
    /// u, v, w by the causal filter, and standard deviations.
    pub velocity_in_body_m_s: Option<[f64; 3]>,
    /// Their standard deviations.
    pub velocity_std_m_s: Option<[f64; 3]>,
    /// p, q, r by the causal filter.
    pub rates_rad_s: Option<[f64; 3]>,
    /// Their standard deviations.
    pub rates_std_rad_s: Option<[f64; 3]>,
    /// Root mean square residual.
    pub residual_px: Option<f64>,
    /// From the frame in hand to the pose.
    pub latency_ms: f64,
    /// Why there is no pose.
    pub reason: Option<String>,
}

/// What stands still.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scene {
    /// Name of the session.
    pub name: String,
    /// Cameras, in the order of their indices.
    pub cameras: Vec<CameraView>,
    /// Markers, in the order of their indices.
    pub markers: Vec<MarkerView>,
    /// Lowest and highest corner of the calibrated volume.
    pub volume_m: [[f64; 3]; 2],
}

/// One camera of the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraView {
    /// Name of the camera.
    pub name: String,
    /// Image.
    pub width_px: u32,
    /// Image.
    pub height_px: u32,
    /// Where it stands.
    pub centre_m: [f64; 3],
    /// Directions in world axes, of unit length in depth, of the image's corners: left top, right top, right
    /// bottom, left bottom.
    pub corners: [[f64; 3]; 4],
}

/// One marker of the vehicle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MarkerView {
    /// Name of the marker.
    pub name: String,
    /// Colour, 0-255.
    pub rgb: [u8; 3],
    /// Where it is in body axes.
    pub in_body_m: [f64; 3],
    /// Diameter.
    pub diameter_m: f64,
}

/// One ball in one image.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DetectedBall {
    /// Centre.
    pub u_px: f64,
    /// Centre.
    pub v_px: f64,
    /// Diameter.
    pub diameter_px: f64,
    /// The marker that it shows, where it is identified.
    pub marker: Option<usize>,
    /// What the pose leaves of it: seen less projected.
    pub residual_px: Option<[f64; 2]>,
}

/// One parameter so far.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Name, as in `parameters.csv`.
    pub name: String,
    /// Estimate; none where it is not determined yet.
    pub value: Option<f64>,
    /// Half width of the 95 % interval.
    pub half_width: Option<f64>,
    /// Whether that is as small as was asked for.
    pub enough: bool,
}

/// Where tracking stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Tracking {
    /// The aircraft has not been seen yet.
    #[default]
    Acquiring,
    /// It is being followed.
    Tracking,
    /// It was followed and is not now.
    Lost,
    /// It has been found again; for one second, then tracking.
    Reacquired,
}

/// State of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraState {
    /// Opened, no frame yet.
    Starting,
    /// Frames come.
    Running,
    /// No frame for two intervals.
    Stalled,
    /// The source has ended or could not be opened; it is being opened again.
    Gone,
    /// The body is shifted in the image: the camera is left out.
    Moved,
    /// Its balls stand still while the body moves: it is left out.
    Frozen,
    /// It sees next to nothing.
    Dark,
}
