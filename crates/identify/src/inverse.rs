//! Symmetric matrices, scaled on the way.

use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};

/// The symmetric part of a matrix with a unit diagonal, and the factors of rows and columns that make it so.
fn scaled(a: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let scale = a.diagonal().map(|d| 1.0 / d.sqrt());
    (((a + a.transpose()) * 0.5).component_mul(&(&scale * scale.transpose())), scale)
}

/// The inverse of a positive definite matrix; none of any other.
pub(crate) fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (scaled, scale) = scaled(a);
    let out = scaled.cholesky()?.inverse().component_mul(&(&scale * scale.transpose()));
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// Logarithm of the determinant of a positive definite matrix; none of any other.
pub(crate) fn log_determinant(a: &DMatrix<f64>) -> Option<f64> {
    let (scaled, scale) = scaled(a);
    Some(scaled.cholesky()?.ln_determinant() - 2.0 * scale.map(f64::ln).sum())
}

/// The inverse of a symmetric matrix of the size of AᵀA, which scaling by A's columns keeps from being worse
/// than it is.
pub(crate) fn inverse_of_scaled(
    matrix: &DMatrix<f64>,
    columns: &DMatrix<f64>,
) -> Result<DMatrix<f64>, IdentifyError> {
    let scale = DVector::from_iterator(columns.ncols(), columns.column_iter().map(|c| c.norm().recip()));
    let both = &scale * scale.transpose();
    let inverse = matrix.component_mul(&both).try_inverse().filter(|m| m.iter().all(|v| v.is_finite()));
    Ok(inverse.ok_or(IdentifyError::RankZero)?.component_mul(&both))
}
