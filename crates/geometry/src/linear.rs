//! Steps that linear estimators share.

use nalgebra::{Matrix2, SVector};

/// W with Wᵀ W = covariance⁻¹, which makes errors of that covariance independent and of unit variance; `None`
/// for a covariance that is not finite and positive definite.
pub fn whitener(covariance: &Matrix2<f64>) -> Option<Matrix2<f64>> {
    let inverse = covariance.cholesky()?.l().try_inverse()?;
    inverse.iter().all(|x| x.is_finite()).then_some(inverse)
}

/// Mean of points, and root mean square of a coordinate about it: the shift and scale of Hartley's
/// normalisation (1997).
pub fn centroid_and_spread<const D: usize>(
    points: impl ExactSizeIterator<Item = SVector<f64, D>> + Clone,
) -> (SVector<f64, D>, f64) {
    let n = points.len() as f64;
    let mean = points.clone().sum::<SVector<f64, D>>() / n;
    let square = points.map(|p| (p - mean).norm_squared()).sum::<f64>() / (n * D as f64);
    (mean, square.sqrt())
}
