//! The iteration of an output-error fit.

use super::colour::Colour;
use super::condense::Condensed;
use super::covariance::{self, inverse};
use super::determined::refuse_undetermined;
use super::linear::Linear;
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::propagate::TANGENT;
use super::result::{OutputErrorFit, assemble};
use super::shooting::{Evaluation, Point, Problem, Record, moved_point};
use super::start::nodes;
use crate::IdentifyError;
use mavsight_flight::{Coefficient, InputSeries, StateVector};
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
    /// As right but for one factor for each channel, which the residuals tell: x, y, z, ..., or u and v of each marker in
    /// each camera.
    Scaled,
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
            max_iterations: 200,
        }
    }
}

/// Tightness of the gaps: loose enough for any start, then far below what is measured. With the last one a gap costs
/// less than 1e-9 m.
pub(super) const TIGHTNESS: [f64; 4] = [3e-2, 3e-3, 1e-4, 1e-7];
/// A stage ends when the next step promises less than this of the squares.
pub(super) const PROMISE: [f64; 4] = [100.0, 100.0, 10.0, 0.1];
/// The fit ends when the next step promises less than this: a hundredth of a standard deviation.
const LAST_PROMISE: f64 = 1e-4;
/// Claimed noise is not believed to be more than a hundred times too large: exact data would drive the weights up for ever.
const LEAST_VARIANCE_FACTOR: f64 = 1e-4;
/// The longest step of the integration on the way, and at the end, where it is below a micrometre of error over ten seconds.
pub(super) const LONGEST_STEP_S: [f64; 2] = [0.01, 0.005];
/// As if each channel had so many more residuals of the mean size: a marker that a camera hardly sees gets no weight that
/// its few residuals cannot bear.
const MORE_RESIDUALS: f64 = 10.0;
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
    pub(super) promise: f64,
    pub(super) limit: usize,
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
    let tightness = TIGHTNESS[3];
    for (tightness, promise) in TIGHTNESS.into_iter().zip(PROMISE) {
        fitter.stage(tightness == TIGHTNESS[0], LONGEST_STEP_S[0])?;
        fitter.converge(tightness, promise);
    }
    if options.noise == NoiseModel::Scaled {
        for _ in 0..RELAXATIONS {
            if fitter.rescale(tightness)? < FACTOR_CHANGE {
                break;
            }
            fitter.converge(tightness, PROMISE[3]);
        }
    }
    fitter.stage(false, LONGEST_STEP_S[1])?;
    fitter.converge(tightness, LAST_PROMISE);
    let (condensed, records) = fitter.linearised(tightness)?;
    refuse_undetermined(&fitter, &condensed, &records)?;
    if !fitter.converged {
        return Err(fitter.not_converged(tightness));
    }
    let white = Linear::new(&fitter, &condensed, &records);
    let channels = measurements.channels().len();
    let lasting = options.noise == NoiseModel::Scaled && covariance::correlation_lag(&white, channels) > 0;
    let coloured = if lasting { fitter.weigh_colour(white.clone(), tightness)? } else { None };
    let (linear, colour) = coloured.map_or((white, None), |(linear, colour)| (linear, Some(colour)));
    assemble(&fitter, &linear, colour.as_ref())
}

impl<'a> Fitter<'a> {
    pub(super) fn new(
        start: &FlightModel,
        inputs: &'a InputSeries,
        measurements: &'a Measurements,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let segment_s = if options.segment_s > 0.0 { options.segment_s } else { f64::INFINITY };
        let (model, nodes) = nodes(start, inputs, measurements, segment_s)?;
        Self::at((start, model), nodes, (inputs, measurements), options)
    }

    /// At a model and at states with which the segments begin, each with its instant.
    pub(super) fn at(
        (start, model): (&FlightModel, FlightModel),
        nodes: Vec<(usize, StateVector)>,
        (inputs, measurements): (&'a InputSeries, &'a Measurements),
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let times_s = measurements.times_s();
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
        let channels = measurements.channels().len();
        let mut problem = Problem {
            inputs: inputs.samples(),
            measurements,
            hold_times: false,
            longest_step_s: LONGEST_STEP_S[0],
            weights: vec![1.0; channels],
            times_s,
            bounds,
            nuisance_gram: DMatrix::zeros(k, k),
            prior_information,
            prior_start,
        };
        let point = Point { model: model.clone(), nuisances: DVector::zeros(k), starts };
        let at = problem.evaluate(&point, None)?;
        let rows: usize = at.channel_squares.iter().map(|g| g.1).sum();
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

    pub(super) fn stage(&mut self, hold_times: bool, longest_step_s: f64) -> Result<(), IdentifyError> {
        self.problem.hold_times = hold_times;
        self.problem.longest_step_s = longest_step_s;
        self.at = self.problem.evaluate(&self.point, None)?;
        Ok(())
    }

    /// Weighs each channel by its residuals; the largest relative change of a variance.
    fn rescale(&mut self, tightness: f64) -> Result<f64, IdentifyError> {
        let used = covariance::effective_parameters(&self.condensed(tightness, 0.0)?, &self.point);
        let rows: usize = self.at.channel_squares.iter().map(|g| g.1).sum();
        let free = 1.0 - used / rows as f64;
        let mean = self.at.chi_square / (rows as f64 * free);
        let mut change: f64 = 0.0;
        for (weight, (squares, count)) in self.problem.weights.iter_mut().zip(&self.at.channel_squares) {
            if *count == 0 {
                continue;
            }
            let factor = (squares / free + MORE_RESIDUALS * mean) / (*count as f64 + MORE_RESIDUALS);
            let variance = (factor / (*weight * *weight)).max(LEAST_VARIANCE_FACTOR);
            change = change.max((variance * *weight * *weight - 1.0).abs());
            *weight = 1.0 / variance.sqrt();
        }
        self.problem.update_nuisance_gram(&self.at.states)?;
        self.at = self.problem.evaluate(&self.point, None)?;
        Ok(change)
    }

    pub(super) fn linearised(&self, tightness: f64) -> Result<(Condensed, Vec<Record>), IdentifyError> {
        let condensed = self.condensed(tightness, 0.0)?;
        let mut records = Vec::new();
        self.problem.evaluate(&self.point, Some(&mut records))?;
        Ok((condensed, records))
    }

    /// Moves to the fit with weights for errors that last, which it finds first: Gauss-Newton steps of the whole flight.
    ///
    /// None, and nothing moved, where they do not settle: the fit with weights for white errors then stands.
    fn weigh_colour(
        &mut self,
        white: Linear,
        tightness: f64,
    ) -> Result<Option<(Linear, Colour)>, IdentifyError> {
        let colour = Colour::find(&white, &self.problem.times_s, self.problem.weights.len())?;
        let start = self.point.clone();
        let mut linear = white;
        for _ in 0..RELAXATIONS {
            let whitened = colour.whitened(&linear, &self.problem.times_s);
            let information = whitened.information();
            let covariance = inverse(&information).ok_or(IdentifyError::RankZero)?;
            let step = whitened.step(&covariance);
            if step.dot(&(&information * &step)) < LAST_PROMISE {
                return Ok(Some((whitened, colour)));
            }
            let starts = self.condensed(tightness, 0.0)?.expand(&self.at, &step, 1.0);
            let trial = moved_point(&self.point, &step, &starts);
            if !trial.model.is_physical() {
                break;
            }
            self.point = trial;
            self.iterations += 1;
            let Ok(at) = self.problem.evaluate(&self.point, None) else { break };
            self.at = at;
            let (condensed, records) = self.linearised(tightness)?;
            linear = Linear::new(self, &condensed, &records);
        }
        self.point = start;
        self.at = self.problem.evaluate(&self.point, None)?;
        Ok(None)
    }

    pub(super) fn not_converged(&self, tightness: f64) -> IdentifyError {
        let (iterations, promise) = (self.iterations, self.promise);
        IdentifyError::FitNotConverged { iterations, squares: self.at.merit(tightness), promise }
    }

    /// The free parameters.
    pub(crate) fn free(&self) -> &[ModelParameter] {
        self.point.model.free()
    }
}
