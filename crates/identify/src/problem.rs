//! One output by one estimator.

use crate::coloured::{Coloured, coloured};
use crate::dependence::{Dependence, independent_columns};
use crate::diagnostics::{agreement, autocorrelations, collinearity, correlations, press};
use crate::fit::{Combination, Diagnostics, Estimator, FitOptions, OutputFit, Parameter};
use crate::row_errors::by_row;
use crate::table::{Output, rows_of};
use crate::{
    Band, CoefficientTable, Correlation, IdentifyError, frequency_domain, least_squares,
    student_quantile_975, total_least_squares, verdict, weighted_least_squares,
};
use nalgebra::{DMatrix, DVector};

/// The rows of one output inside the window.
pub(crate) struct Problem<'a> {
    table: &'a CoefficientTable,
    output: &'a Output,
    estimator: Estimator,
    rows: Vec<usize>,
    held_out: Vec<usize>,
    /// Regressors and output, about their means in the frequency domain.
    x: DMatrix<f64>,
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

impl<'a> Problem<'a> {
    pub(crate) fn new(
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
        Ok(Self { table, output, estimator, rows, held_out, x, y, origin, band, lag, dependence })
    }

    pub(crate) fn fit(&self) -> Result<OutputFit, IdentifyError> {
        let basis = self.x.select_columns(&self.dependence.independent);
        let how = Correlation::Rows(self.lag);
        let solved = match self.estimator {
            Estimator::LeastSquares => {
                let fit = least_squares(&basis, &self.y, how)?;
                self.solved(&basis, fit.values, fit.covariance, &fit.inverse_gram, None)
            }
            Estimator::WeightedLeastSquares => {
                let std: Vec<f64> = self.rows.iter().map(|i| self.output.std[*i]).collect();
                let known = std.iter().all(|s| *s > 0.0);
                let std = if known { std } else { vec![1.0; self.rows.len()] };
                let fit = weighted_least_squares(&basis, &self.y, &std, how)?;
                self.solved(&basis, fit.values, fit.covariance, &fit.inverse_gram, Some(std))
            }
            Estimator::TotalLeastSquares => {
                let fit = total_least_squares(&basis, &self.y, &self.mean_errors(), how)?;
                self.solved(&basis, fit.values, fit.covariance, &fit.inverse_moment, None)
            }
            Estimator::TotalLeastSquaresByRow => {
                let errors = |k: usize| self.errors_of(self.rows[k]);
                let fit = by_row(&basis, &self.y, (self.rows.len(), &errors), how)?;
                let std = self.residual_std(&fit.values);
                self.solved(&basis, fit.values, fit.covariance, &fit.inverse_moment, Some(std))
            }
            Estimator::FrequencyDomain => self.in_frequency(&basis)?,
        };
        self.report(&basis, &solved)
    }

    /// Least squares in the band, then weighted by the spectrum that the errors have at those values, until that stands.
    fn in_frequency(&self, basis: &DMatrix<f64>) -> Result<Solved, IdentifyError> {
        /// Weights change little with values that are within their errors: each step gains more than a digit.
        const STEPS: usize = 4;
        let dt_s = self.table.sample_interval_s;
        let frequencies_hz = self.band.frequencies_hz(self.length_s());
        let mut fit = frequency_domain(basis, &self.y, dt_s, self.band, None)?;
        for _ in 0..STEPS {
            let density = self.expected_power(&fit.values, &frequencies_hz);
            if !density.iter().all(|d| *d > 0.0) {
                break;
            }
            fit = frequency_domain(basis, &self.y, dt_s, self.band, Some(&density))?;
        }
        let degrees = (2 * frequencies_hz.len()).saturating_sub(basis.ncols()).max(1) as f64;
        Ok(Solved { values: fit.values, covariance: fit.covariance, degrees })
    }

    /// What the errors' transforms over the record have in the mean square, up to a factor: Σ (n - |l|) γ_l cos(2πfl dt) and
    /// the squares of those that happen once. A record that ends leaks what is strong at high frequencies into low ones, which
    /// the spectrum itself does not say.
    fn expected_power(&self, values: &DVector<f64>, frequencies_hz: &[f64]) -> Vec<f64> {
        let independent = &self.dependence.independent;
        let gamma = self.table.autocovariances(self.output, independent, values);
        let once = self.table.once(self.output, independent, values, &self.rows);
        let rows = self.rows.len();
        let power = |f: &f64| {
            let angle = 2.0 * std::f64::consts::PI * f * self.table.sample_interval_s;
            let lags = gamma.iter().take(rows).enumerate().map(|(l, g)| {
                let both = if l == 0 { 1.0 } else { 2.0 };
                both * (rows - l) as f64 * g * (angle * l as f64).cos()
            });
            let single = once.iter().map(|e| {
                let (re, im) = e.iter().enumerate().fold((0.0, 0.0), |(re, im), (i, e)| {
                    let (sin, cos) = (angle * i as f64).sin_cos();
                    (re + e * cos, im + e * sin)
                });
                re * re + im * im
            });
            lags.chain(single).sum()
        };
        frequencies_hz.iter().map(power).collect()
    }

    fn length_s(&self) -> f64 {
        self.rows.len() as f64 * self.table.sample_interval_s
    }

    /// Takes the covariance that the colour of the errors gives, where that is known, for the one of the scores; degrees of
    /// freedom are those of the residuals' level. Rows that were divided by a standard deviation each have its colour
    /// when they are.
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
        let degrees = (self.x.nrows() - values.len()) as f64;
        match coloured(&scaled, bread, residuals.as_slice(), &gamma, &once) {
            Some(Coloured { covariance, degrees }) => Solved { values, covariance, degrees },
            None => Solved { values, covariance, degrees },
        }
    }

    /// Error covariance of the independent columns and the output at an instant; where none is known, of the output alone.
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
        let mut full = DVector::zeros(self.x.ncols());
        for (position, column) in self.dependence.independent.iter().enumerate() {
            full[*column] = values[position];
        }
        let everything: Vec<usize> = (0..self.table.t_s.len()).collect();
        let offset = self.origin.1 - self.origin.0.dot(&full);
        let fitted: Vec<f64> =
            (rows_of(self.output, &everything) * &full).iter().map(|v| v + offset).collect();
        let diagnostics = self.diagnostics(basis, &solved.covariance, &fitted)?;
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
            fitted,
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
                combinations.push(Combination { text, value, std });
            }
        }
        (parameters, combinations)
    }

    fn diagnostics(
        &self,
        basis: &DMatrix<f64>,
        covariance: &DMatrix<f64>,
        fitted: &[f64],
    ) -> Result<Diagnostics, IdentifyError> {
        let pick = |rows: &[usize]| -> (Vec<f64>, Vec<f64>) {
            rows.iter().map(|i| (self.output.values[*i], fitted[*i])).unzip()
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
