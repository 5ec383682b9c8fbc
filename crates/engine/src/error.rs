//! What ends a run.

use mavsight_flight::FlightError;
use mavsight_identify::IdentifyError;
use mavsight_pipeline::PipelineError;
use mavsight_session::SessionError;
use thiserror::Error;

/// A session that could not be carried through. Each message names the place and the remedy.
#[derive(Debug, Error)]
pub enum EngineError {
    /// A file that the session names holds something wrong.
    #[error(transparent)]
    Input(SessionError),
    /// A recording that cannot be read, or a result that cannot be written.
    #[error(transparent)]
    File(#[from] SessionError),
    /// A model or a setting of the identification that is wrong, whatever the flight.
    #[error(transparent)]
    Setting(IdentifyError),
    /// A vehicle or inputs that are not valid.
    #[error(transparent)]
    Vehicle(#[from] FlightError),
    /// A camera that sees too few control balls to be calibrated before its flight, by which it could be.
    #[error(
        "{camera}: only {found} of {wanted} control balls were found in the still (missing: {missing}): at least 6 are needed, as a flight that is still to come cannot calibrate it; move the camera or the balls until 6 are in the image; if they are, check their colours or click on them (`mavsight pick`); or film a flight, name its recordings in `video`, calibrate by it (`mavsight calibrate`) and name the rig.toml in `[rig]`"
    )]
    BeforeFlight {
        /// Camera name.
        camera: String,
        /// Balls found.
        found: usize,
        /// Balls in the table.
        wanted: usize,
        /// Names of those not found.
        missing: String,
    },
    /// Calibration, tracking or identification failed.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
}

impl EngineError {
    /// Whether the error lies in what the caller gave, and not in the flight.
    pub fn is_of_the_input(&self) -> bool {
        matches!(self, Self::Input(_) | Self::Setting(_))
    }
}

/// Marks an error of a file that the session names.
pub(crate) fn input<T>(loaded: Result<T, SessionError>) -> Result<T, EngineError> {
    loaded.map_err(EngineError::Input)
}
