//! Total least squares with exact columns.

use crate::IdentifyError;
use crate::inverse::inverse_of_scaled;
use crate::least_squares::check;
use crate::robust_covariance::Correlation;
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::{Cholesky, DMatrix, DVector};

/// A total least-squares fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TotalLeastSquares {
    /// One value a column.
    pub values: DVector<f64>,
    /// Covariance of the values.
    pub covariance: DMatrix<f64>,
    /// M⁻¹, the inverse of AᵀA less what the errors add to it.
    pub inverse_moment: DMatrix<f64>,
    /// Output less fit at the measured regressors.
    pub residuals: DVector<f64>,
    /// Variance of the errors over that of the given covariance, from the smallest singular value; one where
    /// that covariance was right.
    pub level: f64,
    /// Singular values of the noisy columns and the output, in units of their errors, after exact columns are
    /// taken out.
    pub singular_values: DVector<f64>,
}

/// Covariance of errors that are independent from column to column: those of the regressors, then of the
/// output.
pub fn independent_errors(column_std: &[f64], output_std: f64) -> DMatrix<f64> {
    let all = column_std.iter().chain([&output_std]).map(|s| s * s);
    DMatrix::from_diagonal(&DVector::from_iterator(column_std.len() + 1, all))
}

/// Fits `output` by `regressors` of which each row, with its output last, carries an error of covariance
/// `errors` times an unknown factor; a column whose row of `errors` is zero is exact.
///
/// Exact columns are taken out by QR, the rest, whitened by its error covariance, is solved by the smallest
/// singular vector of what remains (Golub, Hoffman & Stewart 1987; Van Huffel & Vandewalle 1991, algorithm
/// 3.2). Consistent where least squares is biased by errors in the regressors; `errors` must be right up to
/// its factor, which is estimated. With no noisy column it is least squares.
///
/// Covariance after Fuller (1987, sections 2.2 and 2.3) and Gleser (1981), normal errors: with v the
/// residuals, M = AᵀA - nΣ_aa and s = Σ_ay - Σ_aa x, white errors give M⁻¹[σ_v² M + n(σ_v² Σ_aa - s sᵀ)]M⁻¹,
/// others the weighted sum of products of the scores a_i v_i - s v_i²/σ_v² between M⁻¹.
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
    let split = Split::new(regressors.ncols(), errors)?;
    let (values, singular_values) = split.solve(regressors, output)?;
    let last = singular_values.len() - 1;
    let degrees = (regressors.nrows() - regressors.ncols()).max(1);
    let level = singular_values[last].powi(2) / degrees as f64;
    let residuals = output - regressors * &values;
    let (covariance, inverse_moment) =
        covariance(regressors, &values, &residuals, &(errors * level), correlation)?;
    Ok(TotalLeastSquares { values, covariance, inverse_moment, residuals, level, singular_values })
}

/// Columns that are exact and those that are not, with the triangle that whitens the latter and the output.
struct Split {
    exact: Vec<usize>,
    noisy: Vec<usize>,
    /// L of Σ = L Lᵀ.
    lower: DMatrix<f64>,
}

impl Split {
    fn new(count: usize, errors: &DMatrix<f64>) -> Result<Self, IdentifyError> {
        let bad = |what: &'static str| IdentifyError::BadErrors { what, columns: count };
        if errors.shape() != (count + 1, count + 1) || !errors.iter().all(|v| v.is_finite()) {
            return Err(bad("must be finite, square, with one row a column and one for the output"));
        }
        if (errors - errors.transpose()).amax() > 1e-9 * errors.amax() {
            return Err(bad("must be symmetric"));
        }
        let is_exact = |j: usize| errors.row(j).iter().all(|v| *v == 0.0);
        if is_exact(count) {
            return Err(bad("must leave the output an error: total least squares needs one"));
        }
        let exact: Vec<usize> = (0..count).filter(|j| is_exact(*j)).collect();
        let noisy: Vec<usize> = (0..count).filter(|j| !is_exact(*j)).collect();
        let kept: Vec<usize> = noisy.iter().copied().chain([count]).collect();
        let block = errors.select_rows(&kept).select_columns(&kept);
        let lower = Cholesky::new(block)
            .ok_or_else(|| bad("must be positive definite in its columns that are not exact"))?
            .unpack();
        Ok(Self { exact, noisy, lower })
    }

    /// Values, and the singular values of what is left of the whitened columns.
    fn solve(
        &self,
        regressors: &DMatrix<f64>,
        output: &DVector<f64>,
    ) -> Result<(DVector<f64>, DVector<f64>), IdentifyError> {
        let rows = regressors.nrows();
        let (k, m) = (self.exact.len(), self.noisy.len());
        let scales: Vec<f64> = self.exact.iter().map(|j| regressors.column(*j).norm()).collect();
        let mut all = DMatrix::zeros(rows, k + m + 1);
        for (position, (j, scale)) in self.exact.iter().zip(&scales).enumerate() {
            all.set_column(position, &(regressors.column(*j) / *scale));
        }
        let mut noisy = regressors.select_columns(&self.noisy).transpose().insert_row(m, 0.0);
        noisy.set_row(m, &output.transpose());
        let whitened = self.lower.solve_lower_triangular(&noisy).ok_or(IdentifyError::RankZero)?;
        all.columns_mut(k, m + 1).copy_from(&whitened.transpose());
        let r = all.qr().r();
        let size = (rows - k).min(m + 1);
        let svd = jacobi_svd(&r.view((k, k), (size, m + 1)).into_owned());
        let smallest = svd.v.column(m);
        let null = self.lower.tr_solve_lower_triangular(&smallest).ok_or(IdentifyError::RankZero)?;
        // The share of the output, in units of its error.
        let part = (null[m] * self.lower[(m, m)]).abs();
        if part < 1e-10 {
            return Err(IdentifyError::NonGeneric { part });
        }
        let noisy = null.rows(0, m) / -null[m];
        let mut values = DVector::zeros(k + m);
        for (position, j) in self.noisy.iter().enumerate() {
            values[*j] = noisy[position];
        }
        if k > 0 {
            // E c = y - A x = [A y] null / null_y.
            let right = r.view((0, k), (k, m + 1)) * smallest / null[m];
            let triangle = r.view((0, 0), (k, k));
            let exact = triangle.solve_upper_triangular(&right).ok_or(IdentifyError::RankZero)?;
            for (position, j) in self.exact.iter().enumerate() {
                values[*j] = exact[position] / scales[position];
            }
        }
        if !values.iter().all(|v| v.is_finite()) {
            return Err(IdentifyError::RankZero);
        }
        Ok((values, svd.singular_values))
    }
}

/// Fuller's covariance, and M⁻¹, of values fitted to rows whose errors, output last, have the given
/// covariance.
fn covariance(
    regressors: &DMatrix<f64>,
    values: &DVector<f64>,
    residuals: &DVector<f64>,
    errors: &DMatrix<f64>,
    correlation: Correlation,
) -> Result<(DMatrix<f64>, DMatrix<f64>), IdentifyError> {
    let (rows, count) = regressors.shape();
    let n = rows as f64;
    let in_regressors = errors.view((0, 0), (count, count)).into_owned();
    let with_output = errors.view((0, count), (count, 1)).column(0).into_owned();
    let m = regressors.tr_mul(regressors) - &in_regressors * n;
    let shared = &with_output - &in_regressors * values;
    let variance = errors[(count, count)] - (&with_output + &shared).dot(values);
    let inverse = inverse_of_scaled(&m, regressors)?;
    let middle = match correlation {
        Correlation::White => m * variance + (in_regressors * variance - &shared * shared.transpose()) * n,
        _ => {
            let per_square = &shared / variance;
            let scores = DMatrix::from_fn(rows, count, |i, j| {
                regressors[(i, j)] * residuals[i] - per_square[j] * residuals[i].powi(2)
            });
            correlation.sum(&scores)
        }
    };
    Ok((&inverse * middle * &inverse, inverse))
}

#[cfg(test)]
mod tests;
