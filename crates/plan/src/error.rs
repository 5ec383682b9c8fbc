//! What cannot be planned, and what to do about it.

use mavsight_identify::IdentifyError;
use mavsight_pose::PoseError;
use mavsight_session::SessionError;
use mavsight_simulator::SimulatorError;
use std::path::PathBuf;
use thiserror::Error;

/// A plan that cannot be made.
#[derive(Debug, Error)]
pub enum PlanError {
    /// A value of the room file that makes no sense.
    #[error("{key}: {detail}")]
    Value {
        /// Key concerned.
        key: String,
        /// Reason and remedy.
        detail: String,
    },
    /// A room file with such a value.
    #[error("{}: {source}", path.display())]
    Room {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: Box<PlanError>,
    },
    /// A file that cannot be read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Nowhere to stand.
    #[error(
        "no place for a camera is left of the {looked_at} that were looked at, {step_m} m apart: enlarge a [[stand]] box, or take away a [[keep_out]] or [[block]] box"
    )]
    NoPlace {
        /// Grid points.
        looked_at: usize,
        /// Their distance.
        step_m: f64,
    },
    /// No placement that was tried shows all that must be seen.
    #[error(
        "none of {tried} placements of {cameras} cameras meets all limits; the best sees every marker by two cameras in {seen_percent:.0} % of the volume and {limit}: make the volume smaller, add cameras or places, or take a wider lens"
    )]
    NothingSeen {
        /// Placements.
        tried: usize,
        /// Cameras.
        cameras: usize,
        /// Of the best.
        seen_percent: f64,
        /// Reason.
        limit: String,
    },
    /// A flight that the cameras do not see.
    #[error(
        "at {t_s:.2} s, at ({:.2}, {:.2}, {:.2}) m, some marker is not seen by two cameras: make the volume smaller or place the cameras for it",
        at_m[0], at_m[1], at_m[2]
    )]
    OutOfView {
        /// When.
        t_s: f64,
        /// Where.
        at_m: [f64; 3],
    },
    /// The estimator's own refusal.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// A flight that cannot be simulated.
    #[error(transparent)]
    Flight(#[from] SimulatorError),
    /// A flight that determines nothing.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
}

impl PlanError {
    /// Refuses the value of a key unless it is right; `detail` says what is wrong and what to do.
    pub(crate) fn unless(
        is_right: bool,
        key: impl Into<String>,
        detail: impl FnOnce() -> String,
    ) -> Result<(), Self> {
        if is_right { Ok(()) } else { Err(Self::value(key, detail())) }
    }

    pub(crate) fn value(key: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::Value { key: key.into(), detail: detail.into() }
    }
}
