//! Equation error: the regression of each output by each estimator.

use crate::coloured::{Coloured, coloured};
use crate::dependence::{Dependence, independent_columns};
use crate::diagnostics::{agreement, autocorrelations, collinearity, correlations, press};
use crate::fit::{
    Combination, Diagnostics, Estimator, FitOptions, Identification, Line, OutputFit, Parameter,
};
use crate::row_errors::by_row;
use crate::table::{Output, rows_of};
use crate::{
    Band, CoefficientTable, Correlation, IdentifyError, LeastSquares, frequency_domain, least_squares,
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

/// The rows of one output inside the window.
struct Regression<'a> {
    table: &'a CoefficientTable,
    output: &'a Output,
    estimator: Estimator,
    rows: Vec<usize>,
    held_out: Vec<usize>,
    /// Independent regressors and output, about their means in the frequency domain.
    basis: DMatrix<f64>,
    y: DVector<f64>,
    /// Those means.
    origin: (DVector<f64>, f64),
    band: Band,
    lag: usize,
    dependence: Dependence,
}

/// Estimates of the independent columns.
struct Solved {
    values: DVector<f64>,
    covariance: DMatrix<f64>,
    degrees: f64,
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
        let mut x = rows_of(output, &rows);
        let mut y = DVector::from_iterator(rows.len(), rows.iter().map(|i| output.values[*i]));
        let mut origin = (DVector::zeros(count), 0.0);
        if estimator == Estimator::FrequencyDomain {
            origin = (DVector::from_iterator(count, x.column_iter().map(|c| c.mean())), y.mean());
            for (mut column, mean) in x.column_iter_mut().zip(&origin.0) {
                // What is a constant leaves rounding, which is no signal.
                if column.iter().all(|v| (v - mean).abs() <= 1e-12 * mean.abs()) {
                    column.fill(0.0);
                } else {
                    column.add_scalar_mut(-mean);
                }
            }
            y.add_scalar_mut(-origin.1);
        }
        let noise: Vec<f64> = output.columns.iter().map(|c| c.std).collect();
        let dependence = independent_columns(&x, &noise);
        if dependence.independent.is_empty() {
            return Err(IdentifyError::RankZero);
        }
        let length_s = rows.len() as f64 * table.sample_interval_s;
        let nyquist_hz = 0.5 / table.sample_interval_s;
        let band = options
            .band
            .unwrap_or(Band { low_hz: 1.0 / length_s, high_hz: output.bandwidth_hz.min(nyquist_hz) });
        let lag = table.correlated_rows(output.bandwidth_hz, rows.len());
        let basis =
            if dependence.dependent.is_empty() { x } else { x.select_columns(&dependence.independent) };
        Ok(Self { table, output, estimator, rows, held_out, basis, y, origin, band, lag, dependence })
    }

    fn fit(&self) -> Result<OutputFit, IdentifyError> {
        let basis = &self.basis;
        let how = Correlation::Rows(self.lag);
        let solved = match self.estimator {
            Estimator::LeastSquares => {
                let fit = least_squares(basis, &self.y, how)?;
                self.solved(basis, fit.values, fit.covariance, &fit.inverse_gram, None)
            }
            Estimator::WeightedLeastSquares => {
                let std: Vec<f64> = self.rows.iter().map(|i| self.output.std[*i]).collect();
                let known = std.iter().all(|s| *s > 0.0);
                let std = if known { std } else { vec![1.0; self.rows.len()] };
                let fit = weighted_least_squares(basis, &self.y, &std, how)?;
                self.solved(basis, fit.values, fit.covariance, &fit.inverse_gram, Some(std))
            }
            Estimator::TotalLeastSquares => {
                let fit = total_least_squares(basis, &self.y, &self.mean_errors(), how)?;
                self.solved(basis, fit.values, fit.covariance, &fit.inverse_moment, None)
            }
            Estimator::TotalLeastSquaresByRow => {
                let errors = |k: usize| self.errors_of(self.rows[k]);
                let fit = by_row(basis, &self.y, (self.rows.len(), &errors), how)?;
                let std = self.residual_std(&fit.values);
                self.solved(basis, fit.values, fit.covariance, &fit.inverse_moment, Some(std))
            }
            Estimator::FrequencyDomain => self.in_frequency(basis)?,
        };
        self.report(basis, &solved)
    }

    /// Least squares in the band, then weighted by the variance that the errors' transforms have at those
    /// values, until that stands; the covariance is that of the estimates as a sum of the errors' transforms,
    /// level from the residuals.
    fn in_frequency(&self, basis: &DMatrix<f64>) -> Result<Solved, IdentifyError> {
        /// Weights change little with values that are within their errors: each step gains more than a digit.
        const STEPS: usize = 4;
        let dt_s = self.table.sample_interval_s;
        let plain = frequency_domain(basis, &self.y, dt_s, self.band, None)?;
        let x = self.band.transform(basis, dt_s)?;
        let y = self.band.transform(&DMatrix::from_column_slice(self.y.len(), 1, self.y.as_slice()), dt_s)?;
        let y = y.column(0).into_owned();
        let degrees = x.nrows().saturating_sub(basis.ncols()).max(1) as f64;
        let mut solved = Solved { values: plain.values, covariance: plain.covariance, degrees };
        for _ in 0..STEPS {
            let spread = self.expected_spread(&solved.values);
            if !spread.diagonal().iter().all(|d| *d > 0.0) {
                break;
            }
            let std: Vec<f64> = spread.diagonal().iter().map(|d| d.sqrt()).collect();
            let fit = weighted_least_squares(&x, &y, &std, Correlation::White)?;
            solved = in_band(&x, &y, &spread, &fit);
        }
        Ok(solved)
    }

    /// The covariance, up to a factor, of the errors' transforms in the band (real parts, then imaginary) at
    /// values of the independent columns. A record that ends leaks what is strong at high frequencies into
    /// all low ones alike: errors of neighbours then go together, and real and imaginary parts differ.
    fn expected_spread(&self, values: &DVector<f64>) -> DMatrix<f64> {
        let independent = &self.dependence.independent;
        let gamma = self.table.autocovariances(self.output, independent, values);
        let once = self.table.once(self.output, independent, values, &self.rows);
        let mut weights = self.band.weights(self.rows.len(), self.table.sample_interval_s);
        // What is fitted has its mean taken off.
        for mut row in weights.row_iter_mut() {
            let mean = row.mean();
            row.add_scalar_mut(-mean);
        }
        let coloured = DMatrix::from_fn(weights.ncols(), weights.nrows(), |i, k| {
            let row = weights.row(k);
            let near = i.saturating_sub(gamma.len().saturating_sub(1))..weights.ncols().min(i + gamma.len());
            near.map(|j| gamma[i.abs_diff(j)] * row[j]).sum::<f64>()
        });
        let mut out = &weights * coloured;
        for single in &once {
            let transform = &weights * single;
            out.ger(1.0, &transform, &transform, 1.0);
        }
        out
    }

    /// Takes the covariance that the colour of the errors gives, where that is known, for the one of the
    /// scores; degrees of freedom are those of the residuals' level. Rows that were divided by a standard
    /// deviation each have its colour when they are.
    fn solved(
        &self,
        basis: &DMatrix<f64>,
        values: DVector<f64>,
        covariance: DMatrix<f64>,
        bread: &DMatrix<f64>,
        std: Option<Vec<f64>>,
    ) -> Solved {
        let mut gamma = self.table.autocovariances(self.output, &self.dependence.independent, &values);
        if let Some(std) = &std {
            let mean_square = std.iter().map(|s| s * s).sum::<f64>() / std.len() as f64;
            gamma.iter_mut().for_each(|g| *g /= mean_square);
        }
        let mut once = self.table.once(self.output, &self.dependence.independent, &values, &self.rows);
        let mut residuals = &self.y - basis * &values;
        let mut scaled = basis.clone();
        for (i, std) in std.iter().flatten().enumerate() {
            residuals[i] /= std;
            once.iter_mut().for_each(|e| e[i] /= std);
            scaled.row_mut(i).unscale_mut(*std);
        }
        let degrees = (self.basis.nrows() - values.len()) as f64;
        match coloured(&scaled, bread, residuals.as_slice(), &gamma, &once) {
            Some(Coloured { covariance, degrees }) => Solved { values, covariance, degrees },
            None => Solved { values, covariance, degrees },
        }
    }

    /// Error covariance of the independent columns and the output at an instant; where none is known, of the
    /// output alone.
    fn errors_of(&self, row: usize) -> DMatrix<f64> {
        let count = self.output.columns.len();
        let kept: Vec<usize> = self.dependence.independent.iter().copied().chain([count]).collect();
        let all = &self.output.errors;
        if row < all.len() && all.at(row, count, count) > 0.0 {
            return all.block(row, &kept);
        }
        let mut errors = DMatrix::zeros(kept.len(), kept.len());
        errors[(kept.len() - 1, kept.len() - 1)] = 1.0;
        errors
    }

    /// Standard deviation of each row's residual, output less fit, by its errors' covariance.
    fn residual_std(&self, values: &DVector<f64>) -> Vec<f64> {
        let weights = values.map(|v| -v).push(1.0);
        self.rows.iter().map(|i| weights.dot(&(self.errors_of(*i) * &weights)).sqrt()).collect()
    }

    fn mean_errors(&self) -> DMatrix<f64> {
        let size = self.dependence.independent.len() + 1;
        let sum = self.rows.iter().fold(DMatrix::zeros(size, size), |sum, i| sum + self.errors_of(*i));
        sum / self.rows.len() as f64
    }

    /// Puts estimates of the independent columns into the model's order.
    fn report(&self, basis: &DMatrix<f64>, solved: &Solved) -> Result<OutputFit, IdentifyError> {
        let (parameters, combinations) = self.parameters(solved);
        let values = &solved.values;
        let mut full = DVector::zeros(self.output.columns.len());
        for (position, column) in self.dependence.independent.iter().enumerate() {
            full[*column] = values[position];
        }
        let line =
            Line { offset: self.origin.1 - self.origin.0.dot(&full), factors: full.as_slice().to_vec() };
        let diagnostics = self.diagnostics(basis, &solved.covariance, &line)?;
        let mut fit = OutputFit {
            output: self.output.name.clone(),
            estimator: self.estimator,
            parameters,
            combinations,
            r2: diagnostics.fit.r2,
            max_residual: diagnostics.fit.max,
            rms_residual: diagnostics.fit.rms,
            rank: values.len(),
            condition: diagnostics.collinearity.condition_indices.max(),
            line,
            left_out: self.table.instants_in_gaps(),
            diagnostics,
            verdict: String::new(),
        };
        fit.verdict = verdict::words(self.output, &self.dependence, &fit);
        Ok(fit)
    }

    fn parameters(&self, solved: &Solved) -> (Vec<Parameter>, Vec<Combination>) {
        let Solved { values, covariance, degrees } = solved;
        let t = student_quantile_975(degrees.floor() as usize);
        let nothing = |name: &String| Parameter {
            name: name.clone(),
            value: None,
            std: None,
            ci_low: None,
            ci_high: None,
            identifiable: false,
        };
        let mut parameters: Vec<Parameter> = self.output.columns.iter().map(|c| nothing(&c.name)).collect();
        let mut combinations = Vec::new();
        for (position, column) in self.dependence.independent.iter().copied().enumerate() {
            let (value, std) = (values[position], covariance[(position, position)].max(0.0).sqrt());
            if self.dependence.stands_alone(position) {
                let p = &mut parameters[column];
                p.identifiable = true;
                (p.value, p.std) = (Some(value), Some(std));
                (p.ci_low, p.ci_high) = (Some(value - t * std), Some(value + t * std));
            } else {
                let text = verdict::combination(self.output, &self.dependence, position);
                let (ci_low, ci_high) = (value - t * std, value + t * std);
                combinations.push(Combination { text, value, std, ci_low, ci_high });
            }
        }
        (parameters, combinations)
    }

    fn diagnostics(
        &self,
        basis: &DMatrix<f64>,
        covariance: &DMatrix<f64>,
        line: &Line,
    ) -> Result<Diagnostics, IdentifyError> {
        let pick = |rows: &[usize]| -> (Vec<f64>, Vec<f64>) {
            rows.iter().map(|i| (self.output.values[*i], line.at(self.output, *i))).unzip()
        };
        let (measured, explained) = pick(&self.rows);
        let residuals: Vec<f64> = measured.iter().zip(&explained).map(|(a, b)| a - b).collect();
        let press = press(basis, &self.y, self.lag)?;
        let spread = self.y.add_scalar(-self.y.mean()).norm_squared();
        let held = pick(&self.held_out);
        let columns =
            self.dependence.independent.iter().map(|j| self.output.columns[*j].name.clone()).collect();
        Ok(Diagnostics {
            columns,
            collinearity: collinearity(basis)?,
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
fn in_band(x: &DMatrix<f64>, y: &DVector<f64>, spread: &DMatrix<f64>, fit: &LeastSquares) -> Solved {
    let root = spread.diagonal().map(|d| d.sqrt().recip());
    let weighted = DMatrix::from_fn(x.nrows(), x.ncols(), |i, j| x[(i, j)] * root[i]);
    let influence = &fit.inverse_gram * weighted.transpose();
    let scaled = DMatrix::from_fn(x.nrows(), x.nrows(), |i, j| spread[(i, j)] * root[i] * root[j]);
    let left = DMatrix::identity(x.nrows(), x.nrows()) - &weighted * &influence;
    let residuals = &left * y.component_mul(&root);
    let expected = &left * &scaled * left.transpose();
    let level = residuals.norm_squared() / expected.trace();
    let degrees = (expected.trace().powi(2) / expected.norm_squared()).max(1.0);
    let covariance = &influence * scaled * influence.transpose() * level;
    Solved { values: fit.values.clone(), covariance, degrees }
}
