//! What ends a run, with the place where it happened.

use thiserror::Error;

/// A chain that could not be carried through.
#[derive(Debug, Error)]
pub enum PipelineError {
    /// A source of frames failed.
    #[error("{camera}: {source}")]
    Source {
        /// Camera name.
        camera: String,
        /// What happened.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Seeing failed.
    #[error("{place}: {source}")]
    Vision {
        /// Camera or table concerned.
        place: String,
        /// What happened.
        source: mavsight_vision::VisionError,
    },
    /// Calibration, pose or smoothing failed.
    #[error("{place}: {source}")]
    Pose {
        /// Camera or stage concerned.
        place: String,
        /// What happened.
        source: mavsight_pose::PoseError,
    },
    /// The control points fit the mirrored image of a camera, and not the image.
    #[error(
        "{camera}: the control points fit its image only if that is mirrored, as by a selfie camera: mirror the image and the \
         recording back; with one camera it may be the table, whose x, y, z must be a right-handed frame with z up"
    )]
    MirroredImage {
        /// Camera.
        camera: String,
    },
    /// The control points fit the mirrored images of all cameras.
    #[error(
        "the control points fit the images of all cameras only if these are mirrored: the table's axes are left-handed; give x, y, z \
         of a right-handed frame with z up, in which y is left of x seen from above"
    )]
    LeftHandedTable,
    /// Identification failed.
    #[error("identification: {0}")]
    Identify(#[from] mavsight_identify::IdentifyError),
    /// A recording at other times than all others.
    #[error(
        "{camera} runs from {from_s:.3} s to {to_s:.3} s by its time stamps, when no other camera does: give time_offset_s of the cameras, or recordings of one flight"
    )]
    NoCommonTime {
        /// Camera name.
        camera: String,
        /// Its first frame.
        from_s: f64,
        /// Its last frame.
        to_s: f64,
    },
    /// Recordings that are not those of their cameras.
    #[error(
        "what the cameras saw {given} where any pose of the body has it, and lies {instead_px:.2} px from it {mistake}"
    )]
    MixedUp {
        /// What may have been done to them.
        causes: Vec<crate::Cause>,
        /// How far it lies from there.
        given: String,
        /// The same without the mistake.
        instead_px: f64,
        /// What was done to which recording, and what to do.
        mistake: String,
    },
    /// Two cameras with one recording.
    #[error("{camera} and {other} saw the same: give each camera its own recording")]
    SameRecording {
        /// Camera name.
        camera: String,
        /// The other's.
        other: String,
    },
    /// A camera delivered nothing.
    #[error("{camera} has no frames: check the recording")]
    NoFrames {
        /// Camera name.
        camera: String,
    },
    /// A camera whose time stamps lie closer together than frames can.
    #[error(
        "{camera}: frames are {interval_ns} ns apart by their time stamps, and at least {least_ns} ns are: the stamps are of another unit; give nanoseconds"
    )]
    StampsTooDense {
        /// Camera name.
        camera: String,
        /// Median interval.
        interval_ns: i64,
        /// The least of a camera.
        least_ns: i64,
    },
    /// A control table that is too short.
    #[error(
        "the control table has {found} points, but a calibration needs at least 6 that do not lie in one plane: survey more"
    )]
    ControlTable {
        /// Points in the table.
        found: usize,
    },
    /// A control ball that no colour matched.
    #[error(
        "{camera}: only {found} of {wanted} control balls were found in the still (missing: {missing}): at least 6 are needed; check the colours in the control table, or click on the balls (`mavsight pick`)"
    )]
    ControlBalls {
        /// Camera name.
        camera: String,
        /// Balls found.
        found: usize,
        /// Balls in the table.
        wanted: usize,
        /// Names of those not found.
        missing: String,
    },
    /// A board whose markers cannot be what is said of them.
    #[error("{key}: {detail}")]
    Board {
        /// Key of the session file.
        key: &'static str,
        /// What is wrong and what to do.
        detail: String,
    },
    /// A board that no image shows.
    #[error("{camera}: none of {frames} images shows {what}: check {check}")]
    NoBoard {
        /// Camera name.
        camera: String,
        /// Images looked at.
        frames: usize,
        /// What was looked for.
        what: String,
        /// What may be wrong.
        check: &'static str,
    },
    /// A worker thread ended without a result.
    #[error("{camera}: the tracking stage stopped unexpectedly: please report this with the recording")]
    Worker {
        /// Camera name.
        camera: String,
    },
}
