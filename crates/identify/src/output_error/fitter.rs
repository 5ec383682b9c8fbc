//! State of an output-error fit.

use super::condense::{Condensed, Penalty};
use super::linear::Linear;
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::options::{InitialFlapping, OutputErrorOptions};
use super::propagate::TANGENT;
use super::shooting::{Evaluation, Point, Shooting};
use crate::IdentifyError;
use crate::inverse::inverse;
use mavsight_flight::{Coefficient, InputSeries, StateVector};
use nalgebra::DVector;

/// Tightness of the gaps: loose enough for any start, then far below what is measured. With the last one a
/// gap costs less than 1e-9 m.
pub(super) const TIGHTNESS: [f64; 4] = [3e-2, 3e-3, 1e-4, 1e-7];
/// A stage ends when the predicted decrease of the squares is below this.
pub(super) const PROMISE: [f64; 4] = [100.0, 100.0, 10.0, 0.1];
/// Claimed noise is not believed to be more than a hundred times too large: exact data would drive the
/// weights up for ever.
const LEAST_VARIANCE_FACTOR: f64 = 1e-4;
/// The longest step of the integration on the way, and at the end, where it is below a micrometre of error
/// over ten seconds.
pub(super) const LONGEST_STEP_S: [f64; 2] = [0.01, 0.005];
/// As if each channel had so many more residuals of the mean size: a marker that a camera hardly sees gets no
/// weight that its few residuals cannot bear.
const MORE_RESIDUALS: f64 = 10.0;
/// Standard deviation of the flapping angles at the start in trim, and free.
const TRIM_STD_RAD: f64 = 1e-6;
const FREE_STD_RAD: f64 = 0.2;
/// Without poses, position and heading are conventions: they are held at the start by these.
const GAUGE_STD: f64 = 1e-4;

pub(crate) struct Fitter<'a> {
    pub(crate) start: FlightModel,
    pub(crate) problem: Shooting<'a>,
    pub(crate) point: Point,
    pub(crate) at: Evaluation,
    pub(crate) iterations: usize,
    pub(crate) converged: bool,
    pub(super) promise: f64,
    pub(super) limit: usize,
}

/// Where the iteration begins.
pub(super) struct Begin {
    pub(super) model: FlightModel,
    /// States with which the segments begin, each with its instant.
    pub(super) nodes: Vec<(usize, StateVector)>,
}

/// What was recorded of a flight.
#[derive(Clone, Copy)]
pub(super) struct Recorded<'a> {
    pub(super) inputs: &'a InputSeries,
    pub(super) measurements: &'a Measurements,
}

impl<'a> Fitter<'a> {
    /// A fit that begins at given values; `start` has the values before the fit.
    pub(super) fn new(
        start: &FlightModel,
        begin: Begin,
        recorded: Recorded<'a>,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let (Begin { model, nodes }, Recorded { inputs, measurements }) = (begin, recorded);
        let times_s = measurements.times_s();
        let (mut bounds, mut starts): (Vec<usize>, Vec<StateVector>) = nodes.into_iter().unzip();
        bounds.push(times_s.len());
        inputs.require(times_s[times_s.len() - 1] - model.input_lag_s)?;
        let input = inputs.require(times_s[bounds[0]] - model.input_lag_s)?;
        let kb = model.coefficients.get(Coefficient::SwashplateGain);
        starts[0][13..].copy_from_slice(&[kb * input.delta_lon_rad, kb * input.delta_lat_rad, 0.0, 0.0]);
        let mut prior_weights = [0.0; TANGENT];
        prior_weights[12..].fill(match options.initial_flapping {
            InitialFlapping::Trim => TRIM_STD_RAD.recip(),
            InitialFlapping::Free => FREE_STD_RAD.recip(),
        });
        if measurements.poses().is_empty() {
            [0, 1, 2, 5].into_iter().for_each(|k| prior_weights[k] = GAUGE_STD.recip());
        }
        let problem = Shooting {
            inputs: inputs.samples(),
            measurements,
            hold_times: false,
            longest_step_s: LONGEST_STEP_S[0],
            weights: vec![1.0; measurements.channels().len()],
            times_s,
            bounds,
            prior_weights,
            prior_start: starts[0],
        };
        let point = Point { model, nuisances: DVector::zeros(measurements.nuisances()), starts };
        let at = problem.evaluate(&point)?;
        let (rows, unknown) = (at.places.len(), point.model.free().len() + TANGENT);
        if rows <= unknown {
            return Err(IdentifyError::TooFewInstants { found: rows, parameters: unknown });
        }
        let (start, limit) = (start.clone(), options.max_iterations);
        Ok(Self { start, problem, point, at, iterations: 0, converged: false, promise: f64::INFINITY, limit })
    }

    pub(crate) fn condensed(&self, tightness: f64, damping: f64) -> Result<Condensed, IdentifyError> {
        Condensed::new(&self.at, Penalty { tightness, damping })
    }

    pub(super) fn stage(&mut self, hold_times: bool, longest_step_s: f64) -> Result<(), IdentifyError> {
        self.problem.hold_times = hold_times;
        self.problem.longest_step_s = longest_step_s;
        self.at = self.problem.evaluate(&self.point)?;
        Ok(())
    }

    /// Weighs each channel by its residuals; the largest relative change of a variance.
    pub(super) fn rescale(&mut self, tightness: f64) -> Result<f64, IdentifyError> {
        let mut channels = vec![(0.0, 0.0); self.problem.weights.len()];
        for (place, residual) in self.at.places.iter().zip(self.at.residuals()) {
            channels[place.channel].0 += residual * residual;
            channels[place.channel].1 += 1.0;
        }
        let rows = self.at.places.len() as f64;
        let free = 1.0 - self.effective_parameters(tightness)? / rows;
        let mean = channels.iter().map(|c| c.0).sum::<f64>() / (rows * free);
        let mut change: f64 = 0.0;
        let seen = self.problem.weights.iter_mut().zip(channels).filter(|(_, (_, count))| *count > 0.0);
        for (weight, (squares, count)) in seen {
            let factor = (squares / free + MORE_RESIDUALS * mean) / (count + MORE_RESIDUALS);
            let variance = (factor / (*weight * *weight)).max(LEAST_VARIANCE_FACTOR);
            change = change.max((variance * *weight * *weight - 1.0).abs());
            *weight = 1.0 / variance.sqrt();
        }
        self.at = self.problem.evaluate(&self.point)?;
        Ok(change)
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

    pub(super) fn not_converged(&self, tightness: f64) -> IdentifyError {
        let (iterations, promise) = (self.iterations, self.promise);
        IdentifyError::FitNotConverged { iterations, squares: self.at.merit(tightness), promise }
    }

    /// The free parameters.
    pub(crate) fn free(&self) -> &[ModelParameter] {
        self.point.model.free()
    }
}
