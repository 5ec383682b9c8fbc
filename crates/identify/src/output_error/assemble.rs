//! The result of a fit that has converged.

use super::colour::Colour;
use super::condense::Linear;
use super::contradicted::{Contradicted, Found};
use super::covariance::Covariance;
use super::determined::typical_sizes;
use super::filter::{NOISES, VELOCITY};
use super::fitter::Fitter;
use super::model::ModelParameter;
use super::result::{DerivedQuantity, FittedParameter, OutputErrorFit, SystematicErrors};
use crate::inverse::log_determinant;
use crate::{IdentifyError, student_quantile_975};
use mavsight_model::{Derived, Unit};
use nalgebra::{DMatrix, DVector};

/// The fitted point, and the flight about it in rows of unit variance as far as `colour` explains them.
pub(super) struct Solved<'a> {
    pub(super) fitter: Fitter<'a>,
    pub(super) linear: Linear,
    pub(super) colour: Option<Colour>,
}

/// What a fit says of its parameters.
pub(super) fn assemble(solved: &Solved<'_>) -> Result<OutputErrorFit, IdentifyError> {
    let Solved { fitter, linear, colour } = solved;
    let colour = colour.as_ref();
    let problem = &fitter.problem;
    let channels = problem.measurements.channels();
    let p = fitter.free().len();
    let Covariance { bound, coloured, uneven, lag, step } =
        Covariance::new(linear, fitter.free().len(), &problem.measurements.series())?;
    let mut covariance = no_less_than(&bound, &coloured);
    if let Some(uneven) = &uneven {
        covariance = no_less_than(&covariance, uneven);
    }
    let degrees = linear.places.len().saturating_sub(p + linear.tangent).max(1);
    let t = student_quantile_975(degrees);
    let sizes = typical_sizes(fitter);
    let found = Found { bound: &bound, covariance: &covariance, step: &step, sizes: &sizes };
    let contradicted = Contradicted::new(fitter, &found);
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
            identifiable: t * std < sizes[k] && !contradicted.stopped.contains(&k),
        }
    };
    let mut parameters: Vec<FittedParameter> = fitter.free().iter().enumerate().map(fitted).collect();
    let derived = derived(fitter, &covariance, t, &contradicted);
    let largest_gap_m = fitter.at.gaps().map(|gap| gap.rows(0, 3).norm()).fold(0.0, f64::max);
    let variances = colour.map(|c| c.variances().collect::<Vec<f64>>());
    let factor = |(k, w): (usize, &f64)| w.powi(-2) * variances.as_ref().map_or(1.0, |v| v[k]);
    let factors = problem.weights.iter().enumerate().map(factor);
    let systematic = colour.map(|c| SystematicErrors { extent: c.extent(), share: c.correlated_share });
    let process_noise = process_noise(fitter);
    let has_one_clock = problem.measurements.are_of_sensors_alone();
    let mut notes: Vec<String> = late(&parameters, has_one_clock).into_iter().collect();
    notes.extend(self::notes(&parameters, systematic, lag, uneven.is_some()));
    notes.extend(contradicted.words(&parameters, &derived));
    notes.extend(unmodelled(&process_noise));
    contradicted.withhold(&mut parameters);
    Ok(OutputErrorFit {
        parameters,
        covariance,
        derived,
        variance_factors: channels.into_iter().zip(factors).collect(),
        systematic,
        correlated_instants: lag,
        criterion: criterion(solved)?,
        reduced_chi_square: linear.residuals().norm_squared() / degrees as f64,
        iterations: fitter.iterations,
        largest_gap_m,
        process_noise,
        held_out: None,
        ahead: None,
        notes,
    })
}

/// Minus twice the logarithm of the restricted likelihood, with Schwarz' price of each number of the noise.
fn criterion(Solved { fitter, linear, colour }: &Solved<'_>) -> Result<f64, IdentifyError> {
    let weights = &fitter.problem.weights;
    let of_weights = linear.places.iter().map(|place| -2.0 * weights[place.channel].ln()).sum::<f64>();
    let squares = linear.rows.row(linear.unknowns()).norm_squared();
    let open = log_determinant(&linear.information()).ok_or(IdentifyError::RankZero)?;
    let numbers = colour.as_ref().map_or_else(|| process_noise(fitter).len(), Colour::numbers);
    Ok(of_weights
        + linear.log_variances
        + squares
        + open
        + numbers as f64 * (linear.places.len() as f64).ln())
}

/// Square roots of the densities of the process noise that was estimated.
fn process_noise(fitter: &Fitter<'_>) -> Vec<(String, f64)> {
    let densities = &fitter.problem.process_noise.rows(VELOCITY, NOISES.len());
    let found = NOISES.iter().zip(densities).filter(|(_, density)| **density > 0.0);
    found.map(|(name, density)| ((*name).to_owned(), density.sqrt())).collect()
}

/// What the model lacks, in words: a white density is that of the mean of a second.
fn unmodelled(process_noise: &[(String, f64)]) -> Option<String> {
    let part = |from: usize| {
        let roots = process_noise.iter().skip(from).take(3);
        roots.map(|(_, root)| format!("{root:.2e}")).collect::<Vec<_>>().join(", ")
    };
    (!process_noise.is_empty()).then(|| {
        format!(
            "What the model lacks comes to {} m/s² along x, y, z and {} rad/s² about them in the mean of a second; the \
             intervals allow for it as for white noise, not for what lasts, such as wind or a gust.",
            part(0),
            part(3)
        )
    })
}

/// Derived quantities with intervals of so many standard deviations, from the covariance of the estimates.
fn derived(
    fitter: &Fitter<'_>,
    covariance: &DMatrix<f64>,
    t: f64,
    contradicted: &Contradicted,
) -> Vec<DerivedQuantity> {
    let (model, places) = (&fitter.point.model, &fitter.problem.equations.places);
    let by = fitter.problem.equations.dynamics.free();
    let values = model.model().derived_values(model.values(), by);
    let own = covariance.select_rows(places).select_columns(places);
    let moves = contradicted.moves.select_rows(places);
    let quantity = |(d, (value, slopes)): (&Derived, (f64, Vec<f64>))| {
        let slopes = DVector::from_vec(slopes);
        let std = slopes.dot(&(&own * &slopes)).max(0.0).sqrt();
        let unit = d.unit.filter(|unit| *unit != Unit::ONE).map_or_else(String::new, |unit| unit.to_string());
        let (ci_low, ci_high) = (value - t * std, value + t * std);
        let identifiable = slopes.dot(&moves).abs() <= std;
        DerivedQuantity { name: d.name.clone(), unit, value, std, ci_low, ci_high, identifiable }
    };
    let all = model.model().derived.iter().zip(values).map(quantity);
    all.filter(|d| d.value.is_finite() && d.std > 0.0 && d.std.is_finite()).collect()
}

/// The corrected covariance with no variance below its bound.
fn no_less_than(bound: &DMatrix<f64>, coloured: &DMatrix<f64>) -> DMatrix<f64> {
    let stretch = bound.diagonal().zip_map(&coloured.diagonal(), |b, c| (c / b).max(1.0).sqrt());
    bound.component_mul(&(&stretch * stretch.transpose()))
}

/// A lag of the inputs that is more than chance, in words. A log alone has one clock. Up to first order a lag of an actuator and
/// a delay act alike, so that the one passes for the other.
fn late(parameters: &[FittedParameter], has_one_clock: bool) -> Option<String> {
    let lag = parameters.iter().find(|p| p.parameter == ModelParameter::InputLag);
    let p = lag.filter(|p| p.ci_low > 0.0 || p.ci_high < 0.0)?;
    let is_late = p.value > 0.0;
    let clocks = if has_one_clock { "" } else { ": check the clocks" };
    let actuators = if is_late {
        " It is no stand-in for a servo or motor that follows its input with a lag: give the model a state for that, or its \
         parameters are wrong."
    } else {
        ""
    };
    Some(format!(
        "The inputs act {:.1} ± {:.1} ms {} by the clock of the measurements, which is more than chance{clocks}. The fit allows for \
         clocks that differ and for a delay.{actuators}",
        1e3 * p.value.abs(),
        1e3 * p.std,
        if is_late { "late" } else { "early" }
    ))
}

fn notes(
    parameters: &[FittedParameter],
    systematic: Option<SystematicErrors>,
    lag: usize,
    uneven: bool,
) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(errors) = systematic {
        out.push(format!(
            "{:.0} % of the measurements' variance is correlated over about {}: a slow effect is missing from the model or the measurements; weights and standard deviations allow for the correlation, not for what the effect does to the parameters.",
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
