//! The kriging equations of a group of rim pixels, solved by Gaussian elimination lane by lane.

use crate::centre::lanes::{GROUP, Lanes};
use pulp::Simd;

/// Free pixels from which the background of one pixel is predicted: two rows of a neighbourhood of radius
/// two.
pub(super) const NEIGHBOURS: usize = 8;
/// Half a row of equations.
const HALF: usize = NEIGHBOURS / 2;

/// The equations of a group of rim pixels: covariance of the neighbours' values (above the diagonal), and
/// with the pixel.
pub(super) struct Systems {
    pub(super) matrix: [[[f32; GROUP]; NEIGHBOURS]; NEIGHBOURS],
    pub(super) cross: [[f32; GROUP]; NEIGHBOURS],
    /// Variance of a neighbour's value.
    pub(super) own: [f32; GROUP],
    pub(super) count: [usize; GROUP],
}

/// For a group of rim pixels, where their neighbours' values are, and what each counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    pub(super) at: [[u32; GROUP]; NEIGHBOURS],
    pub(super) of: [[f32; GROUP]; NEIGHBOURS],
    /// One more than the neighbours that there are.
    pub(super) counted: [f32; GROUP],
}

impl Systems {
    /// Where nothing was found, which predicts nothing.
    pub(super) const NOTHING: Self = Self {
        matrix: [[[0.0; GROUP]; NEIGHBOURS]; NEIGHBOURS],
        cross: [[0.0; GROUP]; NEIGHBOURS],
        own: [1.0; GROUP],
        count: [0; GROUP],
    };

    /// Weights of the neighbours; None where a matrix is not positive definite.
    #[inline(always)]
    pub(super) fn solve<S: Simd>(&self, simd: S, weights: &mut Weights) -> Option<()> {
        let mut least = [0.0; GROUP];
        for part in 0..Lanes::<S>::PARTS {
            let load = |values: &[f32; GROUP]| Lanes::load(simd, values, part);
            let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
            let own = load(&self.own);
            let (mut rows, mut x) = ([[zero; NEIGHBOURS]; NEIGHBOURS], [zero; NEIGHBOURS]);
            for (i, row) in rows.iter_mut().enumerate() {
                row[i] = own;
                for (value, from) in row.iter_mut().zip(&self.matrix[i]).skip(i + 1) {
                    *value = load(from);
                }
                x[i] = load(&self.cross[i]);
            }
            let mut smallest = rows[0][0];
            let mut inverse = [zero; NEIGHBOURS];
            for k in 0..NEIGHBOURS {
                let pivot = rows[k];
                smallest = pivot[k].min(smallest);
                inverse[k] = one / pivot[k];
                for i in k + 1..NEIGHBOURS {
                    let factor = pivot[i] * inverse[k];
                    // Whole halves of a row: a loop of fixed length.
                    let from = i / HALF * HALF;
                    for j in 0..HALF {
                        rows[i][from + j] = rows[i][from + j] - factor * pivot[from + j];
                    }
                    if from == 0 {
                        for j in HALF..NEIGHBOURS {
                            rows[i][j] = rows[i][j] - factor * pivot[j];
                        }
                    }
                    x[i] = x[i] - factor * x[k];
                }
            }
            for k in (0..NEIGHBOURS).rev() {
                for i in k + 1..NEIGHBOURS {
                    x[k] = x[k] - rows[k][i] * x[i];
                }
                x[k] = x[k] * inverse[k];
                x[k].store(&mut weights.of[k], part);
            }
            smallest.store(&mut least, part);
        }
        least.iter().all(|least| *least > 0.0).then_some(())
    }
}

impl Weights {
    pub(super) const NOTHING: Self =
        Self { at: [[0; GROUP]; NEIGHBOURS], of: [[0.0; GROUP]; NEIGHBOURS], counted: [1.0; GROUP] };

    /// What is predicted from values, and how far it may be off: the root of the mean over these squared and
    /// the clutter's variance.
    #[inline(always)]
    pub(super) fn predict<S: Simd>(
        &self,
        simd: S,
        values: &[f32],
        clutter_variance: Lanes<S>,
    ) -> ([f32; GROUP], [f32; GROUP]) {
        let mut left = [[0.0; GROUP]; NEIGHBOURS];
        for (left, at) in left.iter_mut().zip(&self.at) {
            for (left, at) in left.iter_mut().zip(at) {
                *left = values[*at as usize];
            }
        }
        let (mut predicted, mut deviation) = ([0.0; GROUP], [0.0; GROUP]);
        for part in 0..Lanes::<S>::PARTS {
            let (mut sum, mut squares) = (Lanes::splat(simd, 0.0), clutter_variance);
            for k in (0..NEIGHBOURS).rev() {
                let left = Lanes::load(simd, &left[k], part);
                sum = sum + Lanes::load(simd, &self.of[k], part) * left;
                squares = squares + left * left;
            }
            sum.store(&mut predicted, part);
            (squares / Lanes::load(simd, &self.counted, part)).sqrt().store(&mut deviation, part);
        }
        (predicted, deviation)
    }
}
