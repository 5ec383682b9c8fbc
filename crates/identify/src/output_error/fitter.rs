//! State of an output-error fit, and its steps: down to the minimum along flights without gaps.

use super::condense::{Condensed, Linear, Penalty};
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::options::{InitialStates, OutputErrorOptions};
use super::shooting::{Evaluation, OPEN, ParameterPrior, Point, Shooting, gap_std};
use super::squares::Squares;
use super::start::begin;
use crate::IdentifyError;
use crate::inverse::inverse;
use mavsight_flight::{FlightError, InputSeries};
use mavsight_model::{FurtherState, RIGID_STATES, Start};
use nalgebra::DVector;
use std::time::{Duration, Instant};

/// Tightness of the gaps: loose enough for any start, then far below what is measured. With the last one a
/// gap costs less than 1e-9 m.
pub(super) const TIGHTNESS: [f64; 4] = [3e-2, 3e-3, 1e-4, 1e-7];
/// A stage ends when the predicted decrease of the squares is below this.
pub(super) const PROMISE: [f64; 4] = [100.0, 100.0, 10.0, 0.1];
/// Noise is not more than a hundred times smaller than claimed: exact data would drive weights up for ever.
const LEAST_VARIANCE_FACTOR: f64 = 1e-4;
/// The longest step of the integration on the way, and at the end: a micrometre of error over ten seconds.
pub(super) const LONGEST_STEP_S: [f64; 2] = [0.01, 0.005];
/// Residuals of the mean size that each channel has in addition: a few of its own bear no large weight.
const MORE_RESIDUALS: f64 = 10.0;
/// Standard deviation of a further state whose value at the start is known, over its usual excursion.
const KNOWN_SHARE: f64 = 5e-6;

/// Damping of a step that closes gaps and little else.
const RESTORING: f64 = 100.0;
/// Damping below this is none.
const LEAST_DAMPING: f64 = 1e-3;
const LARGEST_DAMPING: f64 = 1e8;

pub(crate) struct Fitter<'a> {
    pub(crate) start: FlightModel,
    pub(crate) problem: Shooting<'a>,
    pub(crate) point: Point,
    pub(crate) at: Evaluation,
    pub(crate) iterations: usize,
    pub(crate) converged: bool,
    pub(super) promise: f64,
    pub(super) limit: Limit,
}

/// When a fit ends without having converged.
#[derive(Clone, Copy)]
pub(super) struct Limit {
    iterations: usize,
    begun: Instant,
    at_most: Option<Duration>,
}

impl Limit {
    fn of(options: &OutputErrorOptions) -> Self {
        Self { iterations: options.max_iterations, begun: Instant::now(), at_most: options.at_most }
    }

    /// A first step always: without one nothing could be said of what hinders the fit.
    fn permits(&self, iterations: usize) -> bool {
        iterations < self.iterations && (iterations == 0 || self.too_long_s().is_none())
    }

    /// The time that the fit has taken, if it may take no more.
    pub(super) fn too_long_s(&self) -> Option<f64> {
        let taken = self.begun.elapsed();
        self.at_most.filter(|longest| taken >= *longest).map(|_| taken.as_secs_f64())
    }
}

pub(super) struct Begin {
    pub(super) model: FlightModel,
    /// States with which the segments begin, each with its instant.
    pub(super) nodes: Vec<(usize, Vec<f64>)>,
}

#[derive(Clone, Copy)]
pub(super) struct Recorded<'a> {
    pub(super) inputs: &'a InputSeries,
    pub(super) measurements: &'a Measurements,
}

/// Standard deviation of a further state at the beginning of what is fitted.
fn initial_std(state: &FurtherState, initial: InitialStates) -> f64 {
    match initial {
        InitialStates::AsModelled => state.initial_std.max(KNOWN_SHARE * state.size),
        InitialStates::Free => state.size,
    }
}

impl<'a> Fitter<'a> {
    /// A fit that begins at given values; `start` has the values before the fit. Inputs are those that the
    /// model reads, in its order.
    pub(super) fn new(
        start: &FlightModel,
        begin: Begin,
        recorded: Recorded<'a>,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let (Begin { model, nodes }, Recorded { inputs, measurements }) = (begin, recorded);
        let times_s = measurements.times_s();
        let (mut bounds, mut starts): (Vec<usize>, Vec<Vec<f64>>) = nodes.into_iter().unzip();
        bounds.push(times_s.len());
        inputs.require(times_s[times_s.len() - 1] - model.input_lag_s)?;
        let input = inputs.require(times_s[bounds[0]] - model.input_lag_s)?;
        starts[0][RIGID_STATES..].copy_from_slice(&model.model().initial(model.values(), input));
        let further = &model.model().states;
        let gap_std = gap_std(further);
        // Sensors do not show all of where a flight begins.
        let begins_open =
            |std: &f64| if measurements.are_of_sensors_alone() { (OPEN * std).recip() } else { 0.0 };
        let mut prior_weights: Vec<f64> = gap_std.iter().take(RIGID_STATES - 1).map(begins_open).collect();
        prior_weights.extend(further.iter().map(|state| initial_std(state, options.initial).recip()));
        let prior = |(place, std): (usize, f64)| {
            let value = start.value(start.free()[place]);
            ParameterPrior { place, value, std }
        };
        let problem = Shooting {
            inputs: inputs.clone(),
            equations: measurements.equations(&model),
            measurements,
            hold_nonlinear: false,
            longest_step_s: LONGEST_STEP_S[0],
            weights: vec![1.0; measurements.channels().len()],
            times_s,
            bounds,
            prior_weights,
            prior_start: starts[0].clone(),
            parameter_priors: start.priors().map(prior).collect(),
            gap_std,
            process_noise: DVector::zeros(starts[0].len() - 1),
        };
        let point = Point { model, nuisances: DVector::zeros(measurements.nuisances()), starts };
        let at = problem.evaluate(&point).map_err(|error| explained(error, &point, input))?;
        let (rows, unknown) = (at.places.len(), point.model.free().len() + problem.equations.tangent());
        if rows <= unknown {
            return Err(IdentifyError::TooFewInstants { found: rows, parameters: unknown });
        }
        let (start, limit) = (start.clone(), Limit::of(options));
        Ok(Self { start, problem, point, at, iterations: 0, converged: false, promise: f64::INFINITY, limit })
    }

    /// A fit of a model to what was recorded, its values and states still rough, in segments of a length.
    ///
    /// # Errors
    /// Nothing free; measurements that cannot be fitted; inputs that do not cover them.
    pub(super) fn begin(
        model: &FlightModel,
        recorded: Recorded<'a>,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        if model.free().is_empty() {
            return Err(IdentifyError::NothingFree);
        }
        recorded.measurements.check()?;
        Self::new(model, begin(model, recorded, options.segment_s)?, recorded, options)
    }

    /// Closes the gaps between segments step by step.
    pub(super) fn close_gaps(&mut self) -> Result<(), IdentifyError> {
        for (tightness, promise) in TIGHTNESS.into_iter().zip(PROMISE) {
            self.stage(tightness == TIGHTNESS[0], LONGEST_STEP_S[0])?;
            self.converge(tightness, promise);
        }
        Ok(())
    }

    pub(crate) fn condensed(&self, tightness: f64, damping: f64) -> Result<Condensed, IdentifyError> {
        Condensed::new(&self.at, Penalty { tightness, damping })
    }

    pub(super) fn stage(&mut self, hold_nonlinear: bool, longest_step_s: f64) -> Result<(), IdentifyError> {
        self.problem.hold_nonlinear = hold_nonlinear;
        self.problem.longest_step_s = longest_step_s;
        self.at = self.problem.evaluate(&self.point)?;
        Ok(())
    }

    /// Weighs each channel by its residuals; the largest relative change of a variance.
    pub(super) fn rescale(&mut self, tightness: f64) -> Result<f64, IdentifyError> {
        let rows = self.at.places.len() as f64;
        let free = 1.0 - self.effective_parameters(tightness)? / rows;
        let mut found = vec![Squares::default(); self.problem.weights.len()];
        for (place, residual) in self.at.places.iter().zip(self.at.residuals()) {
            found[place.channel].add(residual * residual, free);
        }
        let change = self.weigh(&found);
        self.at = self.problem.evaluate(&self.point)?;
        Ok(change)
    }

    /// Weighs each channel by the squares of its residuals; the largest relative change of a variance.
    pub(super) fn weigh(&mut self, found: &[Squares]) -> f64 {
        let mean = Squares::total(found).factor();
        let mut change: f64 = 0.0;
        for (weight, own) in self.problem.weights.iter_mut().zip(found).filter(|(_, own)| own.count > 0.0) {
            let factor = (own.factor() * own.count + MORE_RESIDUALS * mean) / (own.count + MORE_RESIDUALS);
            let variance = (factor / (*weight * *weight)).max(LEAST_VARIANCE_FACTOR);
            change = change.max((variance * *weight * *weight - 1.0).abs());
            *weight = 1.0 / variance.sqrt();
        }
        change
    }

    /// How many of the unknowns the measurements decide: all but what the nuisances' priors do.
    fn effective_parameters(&self, tightness: f64) -> Result<f64, IdentifyError> {
        let (all, k) = (self.condensed(tightness, 0.0)?.information(), self.point.nuisances.len());
        let undecided = inverse(&all).map_or(0.0, |c| c.diagonal().rows(all.nrows() - k, k).sum());
        Ok(all.nrows() as f64 - undecided)
    }

    pub(super) fn linearised(&self, tightness: f64) -> Result<Linear, IdentifyError> {
        Ok(Linear::new(&self.at, &self.condensed(tightness, 0.0)?))
    }

    pub(crate) fn free(&self) -> &[ModelParameter] {
        self.point.model.free()
    }

    /// Gauss-Newton steps with the damping of Levenberg and Marquardt where one fails.
    ///
    /// A step along the constraint opens the gaps by its square, which a tight penalty punishes: a step that
    /// raises the squares may stand (the watchdog of Chamberlain, Powell, Lemarechal & Pedersen 1982) if
    /// further ones, which close the gaps and hold the rest (the second-order correction of Fletcher 1982),
    /// each leave less than half of what was too much and end below the squares before.
    pub(super) fn converge(&mut self, tightness: f64, promised: f64) {
        let mut damping: f64 = 0.0;
        let mut watched: Option<Watched> = None;
        self.converged = false;
        while self.limit.permits(self.iterations) {
            self.iterations += 1;
            let merit = self.at.merit(tightness);
            let reference = watched.as_ref().map_or(merit, |w| w.merit);
            let enough = |merit: f64| promised.max(1e-9 * merit);
            let held = if watched.is_some() { RESTORING * damping.max(1.0) } else { damping };
            let tried = self.step(tightness, held);
            let negligible = tried.is_some() && self.promise < enough(merit);
            if negligible && watched.is_none() {
                // A damped step may promise little far from the minimum.
                let damped = self.promise;
                let whole = damping == 0.0 || self.step(tightness, 0.0).is_some();
                if whole && self.promise < enough(merit) {
                    self.converged = true;
                    break;
                }
                self.promise = damped;
            }
            let tried = tried.filter(|trial| trial.point.model.is_physical()).and_then(|t| self.fly(t).ok());
            match tried {
                Some((at, point)) if at.merit(tightness) <= reference => {
                    let promise = watched.take().map_or(self.promise, |w| w.promise);
                    damping = relaxed(damping, (reference - at.merit(tightness)) / promise);
                    (self.point, self.at) = (point, at);
                }
                Some((at, point)) if watched.is_none() && !self.has_process_noise() => {
                    let point = std::mem::replace(&mut self.point, point);
                    let at = std::mem::replace(&mut self.at, at);
                    watched = Some(Watched { point, at, merit, promise: self.promise });
                }
                Some((at, point)) if at.merit(tightness) - reference < 0.5 * (merit - reference) => {
                    (self.point, self.at) = (point, at);
                }
                _ => {
                    let negligible = watched.take().map_or(negligible, |w| {
                        (self.point, self.at) = (w.point, w.at);
                        w.promise < enough(w.merit)
                    });
                    if negligible || damping > LARGEST_DAMPING {
                        self.converged = negligible;
                        break;
                    }
                    damping = (damping * 8.0).max(LEAST_DAMPING);
                }
            }
        }
        if let Some(w) = watched {
            (self.point, self.at, self.promise) = (w.point, w.at, w.promise);
        }
    }

    fn has_process_noise(&self) -> bool {
        self.problem.process_noise.amax() > 0.0
    }

    /// Flies a trial. Process noise is fed back from where each segment ends, so that what has none remains
    /// closed however far the step (differential dynamic programming; Mayne 1966).
    fn fly(&self, trial: Trial) -> Result<(Evaluation, Point), IdentifyError> {
        let Trial { mut point, condensed, step } = trial;
        if !self.has_process_noise() {
            return Ok((self.problem.evaluate(&point)?, point));
        }
        let begin =
            |s: usize, end: &[f64], _: &[f64]| condensed.start_after(&step, s, end, &self.point.starts[s]);
        let (at, starts) = self.problem.fly(&point, begin)?;
        point.starts = starts;
        Ok((at, point))
    }

    /// The point after a step; `promise` becomes the predicted decrease of the squares.
    ///
    /// A parameter that would leave its bounds goes to its bound, and the others to where the squares are
    /// then least (an active set; Nocedal & Wright 2006, section 16.5).
    fn step(&mut self, tightness: f64, damping: f64) -> Option<Trial> {
        let condensed = self.condensed(tightness, damping).ok()?;
        let mut at_bound: Vec<(usize, f64)> = Vec::new();
        loop {
            let (step, left) = condensed.minimum(&at_bound)?;
            let beyond = self.point.beyond_bounds(&step, self.at.tangent);
            let more: Vec<(usize, f64)> =
                beyond.into_iter().filter(|(k, _)| at_bound.iter().all(|(own, _)| own != k)).collect();
            if more.is_empty() {
                self.promise = self.at.merit(tightness) - left;
                let point = self.point.moved(&step, &condensed.starts);
                return Some(Trial { point, condensed, step });
            }
            at_bound.extend(more);
        }
    }
}

/// A point to be flown.
struct Trial {
    point: Point,
    condensed: Condensed,
    step: DVector<f64>,
}

/// Why a flight runs away, where that shows at its start: what is not finite there.
fn explained(error: IdentifyError, point: &Point, inputs: &[f64]) -> IdentifyError {
    let IdentifyError::RanAway(_) = error else { return error };
    let start = Start { inputs: inputs.to_vec(), state: point.starts[0].clone() };
    let cause = point.model.model().check(point.model.values(), &start);
    cause.map_or_else(|cause| FlightError::ModelFile(cause).into(), |()| error)
}

/// Where a step began that has raised the squares.
struct Watched {
    point: Point,
    at: Evaluation,
    merit: f64,
    promise: f64,
}

/// The share of the predicted decrease that a step achieved shows how far the quadratic model holds
/// (Marquardt 1963).
fn relaxed(damping: f64, kept: f64) -> f64 {
    let factor = [(0.75, 0.1), (0.25, 0.5)].into_iter().find(|(bound, _)| kept > *bound);
    let next = damping * factor.map_or(2.0, |(_, factor)| factor);
    if next < LEAST_DAMPING { 0.0 } else { next }
}
