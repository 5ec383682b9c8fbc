//! Results and options of equation-error fits.

use crate::diagnostics::{Agreement, Collinearity};
use crate::{Band, Output};
use nalgebra::DMatrix;

/// How parameters were estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Ordinary least squares with errors for coloured residuals.
    LeastSquares,
    /// Least squares with each instant weighted by the error of its output.
    WeightedLeastSquares,
    /// Total least squares with exact columns held exact.
    TotalLeastSquares,
    /// Total least squares with the error covariance of each instant.
    TotalLeastSquaresByRow,
    /// Least squares of the Fourier transforms in a band.
    FrequencyDomain,
}

impl Estimator {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::LeastSquares,
        Self::WeightedLeastSquares,
        Self::TotalLeastSquares,
        Self::TotalLeastSquaresByRow,
        Self::FrequencyDomain,
    ];

    /// The name in `parameters.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeastSquares => "ols",
            Self::WeightedLeastSquares => "wls",
            Self::TotalLeastSquares => "tls",
            Self::TotalLeastSquaresByRow => "gtls",
            Self::FrequencyDomain => "fd",
        }
    }

    /// The estimator of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|e| e.name() == name)
    }
}

/// One parameter of the model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameter {
    /// Regressor that it belongs to.
    pub name: String,
    /// Estimate; none where it is not identifiable.
    pub value: Option<f64>,
    /// Standard deviation.
    pub std: Option<f64>,
    /// 95 % interval, from.
    pub ci_low: Option<f64>,
    /// 95 % interval, to.
    pub ci_high: Option<f64>,
    /// Whether the flight determines it by itself.
    pub identifiable: bool,
}

/// A sum of parameters that is determined although its parts are not.
#[derive(Debug, Clone, PartialEq)]
pub struct Combination {
    /// In words, such as `C_X,0 + 4.631·C_X,T_u`.
    pub text: String,
    /// Estimate.
    pub value: f64,
    /// Standard deviation.
    pub std: f64,
    /// 95 % interval, from.
    pub ci_low: f64,
    /// 95 % interval, to.
    pub ci_high: f64,
}

/// How far a fit can be trusted.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnostics {
    /// Names of the independent columns, in the order of all that follows.
    pub columns: Vec<String>,
    /// How well they are distinguished.
    pub collinearity: Collinearity,
    /// Correlations of their estimates.
    pub correlations: DMatrix<f64>,
    /// [`crate::press()`] in blocks of one period of the low-pass.
    pub press: f64,
    /// One less PRESS over the sum of squares about the mean.
    pub predicted_r2: f64,
    /// Autocorrelations of the residuals from lag one on, over two periods of the low-pass.
    pub autocorrelations: Vec<f64>,
    /// Fit against measurement in the window, with Theil's coefficient.
    pub fit: Agreement,
    /// Prediction against measurement where the fit has not looked.
    pub held_out: Option<Agreement>,
}

/// A fitted output: a sum of its regressors.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Line {
    /// What each regressor is multiplied by; 0 for those that are combinations of others.
    pub factors: Vec<f64>,
    /// What is added.
    pub offset: f64,
}

impl Line {
    /// The fitted value at a row of the table.
    pub fn at(&self, output: &Output, row: usize) -> f64 {
        let parts = output.columns.iter().zip(&self.factors).map(|(c, factor)| c.values[row] * factor);
        parts.sum::<f64>() + self.offset
    }
}

/// The fit of one output.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputFit {
    /// `C_X`, `C_Z` or `C_m`, or as the model has it.
    pub output: String,
    /// How.
    pub estimator: Estimator,
    /// All free parameters of the model, in its order.
    pub parameters: Vec<Parameter>,
    /// What can be said of those that are not identifiable.
    pub combinations: Vec<Combination>,
    /// Number of independent columns.
    pub rank: usize,
    /// Condition number of the independent columns, each scaled to length one (Belsley, Kuh & Welsch 1980).
    pub condition: f64,
    /// What is fitted.
    pub line: Line,
    /// Instants of the window that were not fitted because they lie in a gap of the poses.
    pub left_out: usize,
    /// More of that kind.
    pub diagnostics: Diagnostics,
    /// Samples that the low-pass of both sides leaves independent: twice its half point times the time that is fitted
    /// (Shannon 1949).
    pub independent_samples: f64,
    /// Whether the fit is of use; if not, being further from what was measured than the mean is, or of no more independent
    /// samples than columns, none of its parameters is determined.
    pub explains: bool,
    /// What that means, in words.
    pub verdict: String,
}

/// All fits of one flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Identification {
    /// By output, then estimator.
    pub fits: Vec<OutputFit>,
}

impl Identification {
    /// The fit of an output by an estimator.
    pub fn fit(&self, output: &str, estimator: Estimator) -> Option<&OutputFit> {
        self.fits.iter().find(|f| f.output == output && f.estimator == estimator)
    }
}

/// What a user may choose of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Estimators, in the order of the results.
    pub estimators: Vec<Estimator>,
    /// Band of [`Estimator::FrequencyDomain`]; by default one cycle in the window to the output's bandwidth.
    pub band: Option<Band>,
    /// First and last time of a part that is not fitted but predicted.
    pub held_out_s: Option<(f64, f64)>,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            estimators: vec![
                Estimator::LeastSquares,
                Estimator::TotalLeastSquares,
                Estimator::TotalLeastSquaresByRow,
            ],
            band: None,
            held_out_s: None,
        }
    }
}
