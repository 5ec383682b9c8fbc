//! The normal equations of a fit: sums of weighted outer products, and their solution.

use super::lanes::{GROUP, Lanes};
use super::model::{COUNT, Parameters, RESIDUAL, Row, WIDTH};
use pulp::Simd;

/// Information of a parameter that is held: a millionth of a pixel.
const HELD: f64 = 1e12;
/// Columns of the sums that are added to together: as many sums as a vector unit keeps at hand.
const TOGETHER: usize = 10;

/// Columns of the information matrix from the diagonal down and behind each, in row [`RESIDUAL`], the
/// gradient; in double precision, as a solution needs it.
type Columns = [[f64; WIDTH]; COUNT];

#[derive(Debug, Clone)]
pub(super) struct Normal(Columns);

/// The step, its squared length in standard deviations, and the information after elimination.
pub(super) struct Solved {
    pub(super) change: Parameters,
    pub(super) length: f64,
    eliminated: Columns,
}

impl Normal {
    pub(super) fn new() -> Self {
        Self([[0.0; WIDTH]; COUNT])
    }

    /// Adds the sums over some samples: derivatives with the residual behind them, and one over the variance.
    #[inline(always)]
    pub(super) fn add<'a, S: Simd>(
        &mut self,
        simd: S,
        samples: impl Iterator<Item = (&'a Row, f32)> + Clone,
    ) {
        const { assert!(COUNT.is_multiple_of(TOGETHER)) };
        for first in (0..COUNT).step_by(TOGETHER) {
            for part in first / S::F32_LANES..WIDTH / S::F32_LANES {
                let mut sums = [Lanes::splat(simd, 0.0); TOGETHER];
                for (row, information) in samples.clone() {
                    let values = Lanes::load(simd, row, part) * Lanes::splat(simd, information);
                    for (sum, factor) in sums.iter_mut().zip(&row[first..first + TOGETHER]) {
                        *sum = Lanes::splat(simd, *factor).mul_add(values, *sum);
                    }
                }
                for (k, sum) in sums.into_iter().enumerate() {
                    let mut out = [0.0; GROUP];
                    sum.store(&mut out, 0);
                    let column = &mut self.0[first + k];
                    let into = column[part * S::F32_LANES..].iter_mut();
                    into.zip(&out[..S::F32_LANES]).for_each(|(value, sum)| *value += f64::from(*sum));
                }
            }
        }
    }

    /// Adds what is known of one parameter: the inverse of its variance, and how far below its mean it is.
    pub(super) fn add_known(&mut self, i: usize, information: f64, residual: f64) {
        self.0[i][i] += information;
        self.0[i][RESIDUAL] += information * residual;
    }

    /// Which way and how strongly the samples pull a parameter.
    pub(super) fn pull(&self, i: usize) -> f64 {
        self.0[i][RESIDUAL]
    }

    /// Keeps a parameter as it is.
    pub(super) fn hold(&mut self, i: usize) {
        self.0[i][i] += HELD;
        self.0[i][RESIDUAL] = 0.0;
    }

    /// The solution by symmetric elimination; None where the information is not positive definite. The loops
    /// have fixed lengths, for the vector unit; what they leave above the diagonal is not read.
    #[inline(always)]
    pub(super) fn solve(&self) -> Option<Solved> {
        let mut eliminated = self.0;
        for k in 0..COUNT {
            let pivot = eliminated[k];
            if pivot[k].is_nan() || pivot[k] <= 0.0 {
                return None;
            }
            for j in k + 1..COUNT {
                let factor = pivot[j] / pivot[k];
                for (value, taken) in eliminated[j].iter_mut().zip(&pivot) {
                    *value -= factor * taken;
                }
            }
        }
        let gradient = Parameters::from_fn(|k, _| self.0[k][RESIDUAL]);
        let change = solution(&eliminated, gradient);
        Some(Solved { change, length: gradient.dot(&change), eliminated })
    }
}

/// Solution for a right-hand side, by the information after elimination.
#[inline(always)]
fn solution(eliminated: &Columns, mut side: Parameters) -> Parameters {
    for (k, column) in eliminated.iter().enumerate() {
        let part = side[k] / column[k];
        (k + 1..COUNT).for_each(|i| side[i] -= part * column[i]);
    }
    for (k, column) in eliminated.iter().enumerate().rev() {
        let others: f64 = (k + 1..COUNT).map(|i| column[i] * side[i]).sum();
        side[k] = (side[k] - others) / column[k];
    }
    side
}

impl Solved {
    /// Covariance of a parameter with each.
    pub(super) fn covariance(&self, of: usize) -> Parameters {
        let mut unit = Parameters::zeros();
        unit[of] = 1.0;
        solution(&self.eliminated, unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    #[test]
    fn it_agrees_with_the_general_solver() {
        let (mut normal, mut information) = (Normal::new(), SMatrix::<f64, COUNT, COUNT>::zeros());
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
        let solved = normal.solve().expect("definite");
        let covariance = information.try_inverse().expect("an inverse");
        let want = covariance * gradient;
        assert!((solved.change - want).norm() < 1e-4 * want.norm());
        assert!((solved.length - gradient.dot(&want)).abs() < 1e-4 * solved.length);
        for of in 0..COUNT {
            assert!((solved.covariance(of) - covariance.column(of)).norm() < 1e-4 * covariance.norm());
        }
        assert!(Normal::new().solve().is_none());
    }

    /// Beside the equations without the parameter.
    #[test]
    fn a_parameter_that_is_held_keeps_its_value_and_the_others_do_not_see_it() {
        const HELD: usize = 3;
        let mut normal = Normal::new();
        let (mut information, mut gradient) = (SMatrix::<f64, COUNT, COUNT>::zeros(), Parameters::zeros());
        for i in 0..COUNT {
            for j in i..COUNT {
                let value = ((i * 5 + j * 3) as f64).sin() + if i == j { 30.0 } else { 0.0 };
                normal.0[i][j] = value;
                (information[(i, j)], information[(j, i)]) = (value, value);
            }
            normal.0[i][RESIDUAL] = (i as f64).cos();
            gradient[i] = (i as f64).cos();
        }
        assert!((normal.pull(HELD) - gradient[HELD]).abs() < 1e-15);
        normal.hold(HELD);
        let Solved { change, length, .. } = normal.solve().expect("definite");
        let rest = information.remove_row(HELD).remove_column(HELD).try_inverse().expect("an inverse");
        let wanted = rest * gradient.remove_row(HELD);
        assert!(change[HELD].abs() < 1e-9 && (length - gradient.remove_row(HELD).dot(&wanted)).abs() < 1e-9);
        assert!((change.remove_row(HELD) - wanted).norm() < 1e-9);
    }
}
