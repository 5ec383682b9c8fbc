//! The normal equations of a fit: sums of weighted outer products, solved in place.

use super::model::{COUNT, Parameters, RESIDUAL, Row, WIDTH};

/// Upper triangle of the information matrix, the gradient behind each of its rows; after [`Self::solve`], its factor.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    rows: [Row; COUNT],
}

impl Default for Normal {
    fn default() -> Self {
        Self { rows: [[0.0; WIDTH]; COUNT] }
    }
}

impl Normal {
    pub(super) fn clear(&mut self) {
        self.rows = [[0.0; WIDTH]; COUNT];
    }

    /// Adds a sample: derivatives with the residual behind them, and the inverse of its variance.
    #[inline(always)]
    pub(super) fn add(&mut self, row: &Row, weight: f64) {
        for (i, sum) in self.rows.iter_mut().enumerate() {
            add_scaled(sum, i, row, weight * row[i]);
        }
    }

    /// Adds what is known of one parameter: the inverse of its variance, and how far below its mean it is.
    pub(super) fn add_known(&mut self, i: usize, information: f64, residual: f64) {
        self.rows[i][i] += information;
        self.rows[i][RESIDUAL] += information * residual;
    }

    /// The step that these equations ask for and its squared length in standard deviations; None where the information is
    /// not positive definite. Leaves the factor: information = Uᵀ D⁻¹ U with D the diagonal of U.
    #[inline(always)]
    pub(super) fn solve(&mut self) -> Option<(Parameters, f64)> {
        let mut length = 0.0;
        for k in 0..COUNT {
            let (done, rest) = self.rows.split_at_mut(k + 1);
            let pivot_row = &done[k];
            let pivot = pivot_row[k];
            if pivot.is_nan() || pivot <= 0.0 {
                return None;
            }
            let inverse = pivot.recip();
            length += pivot_row[RESIDUAL] * pivot_row[RESIDUAL] * inverse;
            for (row, i) in rest.iter_mut().zip(k + 1..) {
                add_scaled(row, i, pivot_row, -pivot_row[i] * inverse);
            }
        }
        let mut change: Row = [0.0; WIDTH];
        for (out, row) in change.iter_mut().zip(&self.rows) {
            *out = row[RESIDUAL];
        }
        self.back_substitute(&mut change);
        Some((Parameters::from_fn(|i, _| change[i]), length))
    }

    fn back_substitute(&self, x: &mut Row) {
        for k in (0..COUNT).rev() {
            let row = &self.rows[k];
            let known: f64 = (k + 1..COUNT).map(|j| row[j] * x[j]).sum();
            x[k] = (x[k] - known) / row[k];
        }
    }

    /// A column of the covariance, after [`Self::solve`].
    pub(super) fn covariance_column(&self, column: usize) -> Parameters {
        let mut x: Row = [0.0; WIDTH];
        x[column] = 1.0;
        for k in column..COUNT {
            let factor = x[k] / self.rows[k][k];
            for (out, value) in x.iter_mut().zip(&self.rows[k]).skip(k + 1) {
                *out -= factor * value;
            }
        }
        self.back_substitute(&mut x);
        Parameters::from_fn(|i, _| x[i])
    }
}

/// Adds a multiple of a row to row `i`: nothing before its diagonal is read, and loops of a fixed length are what
/// compilers turn into vector instructions.
#[inline(always)]
fn add_scaled(sum: &mut Row, i: usize, row: &Row, factor: f64) {
    const HALF: usize = 8;
    if i < HALF {
        for k in 0..WIDTH {
            sum[k] += factor * row[k];
        }
    } else {
        for k in HALF..WIDTH {
            sum[k] += factor * row[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    #[test]
    fn it_agrees_with_the_general_solver() {
        let (mut normal, mut information) = (Normal::default(), SMatrix::<f64, COUNT, COUNT>::zeros());
        let mut gradient = Parameters::zeros();
        for sample in 0..40 {
            let mut row: Row = [0.0; WIDTH];
            for (k, value) in row[..=RESIDUAL].iter_mut().enumerate() {
                *value = ((sample * 7 + k * 13 + k * k * sample) as f64).sin();
            }
            let (derivatives, weight) = (Parameters::from_fn(|k, _| row[k]), 1.0 + (sample % 3) as f64);
            normal.add(&row, weight);
            information += derivatives * derivatives.transpose() * weight;
            gradient += derivatives * (row[RESIDUAL] * weight);
        }
        normal.add_known(3, 5.0, 0.2);
        information[(3, 3)] += 5.0;
        gradient[3] += 1.0;
        let (change, length) = normal.solve().expect("definite");
        let covariance = information.try_inverse().expect("an inverse");
        let want = covariance * gradient;
        assert!((change - want).norm() < 1e-9 * want.norm());
        assert!((length - gradient.dot(&want)).abs() < 1e-9 * length);
        for k in [0, 5, COUNT - 1] {
            assert!((normal.covariance_column(k) - covariance.column(k)).norm() < 1e-9);
        }
        assert!(Normal::default().solve().is_none());
    }
}
