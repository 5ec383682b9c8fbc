//! The fits of one flight by least squares and by total least squares.

use crate::dependence::{Dependence, independent_columns};
use crate::regressors::Output;
use crate::{
    CoefficientTable, Correlation, IdentifyError, independent_errors, least_squares, student_quantile_975,
    total_least_squares, verdict,
};
use nalgebra::{DMatrix, DVector};

/// How parameters were estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Ordinary least squares with errors for coloured residuals.
    LeastSquares,
    /// Total least squares with exact columns held exact.
    TotalLeastSquares,
}

impl Estimator {
    /// The name in `parameters.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeastSquares => "ols",
            Self::TotalLeastSquares => "tls",
        }
    }

    /// The estimator of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::LeastSquares, Self::TotalLeastSquares].into_iter().find(|e| e.name() == name)
    }
}

/// One parameter of equation 3.
#[derive(Debug, Clone, PartialEq)]
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
}

/// The fit of one output.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputFit {
    /// `C_X`, `C_Z` or `C_m`.
    pub output: String,
    /// How.
    pub estimator: Estimator,
    /// All parameters of the model, in its order.
    pub parameters: Vec<Parameter>,
    /// What can be said of those that are not identifiable.
    pub combinations: Vec<Combination>,
    /// Share of the variance about the mean that the fit explains, in the window.
    pub r2: f64,
    /// Largest residual in the window.
    pub max_residual: f64,
    /// Root mean square residual in the window.
    pub rms_residual: f64,
    /// Number of independent columns.
    pub rank: usize,
    /// Condition number of the independent columns, each scaled to length one (Belsley, Kuh & Welsch 1980).
    pub condition: f64,
    /// Fit at all times of the table.
    pub fitted: Vec<f64>,
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

/// The rows of one output inside the window.
struct Problem<'a> {
    output: &'a Output,
    all: DMatrix<f64>,
    x: DMatrix<f64>,
    y: DVector<f64>,
    output_std: f64,
    correlation: Correlation,
    dependence: Dependence,
}

/// Fits every output of the table by each estimator.
///
/// A column that is a combination of those before it (constant thrusts are multiples of the intercept) is taken into
/// them; parameters concerned are marked as not identifiable and the combination that is determined is given.
///
/// # Errors
/// Too few instants, columns of rank zero, no total least-squares solution.
pub fn identify(table: &CoefficientTable) -> Result<Identification, IdentifyError> {
    let mut fits = Vec::new();
    for output in &table.outputs {
        let problem = Problem::new(table, output)?;
        for estimator in [Estimator::LeastSquares, Estimator::TotalLeastSquares] {
            fits.push(problem.fit(estimator)?);
        }
    }
    Ok(Identification { fits })
}

impl<'a> Problem<'a> {
    fn new(table: &CoefficientTable, output: &'a Output) -> Result<Self, IdentifyError> {
        let count = output.columns.len();
        let all = DMatrix::from_fn(table.t_s.len(), count, |i, j| output.columns[j].values[i]);
        let rows = table.rows_in_window();
        if rows.len() <= count {
            return Err(IdentifyError::TooFewInstants { found: rows.len(), parameters: count });
        }
        let x = all.select_rows(&rows);
        let y = DVector::from_iterator(rows.len(), rows.iter().map(|i| output.values[*i]));
        let variance: f64 = rows.iter().map(|i| output.std[*i].powi(2)).sum::<f64>() / rows.len() as f64;
        let noise: Vec<f64> = output.columns.iter().map(|c| c.std).collect();
        let dependence = independent_columns(&x, &noise);
        if dependence.independent.is_empty() {
            return Err(IdentifyError::RankZero);
        }
        let lag = table.correlated_rows(output.bandwidth_hz, rows.len());
        let output_std = if variance > 0.0 { variance.sqrt() } else { 1.0 };
        Ok(Self { output, all, x, y, output_std, correlation: Correlation::Rows(lag), dependence })
    }

    fn fit(&self, estimator: Estimator) -> Result<OutputFit, IdentifyError> {
        let independent = &self.dependence.independent;
        let basis = self.x.select_columns(independent);
        let (values, covariance) = match estimator {
            Estimator::LeastSquares => {
                let fit = least_squares(&basis, &self.y, self.correlation)?;
                (fit.values, fit.covariance)
            }
            Estimator::TotalLeastSquares => {
                let std: Vec<f64> = independent.iter().map(|j| self.output.columns[*j].std).collect();
                let fit = total_least_squares(
                    &basis,
                    &self.y,
                    &independent_errors(&std, self.output_std),
                    self.correlation,
                )?;
                (fit.values, fit.covariance)
            }
        };
        Ok(self.report(estimator, &values, &covariance))
    }

    /// Puts estimates of the independent columns into the model's order.
    fn report(&self, estimator: Estimator, values: &DVector<f64>, covariance: &DMatrix<f64>) -> OutputFit {
        let independent = &self.dependence.independent;
        let degrees = self.x.nrows() - independent.len();
        let t = student_quantile_975(degrees);
        let mut parameters: Vec<Parameter> = self
            .output
            .columns
            .iter()
            .map(|c| Parameter {
                name: c.name.clone(),
                value: None,
                std: None,
                ci_low: None,
                ci_high: None,
                identifiable: false,
            })
            .collect();
        let mut combinations = Vec::new();
        let mut full = DVector::zeros(self.x.ncols());
        for (position, column) in independent.iter().copied().enumerate() {
            let (value, std) = (values[position], covariance[(position, position)].max(0.0).sqrt());
            full[column] = value;
            if self.dependence.stands_alone(position) {
                let p = &mut parameters[column];
                p.identifiable = true;
                (p.value, p.std) = (Some(value), Some(std));
                (p.ci_low, p.ci_high) = (Some(value - t * std), Some(value + t * std));
            } else {
                combinations.push(Combination {
                    text: verdict::combination(self.output, &self.dependence, position),
                    value,
                    std,
                });
            }
        }
        let residuals = &self.y - &self.x * &full;
        let spread = self.y.add_scalar(-self.y.mean()).norm_squared();
        let condition = self.condition();
        let rank = independent.len();
        OutputFit {
            output: self.output.name.clone(),
            estimator,
            r2: if spread > 0.0 { 1.0 - residuals.norm_squared() / spread } else { 0.0 },
            max_residual: residuals.amax(),
            rms_residual: (residuals.norm_squared() / residuals.len() as f64).sqrt(),
            rank,
            condition,
            fitted: (&self.all * &full).iter().copied().collect(),
            verdict: verdict::words(self.output, &self.dependence, &parameters, &combinations, condition),
            parameters,
            combinations,
        }
    }

    fn condition(&self) -> f64 {
        let mut scaled = self.x.select_columns(&self.dependence.independent);
        for mut column in scaled.column_iter_mut() {
            let length = column.norm();
            column /= length;
        }
        let s = mavsight_geometry::svd::jacobi_svd(&scaled.qr().r()).singular_values;
        s[0] / s[s.len() - 1]
    }
}
