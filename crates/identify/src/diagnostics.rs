//! How well rows determine a fit, and how well the fit says them.

use crate::orthogonal::Factored;
use crate::{IdentifyError, least_squares::check};
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::{DMatrix, DVector};

/// How well the columns of a fit are distinguished.
#[derive(Debug, Clone, PartialEq)]
pub struct Collinearity {
    /// Singular values of the columns, each scaled to length one, descending.
    pub singular_values: DVector<f64>,
    /// The largest over each (Belsley, Kuh & Welsch 1980, section 3.2); the last is the condition number.
    pub condition_indices: DVector<f64>,
    /// Share of each parameter's variance (column) that goes with each singular value (row). Two or more
    /// above a half in a row of a condition index above 30 are entangled parameters (same, section 3.3).
    pub variance_proportions: DMatrix<f64>,
    /// By how much each parameter's variance exceeds that without the other columns; about the mean for
    /// columns next to a constant one (Marquardt 1970).
    pub variance_inflation: DVector<f64>,
}

/// Finds how well columns are distinguished.
///
/// # Errors
/// Numbers that are not finite, or a column of zeros or rank that is deficient
/// ([`crate::independent_columns`] finds it).
pub fn collinearity(columns: &DMatrix<f64>) -> Result<Collinearity, IdentifyError> {
    let (rows, count) = columns.shape();
    check(columns, &DVector::zeros(rows))?;
    let lengths: Vec<f64> = columns.column_iter().map(|c| c.norm()).collect();
    if lengths.contains(&0.0) {
        return Err(IdentifyError::RankZero);
    }
    let scaled = DMatrix::from_fn(rows, count, |i, j| columns[(i, j)] / lengths[j]);
    let svd = jacobi_svd(&scaled.qr().r());
    if svd.singular_values[count - 1] == 0.0 {
        return Err(IdentifyError::RankZero);
    }
    let parts = DMatrix::from_fn(count, count, |k, j| (svd.v[(j, k)] / svd.singular_values[k]).powi(2));
    let variance_proportions = DMatrix::from_fn(count, count, |k, j| parts[(k, j)] / parts.column(j).sum());
    let inverse = Factored::new(columns)?.inverse_gram()?;
    let constant = |j: usize| columns.column(j).iter().all(|v| *v == columns[(0, j)]);
    let with_constant = (0..count).any(constant);
    let variance_inflation = DVector::from_fn(count, |j, _| {
        let column = columns.column(j);
        let alone = if with_constant && !constant(j) {
            column.add_scalar(-column.mean()).norm_squared()
        } else {
            column.norm_squared()
        };
        (inverse[(j, j)] * alone).max(1.0)
    });
    Ok(Collinearity {
        condition_indices: svd.singular_values.map(|s| svd.singular_values[0] / s),
        singular_values: svd.singular_values,
        variance_proportions,
        variance_inflation,
    })
}

impl Collinearity {
    /// Groups of columns that trade against each other: two or more with shares above a half in one condition
    /// index above `threshold`.
    pub fn entangled(&self, threshold: f64) -> Vec<Vec<usize>> {
        let count = self.condition_indices.len();
        let group = |k: usize| (0..count).filter(move |j| self.variance_proportions[(k, *j)] > 0.5).collect();
        let strong = (0..count).filter(|k| self.condition_indices[*k] > threshold);
        strong.map(group).filter(|group: &Vec<usize>| group.len() > 1).collect()
    }
}

/// Correlations of parameters from their covariance; zero next to one that has no variance.
pub fn correlations(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let std = covariance.diagonal().map(|v| v.max(0.0).sqrt());
    DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        if i == j {
            1.0
        } else if std[i] > 0.0 && std[j] > 0.0 {
            (covariance[(i, j)] / (std[i] * std[j])).clamp(-1.0, 1.0)
        } else {
            0.0
        }
    })
}

/// Autocorrelations of residuals about their mean at lags 1, 2, ... up to `lags`; for white ones 95 % lie
/// within ± 1.96/√n (Box & Jenkins 1976, section 6.2.2).
pub fn autocorrelations(residuals: &[f64], lags: usize) -> Vec<f64> {
    let n = residuals.len();
    let mean = residuals.iter().sum::<f64>() / n.max(1) as f64;
    let sum =
        |lag: usize| -> f64 { (lag..n).map(|i| (residuals[i] - mean) * (residuals[i - lag] - mean)).sum() };
    let variance = sum(0);
    (1..=lags.min(n.saturating_sub(1)))
        .map(|lag| if variance > 0.0 { sum(lag) / variance } else { 0.0 })
        .collect()
}

/// How near a fit or a prediction comes to what was measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// Instants compared.
    pub count: usize,
    /// Share of the variance about the mean that is explained; negative where the mean would do better.
    pub r2: f64,
    /// Root mean square difference.
    pub rms: f64,
    /// Largest difference.
    pub max: f64,
    /// Theil's inequality coefficient: the root mean square difference over the sum of both root mean
    /// squares, 0 for equal, 1 for unrelated series (Theil 1961); below 0.25 to 0.3 counts as good
    /// (Jategaonkar 2015, section 11.3.3).
    pub theil: f64,
}

/// Compares a measured series with a fitted or predicted one; the shorter decides how many. Empty series
/// agree in nothing.
pub fn agreement(measured: &[f64], predicted: &[f64]) -> Agreement {
    let count = measured.len().min(predicted.len());
    if count == 0 {
        return Agreement::default();
    }
    let (y, z) = (DVector::from_row_slice(&measured[..count]), DVector::from_row_slice(&predicted[..count]));
    let n = count as f64;
    let difference = &y - &z;
    let mean_square = difference.norm_squared() / n;
    let variance = y.add_scalar(-y.mean()).norm_squared() / n;
    let sizes = (y.norm() + z.norm()) / n.sqrt();
    Agreement {
        count,
        r2: if variance > 0.0 { 1.0 - mean_square / variance } else { 0.0 },
        rms: mean_square.sqrt(),
        max: difference.amax(),
        theil: if sizes > 0.0 { mean_square.sqrt() / sizes } else { 0.0 },
    }
}

/// Sum of squares of the prediction error of rows when they are left out, in blocks of consecutive rows.
///
/// A block of one is PRESS (Allen 1974); where neighbours' errors are correlated, a block about as long as
/// that keeps too large models from looking good (Burman, Chow & Nolan 1994). Formed from one fit: the
/// block's prediction error is (I - H)⁻¹ e with H its part of the hat matrix. Infinite where a block's rows
/// alone hold a parameter.
///
/// # Errors
/// The errors of [`crate::least_squares`].
pub fn press(regressors: &DMatrix<f64>, output: &DVector<f64>, block: usize) -> Result<f64, IdentifyError> {
    check(regressors, output)?;
    let factored = Factored::new(regressors)?;
    let (_, residuals) = factored.solve(output)?;
    let (rows, block) = (output.len(), block.max(1));
    let mut sum = 0.0;
    for start in (0..rows).step_by(block) {
        let size = block.min(rows - start);
        let q = factored.q.rows(start, size);
        let left = DMatrix::identity(size, size) - q * q.transpose();
        let own = residuals.rows(start, size).into_owned();
        let Some(factor) = left.cholesky().filter(|c| c.l_dirty().diagonal().min() > 1e-7) else {
            return Ok(f64::INFINITY);
        };
        sum += factor.solve(&own).norm_squared();
    }
    Ok(sum)
}

#[cfg(test)]
mod tests;
