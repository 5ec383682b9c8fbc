//! From poses to motion, and from motion and inputs to parameters.

use crate::{PipelineError, Progress, Stage};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::{
    Clocks, CoefficientTable, FitOptions, Identification, Options, choose_structure, coefficients, delayed,
    estimate_lag, identify_with,
};
use mavsight_pose::{BodyMarker, Motion, PoseSample, smooth};

/// What a user may choose of identification.
#[derive(Debug, Clone, Default)]
pub struct IdentifyOptions {
    /// Model, low-pass and window.
    pub table: Options,
    /// Estimators, band and what is held out.
    pub fit: FitOptions,
    /// What is to be added to the inputs' times; estimated where it is not given.
    pub lag_s: Option<f64>,
    /// Whether the regressors of each output are chosen from the model's by PRESS.
    pub stepwise: bool,
}

/// Motion, coefficients and parameters of one flight.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Smoothed motion.
    pub motion: Motion,
    /// Coefficients and regressors.
    pub coefficients: CoefficientTable,
    /// Fits.
    pub identification: Identification,
    /// The lag between inputs and motion.
    pub clocks: Clocks,
    /// The inputs as they were fitted, with their clock set right.
    pub inputs: InputSeries,
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

/// Sets the inputs' clock right, forms the coefficients and fits the model.
///
/// A lag is searched as far as the margin that fits leave out at either end, over which the inputs' ends are held.
///
/// # Errors
/// Inputs that do not cover the flight, a model with an unknown signal, or a fit without a determined answer.
pub fn identify_motion(
    motion: Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    options: &IdentifyOptions,
    progress: &dyn Progress,
) -> Result<Solution, PipelineError> {
    progress.begin(Stage::Identify, None);
    let clocks = match options.lag_s {
        Some(lag_s) => Clocks::Known(lag_s),
        None => estimate_lag(&motion, inputs, vehicle, &options.table, options.table.margin_s)?,
    };
    let inputs = match clocks.correction_s() {
        0.0 => inputs.clone(),
        lag_s => delayed(inputs, lag_s)?,
    };
    let mut table = coefficients(&motion, &inputs, vehicle, &options.table)?;
    if options.stepwise {
        table = choose_structure(&table)?.0;
    }
    let identification = identify_with(&table, &options.fit)?;
    Ok(Solution { motion, coefficients: table, identification, clocks, inputs })
}
