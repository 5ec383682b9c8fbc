//! A problem that several tests share.

use nalgebra::{DMatrix, DVector};

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
