//! From a converged output-error fit to its result.

use super::colour::Colour;
use super::covariance::Covariance;
use super::determined::typical;
use super::fitter::Fitter;
use super::linear::Linear;
use super::model::ModelParameter;
use super::propagate::TANGENT;
use super::result::{ChannelResiduals, FittedParameter, FittedState, OutputErrorFit, SystematicErrors};
use super::row::pose_of;
use crate::{IdentifyError, correlations, student_quantile_975};
use mavsight_flight::{FlapState, StateVector};
use mavsight_geometry::Vector3;
use nalgebra::DMatrix;

/// `linear` is the flight about the fitted point, in rows of unit variance as far as `colour` explains them.
pub(crate) fn assemble(
    fitter: &Fitter<'_>,
    linear: &Linear,
    colour: Option<&Colour>,
) -> Result<OutputErrorFit, IdentifyError> {
    let problem = &fitter.problem;
    let channels = problem.measurements.channels();
    let p = fitter.free().len();
    let known = Covariance::new(linear, p, channels.len())?;
    let bound = known.bound.view((TANGENT, TANGENT), (p, p)).into_owned();
    let mut covariance = no_less_than(&bound, &known.coloured);
    if let Some(uneven) = &known.uneven {
        covariance = no_less_than(&covariance, uneven);
    }
    let degrees = linear.places.len().saturating_sub(p + TANGENT).max(1);
    let t = student_quantile_975(degrees);
    let fitted = |(k, parameter): (usize, &ModelParameter)| {
        let (value, std) = (fitter.point.model.value(*parameter), covariance[(k, k)].sqrt());
        FittedParameter {
            parameter: *parameter,
            name: parameter.name(),
            value,
            std,
            bound_std: bound[(k, k)].sqrt(),
            ci_low: value - t * std,
            ci_high: value + t * std,
            identifiable: t * std < typical(*parameter, fitter),
        }
    };
    let parameters: Vec<FittedParameter> = fitter.free().iter().enumerate().map(fitted).collect();
    let trajectory: Vec<FittedState> = (problem.bounds[0]..problem.times_s.len())
        .map(|i| fitted_state(problem.times_s[i], &fitter.at.states[i]))
        .collect();
    let largest_gap_m = fitter.at.gaps().map(|gap| gap.fixed_rows::<3>(0).norm()).fold(0.0, f64::max);
    let mut factors: Vec<f64> = problem.weights.iter().map(|w| w.powi(-2)).collect();
    for (factor, variance) in factors.iter_mut().zip(colour.iter().flat_map(|c| c.variances())) {
        *factor *= variance;
    }
    let systematic = colour.map(|c| SystematicErrors { extent: c.extent(), share: c.correlated_share });
    let notes = notes(&parameters, systematic, known.lag, known.uneven.is_some());
    Ok(OutputErrorFit {
        parameters,
        correlation: correlations(&covariance),
        covariance,
        residuals: residuals(linear, &channels),
        variance_factors: channels.into_iter().zip(factors).collect(),
        systematic,
        correlated_instants: known.lag,
        reduced_chi_square: linear.residuals().norm_squared() / degrees as f64,
        iterations: fitter.iterations,
        converged: fitter.converged,
        initial_state: trajectory[0],
        initial_covariance: known.bound.view((0, 0), (TANGENT, TANGENT)).into_owned(),
        trajectory,
        nuisances: fitter.point.nuisances.iter().copied().collect(),
        largest_gap_m,
        held_out: None,
        notes,
    })
}

/// The corrected covariance with no variance below its bound.
fn no_less_than(bound: &DMatrix<f64>, coloured: &DMatrix<f64>) -> DMatrix<f64> {
    let stretch = bound.diagonal().zip_map(&coloured.diagonal(), |b, c| (c / b).max(1.0).sqrt());
    bound.component_mul(&(&stretch * stretch.transpose()))
}

fn fitted_state(t_s: f64, y: &StateVector) -> FittedState {
    FittedState {
        t_s,
        world_from_body: pose_of(y),
        velocity_in_body_m_s: Vector3::new(y[7], y[8], y[9]),
        rates_rad_s: Vector3::new(y[10], y[11], y[12]),
        flap: FlapState { alpha_l_rad: y[13], beta_l_rad: y[14], alpha_f_rad: y[15], beta_f_rad: y[16] },
    }
}

fn residuals(linear: &Linear, channels: &[String]) -> Vec<ChannelResiduals> {
    let all = linear.residuals();
    let of_channel = |(channel, name): (usize, &String)| {
        let own = linear.places.iter().zip(&all).filter(|(place, _)| place.channel == channel);
        let (instants, series): (Vec<usize>, Vec<f64>) = own.map(|(place, r)| (place.instant, *r)).unzip();
        let (count, n) = (series.len(), series.len() as f64);
        let squares: f64 = series.iter().map(|r| r * r).sum();
        let pairs = instants.windows(2).zip(series.windows(2)).filter(|(i, _)| i[1] == i[0] + 1);
        let products: f64 = pairs.map(|(_, r)| r[0] * r[1]).sum();
        (count > 0).then(|| ChannelResiduals {
            name: name.clone(),
            count,
            mean: series.iter().sum::<f64>() / n,
            rms: (squares / n).sqrt(),
            autocorrelation: if squares > 0.0 { products / squares } else { 0.0 },
        })
    };
    channels.iter().enumerate().filter_map(of_channel).collect()
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
    let vague: Vec<&str> = parameters.iter().filter(|p| !p.identifiable).map(|p| p.name).collect();
    if !vague.is_empty() {
        out.push(format!("The flight hardly determines {}.", vague.join(", ")));
    }
    out
}
