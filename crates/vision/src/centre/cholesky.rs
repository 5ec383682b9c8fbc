//! Cholesky factor of a symmetric matrix whose entries are near the diagonal, in place, by rows of the lower triangle.

/// A lower triangle of which each row begins at its own column. Reused, so that nothing is allocated once it has grown.
#[derive(Debug, Clone, Default)]
pub(super) struct Skyline {
    /// First column of each row, and where the row's numbers start.
    rows: Vec<(usize, usize)>,
    values: Vec<f64>,
}

impl Skyline {
    pub(super) fn clear(&mut self) {
        self.rows.clear();
        self.values.clear();
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Appends a row whose entries before column `first` are zero and whose last one is on the diagonal.
    pub(super) fn push(&mut self, first: usize, entries: impl Iterator<Item = f64>) {
        self.rows.push((first, self.values.len()));
        self.values.extend(entries);
    }

    /// The entries of a row with their columns.
    #[inline(always)]
    pub(super) fn row(&self, i: usize) -> (usize, &[f64]) {
        let (first, start) = self.rows[i];
        (first, &self.values[start..=start + i - first])
    }

    /// Copies a matrix with its entries changed.
    #[inline(always)]
    pub(super) fn copy(&mut self, from: &Self, change: impl Fn(usize, usize, f64) -> f64) {
        self.rows.clone_from(&from.rows);
        self.values.clear();
        for i in 0..from.len() {
            let (first, row) = from.row(i);
            self.values.extend(row.iter().enumerate().map(|(k, v)| change(i, first + k, *v)));
        }
    }

    /// Replaces the matrix by its factor; false where it is not positive definite.
    #[inline(always)]
    pub(super) fn factor(&mut self) -> bool {
        for i in 0..self.rows.len() {
            let (first, start) = self.rows[i];
            let (done, rest) = self.values.split_at_mut(start);
            let row = &mut rest[..=i - first];
            for j in first..i {
                let (other_first, other_start) = self.rows[j];
                let from = first.max(other_first);
                let other = &done[other_start + from - other_first..other_start + j - other_first];
                let sum = dot(&row[from - first..j - first], other);
                row[j - first] = (row[j - first] - sum) / done[other_start + j - other_first];
            }
            let left = row[i - first] - row[..i - first].iter().map(|a| a * a).sum::<f64>();
            if left.is_nan() || left <= 0.0 {
                return false;
            }
            row[i - first] = left.sqrt();
        }
        true
    }

    /// Solves L X = B in place, L being this factor.
    #[inline(always)]
    pub(super) fn whiten<const WIDTH: usize>(&self, b: &mut [[f64; WIDTH]]) {
        for i in 0..self.rows.len() {
            let (first, row) = self.row(i);
            let (done, rest) = b.split_at_mut(i);
            let target = &mut rest[0];
            let mut left = *target;
            for (l, other) in row.iter().zip(&done[first..]) {
                for (x, y) in left.iter_mut().zip(other) {
                    *x -= l * y;
                }
            }
            let scale = row[i - first].recip();
            *target = left.map(|x| x * scale);
        }
    }
}

/// Scalar product, in four sums that a vector register holds.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    let mut sums = [0.0; 4];
    for (a, b) in a.zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn it_agrees_with_the_general_solver() {
        let (n, band) = (9_usize, 3_usize);
        let near = |i: usize, j: usize| i.abs_diff(j) <= band;
        let a = DMatrix::from_fn(n, n, |i, j| {
            if i == j {
                8.0
            } else if near(i, j) {
                ((i * j) as f64).sin()
            } else {
                0.0
            }
        });
        let mut plain = Skyline::default();
        for i in 0..n {
            let first = i.saturating_sub(band);
            plain.push(first, (first..=i).map(|j| a[(i, j)]));
        }
        let mut l = Skyline::default();
        l.copy(&plain, |i, j, v| if i == j { v + 1.0 } else { v });
        let a = a + DMatrix::identity(n, n);
        assert!(l.factor());
        let rhs = DVector::from_fn(n, |i, _| i as f64 - 2.0);
        let mut two: Vec<[f64; 2]> = rhs.iter().map(|x| [*x, 2.0 * x]).collect();
        l.whiten(&mut two);
        let want = rhs.dot(&a.lu().solve(&rhs).unwrap());
        assert!((two.iter().map(|x| x[0] * x[1]).sum::<f64>() - 2.0 * want).abs() < 1e-10);
        let mut indefinite = Skyline::default();
        indefinite.push(0, [1.0].into_iter());
        indefinite.push(0, [2.0, 1.0].into_iter());
        assert!(!indefinite.factor());
    }
}
