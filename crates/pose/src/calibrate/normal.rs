//! Factors of a normal matrix whose parameters have different units.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// The Cholesky factor of a normal matrix that is scaled to a unit diagonal.
pub(super) struct Factored {
    scale: DVector<f64>,
    scaled: Cholesky<f64, Dyn>,
    /// Log determinant of the matrix as it was given.
    pub(super) log_determinant: f64,
}

impl Factored {
    /// Factors a matrix with its diagonal enlarged by a part `damping` of itself; `None` where it is not
    /// positive definite.
    pub(super) fn new(normal: &DMatrix<f64>, damping: f64) -> Option<Self> {
        let scale = normal.diagonal().map(|d| 1.0 / (d * (1.0 + damping)).sqrt());
        if !scale.iter().all(|s| s.is_finite()) {
            return None;
        }
        let mut scaled = normal.component_mul(&(&scale * scale.transpose()));
        scaled.fill_diagonal(1.0);
        let scaled = scaled.cholesky()?;
        let log_determinant = scaled.ln_determinant() - 2.0 * scale.map(f64::ln).sum();
        log_determinant.is_finite().then_some(Self { scale, scaled, log_determinant })
    }

    pub(super) fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        self.scaled.solve(&right.component_mul(&self.scale)).component_mul(&self.scale)
    }

    pub(super) fn inverse(&self) -> DMatrix<f64> {
        self.scaled.inverse().component_mul(&(&self.scale * self.scale.transpose()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal() -> DMatrix<f64> {
        let mut jacobian = DMatrix::<f64>::zeros(60, 21);
        let mut seed = 5;
        for row in 0..60 {
            let (point, camera) = (row / 15, row % 3);
            let mut number = || crate::testing::normal(&mut seed);
            (0..3).for_each(|k| jacobian[(row, 3 * camera + k)] = number() * 10f64.powi(k as i32 - 1));
            (0..3).for_each(|k| jacobian[(row, 9 + 3 * point + k)] = number());
        }
        jacobian.tr_mul(&jacobian)
    }

    #[test]
    fn the_scaled_factor_agrees_with_the_matrix_as_it_is() {
        let normal = normal();
        let right = DVector::from_fn(21, |i, _| (i as f64).cos());
        for damping in [0.0, 0.3] {
            let mut dense = normal.clone();
            (0..21).for_each(|k| dense[(k, k)] *= 1.0 + damping);
            let got = Factored::new(&normal, damping).expect("positive");
            let wanted = dense.clone().cholesky().expect("positive");
            assert!((got.solve(&right) - wanted.solve(&right)).amax() < 1e-9);
            assert!((got.inverse() * &dense - DMatrix::identity(21, 21)).amax() < 1e-9);
            assert!((got.log_determinant - wanted.ln_determinant()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_has_no_factors() {
        let mut flat = normal();
        flat.fill_row(2, 0.0);
        flat.fill_column(2, 0.0);
        assert!(Factored::new(&flat, 0.0).is_none());
        assert!(Factored::new(&-normal(), 0.0).is_none());
    }
}
