//! Positive definite matrices, scaled to a unit diagonal on the way.

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
