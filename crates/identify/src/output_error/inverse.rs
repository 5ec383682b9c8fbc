//! Inverse of a positive definite matrix.

use nalgebra::{DMatrix, DVector};

/// Inverse of a positive definite matrix, scaled to a unit diagonal on the way.
pub(crate) fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let scale = DVector::from_fn(n, |i, _| 1.0 / a[(i, i)].sqrt());
    let scaled = DMatrix::from_fn(n, n, |i, j| 0.5 * (a[(i, j)] + a[(j, i)]) * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    let out = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    out.iter().all(|v| v.is_finite()).then_some(out)
}
