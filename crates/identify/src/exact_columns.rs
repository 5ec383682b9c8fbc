//! Total least squares of rows with errors of one covariance, of which some columns are exact.

use crate::IdentifyError;
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Columns that are exact and those that are not, with the triangle that whitens the latter and the output.
pub(crate) struct Split {
    exact: Vec<usize>,
    noisy: Vec<usize>,
    /// L of Σ = L Lᵀ.
    lower: DMatrix<f64>,
}

pub(crate) struct Solution {
    pub(crate) values: DVector<f64>,
    /// Of what is left of the whitened columns.
    pub(crate) singular_values: DVector<f64>,
}

impl Split {
    pub(crate) fn new(count: usize, errors: &DMatrix<f64>) -> Result<Self, IdentifyError> {
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
        let kept: Vec<usize> = noisy.iter().copied().chain([count]).collect();
        let lower = Cholesky::new(errors.select_rows(&kept).select_columns(&kept))
            .ok_or_else(|| bad("must be positive definite in its columns that are not exact"))?
            .unpack();
        Ok(Self { exact, noisy, lower })
    }

    pub(crate) fn solve(
        &self,
        regressors: &DMatrix<f64>,
        output: &DVector<f64>,
    ) -> Result<Solution, IdentifyError> {
        let rows = regressors.nrows();
        let (k, m) = (self.exact.len(), self.noisy.len());
        let mut noisy = regressors.select_columns(&self.noisy).transpose().insert_row(m, 0.0);
        noisy.set_row(m, &output.transpose());
        let whitened = self.lower.solve_lower_triangular(&noisy).ok_or(IdentifyError::RankZero)?;
        let mut all = regressors.select_columns(&self.exact).resize_horizontally(k + m + 1, 0.0);
        all.columns_mut(k, m + 1).copy_from(&whitened.transpose());
        let r = all.qr().r();
        let size = (rows - k).min(m + 1);
        let svd = jacobi_svd(&r.view((k, k), (size, m + 1)).into_owned());
        let smallest = svd.v.column(m);
        let null = self.lower.tr_solve_lower_triangular(&smallest).ok_or(IdentifyError::RankZero)?;
        // The share of the output, in units of its error.
        let part = (null[m] * self.lower[(m, m)]).abs();
        if part < 1e-10 {
            return Err(IdentifyError::NonGeneric(part));
        }
        // E c = y - A x = [A y] null / null_y.
        let right = r.view((0, k), (k, m + 1)) * smallest / null[m];
        let triangle = r.view((0, 0), (k, k));
        let exact = triangle.solve_upper_triangular(&right).ok_or(IdentifyError::RankZero)?;
        let mut values = DVector::zeros(k + m);
        self.exact.iter().zip(&exact).for_each(|(j, value)| values[*j] = *value);
        self.noisy.iter().zip(&null).for_each(|(j, part)| values[*j] = -part / null[m]);
        if !values.iter().all(|v: &f64| v.is_finite()) {
            return Err(IdentifyError::RankZero);
        }
        Ok(Solution { values, singular_values: svd.singular_values })
    }
}
