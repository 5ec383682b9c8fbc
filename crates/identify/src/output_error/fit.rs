//! The iteration of an output-error fit, and its result.

use super::assemble::{Solved, assemble};
use super::colour::Colour;
use super::condense::Linear;
use super::covariance::correlation_lag;
use super::determined::refuse_undetermined;
use super::fitter::{Fitter, LONGEST_STEP_S, PROMISE, Recorded, TIGHTNESS};
use super::measure::Measurements;
use super::model::FlightModel;
use super::options::{NoiseModel, OutputErrorOptions};
use super::result::OutputErrorFit;
use crate::IdentifyError;
use crate::inverse::inverse;
use mavsight_flight::InputSeries;

/// The fit ends when the predicted decrease of the squares is below this: a hundredth of a standard
/// deviation.
const LAST_PROMISE: f64 = 1e-4;
const RELAXATIONS: usize = 8;
/// Variance factors that change by less have converged.
const FACTOR_CHANGE: f64 = 0.01;

/// Fits the free parameters of a model, the start of the flight and the noise level to the measurements.
///
/// Inputs hold from sample to sample; measurements lie at increasing times, with gaps as they come. Initial
/// position, attitude, velocity and rates are always estimated.
///
/// # Errors
/// Nothing free; inputs that do not cover the measurements; measurements that are not finite, not in order or
/// too few; parameters that the flight does not determine, by name; no convergence.
pub fn output_error(
    model: &FlightModel,
    inputs: &InputSeries,
    measurements: &Measurements,
    options: &OutputErrorOptions,
) -> Result<OutputErrorFit, IdentifyError> {
    let inputs = &model.inputs_of(inputs)?;
    assemble(&solve(model, Recorded { inputs, measurements }, options)?)
}

/// Finds the fit to measurements that are in order; inputs are those that the model reads.
pub(super) fn solve<'a>(
    model: &FlightModel,
    recorded: Recorded<'a>,
    options: &OutputErrorOptions,
) -> Result<Solved<'a>, IdentifyError> {
    let mut fitter = Fitter::begin(model, recorded, options)?;
    fitter.close_gaps()?;
    let tightness = TIGHTNESS[3];
    if options.noise == NoiseModel::Scaled {
        for _ in 0..RELAXATIONS {
            if fitter.rescale(tightness)? < FACTOR_CHANGE || fitter.limit.too_long_s().is_some() {
                break;
            }
            fitter.converge(tightness, PROMISE[3]);
        }
    }
    fitter.stage(false, LONGEST_STEP_S[1])?;
    fitter.converge(tightness, LAST_PROMISE);
    let white = fitter.linearised(tightness)?;
    refuse_undetermined(&fitter, &white)?;
    if !fitter.converged {
        return Err(fitter.not_converged(tightness));
    }
    let series = fitter.problem.measurements.series();
    let correlated = options.noise == NoiseModel::Scaled
        && series.iter().any(|channels| correlation_lag(&white, channels) > 0);
    let coloured = if correlated { fitter.weigh_colour(white.clone(), tightness)? } else { None };
    let (linear, colour) = coloured.map_or((white, None), |(linear, colour)| (linear, Some(colour)));
    Ok(Solved { fitter, linear, colour })
}

impl Fitter<'_> {
    /// Moves to the fit with weights for correlated errors, which it finds first: Gauss-Newton steps of the
    /// whole flight.
    ///
    /// None, and nothing moved, where they do not converge: the fit with weights for white errors then
    /// stands.
    fn weigh_colour(
        &mut self,
        white: Linear,
        tightness: f64,
    ) -> Result<Option<(Linear, Colour)>, IdentifyError> {
        let colour = Colour::find(&white, self.problem.weights.len())?;
        let start = self.point.clone();
        let mut linear = white;
        for _ in 0..RELAXATIONS {
            let whitened = colour.whitened(&linear);
            let information = whitened.information();
            let covariance = inverse(&information).ok_or(IdentifyError::RankZero)?;
            let step = whitened.step(&covariance);
            if step.dot(&(&information * &step)) < LAST_PROMISE {
                return Ok(Some((whitened, colour)));
            }
            let trial = self.point.moved(&step.push(-1.0), &self.condensed(tightness, 0.0)?.starts);
            if !trial.model.is_physical() {
                break;
            }
            self.point = trial;
            self.iterations += 1;
            let Ok(at) = self.problem.evaluate(&self.point) else { break };
            self.at = at;
            linear = self.linearised(tightness)?;
        }
        self.point = start;
        self.at = self.problem.evaluate(&self.point)?;
        Ok(None)
    }
}
