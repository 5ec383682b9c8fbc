//! Normal equations of a bundle adjustment: a point is bound to the cameras and to no other point.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3};

/// The factors of a normal matrix whose points are eliminated first (Brown 1976; Triggs et al. 2000, section
/// 6.1).
///
/// The first rows are those of the cameras, then come three for each point. All is scaled to a unit diagonal.
pub(super) struct Eliminated {
    scale: DVector<f64>,
    /// Of the cameras alone, after elimination.
    cameras: Option<Cholesky<f64, Dyn>>,
    /// Inverse 3×3 block of each point.
    points: Vec<Matrix3<f64>>,
    /// The block between cameras and points, times the points' inverse.
    between: DMatrix<f64>,
    /// Log determinant of the matrix as it was given.
    pub(super) log_determinant: f64,
}

impl Eliminated {
    /// Factors a matrix of which the first rows, `cameras` in number, are those of the cameras, its diagonal
    /// enlarged by a part `damping` of itself; `None` where it is not positive definite.
    pub(super) fn new(normal: &DMatrix<f64>, cameras: usize, damping: f64) -> Option<Self> {
        let scale = normal.diagonal().map(|d| 1.0 / (d * (1.0 + damping)).sqrt());
        if !scale.iter().all(|s| s.is_finite()) {
            return None;
        }
        let mut scaled = normal.component_mul(&(&scale * scale.transpose()));
        scaled.fill_diagonal(1.0);
        let mut log_determinant = -2.0 * scale.map(f64::ln).sum();
        let mut points = Vec::new();
        let mut between = DMatrix::zeros(cameras, normal.nrows() - cameras);
        let mut reduced = scaled.view((0, 0), (cameras, cameras)).into_owned();
        for at in (cameras..normal.nrows()).step_by(3) {
            let own = scaled.fixed_view::<3, 3>(at, at).into_owned().cholesky()?;
            log_determinant += own.ln_determinant();
            let inverse = own.inverse();
            let across = scaled.view((0, at), (cameras, 3));
            let mut solved = between.columns_mut(at - cameras, 3);
            solved.gemm(1.0, &across, &inverse, 0.0);
            reduced.gemm(-1.0, &solved, &across.transpose(), 1.0);
            points.push(inverse);
        }
        let cameras = if cameras > 0 { Some(reduced.cholesky()?) } else { None };
        log_determinant += cameras.as_ref().map_or(0.0, Cholesky::ln_determinant);
        log_determinant.is_finite().then_some(Self { scale, cameras, points, between, log_determinant })
    }

    /// The solution for a right side.
    pub(super) fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        let scaled = right.component_mul(&self.scale);
        let (c, p) = self.between.shape();
        let (of_cameras, of_points) = (scaled.rows(0, c), scaled.rows(c, p));
        let mut out = DVector::zeros(c + p);
        let mut first = of_cameras - &self.between * of_points;
        if let Some(factor) = &self.cameras {
            factor.solve_mut(&mut first);
        }
        let mut last = -self.between.tr_mul(&first);
        for (k, inverse) in self.points.iter().enumerate() {
            let own = inverse * of_points.fixed_rows::<3>(3 * k);
            let mut rows = last.fixed_rows_mut::<3>(3 * k);
            rows += own;
        }
        out.rows_mut(0, c).copy_from(&first);
        out.rows_mut(c, p).copy_from(&last);
        out.component_mul(&self.scale)
    }

    /// The inverse.
    pub(super) fn inverse(&self) -> DMatrix<f64> {
        let (c, p) = self.between.shape();
        let mut out = DMatrix::zeros(c + p, c + p);
        let cameras = self.cameras.as_ref().map_or_else(|| DMatrix::zeros(0, 0), Cholesky::inverse);
        let across = -(&cameras * &self.between);
        let mut points = -self.between.tr_mul(&across);
        for (k, inverse) in self.points.iter().enumerate() {
            let mut own = points.fixed_view_mut::<3, 3>(3 * k, 3 * k);
            own += inverse;
        }
        out.view_mut((0, 0), (c, c)).copy_from(&cameras);
        out.view_mut((0, c), (c, p)).copy_from(&across);
        out.view_mut((c, 0), (p, c)).copy_from(&across.transpose());
        out.view_mut((c, c), (p, p)).copy_from(&points);
        out.component_mul(&(&self.scale * self.scale.transpose()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine camera rows and four points, of which each is seen by a part of the cameras.
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
    fn elimination_agrees_with_the_dense_matrix() {
        let normal = normal();
        let right = DVector::from_fn(21, |i, _| (i as f64).cos());
        for damping in [0.0, 0.3] {
            let mut dense = normal.clone();
            (0..21).for_each(|k| dense[(k, k)] *= 1.0 + damping);
            let got = Eliminated::new(&normal, 9, damping).expect("positive");
            let wanted = dense.clone().cholesky().expect("positive");
            assert!((got.solve(&right) - wanted.solve(&right)).amax() < 1e-9);
            assert!((got.inverse() * &dense - DMatrix::identity(21, 21)).amax() < 1e-9);
            assert!((got.log_determinant - wanted.ln_determinant()).abs() < 1e-9);
        }
        let points = normal.view((9, 9), (12, 12)).into_owned();
        assert!(
            (Eliminated::new(&points, 0, 0.0).expect("positive").inverse() * points
                - DMatrix::identity(12, 12))
            .amax()
                < 1e-9
        );
    }

    #[test]
    fn a_matrix_that_is_not_positive_has_no_factors() {
        let mut flat = normal();
        flat.fill_row(2, 0.0);
        flat.fill_column(2, 0.0);
        assert!(Eliminated::new(&flat, 9, 0.0).is_none());
        assert!(Eliminated::new(&-normal(), 9, 0.0).is_none());
    }
}
