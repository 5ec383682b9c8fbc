//! Total least squares: regression where regressors have errors as well as the output.

use crate::IdentifyError;
use crate::inverse::inverse_of_scaled;
use crate::least_squares::{check, weighted_least_squares};
use crate::robust_covariance::Correlation;
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Steps at most; each gains some digits in proportion to how small errors are.
const MAX_STEPS: usize = 100;
/// Change of the sum, relative, below which a step is one of a millionth of a standard deviation or less.
const NEGLIGIBLE: f64 = 1e-15;
/// Halvings of a step that makes the sum of squares grow.
const MAX_HALVINGS: usize = 30;

/// A total least-squares fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TotalLeastSquares {
    /// One value a column.
    pub values: DVector<f64>,
    /// Covariance of the values.
    pub covariance: DMatrix<f64>,
    /// Output less fit at the measured regressors.
    pub residuals: DVector<f64>,
    /// Standard deviation of each residual by the given covariance.
    pub std: DVector<f64>,
    /// M⁻¹, the inverse of AᵀA less what the errors add to it, of rows divided by `std`.
    pub inverse_moment: DMatrix<f64>,
    /// Variance of the errors over that of the given covariance; one where that was right.
    pub level: f64,
    /// Singular values of the noisy columns and the output, in units of their errors, after exact columns are
    /// taken out; of rows that differ only the root of the sum of squares of residuals over `std`.
    pub singular_values: DVector<f64>,
}

/// Fits `output` by `regressors` of which each row, with its output last, carries an error of covariance
/// `errors` times an unknown factor; a column whose row of `errors` is zero is exact.
///
/// Exact columns are taken out by QR, the rest, whitened by its error covariance, is solved by the smallest
/// singular vector of what remains (Golub, Hoffman & Stewart 1987; Van Huffel & Vandewalle 1991, algorithm
/// 3.2). Consistent where least squares is biased by errors in the regressors; `errors` must be right up to
/// its factor, which is estimated. With no noisy column it is least squares.
///
/// Covariance after Fuller (1987, sections 2.2 and 2.3) and Gleser (1981): with v the residuals, σ² their
/// variance, M = AᵀA - nΣ_aa and s = Σ_ay - Σ_aa x, the weighted sum of products of the scores
/// a_i v_i - s v_i²/σ² between M⁻¹.
///
/// # Errors
/// The errors of [`crate::least_squares`]; [`IdentifyError::BadErrors`] for an `errors` that is not a
/// covariance or leaves the output exact; [`IdentifyError::NonGeneric`] where no solution exists.
pub fn total_least_squares(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    errors: &DMatrix<f64>,
    correlation: Correlation,
) -> Result<TotalLeastSquares, IdentifyError> {
    check(regressors, output)?;
    let EqualRows { values, singular_values } = EqualRows::solve(regressors, output, errors)?;
    let problem = Problem { regressors, output, errors: &|_| errors.clone() };
    let state = problem.at(&values)?;
    Ok(TotalLeastSquares { singular_values, ..problem.finish(values, state, correlation)? })
}

/// Fits `output` by `regressors` of which row i, with its output last, carries an error of covariance
/// `errors[i]` times a factor common to all rows: the maximum of the likelihood with the true regressors as
/// unknowns.
///
/// Minimises Σ v_i²/σ_i² with v_i = y_i - a_i x and σ_i² the variance of v_i, which is orthogonal distance
/// regression of a linear model (Boggs, Byrd & Schnabel 1987) and element-wise weighted total least squares
/// (Markovsky & Van Huffel 2006). Gauss-Newton steps, which regress v_i on the corrected regressors
/// a_i - s_i v_i/σ_i² with s_i = Σ_ay - Σ_aa x, begin at [`total_least_squares`] with the mean covariance.
/// Covariance by the scores, as there; `level` is Σ v_i²/σ_i² over the degrees of freedom.
///
/// Zero rows of every covariance mark exact columns. Valid where errors are small beside what the corrected
/// regressors vary by.
///
/// # Errors
/// Columns that [`crate::least_squares`] refuses; [`IdentifyError::BadErrors`] for a covariance of the wrong
/// size, not finite, with negative variances, or one that leaves a residual without error;
/// [`IdentifyError::NotConverged`].
pub fn total_least_squares_by_row(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    errors: &[DMatrix<f64>],
    correlation: Correlation,
) -> Result<TotalLeastSquares, IdentifyError> {
    if errors.len() != regressors.nrows() {
        return Err(IdentifyError::BadErrors { what: ONE_A_ROW, columns: regressors.ncols() });
    }
    by_row(regressors, output, &|i| errors[i].clone(), correlation)
}

/// [`total_least_squares_by_row`] with covariances that are formed on demand.
pub(crate) fn by_row(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    errors: ErrorsOf<'_>,
    correlation: Correlation,
) -> Result<TotalLeastSquares, IdentifyError> {
    check(regressors, output)?;
    let problem = Problem { regressors, output, errors };
    problem.check()?;
    let mut x = problem.start()?;
    let mut state = problem.at(&x)?;
    for _ in 0..MAX_STEPS {
        let mut step = state.step()?;
        // The change of Σ v²/σ² that the step promises.
        let promise = step.dot(&state.score()).abs();
        let mut next = problem.at(&(&x + &step))?;
        let mut halvings = 0;
        while next.sum() > state.sum() * (1.0 + 1e-14) && halvings < MAX_HALVINGS {
            step *= 0.5;
            halvings += 1;
            next = problem.at(&(&x + &step))?;
        }
        if halvings < MAX_HALVINGS {
            x += step;
            state = next;
        }
        if promise <= NEGLIGIBLE * state.sum() || halvings == MAX_HALVINGS {
            return problem.finish(x, state, correlation);
        }
    }
    Err(IdentifyError::NotConverged { what: "total least squares by rows", steps: MAX_STEPS })
}

/// Values of rows with errors of one covariance, of which some columns are exact.
struct EqualRows {
    values: DVector<f64>,
    /// Of what is left of the whitened columns.
    singular_values: DVector<f64>,
}

impl EqualRows {
    fn solve(
        regressors: &DMatrix<f64>,
        output: &DVector<f64>,
        errors: &DMatrix<f64>,
    ) -> Result<Self, IdentifyError> {
        let (rows, count) = regressors.shape();
        let bad = |what: &'static str| IdentifyError::BadErrors { what, columns: count };
        if errors.shape() != (count + 1, count + 1) || !errors.iter().all(|v| v.is_finite()) {
            return Err(bad("must be finite, square, with one row a column and one for the output"));
        }
        if (errors - errors.transpose()).amax() > 1e-9 * errors.amax() {
            return Err(bad("must be symmetric"));
        }
        let is_exact = |j: &usize| errors.row(*j).iter().all(|v| *v == 0.0);
        if is_exact(&count) {
            return Err(bad("must leave the output an error: total least squares needs one"));
        }
        let (exact, noisy): (Vec<usize>, Vec<usize>) = (0..count).partition(is_exact);
        let (k, m) = (exact.len(), noisy.len());
        let kept: Vec<usize> = noisy.iter().copied().chain([count]).collect();
        // L of Σ = L Lᵀ whitens the noisy columns and the output.
        let lower = Cholesky::new(errors.select_rows(&kept).select_columns(&kept));
        let lower =
            lower.ok_or_else(|| bad("must be positive definite in its columns that are not exact"))?;
        let lower = lower.unpack();
        let mut whitened = regressors.select_columns(&noisy).transpose().insert_row(m, 0.0);
        whitened.set_row(m, &output.transpose());
        let whitened = lower.solve_lower_triangular(&whitened).ok_or(IdentifyError::RankZero)?;
        let mut all = regressors.select_columns(&exact).resize_horizontally(k + m + 1, 0.0);
        all.columns_mut(k, m + 1).copy_from(&whitened.transpose());
        let r = all.qr().r();
        let size = (rows - k).min(m + 1);
        let svd = jacobi_svd(&r.view((k, k), (size, m + 1)).into_owned());
        let smallest = svd.v.column(m);
        let null = lower.tr_solve_lower_triangular(&smallest).ok_or(IdentifyError::RankZero)?;
        // The share of the output, in units of its error.
        let part = (null[m] * lower[(m, m)]).abs();
        if part < 1e-10 {
            return Err(IdentifyError::NonGeneric(part));
        }
        // E c = y - A x = [A y] null / null_y.
        let right = r.view((0, k), (k, m + 1)) * smallest / null[m];
        let of_exact =
            r.view((0, 0), (k, k)).solve_upper_triangular(&right).ok_or(IdentifyError::RankZero)?;
        let mut values = DVector::zeros(count);
        exact.iter().zip(&of_exact).for_each(|(j, value)| values[*j] = *value);
        noisy.iter().zip(&null).for_each(|(j, part)| values[*j] = -part / null[m]);
        if !values.iter().all(|v: &f64| v.is_finite()) {
            return Err(IdentifyError::RankZero);
        }
        Ok(Self { values, singular_values: svd.singular_values })
    }
}

const ONE_A_ROW: &str = "must be one matrix a row, with one row a column and one for the output";

type ErrorsOf<'a> = &'a dyn Fn(usize) -> DMatrix<f64>;

struct Problem<'a> {
    regressors: &'a DMatrix<f64>,
    output: &'a DVector<f64>,
    errors: ErrorsOf<'a>,
}

struct State {
    /// v/σ.
    residuals: DVector<f64>,
    /// Corrected regressors over σ.
    corrected: DMatrix<f64>,
    /// σ.
    std: DVector<f64>,
}

impl State {
    /// Σ v²/σ².
    fn sum(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Half the negative gradient.
    fn score(&self) -> DVector<f64> {
        self.corrected.tr_mul(&self.residuals)
    }

    fn step(&self) -> Result<DVector<f64>, IdentifyError> {
        let qr = self.corrected.clone().qr();
        let step = qr.r().solve_upper_triangular(&qr.q().tr_mul(&self.residuals));
        step.filter(|s| s.iter().all(|v| v.is_finite())).ok_or(IdentifyError::RankZero)
    }
}

impl Problem<'_> {
    /// The covariances of all rows, one at a time.
    fn each_errors(&self) -> impl Iterator<Item = DMatrix<f64>> {
        (0..self.output.len()).map(|i| (self.errors)(i))
    }

    fn bad(&self, what: &'static str) -> IdentifyError {
        IdentifyError::BadErrors { what, columns: self.regressors.ncols() }
    }

    fn check(&self) -> Result<(), IdentifyError> {
        let count = self.regressors.ncols();
        for e in self.each_errors() {
            if e.shape() != (count + 1, count + 1) {
                return Err(self.bad(ONE_A_ROW));
            }
            if !e.iter().all(|v| v.is_finite()) || e.diagonal().iter().any(|v| *v < 0.0) {
                return Err(self.bad("must be finite with variances that are not negative"));
            }
            if e[(count, count)] == 0.0 {
                return Err(self.bad("must leave the output an error: total least squares needs one"));
            }
        }
        Ok(())
    }

    fn at(&self, x: &DVector<f64>) -> Result<State, IdentifyError> {
        let (rows, count) = self.regressors.shape();
        let mut residuals = self.output - self.regressors * x;
        let mut corrected = self.regressors.clone();
        let mut std = DVector::zeros(rows);
        // Of v = y - a x.
        let weights = x.map(|v| -v).push(1.0);
        for (i, errors) in self.each_errors().enumerate() {
            let shared = errors * &weights;
            let variance = shared.dot(&weights);
            if variance.is_nan() || variance <= 0.0 {
                return Err(self.bad("must be positive definite: a residual has no error"));
            }
            std[i] = variance.sqrt();
            let correction = shared.rows(0, count).transpose() * (residuals[i] / variance);
            corrected.set_row(i, &((corrected.row(i) - correction) / std[i]));
            residuals[i] /= std[i];
        }
        Ok(State { residuals, corrected, std })
    }

    /// Total least squares with the mean covariance, or weighted least squares where that has no answer.
    fn start(&self) -> Result<DVector<f64>, IdentifyError> {
        let (rows, count) = self.regressors.shape();
        let zero = DMatrix::zeros(count + 1, count + 1);
        let mean = self.each_errors().fold(zero, |sum, errors| sum + errors / rows as f64);
        if let Ok(equal) = EqualRows::solve(self.regressors, self.output, &mean) {
            return Ok(equal.values);
        }
        let output_std: Vec<f64> = self.each_errors().map(|e| e[(count, count)].sqrt()).collect();
        Ok(weighted_least_squares(self.regressors, self.output, &output_std, Correlation::White)?.values)
    }

    fn finish(
        &self,
        values: DVector<f64>,
        state: State,
        correlation: Correlation,
    ) -> Result<TotalLeastSquares, IdentifyError> {
        let (rows, count) = self.regressors.shape();
        let level = state.sum() / (rows - count) as f64;
        // M = Σ (a aᵀ - Σ_aa)/σ², the part of the scores' derivative that does not vanish in the mean.
        let scaled = DMatrix::from_fn(rows, count, |i, j| self.regressors[(i, j)] / state.std[i]);
        let mut m = scaled.tr_mul(&scaled);
        for (errors, std) in self.each_errors().zip(&state.std) {
            m -= errors.view((0, 0), (count, count)) * (level / (std * std));
        }
        let inverse = inverse_of_scaled(&m, &scaled)?;
        let scores = DMatrix::from_fn(rows, count, |i, j| state.corrected[(i, j)] * state.residuals[i]);
        Ok(TotalLeastSquares {
            covariance: &inverse * correlation.sum(&scores) * &inverse,
            inverse_moment: inverse,
            residuals: self.output - self.regressors * &values,
            values,
            level,
            singular_values: DVector::from_element(1, state.sum().sqrt()),
            std: state.std,
        })
    }
}

#[cfg(test)]
mod tests;
