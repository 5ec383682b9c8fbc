//! The iteration of an output-error fit.

use super::covariance;
use super::determined::refuse_undetermined;
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::propagate::TANGENT;
use super::result::{OutputErrorFit, assemble};
use super::shooting::{Condensed, Evaluation, Point, Problem, moved_point};
use super::start::nodes;
use crate::IdentifyError;
use mavsight_flight::{Coefficient, InputSeries};
use nalgebra::{DMatrix, DVector};

/// What is known of the flapping angles at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InitialFlapping {
    /// The flight starts at rest: lower discs where the swash-plate holds them, fly-bar level.
    Trim,
    /// Anything a disc can do (a standard deviation of 0.2 rad).
    Free,
}

/// How the given covariances of the measurements are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseModel {
    /// As they are.
    Given,
    /// As right but for one factor for all positions, turns, velocities, rates, or pixels of a camera, which the
    /// residuals tell.
    Scaled,
    /// As right but for one factor for each channel: x, y, z, ..., or u and v of each marker in each camera.
    ScaledByChannel,
}

/// What a user may choose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputErrorOptions {
    /// Length of the segments; infinite for single shooting. A quarter of a second is short beside the time in which a
    /// small aircraft runs away, and a few of a camera's intervals.
    pub segment_s: f64,
    /// The start.
    pub initial_flapping: InitialFlapping,
    /// The weights.
    pub noise: NoiseModel,
    /// Steps in all.
    pub max_iterations: usize,
}

impl Default for OutputErrorOptions {
    fn default() -> Self {
        Self {
            segment_s: 0.25,
            initial_flapping: InitialFlapping::Trim,
            noise: NoiseModel::Scaled,
            max_iterations: 100,
        }
    }
}

/// Tightness of the gaps: loose enough for any start, then far below what is measured. With the last one a gap costs
/// less than 1e-9 m.
const TIGHTNESS: [f64; 4] = [3e-2, 3e-3, 1e-4, 1e-7];
/// A stage ends when the next step promises less than this of the squares: an intermediate one, the last one (a
/// hundredth of a standard deviation).
const PROMISE: [f64; 4] = [100.0, 100.0, 10.0, 1e-4];
/// Claimed noise is not believed to be more than a hundred times too large: exact data would drive the weights up for ever.
const LEAST_VARIANCE_FACTOR: f64 = 1e-4;
/// The longest step of the integration on the way, and at the end, where it is below a micrometre of error over ten seconds.
const LONGEST_STEP_S: [f64; 2] = [0.01, 0.005];
const RELAXATIONS: usize = 8;
/// Variance factors that change by less are settled.
const FACTOR_CHANGE: f64 = 0.01;
/// Standard deviation of the flapping angles at the start in trim, and free.
const FLAP_STD_RAD: [f64; 2] = [1e-6, 0.2];
/// Without poses, position and heading are conventions: they are held at the start by these.
const GAUGE_STD: f64 = 1e-4;

pub(crate) struct Fitter<'a> {
    pub(crate) start: FlightModel,
    pub(crate) problem: Problem<'a>,
    pub(crate) point: Point,
    pub(crate) at: Evaluation,
    pub(crate) iterations: usize,
    pub(crate) converged: bool,
    promise: f64,
    limit: usize,
}

/// Fits the free parameters of a model, the start of the flight and the noise level to the measurements.
///
/// Inputs hold from sample to sample; measurements lie at increasing times, with gaps as they come. Initial position,
/// attitude, velocity and rates are always estimated.
///
/// # Errors
/// Nothing free; inputs that do not cover the measurements; measurements that are not finite, not in order or too few;
/// parameters that the flight does not determine, by name; no convergence.
pub fn output_error(
    model: &FlightModel,
    inputs: &InputSeries,
    measurements: &Measurements,
    options: &OutputErrorOptions,
) -> Result<OutputErrorFit, IdentifyError> {
    if model.free().is_empty() {
        return Err(IdentifyError::NothingFree);
    }
    measurements.check()?;
    let mut fitter = Fitter::new(model, inputs, measurements, options)?;
    for (tightness, promise) in TIGHTNESS.into_iter().zip(PROMISE) {
        fitter.stage(tightness)?;
        fitter.converge(tightness, promise)?;
        if options.noise != NoiseModel::Given && tightness < TIGHTNESS[1] && tightness > TIGHTNESS[3] {
            fitter.rescale(tightness)?;
        }
    }
    let tightness = TIGHTNESS[3];
    if options.noise != NoiseModel::Given {
        for _ in 0..RELAXATIONS {
            fitter.converge(tightness, PROMISE[3])?;
            if fitter.rescale(tightness)? < FACTOR_CHANGE {
                break;
            }
        }
    }
    fitter.converge(tightness, PROMISE[3])?;
    let condensed = fitter.condensed(tightness, 0.0)?;
    let mut records = Vec::new();
    fitter.problem.evaluate(&fitter.point, Some(&mut records))?;
    refuse_undetermined(&fitter, &condensed, &records)?;
    if !fitter.converged {
        return Err(IdentifyError::NotConverged {
            iterations: fitter.iterations,
            squares: fitter.at.merit(tightness),
            promise: fitter.promise,
        });
    }
    assemble(&fitter, &condensed, &records)
}

impl<'a> Fitter<'a> {
    fn new(
        start: &FlightModel,
        inputs: &'a InputSeries,
        measurements: &'a Measurements,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let times_s = measurements.times_s();
        let segment_s = if options.segment_s > 0.0 { options.segment_s } else { f64::INFINITY };
        let (model, nodes) = nodes(start, inputs, measurements, segment_s)?;
        let mut bounds: Vec<usize> = nodes.iter().map(|(i, _)| *i).collect();
        bounds.push(times_s.len());
        for t_s in [times_s[bounds[0]], times_s[times_s.len() - 1]] {
            inputs.require(t_s - model.input_lag_s)?;
        }
        let mut starts: Vec<_> = nodes.into_iter().map(|(_, y)| y).collect();
        let mut prior_information = [0.0; TANGENT];
        let trim = options.initial_flapping == InitialFlapping::Trim;
        prior_information[12..].fill(FLAP_STD_RAD[usize::from(!trim)].powi(-2));
        if measurements.poses().is_empty() {
            for k in [0, 1, 2, 5] {
                prior_information[k] = GAUGE_STD.powi(-2);
            }
        }
        let input = inputs.require(times_s[bounds[0]] - model.input_lag_s)?;
        let kb = model.coefficients.get(Coefficient::SwashplateGain);
        let trimmed = [kb * input.delta_lon_rad, kb * input.delta_lat_rad, 0.0, 0.0];
        starts[0][13..].copy_from_slice(&trimmed);
        let prior_start = starts[0];
        let k = measurements.nuisances();
        let by_channel = options.noise == NoiseModel::ScaledByChannel;
        let groups = if by_channel { measurements.channels().len() } else { measurements.groups().len() };
        let mut problem = Problem {
            inputs: inputs.samples(),
            measurements,
            hold_times: false,
            longest_step_s: LONGEST_STEP_S[0],
            group_weight: vec![1.0; groups],
            by_channel,
            times_s,
            bounds,
            nuisance_gram: DMatrix::zeros(k, k),
            prior_information,
            prior_start,
        };
        let point = Point { model: model.clone(), nuisances: DVector::zeros(k), starts };
        let at = problem.evaluate(&point, None)?;
        let rows: usize = at.group_squares.iter().map(|g| g.1).sum();
        let unknown = model.free().len() + TANGENT;
        if rows <= unknown {
            return Err(IdentifyError::TooFewInstants { found: rows, parameters: unknown });
        }
        problem.update_nuisance_gram(&at.states)?;
        let limit = options.max_iterations;
        let start = start.clone();
        Ok(Self { start, problem, point, at, iterations: 0, converged: false, promise: f64::INFINITY, limit })
    }

    pub(crate) fn condensed(&self, tightness: f64, damping: f64) -> Result<Condensed, IdentifyError> {
        Condensed::new(&self.problem, &self.at, &self.point.nuisances, (tightness, damping))
    }

    /// Times are held in the first stage, and steps are fine in the last.
    fn stage(&mut self, tightness: f64) -> Result<(), IdentifyError> {
        self.problem.hold_times = tightness == TIGHTNESS[0];
        self.problem.longest_step_s = LONGEST_STEP_S[usize::from(tightness == TIGHTNESS[3])];
        self.at = self.problem.evaluate(&self.point, None)?;
        Ok(())
    }

    /// Gauss-Newton steps with the damping of Levenberg and Marquardt where one fails.
    fn converge(&mut self, tightness: f64, promised: f64) -> Result<(), IdentifyError> {
        let mut damping: f64 = 0.0;
        self.converged = false;
        while self.iterations < self.limit {
            self.iterations += 1;
            let stronger = (damping * 8.0).max(1e-3);
            let merit = self.at.merit(tightness);
            let Ok(condensed) = self.condensed(tightness, damping) else {
                damping = stronger;
                continue;
            };
            let Some((step, left)) = condensed.minimum() else {
                damping = stronger;
                continue;
            };
            self.promise = merit - left;
            let negligible = self.promise < promised.max(1e-9 * merit);
            if negligible && damping < 1e-3 {
                self.converged = true;
                break;
            }
            let starts = condensed.expand(&self.at, &step, 1.0);
            let trial = moved_point(&self.point, &step, &starts);
            let tried = if trial.model.is_physical() {
                self.problem.evaluate(&trial, None).ok().filter(|e| e.merit(tightness) <= merit)
            } else {
                None
            };
            if let Some(at) = tried {
                let kept = (merit - at.merit(tightness)) / self.promise;
                (self.point, self.at) = (trial, at);
                // What a step kept of its promise tells how far the quadratic model reaches (Marquardt 1963).
                damping *= if kept > 0.75 {
                    0.1
                } else if kept > 0.25 {
                    0.5
                } else {
                    2.0
                };
                if damping < 1e-3 {
                    damping = 0.0;
                }
            } else if negligible || damping > 1e8 {
                self.converged = negligible;
                break;
            } else {
                damping = stronger;
            }
        }
        Ok(())
    }

    /// Weighs each group by its residuals; the largest relative change of a variance.
    fn rescale(&mut self, tightness: f64) -> Result<f64, IdentifyError> {
        let used = covariance::effective_parameters(&self.condensed(tightness, 0.0)?, &self.point);
        let rows: usize = self.at.group_squares.iter().map(|g| g.1).sum();
        let free = 1.0 - used / rows as f64;
        let mut change: f64 = 0.0;
        for (weight, (squares, count)) in self.problem.group_weight.iter_mut().zip(&self.at.group_squares) {
            if *count == 0 {
                continue;
            }
            let factor = squares / (*count as f64 * free);
            let variance = (factor / (*weight * *weight)).max(LEAST_VARIANCE_FACTOR);
            change = change.max((variance * *weight * *weight - 1.0).abs());
            *weight = 1.0 / variance.sqrt();
        }
        self.problem.update_nuisance_gram(&self.at.states)?;
        self.at = self.problem.evaluate(&self.point, None)?;
        Ok(change)
    }

    /// The free parameters.
    pub(crate) fn free(&self) -> &[ModelParameter] {
        self.point.model.free()
    }
}
