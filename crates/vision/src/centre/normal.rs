//! The normal equations of a fit: sums of weighted outer products, solved in place.

use super::lanes::{GROUP, Lanes};
use super::model::{COUNT, Parameters, RESIDUAL, Row, WIDTH};
use pulp::Simd;

/// Information of a parameter that is held: a millionth of a pixel.
const HELD: f64 = 1e12;

/// Rows of the sums that are added to together: as many sums as a vector unit keeps at hand.
const ROWS: usize = 10;

/// Upper triangle of the information matrix, the gradient behind each of its rows; after [`Self::solve`], its
/// factor.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    /// Sums over the samples with what is known besides, in double precision, as a solution needs it.
    rows: [[f64; WIDTH]; COUNT],
    /// One over the factor's diagonal.
    inverse: [f64; COUNT],
}

impl Default for Normal {
    fn default() -> Self {
        Self { rows: [[0.0; WIDTH]; COUNT], inverse: [0.0; COUNT] }
    }
}

impl Normal {
    /// Adds the sums over some samples: derivatives with the residual behind them, and one over the variance.
    #[inline(always)]
    pub(super) fn add<'a, S: Simd>(
        &mut self,
        simd: S,
        samples: impl Iterator<Item = (&'a Row, f32)> + Clone,
    ) {
        const { assert!(COUNT.is_multiple_of(ROWS)) };
        for first in (0..COUNT).step_by(ROWS) {
            for part in first / S::F32_LANES..WIDTH / S::F32_LANES {
                let mut sums = [Lanes::splat(simd, 0.0); ROWS];
                for (row, information) in samples.clone() {
                    let values = Lanes::load(simd, row, part) * Lanes::splat(simd, information);
                    for (sum, factor) in sums.iter_mut().zip(&row[first..first + ROWS]) {
                        *sum = Lanes::splat(simd, *factor).mul_add(values, *sum);
                    }
                }
                for (row, sum) in self.rows[first..].iter_mut().zip(sums) {
                    let mut out = [0.0; GROUP];
                    sum.store(&mut out, 0);
                    let into = &mut row[part * S::F32_LANES..];
                    into.iter_mut().zip(&out).take(S::F32_LANES).for_each(|(v, sum)| *v += f64::from(*sum));
                }
            }
        }
    }

    /// Adds what is known of one parameter: the inverse of its variance, and how far below its mean it is.
    pub(super) fn add_known(&mut self, i: usize, information: f64, residual: f64) {
        self.rows[i][i] += information;
        self.rows[i][RESIDUAL] += information * residual;
    }

    /// Which way and how strongly the samples pull a parameter.
    pub(super) fn pull(&self, i: usize) -> f64 {
        self.rows[i][RESIDUAL]
    }

    /// Keeps a parameter as it is.
    pub(super) fn hold(&mut self, i: usize) {
        self.rows[i][i] += HELD;
        self.rows[i][RESIDUAL] = 0.0;
    }

    /// The step that these equations ask for and its squared length in standard deviations; None where the
    /// information is not positive definite. Leaves the factor: information = Uᵀ D⁻¹ U with D the diagonal of
    /// U.
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
            self.inverse[k] = inverse;
            length += pivot_row[RESIDUAL] * pivot_row[RESIDUAL] * inverse;
            for (row, i) in rest.iter_mut().zip(k + 1..) {
                add_scaled(row, i, pivot_row, -pivot_row[i] * inverse);
            }
        }
        let mut change = std::array::from_fn(|i| [self.rows[i][RESIDUAL]]);
        self.back_substitute(&mut change);
        Some((Parameters::from_fn(|i, _| change[i][0]), length))
    }

    /// Solves with the upper triangle. Each value is taken from all before it once it is known, so that none
    /// waits for a sum.
    #[inline(always)]
    fn back_substitute<const N: usize>(&self, x: &mut [[f64; N]; COUNT]) {
        for k in (0..COUNT).rev() {
            let (before, here) = x.split_at_mut(k);
            here[0] = here[0].map(|value| value * self.inverse[k]);
            for (before, row) in before.iter_mut().zip(&self.rows) {
                for n in 0..N {
                    before[n] -= here[0][n] * row[k];
                }
            }
        }
    }

    /// Covariance of some parameters, after [`Self::solve`]: that of two is the product of their columns of
    /// the inverse factor.
    #[inline(always)]
    pub(super) fn covariance<const N: usize>(&self, of: [usize; N]) -> [[f64; N]; N] {
        let mut columns = [[0.0; N]; COUNT];
        for (n, i) in of.into_iter().enumerate() {
            columns[i][n] = 1.0;
        }
        let mut out = [[0.0; N]; N];
        for k in of.into_iter().min().unwrap_or(COUNT)..COUNT {
            let (done, rest) = columns.split_at_mut(k + 1);
            let here = &done[k];
            let mut scaled = [0.0; N];
            for n in 0..N {
                scaled[n] = here[n] * self.inverse[k];
            }
            for (out, scaled) in out.iter_mut().zip(&scaled) {
                for n in 0..N {
                    out[n] += scaled * here[n];
                }
            }
            for (later, value) in rest.iter_mut().zip(&self.rows[k][k + 1..COUNT]) {
                for n in 0..N {
                    later[n] -= scaled[n] * value;
                }
            }
        }
        out
    }
}

/// Where rows begin of which the first part is not worked on.
const HALF: usize = 8;

/// Adds a multiple of a row to row `i`: nothing before its diagonal is read, and loops of a fixed length are
/// what compilers turn into vector instructions.
#[inline(always)]
fn add_scaled(sum: &mut [f64; WIDTH], i: usize, row: &[f64; WIDTH], factor: f64) {
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
        let (mut gradient, mut samples) = (Parameters::zeros(), Vec::new());
        for sample in 0..40 {
            let mut row: Row = [0.0; WIDTH];
            for (k, value) in row[..=RESIDUAL].iter_mut().enumerate() {
                *value = ((sample * 7 + k * 13 + k * k * sample) as f32).sin();
            }
            let derivatives = Parameters::from_fn(|k, _| f64::from(row[k]));
            samples.push(row);
            information += derivatives * derivatives.transpose();
            gradient += derivatives * f64::from(row[RESIDUAL]);
        }
        normal.add(pulp::Scalar::new(), samples.iter().map(|row| (row, 1.0)));
        normal.add_known(3, 5.0, 0.2);
        information[(3, 3)] += 5.0;
        gradient[3] += 1.0;
        let (change, length) = normal.solve().expect("definite");
        let covariance = information.try_inverse().expect("an inverse");
        let want = covariance * gradient;
        assert!((change - want).norm() < 1e-4 * want.norm());
        assert!((length - gradient.dot(&want)).abs() < 1e-4 * length);
        let some = [0, 5, COUNT - 1];
        for (i, row) in some.iter().zip(normal.covariance(some)) {
            for (j, got) in some.iter().zip(row) {
                assert!((got - covariance[(*i, *j)]).abs() < 1e-4 * covariance[(*i, *i)]);
            }
        }
        assert!(Normal::default().solve().is_none());
    }

    /// Beside the equations without the parameter.
    #[test]
    fn a_parameter_that_is_held_keeps_its_value_and_the_others_do_not_see_it() {
        const HELD: usize = 3;
        let mut normal = Normal::default();
        let (mut information, mut gradient) = (SMatrix::<f64, COUNT, COUNT>::zeros(), Parameters::zeros());
        for i in 0..COUNT {
            for j in i..COUNT {
                let value = ((i * 5 + j * 3) as f64).sin() + if i == j { 30.0 } else { 0.0 };
                normal.rows[i][j] = value;
                (information[(i, j)], information[(j, i)]) = (value, value);
            }
            normal.rows[i][RESIDUAL] = (i as f64).cos();
            gradient[i] = (i as f64).cos();
        }
        assert!((normal.pull(HELD) - gradient[HELD]).abs() < 1e-15);
        normal.hold(HELD);
        let (change, length) = normal.solve().expect("definite");
        let rest = information.remove_row(HELD).remove_column(HELD).try_inverse().expect("an inverse");
        let wanted = rest * gradient.remove_row(HELD);
        assert!(change[HELD].abs() < 1e-9 && (length - gradient.remove_row(HELD).dot(&wanted)).abs() < 1e-9);
        assert!((change.remove_row(HELD) - wanted).norm() < 1e-9);
    }
}
