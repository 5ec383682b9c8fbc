//! Results of an output-error fit.

use super::model::ModelParameter;
use crate::Agreement;
use mavsight_flight::FlapState;
use mavsight_geometry::{Isometry3, Vector3};
use nalgebra::DMatrix;

/// One estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// The parameter.
    pub parameter: ModelParameter,
    /// Name of the parameter.
    pub name: &'static str,
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
    /// effect of one hundredth of the weight (over the rotor's radius; per m/s, per 10 rad/s), whichever is
    /// the largest.
    pub identifiable: bool,
}

/// Residuals of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelResiduals {
    /// `x`, `turn_y`, `camera 0 red u` ...
    pub name: String,
    /// How many.
    pub count: usize,
    /// Mean of the whitened residuals: predictions one instant ahead where errors are correlated.
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
    /// Their correlation.
    pub correlation: DMatrix<f64>,
    /// Residuals by channel.
    pub residuals: Vec<ChannelResiduals>,
    /// Each channel with the factor by which its given variances were multiplied; see
    /// [`ChannelResiduals::name`].
    pub variance_factors: Vec<(String, f64)>,
    /// Correlated errors of the measurements; none where residuals are white.
    pub systematic: Option<SystematicErrors>,
    /// Instants over which residuals are correlated once `systematic` is allowed for; 0 for white ones.
    pub correlated_instants: usize,
    /// Weighted squares over redundancy.
    pub reduced_chi_square: f64,
    /// Steps taken.
    pub iterations: usize,
    /// Whether the last step promised nothing more. A fit that has not converged is refused, so this is
    /// always true.
    pub converged: bool,
    /// Where the flight began.
    pub initial_state: FittedState,
    /// Covariance of that: position (world), turn (body), velocity (body), rates, alpha_l, beta_l, alpha_f,
    /// beta_f.
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
