//! From poses to motion, and from motion and inputs to parameters.

use crate::{PipelineError, Progress, Stage, Tracked};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::{CoefficientTable, Identification, Options, coefficients, identify};
use mavsight_pose::{
    BodyMarker, Motion, PoseError, PoseEstimator, PoseSample, RefinedMarkers, Rig, refine_markers, smooth,
};

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

/// Refines the marker positions from what was tracked, and estimates the poses anew with them; `ruler_std_m` is the
/// standard deviation of a coordinate in the vehicle file.
///
/// # Errors
/// Too few frames with a pose, or a standard deviation that is not above zero.
pub fn refine_body(
    tracked: &mut Tracked,
    rig: &Rig,
    vehicle: &Vehicle,
    ruler_std_m: f64,
) -> Result<RefinedMarkers, PipelineError> {
    let failed = |source| PipelineError::Pose { place: "marker positions".into(), source };
    let body = body_markers(vehicle);
    let refined = refine_markers(&tracked.observations, rig, &body, ruler_std_m).map_err(failed)?;
    let estimator = PoseEstimator::refined(rig, &refined).map_err(failed)?;
    poses_anew(estimator, tracked).map_err(failed)?;
    Ok(refined)
}

/// Estimates all poses again with what the first estimates have shown of the centres' lasting errors.
pub(crate) fn poses_anew(estimator: PoseEstimator, tracked: &mut Tracked) -> Result<(), PoseError> {
    let bias_px = estimator.centre_bias_px(&tracked.observations, &tracked.poses)?;
    let estimator = estimator.with_centre_bias(bias_px)?;
    let mut previous = None;
    let mut rest = tracked.observations.as_slice();
    for pose in &mut tracked.poses {
        let own = rest.iter().take_while(|o| o.t_ns == pose.t_ns).count();
        let (seen, later) = rest.split_at(own);
        rest = later;
        *pose = crate::track::pose_at(&estimator, pose.t_ns, seen, previous.as_ref());
        previous = pose.estimate.as_ref().map(|e| e.world_from_body).or(previous);
    }
    Ok(())
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
