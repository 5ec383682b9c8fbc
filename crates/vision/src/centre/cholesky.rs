//! Cholesky factors in place, on rows of a slice, for matrices whose size changes from ball to ball.

/// Replaces the lower triangle of a symmetric matrix by its factor; false where it is not positive definite.
pub(super) fn factor(a: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        let (above, row) = a.split_at_mut(i * n);
        for j in 0..i {
            let other = &above[j * n..j * n + j + 1];
            let sum: f64 = row[..j].iter().zip(other).map(|(x, y)| x * y).sum();
            row[j] = (row[j] - sum) / other[j];
        }
        let left = row[i] - row[..i].iter().map(|x| x * x).sum::<f64>();
        if left.is_nan() || left <= 0.0 {
            return false;
        }
        row[i] = left.sqrt();
    }
    true
}

/// Solves L X = B in place for the lower factor of [`factor`]; B has `n` rows of `width` numbers.
pub(super) fn whiten<const WIDTH: usize>(factor: &[f64], n: usize, b: &mut [[f64; WIDTH]]) {
    for i in 0..n {
        let (done, rest) = b.split_at_mut(i);
        let row = &mut rest[0];
        for (l, other) in factor[i * n..i * n + i].iter().zip(done) {
            for (x, y) in row.iter_mut().zip(other.iter()) {
                *x -= l * y;
            }
        }
        let scale = factor[i * n + i].recip();
        for x in row.iter_mut() {
            *x *= scale;
        }
    }
}

/// The same for one column of B, stored as a slice.
pub(super) fn whiten_column(factor: &[f64], n: usize, b: &mut [f64]) {
    for i in 0..n {
        let (done, rest) = b.split_at_mut(i);
        let sum: f64 = factor[i * n..i * n + i].iter().zip(done.iter()).map(|(l, x)| l * x).sum();
        rest[0] = (rest[0] - sum) / factor[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn it_agrees_with_the_general_solver() {
        let n = 7;
        let b = DMatrix::from_fn(n, n, |i, j| ((i * 31 + j * 17) as f64).sin());
        let a = &b * b.transpose() + DMatrix::identity(n, n);
        let mut l: Vec<f64> = a.transpose().as_slice().to_vec();
        assert!(factor(&mut l, n));
        let rhs = DVector::from_fn(n, |i, _| i as f64 - 2.0);
        let mut one = rhs.as_slice().to_vec();
        whiten_column(&l, n, &mut one);
        let mut two: Vec<[f64; 2]> = rhs.iter().map(|x| [*x, 2.0 * x]).collect();
        whiten(&l, n, &mut two);
        let want = rhs.dot(&a.lu().solve(&rhs).unwrap());
        assert!((one.iter().map(|x| x * x).sum::<f64>() - want).abs() < 1e-10);
        assert!((two.iter().map(|x| x[0] * x[1]).sum::<f64>() - 2.0 * want).abs() < 1e-10);
        assert!(!factor(&mut [1.0, 2.0, 2.0, 1.0], 2));
    }
}
