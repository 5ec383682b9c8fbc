//! Equation error: the regression of each output by each estimator.

use crate::blocks::widened;
use crate::coloured::{Coloured, ResidualErrors, believed, coloured};
use crate::dependence::Dependence;
use crate::diagnostics::{agreement, autocorrelations, collinearity, correlations, press};
use crate::fit::{
    Combination, Diagnostics, Estimator, FitOptions, Identification, Line, OutputFit, Parameter,
};
use crate::table::Output;
use crate::total_least_squares::by_row;
use crate::{
    Band, CoefficientTable, Correlation, IdentifyError, LeastSquares, TotalLeastSquares, least_squares,
    student_quantile_975, total_least_squares, verdict, weighted_least_squares,
};
use nalgebra::{DMatrix, DVector};

/// Fits every output of the table with the default options of [`identify_with`]: ordinary and total least
/// squares, the latter also with each instant's own covariance.
///
/// # Errors
/// Those of [`identify_with`].
pub fn identify(table: &CoefficientTable) -> Result<Identification, IdentifyError> {
    identify_with(table, &FitOptions::default())
}

/// Fits every output of the table by each estimator.
///
/// A column that is a combination of those before it (constant thrusts are multiples of the intercept) is
/// taken into them; parameters concerned are marked as not identifiable and the combination that is
/// determined is given. Intervals allow for residuals that are correlated over a period of the low-pass.
/// [`Estimator::FrequencyDomain`] leaves the constant out.
///
/// # Errors
/// Too few instants, columns of rank zero, no total least-squares solution, a band without frequencies.
pub fn identify_with(
    table: &CoefficientTable,
    options: &FitOptions,
) -> Result<Identification, IdentifyError> {
    let mut fits = Vec::with_capacity(table.outputs.len() * options.estimators.len());
    for output in &table.outputs {
        for estimator in &options.estimators {
            fits.push(Regression::new(table, output, *estimator, options)?.fit()?);
        }
    }
    Ok(Identification { fits })
}

struct Regression<'a> {
    table: &'a CoefficientTable,
    output: &'a Output,
    estimator: Estimator,
    rows: Vec<usize>,
    held_out: Vec<usize>,
    /// Independent regressors and output, about their means in the frequency domain.
    basis: DMatrix<f64>,
    y: DVector<f64>,
    dependence: Dependence,
    /// Means of all regressors and the output; zero where they were not taken off.
    x_means: DVector<f64>,
    y_mean: f64,
    band: Band,
    /// [`OutputFit::independent_samples`].
    independent_samples: f64,
    lag: usize,
}

struct Solved {
    values: DVector<f64>,
    errors: Coloured,
}

impl<'a> Regression<'a> {
    fn new(
        table: &'a CoefficientTable,
        output: &'a Output,
        estimator: Estimator,
        options: &FitOptions,
    ) -> Result<Self, IdentifyError> {
        let count = output.columns.len();
        let is_held = |i: &usize| {
            options.held_out_s.is_some_and(|(from, to)| table.t_s[*i] >= from && table.t_s[*i] <= to)
        };
        let (held_out, rows): (Vec<usize>, Vec<usize>) =
            table.rows_in_window().into_iter().partition(is_held);
        if rows.len() <= count {
            return Err(IdentifyError::TooFewInstants { found: rows.len(), parameters: count });
        }
        let (mut x, mut y) = (output.regressors_at(&rows), output.values_at(&rows));
        let (mut x_means, mut y_mean) = (DVector::zeros(count), 0.0);
        if estimator == Estimator::FrequencyDomain {
            (x_means, y_mean) = (x.row_mean().transpose(), y.mean());
            for (mut column, mean) in x.column_iter_mut().zip(&x_means) {
                // What is a constant leaves rounding, which is no signal.
                let is_constant = column.iter().all(|v| (v - mean).abs() <= 1e-12 * mean.abs());
                column.apply(|v| *v = if is_constant { 0.0 } else { *v - mean });
            }
            y.add_scalar_mut(-y_mean);
        }
        let dependence = output.dependence(&x);
        if dependence.independent.is_empty() {
            return Err(IdentifyError::RankZero);
        }
        let length_s = rows.len() as f64 * table.sample_interval_s;
        let high_hz = output.bandwidth_hz.min(0.5 / table.sample_interval_s);
        let band = options.band.unwrap_or(Band { low_hz: 1.0 / length_s, high_hz });
        let lag = table.correlated_rows(output.bandwidth_hz, rows.len());
        let basis = x.select_columns(&dependence.independent);
        Ok(Self {
            table,
            output,
            estimator,
            rows,
            held_out,
            basis,
            y,
            dependence,
            x_means,
            y_mean,
            band,
            independent_samples: 2.0 * high_hz * length_s,
            lag,
        })
    }

    fn fit(&self) -> Result<OutputFit, IdentifyError> {
        let (x, y, how) = (&self.basis, &self.y, Correlation::Rows(self.lag));
        let plain = |fit: LeastSquares, std: &DVector<f64>| {
            self.coloured(fit.values, fit.covariance, &fit.inverse_gram, std)
        };
        let total =
            |fit: TotalLeastSquares| self.coloured(fit.values, fit.covariance, &fit.inverse_moment, &fit.std);
        let ones = DVector::from_element(y.len(), 1.0);
        self.report(&match self.estimator {
            Estimator::LeastSquares => plain(least_squares(x, y, how)?, &ones),
            Estimator::WeightedLeastSquares => {
                let std = DVector::from_fn(y.len(), |k, _| self.output.std_at(self.rows[k]));
                let std = if std.iter().all(|s| *s > 0.0) { std } else { ones };
                plain(weighted_least_squares(x, y, std.as_slice(), how)?, &std)
            }
            Estimator::TotalLeastSquares => total(total_least_squares(x, y, &self.mean_errors(), how)?),
            Estimator::TotalLeastSquaresByRow => total(by_row(x, y, &|k| self.errors_of(self.rows[k]), how)?),
            Estimator::FrequencyDomain => self.in_frequency()?,
        })
    }

    /// Least squares in the band, then weighted by the variance that the errors' transforms have at those
    /// values, until that stands; the covariance is that of the estimates as a sum of the errors' transforms,
    /// level from the residuals.
    fn in_frequency(&self) -> Result<Solved, IdentifyError> {
        /// Weights change little with values that are within their errors: each step gains more than a digit.
        const STEPS: usize = 4;
        let mut weights = self.band.weights(self.rows.len(), self.table.sample_interval_s)?;
        let (x, y) = (&weights * &self.basis, &weights * &self.y);
        // What is fitted has its mean taken off.
        for mut row in weights.row_iter_mut() {
            row.add_scalar_mut(-row.mean());
        }
        let plain = least_squares(&x, &y, Correlation::White)?;
        let degrees = (x.nrows() - x.ncols()) as f64;
        let errors = Coloured { covariance: plain.covariance, degrees };
        let mut solved = Solved { values: plain.values, errors };
        for _ in 0..STEPS {
            // A record that ends leaks what is strong at high frequencies into all low ones alike: errors of
            // neighbouring transforms go together, and real and imaginary parts differ.
            let spread = &weights * self.errors_at(&solved.values).spread(&weights.transpose());
            if !spread.diagonal().iter().all(|d| *d > 0.0) {
                break;
            }
            let std: Vec<f64> = spread.diagonal().iter().map(|d| d.sqrt()).collect();
            let fit = weighted_least_squares(&x, &y, &std, Correlation::White)?;
            solved = in_band(&x, &y, &spread, fit);
        }
        Ok(solved)
    }

    /// What is known of the errors of the residuals at values of the independent columns.
    fn errors_at(&self, values: &DVector<f64>) -> ResidualErrors {
        self.table.residual_errors(self.output, &self.dependence.independent, values, &self.rows)
    }

    /// Estimates with the covariance that the colour of the errors gives, where that is known. Rows were
    /// divided by their standard deviations, and have the colour when they are; `bread` is what multiplies
    /// the scores.
    fn coloured(
        &self,
        values: DVector<f64>,
        covariance: DMatrix<f64>,
        bread: &DMatrix<f64>,
        std: &DVector<f64>,
    ) -> Solved {
        let mut errors = self.errors_at(&values);
        let mean_square = std.norm_squared() / std.len() as f64;
        errors.gamma.iter_mut().for_each(|g| *g /= mean_square);
        errors.once.iter_mut().for_each(|e| e.component_div_assign(std));
        let residuals = (&self.y - &self.basis * &values).component_div(std);
        let mut scaled = self.basis.clone();
        scaled.column_iter_mut().for_each(|mut c| c.component_div_assign(std));
        let known = coloured(&scaled, bread, &residuals, &errors);
        let degrees = (self.rows.len() - values.len()) as f64;
        let Some(known) = known else { return Solved { values, errors: Coloured { covariance, degrees } } };
        let mut scores = self.without_errors(&values);
        let weighted = residuals.component_div(std);
        scores.column_iter_mut().for_each(|mut c| c.component_mul_assign(&weighted));
        Solved { values, errors: widened(known, &scaled, bread, &scores, &errors, self.lag) }
    }

    /// The independent columns; for total least squares, less what the residuals say of their errors, whose products with
    /// the residuals are then zero on average (Fuller 1987, equation 1.2.20).
    fn without_errors(&self, values: &DVector<f64>) -> DMatrix<f64> {
        let mut out = self.basis.clone();
        let mean = match self.estimator {
            Estimator::TotalLeastSquares => Some(self.mean_errors()),
            Estimator::TotalLeastSquaresByRow => None,
            _ => return out,
        };
        let count = values.len();
        let weights = (-values).push(1.0);
        let residuals = &self.y - &self.basis * values;
        for (k, residual) in residuals.iter().enumerate() {
            let of_residual = mean.clone().unwrap_or_else(|| self.errors_of(self.rows[k])) * &weights;
            let share = residual / weights.dot(&of_residual);
            let mut row = out.row_mut(k);
            row -= of_residual.rows(0, count).transpose() * share;
        }
        out
    }

    /// Error covariance of the independent columns and the output at an instant; where none is known, of the
    /// output alone.
    fn errors_of(&self, row: usize) -> DMatrix<f64> {
        let count = self.output.columns.len();
        let kept: Vec<usize> = self.dependence.independent.iter().copied().chain([count]).collect();
        let mut errors = self.output.errors.covariance(row, &kept);
        if errors[(kept.len() - 1, kept.len() - 1)] == 0.0 {
            errors.fill(0.0);
            errors[(kept.len() - 1, kept.len() - 1)] = 1.0;
        }
        errors
    }

    fn mean_errors(&self) -> DMatrix<f64> {
        let size = self.dependence.independent.len() + 1;
        let sum = self.rows.iter().fold(DMatrix::zeros(size, size), |sum, i| sum + self.errors_of(*i));
        sum / self.rows.len() as f64
    }

    /// Puts estimates of the independent columns into the model's order.
    fn report(&self, solved: &Solved) -> Result<OutputFit, IdentifyError> {
        let (mut parameters, mut combinations) = self.parameters(solved);
        let mut factors = vec![0.0; self.output.columns.len()];
        for (column, value) in self.dependence.independent.iter().zip(&solved.values) {
            factors[*column] = *value;
        }
        let at_means: f64 = self.x_means.iter().zip(&factors).map(|(x, f)| x * f).sum();
        let line = Line { offset: self.y_mean - at_means, factors };
        let diagnostics = self.diagnostics(&solved.errors.covariance, &line)?;
        let explains = self.explains(&diagnostics);
        if !explains {
            combinations.clear();
            parameters
                .iter_mut()
                .for_each(|p| *p = Parameter { name: p.name.clone(), ..Parameter::default() });
        }
        let mut fit = OutputFit {
            output: self.output.name.clone(),
            estimator: self.estimator,
            parameters,
            combinations,
            rank: solved.values.len(),
            independent_samples: self.independent_samples,
            condition: diagnostics.collinearity.condition_indices.max(),
            line,
            left_out: self.table.instants_in_gaps(),
            diagnostics,
            explains,
            verdict: String::new(),
        };
        fit.verdict = verdict::words(self.output, &self.dependence, &fit);
        Ok(fit)
    }

    /// Whether a fit is of use: not where it is further from what was measured than the mean is, and further than
    /// least squares is from blocks that it leaves out. Total least squares ends there where the errors of regressors
    /// are as large as what the flight moves. In the frequency domain the mean is no rival. No more independent samples
    /// than columns are met by any coefficients: what is left says nothing of their errors.
    fn explains(&self, diagnostics: &Diagnostics) -> bool {
        let own = diagnostics.fit.r2;
        let is_near =
            self.estimator == Estimator::FrequencyDomain || own >= 0.0 || own >= diagnostics.predicted_r2;
        is_near && self.independent_samples > self.basis.ncols() as f64
    }

    fn parameters(&self, solved: &Solved) -> (Vec<Parameter>, Vec<Combination>) {
        let Solved { values, errors: Coloured { covariance, degrees } } = solved;
        let t = student_quantile_975(degrees.floor() as usize);
        let nothing = |name: &String| Parameter { name: name.clone(), ..Parameter::default() };
        let mut parameters: Vec<Parameter> = self.output.columns.iter().map(|c| nothing(&c.name)).collect();
        let mut combinations = Vec::new();
        for (position, column) in self.dependence.independent.iter().copied().enumerate() {
            let (value, noise) = (values[position], covariance[(position, position)].max(0.0).sqrt());
            let std = noise.hypot(value * self.output.scale_std);
            let (ci_low, ci_high) = (value - t * std, value + t * std);
            // An interval without bounds determines nothing.
            if !(ci_high - ci_low).is_finite() {
                continue;
            }
            if self.dependence.stands_alone(position) {
                let p = &mut parameters[column];
                p.identifiable = true;
                (p.value, p.std) = (Some(value), Some(std));
                (p.ci_low, p.ci_high) = (Some(ci_low), Some(ci_high));
            } else {
                let text = verdict::combination(self.output, &self.dependence, position);
                combinations.push(Combination { text, value, std, ci_low, ci_high });
            }
        }
        (parameters, combinations)
    }

    fn diagnostics(&self, covariance: &DMatrix<f64>, line: &Line) -> Result<Diagnostics, IdentifyError> {
        let pick = |rows: &[usize]| -> (Vec<f64>, Vec<f64>) {
            rows.iter().map(|i| (self.output.values[*i], line.at(self.output, *i))).unzip()
        };
        let (measured, explained) = pick(&self.rows);
        let residuals: Vec<f64> = measured.iter().zip(&explained).map(|(a, b)| a - b).collect();
        let press = press(&self.basis, &self.y, self.lag)?;
        let spread = self.y.add_scalar(-self.y.mean()).norm_squared();
        let held = pick(&self.held_out);
        let columns =
            self.dependence.independent.iter().map(|j| self.output.columns[*j].name.clone()).collect();
        Ok(Diagnostics {
            columns,
            collinearity: collinearity(&self.basis)?,
            correlations: correlations(covariance),
            press,
            predicted_r2: if spread > 0.0 { 1.0 - press / spread } else { 0.0 },
            autocorrelations: autocorrelations(&residuals, 2 * self.lag),
            fit: agreement(&measured, &explained),
            held_out: (!self.held_out.is_empty()).then(|| agreement(&held.0, &held.1)),
        })
    }
}

/// Weighted least squares of rows whose covariance is `spread` up to a factor, which the weighted residuals
/// show; their degrees of freedom are those of a chi-square with the mean and variance that their squares
/// have (Satterthwaite 1946).
fn in_band(x: &DMatrix<f64>, y: &DVector<f64>, spread: &DMatrix<f64>, fit: LeastSquares) -> Solved {
    let root = spread.diagonal().map(|d| d.sqrt().recip());
    let weighted = DMatrix::from_diagonal(&root) * x;
    let influence = &fit.inverse_gram * weighted.transpose();
    let scaled = spread.component_mul(&(&root * root.transpose()));
    let left = DMatrix::identity(x.nrows(), x.nrows()) - &weighted * &influence;
    let residuals = &left * y.component_mul(&root);
    let expected = &left * &scaled * left.transpose();
    let level = residuals.norm_squared() / expected.trace();
    let degrees = (expected.trace().powi(2) / expected.norm_squared()).max(1.0);
    let covariance = &influence * scaled * influence.transpose() * believed(level, degrees);
    Solved { values: fit.values, errors: Coloured { covariance, degrees } }
}
