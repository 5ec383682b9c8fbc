//! From poses to motion, and from motion and inputs to parameters.

use crate::tracked::Tracked;
use crate::{PipelineError, Progress, Stage};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::output_error::{MotionFits, fitted_stretch_s};
use mavsight_identify::{
    Clocks, CoefficientTable, FitOptions, Identification, IdentifyError, Options, SignalErrors,
    choose_structure, coefficients, delayed, estimate_lag, identify_with,
};
use mavsight_pose::{EffectsOf, Motion, PoseSample, RateSeries, smooth_with_effects, smooth_with_rates};
use nalgebra::Matrix6xX;
use std::cell::RefCell;
use std::time::Duration;

/// What a user may choose of identification.
#[derive(Debug, Clone, Default)]
pub struct IdentifyOptions {
    /// Equations, low-pass and window.
    pub table: Options,
    /// Estimators, band and what is held out.
    pub fit: FitOptions,
    /// What is to be added to the inputs' times; estimated where it is not given.
    pub lag_s: Option<f64>,
    /// Whether the regressors of each output are chosen from the model's by PRESS.
    pub stepwise: bool,
    /// Whether output error searches the terms that the model's file marks as candidates.
    pub search: bool,
    /// Fits of the equations of motion.
    pub motion_fits: MotionFits,
    /// Time that each of these may take.
    pub at_most: Option<Duration>,
}

/// Coefficients and parameters of one flight.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Coefficients and regressors.
    pub coefficients: CoefficientTable,
    /// Fits.
    pub identification: Identification,
    /// The lag between inputs and motion.
    pub clocks: Clocks,
    /// The inputs as they were fitted, where their clock was set right.
    pub inputs: Option<InputSeries>,
}

/// Smooths the poses into motion, with the rates of a gyroscope where there are any.
///
/// # Errors
/// Too few measured poses; rates that contradict them.
pub fn motion_from_poses(
    poses: &[PoseSample],
    rates: Option<&RateSeries>,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Motion, PipelineError> {
    smoothed(poses, &|_| None, rates, vehicle, progress)
}

fn smoothed(
    poses: &[PoseSample],
    effects: EffectsOf<'_>,
    rates: Option<&RateSeries>,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Motion, PipelineError> {
    progress.begin(Stage::Smooth, None);
    let gravity_m_s2 = vehicle.environment.gravity_m_s2;
    let motion = match rates {
        Some(rates) => smooth_with_rates(poses, effects, rates, gravity_m_s2),
        None => smooth_with_effects(poses, effects, gravity_m_s2),
    };
    motion.map_err(|source| PipelineError::Pose { place: "smoothing".into(), source })
}

/// Smooths the poses of what was tracked; the systematic part of their errors is formed from the
/// observations as it is needed. With the rates of a gyroscope where there are any.
///
/// # Errors
/// Too few measured poses; rates that contradict them.
pub fn motion_of(
    tracked: &Tracked,
    rates: Option<&RateSeries>,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Motion, PipelineError> {
    if tracked.estimator.is_none() {
        return motion_from_poses(&tracked.poses, rates, vehicle, progress);
    }
    let of_cameras = systematic_effects(tracked);
    let effects = |k: usize| {
        let effects = of_cameras(k)?;
        let Some(displaced) = tracked.displacements.get(k) else { return Some(effects) };
        let at = effects.ncols();
        let mut effects = effects.insert_column(at, 0.0);
        effects.set_column(at, &displaced.map(f64::from));
        Some(effects)
    };
    smoothed(&tracked.poses, &effects, rates, vehicle, progress)
}

/// The effects of systematic errors of cameras and markers on the poses, by the pose's number, formed from the observations
/// when they are asked for.
fn systematic_effects(tracked: &Tracked) -> impl Fn(usize) -> Option<Matrix6xX<f64>> {
    let seen = RefCell::new(Vec::new());
    move |k| {
        let pose = &tracked.poses[k];
        let mut seen = seen.borrow_mut();
        tracked.observations.at(pose.t_ns, &mut seen);
        tracked.estimator.as_ref()?.systematic_effects(&seen, pose.estimate.as_ref().ok()?)
    }
}

/// How the systematic errors of poses are correlated, for output error: of those from which it is fitted, a
/// minute at most ([`fitted_stretch_s`]), their numbers and systematic columns.
///
/// Displacements of reordered frames are not among them. Output error solves for the size of each systematic error, and
/// those are made from the poses' own noise: it would find the noise in itself (errors in variables).
pub fn systematic_columns(tracked: &Tracked) -> Vec<(usize, Matrix6xX<f32>)> {
    let effects = systematic_effects(tracked);
    let stretch_s = fitted_stretch_s(&tracked.poses);
    let is_needed = |p: &PoseSample| {
        stretch_s.is_none_or(|(from_s, to_s)| (from_s..=to_s).contains(&(p.t_ns as f64 * 1e-9)))
    };
    let needed = tracked.poses.iter().enumerate().filter(|(_, p)| is_needed(p));
    needed.filter_map(|(k, _)| Some((k, effects(k)?.map(|v| v as f32)))).collect()
}

/// Sets the inputs' clock right, forms the coefficients and fits the model.
///
/// A lag is searched as far as the margin that fits leave out at either end, over which the inputs' ends
/// are held.
///
/// # Errors
/// Inputs that do not cover the flight, equations that are none, or a fit without a determined answer.
pub fn identify_motion(
    motion: &Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    options: &IdentifyOptions,
    progress: &dyn Progress,
) -> Result<Solution, PipelineError> {
    progress.begin(Stage::Identify, None);
    let clocks = match options.lag_s {
        Some(lag_s) if lag_s.abs() > inputs.end_s() - inputs.start_s() => {
            let must = "be shorter than the inputs' record, or nothing of it is left";
            return Err(IdentifyError::BadSetting { what: "the lag", value: lag_s, must }.into());
        }
        Some(lag_s) => Clocks::Known(lag_s),
        None => estimate_lag(motion, inputs, vehicle, &options.table, options.table.margin_s)?,
    };
    let moved = match clocks.correction_s() {
        0.0 => None,
        lag_s => Some(delayed(inputs, lag_s)?),
    };
    let inputs = moved.as_ref().unwrap_or(inputs);
    let mut whole: Option<CoefficientTable> = None;
    let mut identification = Identification::default();
    // One equation after the other: only its fits read the errors of its rows.
    for equation in options.table.by_equation(vehicle)? {
        let mut table = coefficients(motion, inputs, vehicle, &equation)?;
        if options.stepwise {
            table = choose_structure(&table)?.0;
        }
        identification.fits.extend(identify_with(&table, &options.fit)?.fits);
        for output in &mut table.outputs {
            (output.errors, output.once) = (SignalErrors::default(), Vec::new());
        }
        match &mut whole {
            Some(all) => {
                all.outputs.append(&mut table.outputs);
                all.not_excited.append(&mut table.not_excited);
            }
            None => whole = Some(table),
        }
    }
    let coefficients = whole.ok_or(IdentifyError::RankZero)?;
    Ok(Solution { coefficients, identification, clocks, inputs: moved })
}
