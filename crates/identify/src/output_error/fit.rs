//! The iteration of an output-error fit, and its result.

use super::colour::Colour;
use super::condense::Linear;
use super::covariance::{Covariance, correlation_lag};
use super::determined::{refuse_undetermined, typical_sizes};
use super::fitter::{Fitter, LONGEST_STEP_S, PROMISE, Recorded, TIGHTNESS};
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::options::{NoiseModel, OutputErrorOptions};
use super::result::{DerivedQuantity, FittedParameter, OutputErrorFit, SystematicErrors};
use super::start::begin;
use crate::inverse::inverse;
use crate::{IdentifyError, student_quantile_975};
use mavsight_flight::InputSeries;
use mavsight_model::{Derived, Unit};
use nalgebra::{DMatrix, DVector};

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
    if model.free().is_empty() {
        return Err(IdentifyError::NothingFree);
    }
    measurements.check()?;
    let inputs = &model.inputs_of(inputs)?;
    assemble(&solve(model, Recorded { inputs, measurements }, options)?)
}

/// The fitted point, and the flight about it in rows of unit variance as far as `colour` explains them.
pub(super) struct Solved<'a> {
    pub(super) fitter: Fitter<'a>,
    pub(super) linear: Linear,
    pub(super) colour: Option<Colour>,
}

/// Finds the fit to measurements that are in order; inputs are those that the model reads.
pub(super) fn solve<'a>(
    model: &FlightModel,
    recorded: Recorded<'a>,
    options: &OutputErrorOptions,
) -> Result<Solved<'a>, IdentifyError> {
    let measurements = recorded.measurements;
    let mut fitter = Fitter::new(model, begin(model, recorded, options.segment_s)?, recorded, options)?;
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
    let white = fitter.linearised(tightness)?;
    refuse_undetermined(&fitter, &white)?;
    if !fitter.converged {
        return Err(fitter.not_converged(tightness));
    }
    let channels = measurements.channels().len();
    let correlated = options.noise == NoiseModel::Scaled && correlation_lag(&white, channels) > 0;
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

pub(super) fn assemble(solved: &Solved<'_>) -> Result<OutputErrorFit, IdentifyError> {
    let Solved { fitter, linear, colour } = solved;
    let colour = colour.as_ref();
    let problem = &fitter.problem;
    let channels = problem.measurements.channels();
    let p = fitter.free().len();
    let known = Covariance::new(linear, p, channels.len())?;
    let bound = known.bound;
    let mut covariance = no_less_than(&bound, &known.coloured);
    if let Some(uneven) = &known.uneven {
        covariance = no_less_than(&covariance, uneven);
    }
    let degrees = linear.places.len().saturating_sub(p + linear.tangent).max(1);
    let t = student_quantile_975(degrees);
    let sizes = typical_sizes(fitter);
    let fitted = |(k, parameter): (usize, &ModelParameter)| {
        let (value, std) = (fitter.point.model.value(*parameter), covariance[(k, k)].sqrt());
        FittedParameter {
            parameter: *parameter,
            name: fitter.point.model.name(*parameter).to_owned(),
            unit: fitter.point.model.unit(*parameter),
            value,
            std,
            bound_std: bound[(k, k)].sqrt(),
            ci_low: value - t * std,
            ci_high: value + t * std,
            identifiable: t * std < sizes[k],
        }
    };
    let parameters: Vec<FittedParameter> = fitter.free().iter().enumerate().map(fitted).collect();
    let derived = derived(fitter, &covariance, t);
    let largest_gap_m = fitter.at.gaps().map(|gap| gap.rows(0, 3).norm()).fold(0.0, f64::max);
    let variances = colour.map(|c| c.variances().collect::<Vec<f64>>());
    let factor = |(k, w): (usize, &f64)| w.powi(-2) * variances.as_ref().map_or(1.0, |v| v[k]);
    let factors = problem.weights.iter().enumerate().map(factor);
    let systematic = colour.map(|c| SystematicErrors { extent: c.extent(), share: c.correlated_share });
    let notes = notes(&parameters, systematic, known.lag, known.uneven.is_some());
    Ok(OutputErrorFit {
        parameters,
        covariance,
        derived,
        variance_factors: channels.into_iter().zip(factors).collect(),
        systematic,
        correlated_instants: known.lag,
        reduced_chi_square: linear.residuals().norm_squared() / degrees as f64,
        iterations: fitter.iterations,
        largest_gap_m,
        held_out: None,
        notes,
    })
}

/// Derived quantities with intervals of so many standard deviations, from the covariance of the estimates.
fn derived(fitter: &Fitter<'_>, covariance: &DMatrix<f64>, t: f64) -> Vec<DerivedQuantity> {
    let (model, places) = (&fitter.point.model, &fitter.problem.equations.places);
    let by = fitter.problem.equations.dynamics.free();
    let values = model.model().derived_values(model.values(), by);
    let own = covariance.select_rows(places).select_columns(places);
    let quantity = |(d, (value, slopes)): (&Derived, (f64, Vec<f64>))| {
        let slopes = DVector::from_vec(slopes);
        let std = slopes.dot(&(&own * &slopes)).max(0.0).sqrt();
        let unit = d.unit.filter(|unit| *unit != Unit::ONE).map_or_else(String::new, |unit| unit.to_string());
        let (ci_low, ci_high) = (value - t * std, value + t * std);
        DerivedQuantity { name: d.name.clone(), unit, value, std, ci_low, ci_high }
    };
    let all = model.model().derived.iter().zip(values).map(quantity);
    all.filter(|d| d.value.is_finite() && d.std > 0.0 && d.std.is_finite()).collect()
}

/// The corrected covariance with no variance below its bound.
fn no_less_than(bound: &DMatrix<f64>, coloured: &DMatrix<f64>) -> DMatrix<f64> {
    let stretch = bound.diagonal().zip_map(&coloured.diagonal(), |b, c| (c / b).max(1.0).sqrt());
    bound.component_mul(&(&stretch * stretch.transpose()))
}

fn notes(
    parameters: &[FittedParameter],
    systematic: Option<SystematicErrors>,
    lag: usize,
    uneven: bool,
) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(p) = parameters.iter().find(|p| p.parameter == ModelParameter::InputLag)
        && (p.ci_low > 0.0 || p.ci_high < 0.0)
    {
        let (what, size) = if p.value > 0.0 { ("late", p.value) } else { ("early", -p.value) };
        out.push(format!(
            "The inputs act {:.1} ± {:.1} ms {what} by the clock of the measurements, which is more than chance: the fit allows for it, but check the clocks.",
            1e3 * size,
            1e3 * p.std
        ));
    }
    if let Some(errors) = systematic {
        out.push(format!(
            "{:.0} % of the measurements' variance is correlated over about {}: a slow effect is missing from the model or the measurements; weights and standard deviations allow for it.",
            100.0 * errors.share, errors.extent
        ));
    }
    if lag > 0 {
        out.push(format!(
            "Residuals are correlated over {lag} instants for which no model was found; standard deviations allow for it."
        ));
    }
    if uneven {
        out.push(
            "Residuals are larger at some times than at others; standard deviations allow for it.".to_owned(),
        );
    }
    let vague: Vec<&str> = parameters.iter().filter(|p| !p.identifiable).map(|p| p.name.as_str()).collect();
    if !vague.is_empty() {
        out.push(format!("The flight hardly determines {}.", vague.join(", ")));
    }
    out
}
