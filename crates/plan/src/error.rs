//! What cannot be planned, and what to do about it.

use mavsight_pose::PoseError;
use thiserror::Error;

/// A plan that cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlanError {
    /// A value of the room file that makes no sense.
    #[error("{key}: {detail}")]
    Value {
        /// Key concerned.
        key: String,
        /// What is wrong and what to do.
        detail: String,
    },
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
        /// What fails there.
        limit: String,
    },
    /// The estimator's own refusal.
    #[error(transparent)]
    Pose(#[from] PoseError),
}

impl PlanError {
    pub(crate) fn value(key: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::Value { key: key.into(), detail: detail.into() }
    }
}
