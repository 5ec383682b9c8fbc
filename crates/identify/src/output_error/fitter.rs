//! State of an output-error fit.

use super::condense::{Condensed, Penalty};
use super::inverse::inverse;
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::options::{InitialFlapping, OutputErrorOptions};
use super::propagate::TANGENT;
use super::shooting::{Evaluation, Point, Record, Shooting};
use super::start::nodes;
use crate::IdentifyError;
use mavsight_flight::{Coefficient, InputSeries, StateVector};
use nalgebra::{DMatrix, DVector};

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
const FLAP_STD_RAD: [f64; 2] = [1e-6, 0.2];
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
    pub(super) fn new(
        start: &FlightModel,
        inputs: &'a InputSeries,
        measurements: &'a Measurements,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let segment_s = if options.segment_s > 0.0 { options.segment_s } else { f64::INFINITY };
        let (model, nodes) = nodes(start, inputs, measurements, segment_s)?;
        Self::at(start, Begin { model, nodes }, Recorded { inputs, measurements }, options)
    }

    /// A fit that begins at given values; `start` has the values before the fit.
    pub(super) fn at(
        start: &FlightModel,
        begin: Begin,
        recorded: Recorded<'a>,
        options: &OutputErrorOptions,
    ) -> Result<Self, IdentifyError> {
        let (Begin { model, nodes }, Recorded { inputs, measurements }) = (begin, recorded);
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
        let mut problem = Shooting {
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
        Condensed::new(&self.problem, &self.at, &self.point.nuisances, Penalty { tightness, damping })
    }

    pub(super) fn stage(&mut self, hold_times: bool, longest_step_s: f64) -> Result<(), IdentifyError> {
        self.problem.hold_times = hold_times;
        self.problem.longest_step_s = longest_step_s;
        self.at = self.problem.evaluate(&self.point, None)?;
        Ok(())
    }

    /// Weighs each channel by its residuals; the largest relative change of a variance.
    pub(super) fn rescale(&mut self, tightness: f64) -> Result<f64, IdentifyError> {
        let used = effective_parameters(&self.condensed(tightness, 0.0)?, &self.point);
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

    pub(super) fn not_converged(&self, tightness: f64) -> IdentifyError {
        let (iterations, promise) = (self.iterations, self.promise);
        IdentifyError::FitNotConverged { iterations, squares: self.at.merit(tightness), promise }
    }

    /// The free parameters.
    pub(crate) fn free(&self) -> &[ModelParameter] {
        self.point.model.free()
    }
}

/// How many of the unknowns the measurements decide: all but what the nuisances' priors do.
fn effective_parameters(condensed: &Condensed, point: &Point) -> f64 {
    let decided = TANGENT + point.model.free().len();
    let k = point.nuisances.len();
    let undecided = inverse(&condensed.information())
        .map_or(0.0, |c| (0..k).map(|i| c[(decided + i, decided + i)]).sum::<f64>());
    (decided + k) as f64 - undecided
}
