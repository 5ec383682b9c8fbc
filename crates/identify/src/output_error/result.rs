//! What an output-error fit found.

use super::colour::Colour;
use super::covariance::Covariance;
use super::determined::typical;
use super::fit::Fitter;
use super::linear::Linear;
use super::measure::pose_of;
use super::model::ModelParameter;
use super::prediction::Prediction;
use super::propagate::TANGENT;
use crate::{IdentifyError, student_quantile_975};
use mavsight_flight::{FlapState, StateVector};
use mavsight_geometry::{Isometry3, Vector3};
use nalgebra::DMatrix;

/// One estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// The parameter.
    pub parameter: ModelParameter,
    /// Its name.
    pub name: &'static str,
    /// Estimate.
    pub value: f64,
    /// Standard deviation: the Cramér-Rao bound, or what residuals that are still correlated, or larger at some times than at
    /// others, make of it where that is more.
    pub std: f64,
    /// The Cramér-Rao bound, for errors of the level and the duration found.
    pub bound_std: f64,
    /// 95 % interval, from.
    pub ci_low: f64,
    /// 95 % interval, to.
    pub ci_high: f64,
    /// Whether half the interval is less than the value itself, the value that the fit started from, or an effect of one
    /// hundredth of the weight (over the rotor's radius; per m/s, per 10 rad/s), whichever is the largest.
    pub identifiable: bool,
}

/// Residuals of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelResiduals {
    /// `x`, `turn_y`, `camera 0 red u` ...
    pub name: String,
    /// How many.
    pub count: usize,
    /// Mean of the whitened residuals: predictions one instant ahead where errors last.
    pub mean: f64,
    /// Root mean square of them: 1 where they are as large as weighed.
    pub rms: f64,
    /// Correlation of neighbours.
    pub autocorrelation: f64,
}

/// The fitted motion at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedState {
    /// Time.
    pub t_s: f64,
    /// Pose.
    pub world_from_body: Isometry3<f64>,
    /// u, v, w.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// Flapping.
    pub flap: FlapState,
}

/// Errors of the measurements that last: part of each channel's variance has the autocorrelation exp(-|x|/extent), x
/// time or the path of the marker's image, whichever is the more likely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LastingErrors {
    /// How long or how far they last.
    pub extent: Extent,
    /// Their share of the variance of all channels.
    pub share: f64,
}

/// How long or how far errors last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extent {
    /// A time, s: errors that change by themselves.
    Time(f64),
    /// A way in the image, px: errors that change with where a marker is, before what, and in which light.
    Path(f64),
}

impl std::fmt::Display for Extent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Time(s) => write!(f, "{s:.1} s"),
            Self::Path(px) => write!(f, "{px:.0} px of a marker's way"),
        }
    }
}

/// The answer of [`super::output_error`].
#[derive(Debug, Clone, PartialEq)]
pub struct OutputErrorFit {
    /// Free parameters in the order of the model.
    pub parameters: Vec<FittedParameter>,
    /// Their covariance, corrected where residuals are still correlated.
    pub covariance: DMatrix<f64>,
    /// Their correlation.
    pub correlation: DMatrix<f64>,
    /// Residuals by channel.
    pub residuals: Vec<ChannelResiduals>,
    /// Each channel with the factor by which its given variances were multiplied; see [`ChannelResiduals::name`].
    pub variance_factors: Vec<(String, f64)>,
    /// Errors of the measurements that last; none where residuals are white.
    pub lasting: Option<LastingErrors>,
    /// Instants over which residuals are correlated once `lasting` is allowed for; 0 for white ones.
    pub correlated_instants: usize,
    /// Weighted squares over redundancy.
    pub reduced_chi_square: f64,
    /// Steps taken.
    pub iterations: usize,
    /// Whether the last step promised nothing more. A fit that has not converged is refused, so this is always true.
    pub converged: bool,
    /// Where the flight began.
    pub initial_state: FittedState,
    /// Covariance of that: position (world), turn (body), velocity (body), rates, alpha_l, beta_l, alpha_f, beta_f.
    pub initial_covariance: DMatrix<f64>,
    /// Motion at the times of measurement, from the first with a pose.
    pub trajectory: Vec<FittedState>,
    /// Nuisances in units of their prior standard deviation.
    pub nuisances: Vec<f64>,
    /// Largest distance between the end of one segment and the start of the next, m.
    pub largest_gap_m: f64,
    /// How it predicts what was held out of the fit.
    pub held_out: Option<Prediction>,
    /// What a user should know, in sentences.
    pub notes: Vec<String>,
}

impl OutputErrorFit {
    /// The estimate of a name.
    pub fn parameter(&self, name: &str) -> Option<&FittedParameter> {
        self.parameters.iter().find(|p| p.name == name)
    }
}

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
    let degrees = linear.residual.len().saturating_sub(p + TANGENT).max(1);
    let t = student_quantile_975(degrees);
    let parameters = fitter
        .free()
        .iter()
        .enumerate()
        .map(|(k, parameter)| {
            let (value, std) = (fitter.point.model.value(*parameter), covariance[(k, k)].sqrt());
            let scale = typical(*parameter, fitter);
            FittedParameter {
                parameter: *parameter,
                name: parameter.name(),
                value,
                std,
                bound_std: bound[(k, k)].sqrt(),
                ci_low: value - t * std,
                ci_high: value + t * std,
                identifiable: t * std < scale,
            }
        })
        .collect::<Vec<_>>();
    let correlation =
        DMatrix::from_fn(p, p, |i, j| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt());
    let trajectory: Vec<FittedState> = (problem.bounds[0]..problem.times_s.len())
        .map(|i| fitted_state(problem.times_s[i], &fitter.at.states[i]))
        .collect();
    let mut factors: Vec<f64> = problem.weights.iter().map(|w| w.powi(-2)).collect();
    for (factor, variance) in factors.iter_mut().zip(colour.iter().flat_map(|c| c.variances())) {
        *factor *= variance;
    }
    let lasting = colour.map(|c| LastingErrors { extent: c.extent(), share: c.lasting_share });
    let notes = notes(&parameters, lasting, known.lag, known.uneven.is_some());
    Ok(OutputErrorFit {
        parameters,
        covariance,
        correlation,
        residuals: residuals(linear, &channels),
        variance_factors: channels.into_iter().zip(factors).collect(),
        lasting,
        correlated_instants: known.lag,
        reduced_chi_square: linear.residual.norm_squared() / degrees as f64,
        iterations: fitter.iterations,
        converged: fitter.converged,
        initial_state: trajectory[0],
        initial_covariance: known.bound.view((0, 0), (TANGENT, TANGENT)).into_owned(),
        trajectory,
        nuisances: fitter.point.nuisances.iter().copied().collect(),
        largest_gap_m: fitter
            .at
            .segments
            .iter()
            .map(|s| Vector3::new(s.gap[0], s.gap[1], s.gap[2]).norm())
            .fold(0.0, f64::max),
        held_out: None,
        notes,
    })
}

/// The corrected covariance with no variance below its bound.
fn no_less_than(bound: &DMatrix<f64>, coloured: &DMatrix<f64>) -> DMatrix<f64> {
    let p = bound.nrows();
    let stretch: Vec<f64> = (0..p).map(|k| (coloured[(k, k)] / bound[(k, k)]).max(1.0).sqrt()).collect();
    DMatrix::from_fn(p, p, |i, j| bound[(i, j)] * stretch[i] * stretch[j])
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
    let mut out = Vec::new();
    for (channel, name) in channels.iter().enumerate() {
        let series: Vec<(usize, f64)> = linear
            .place
            .iter()
            .zip(linear.residual.iter())
            .filter(|((_, c), _)| *c == channel)
            .map(|((instant, _), r)| (*instant, *r))
            .collect();
        if series.is_empty() {
            continue;
        }
        let n = series.len() as f64;
        let squares: f64 = series.iter().map(|(_, r)| r * r).sum();
        let products: f64 = series.windows(2).filter(|w| w[1].0 == w[0].0 + 1).map(|w| w[0].1 * w[1].1).sum();
        out.push(ChannelResiduals {
            name: name.clone(),
            count: series.len(),
            mean: series.iter().map(|(_, r)| r).sum::<f64>() / n,
            rms: (squares / n).sqrt(),
            autocorrelation: if squares > 0.0 { products / squares } else { 0.0 },
        });
    }
    out
}

fn notes(
    parameters: &[FittedParameter],
    lasting: Option<LastingErrors>,
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
    if let Some(lasting) = lasting {
        out.push(format!(
            "{:.0} % of the measurements' variance lasts about {}: something slow is missing from the model or the measurements; weights and standard deviations allow for it.",
            100.0 * lasting.share, lasting.extent
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
        out.push(format!("The flight hardly tells {}.", vague.join(", ")));
    }
    out
}
