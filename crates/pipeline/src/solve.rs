//! From poses to motion, and from motion and inputs to parameters.

use crate::{PipelineError, Progress, Stage};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::{CoefficientTable, Identification, Options, coefficients, identify};
use mavsight_pose::{BodyMarker, Motion, PoseSample, smooth};

/// Motion, coefficients and parameters of one flight.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Smoothed motion.
    pub motion: Motion,
    /// Coefficients and regressors.
    pub coefficients: CoefficientTable,
    /// Fits.
    pub identification: Identification,
}

/// The vehicle's markers as the pose estimator wants them.
pub fn body_markers(vehicle: &Vehicle) -> Vec<BodyMarker> {
    crate::track::body_markers_of(vehicle)
}

/// Smooths the poses into motion.
///
/// # Errors
/// Too few measured poses.
pub fn motion_from_poses(
    poses: &[PoseSample],
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Motion, PipelineError> {
    progress.begin(Stage::Smooth, None);
    smooth(poses, vehicle.environment.gravity_m_s2)
        .map_err(|source| PipelineError::Pose { place: "smoothing".into(), source })
}

/// Forms the coefficients and fits the model.
///
/// # Errors
/// Inputs that do not cover the flight, or a fit without a determined answer.
pub fn identify_motion(
    motion: Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Solution, PipelineError> {
    progress.begin(Stage::Identify, None);
    let table = coefficients(&motion, inputs, vehicle, &Options::default())?;
    let identification = identify(&table)?;
    Ok(Solution { motion, coefficients: table, identification })
}
