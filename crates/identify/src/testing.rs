//! Random numbers and shared problems for tests.

use nalgebra::{DMatrix, DVector};

/// A standard normal number (Box & Muller 1958) from a linear congruential generator (Knuth's MMIX
/// constants).
pub(crate) fn normal(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((*state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    (-2.0 * uniform().ln()).sqrt() * (2.0 * std::f64::consts::PI * uniform()).cos()
}

/// Twelve rows of a column of ones and two noisy columns, and their output: the problem that scipy.odr has
/// solved.
#[expect(clippy::approx_constant, reason = "3.141 is a datum")]
pub(crate) fn linear_problem_of_scipy() -> (DMatrix<f64>, DVector<f64>) {
    let x1 = [0.0, 2.15, 2.92, 1.482, -1.324, -3.133, -2.323, 0.25, 2.388, 2.71, 1.227, -1.173];
    let x2 = [-1.85, 1.459, -1.127, 2.611, 0.066, 3.352, 1.015, -1.361, 1.908, -0.589, 3.141, 0.511];
    let y = [4.2, 1.665, 4.786, -0.702, 0.56, -4.749, -1.508, 3.069, 0.805, 4.586, -0.822, -0.192];
    let x = DMatrix::from_fn(12, 3, |i, j| [1.0, x1[i], x2[i]][j]);
    (x, DVector::from_row_slice(&y))
}
