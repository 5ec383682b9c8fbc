//! Results of an output-error fit.

use super::ahead::AheadErrors;
use super::model::{FlightModel, ModelParameter};
use crate::{Agreement, IdentifyError};
use nalgebra::DMatrix;

/// One estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// The parameter.
    pub parameter: ModelParameter,
    /// Name of the parameter.
    pub name: String,
    /// Unit; empty where it has none, or none is declared.
    pub unit: String,
    /// Estimate.
    pub value: f64,
    /// Standard deviation: the Cramér-Rao bound, or what residuals that are still correlated, or larger at
    /// some times than at others, make of it where that is more.
    pub std: f64,
    /// The Cramér-Rao bound, for errors of the level and the duration found.
    pub bound_std: f64,
    /// 95 % interval, from.
    pub ci_low: f64,
    /// 95 % interval, to.
    pub ci_high: f64,
    /// Whether half the interval is less than the value itself, the value that the fit started from, or an
    /// effect of one hundredth of the weight (over three radii of gyration for a moment; per m/s, per 10 rad/s),
    /// whichever is the largest; not where a bound has stopped the parameter, where it hangs on a bound or a prior that the
    /// flight contradicts, nor where filter error contradicts the fit.
    pub identifiable: bool,
}

/// A quantity that the model derives from its parameters, of which at least one was free.
#[derive(Debug, Clone, PartialEq)]
pub struct DerivedQuantity {
    /// Name.
    pub name: String,
    /// Unit; empty where it has none, or none is declared.
    pub unit: String,
    /// Value at the estimates.
    pub value: f64,
    /// Standard deviation: of the estimates, to first order.
    pub std: f64,
    /// 95 % interval, from.
    pub ci_low: f64,
    /// 95 % interval, to.
    pub ci_high: f64,
    /// Whether it may be used: not where nothing of the fit may be, nor where it hangs on a bound or a prior that the flight
    /// contradicts.
    pub identifiable: bool,
}

/// Correlated errors of the measurements: part of each channel's variance has the autocorrelation
/// exp(-|x|/extent), x time or the path of the marker's image, whichever is the more likely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystematicErrors {
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
    /// What the model derives from them.
    pub derived: Vec<DerivedQuantity>,
    /// Each channel (`x`, `turn_y`, `camera 0 red u` ...) with the factor by which its given variances were
    /// multiplied.
    pub variance_factors: Vec<(String, f64)>,
    /// Correlated errors of the measurements; none where residuals are white.
    pub systematic: Option<SystematicErrors>,
    /// Instants over which residuals are correlated once `systematic` is allowed for; 0 for white ones.
    pub correlated_instants: usize,
    /// How well the noise that was found explains the measurements: minus twice the logarithm of their restricted likelihood
    /// (Patterson & Thompson 1971), and for each number of the noise beside the channels' variances the logarithm of the
    /// number of measurements (Schwarz 1978). Of two fits of the same parameters to the same measurements the one with the
    /// smaller number is to be preferred; by itself the number says nothing.
    pub criterion: f64,
    /// Weighted squares over redundancy.
    pub reduced_chi_square: f64,
    /// Steps taken.
    pub iterations: usize,
    /// Largest distance between the end of one segment and the start of the next, m.
    pub largest_gap_m: f64,
    /// What the model lacks, where that was estimated ([`super::filter_error`]): square roots of the spectral
    /// densities of specific force (`force x` ..., m/s² √s) and angular acceleration (`moment x` ..., rad/s²
    /// √s) along the body's axes.
    pub process_noise: Vec<(String, f64)>,
    /// How it predicts what was held out of the fit.
    pub held_out: Option<Prediction>,
    /// How it predicts that a second ahead.
    pub ahead: Option<AheadErrors>,
    /// What a user should know, in sentences.
    pub notes: Vec<String>,
}

impl OutputErrorFit {
    /// Leaves nothing of the fit to be used: neither parameters nor what is derived from them.
    pub(super) fn withhold(&mut self) {
        self.parameters.iter_mut().for_each(|p| p.identifiable = false);
        self.derived.iter_mut().for_each(|d| d.identifiable = false);
    }

    /// The model that was fitted with the estimates, none of which is free any more.
    ///
    /// # Errors
    /// Estimates that are none of this model's.
    pub fn model(&self, before: &FlightModel) -> Result<FlightModel, IdentifyError> {
        let fixed = before.clone().with_free(&[])?;
        self.parameters.iter().try_fold(fixed, |model, p| model.with_value(&p.name, p.value))
    }

    /// The estimate of a name.
    pub fn parameter(&self, name: &str) -> Option<&FittedParameter> {
        self.parameters.iter().find(|p| p.name == name)
    }
}

/// Measured poses against those that a model predicts from the recorded inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// First and last instant compared.
    pub span_s: (f64, f64),
    /// Each coordinate of [`Prediction::COORDINATES`].
    pub agreements: [Agreement; 6],
}

impl Prediction {
    /// Position in the world, roll, pitch and yaw.
    pub const COORDINATES: [&'static str; 6] = ["x", "y", "z", "phi", "theta", "psi"];
}
