//! The fastest motion of a model.

use crate::dynamics::Evaluation;

/// The fastest motion of linearised equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fastest {
    /// The state that takes the largest part in it.
    pub state: usize,
    /// Its time constant: one over the largest magnitude of an eigenvalue.
    pub time_s: f64,
}

/// Squarings of the matrix: its power 1024 has lost all but the largest eigenvalues.
const SQUARINGS: u32 = 10;

impl Evaluation<'_> {
    /// The fastest motion about a state, for the inputs that are set: of an integration with steps of fixed
    /// length, a step must be shorter than about twice its time constant.
    pub fn fastest(&mut self, state: &[f64]) -> Fastest {
        let n = state.len();
        self.linearise(state, &mut vec![0.0; n]);
        let mut matrix = vec![0.0; n * n];
        for slope in self.by_state() {
            matrix[slope.row * n + slope.column] = slope.value;
        }
        // Gelfand: the 2^k-th root of the norm of the 2^k-th power goes to the largest eigenvalue. A norm
        // that is taken out each time keeps numbers in range.
        let mut logarithm = 0.0;
        for k in 0..=SQUARINGS {
            let norm = matrix.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
            if norm == 0.0 || !norm.is_finite() {
                let time_s = if norm == 0.0 { f64::INFINITY } else { 0.0 };
                return Fastest { state: 0, time_s };
            }
            logarithm += norm.ln() / f64::from(1_u32 << k);
            matrix.iter_mut().for_each(|v| *v /= norm);
            if k < SQUARINGS {
                matrix = squared(&matrix, n);
            }
        }
        let part = |k: usize| matrix[k * n + k].abs();
        let state = (0..n).max_by(|a, b| part(*a).total_cmp(&part(*b))).unwrap_or_default();
        Fastest { state, time_s: (-logarithm).exp() }
    }
}

fn squared(matrix: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for (row, out) in matrix.chunks(n).zip(out.chunks_mut(n)) {
        for (factor, other) in row.iter().zip(matrix.chunks(n)).filter(|(factor, _)| **factor != 0.0) {
            out.iter_mut().zip(other).for_each(|(out, other)| *out += factor * other);
        }
    }
    out
}
