//! Cholesky factor of a symmetric matrix whose entries are near the diagonal, in place, by columns of the
//! lower triangle.

use super::lanes::{GROUP, Lanes};
use pulp::Simd;

/// Entries below the diagonal that a column may have.
pub(super) const BAND: usize = 16;

/// The diagonal and what is below it, and nothing in what is left of a whole number of groups.
pub(super) type Column = [f32; BAND + GROUP];

/// A lower triangle in columns of one length. Reused, so that nothing is allocated once it has grown.
#[derive(Debug, Clone, Default)]
pub(super) struct Banded {
    /// Behind the matrix's own columns as many empty ones as a column is long.
    columns: Vec<Column>,
    count: usize,
}

impl Banded {
    /// Number of columns.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Makes it one without columns.
    pub(super) fn clear(&mut self) {
        self.count = 0;
        self.columns.clear();
    }

    /// Sets the matrix: the entry at a row and as many columns before it as the second number says, diagonal
    /// included.
    #[inline(always)]
    pub(super) fn set(&mut self, count: usize, entry: impl Fn(usize, usize) -> f32) {
        self.columns.clear();
        self.columns.resize(count + BAND, [0.0; BAND + GROUP]);
        self.count = count;
        for (j, column) in self.columns[..count].iter_mut().enumerate() {
            for (below, value) in column[..=BAND.min(count - 1 - j)].iter_mut().enumerate() {
                *value = entry(j + below, below);
            }
        }
    }

    /// Copies a matrix, each entry times the factors of its row and its column, and adds to the diagonal.
    /// There are as many factors as columns and a band more.
    #[inline(always)]
    pub(super) fn copy(&mut self, from: &Self, factors: &[f32], added: &[f32]) {
        self.clone_from(from);
        for (j, column) in self.columns[..from.count].iter_mut().enumerate() {
            for (value, factor) in column[..=BAND].iter_mut().zip(&factors[j..=j + BAND]) {
                *value *= factors[j] * factor;
            }
            column[0] += added[j];
        }
    }

    /// Replaces the matrix by its factor, the diagonal by its inverse; false where it is not positive
    /// definite.
    #[inline(always)]
    pub(super) fn factor<S: Simd>(&mut self, simd: S) -> bool {
        for j in 0..self.count {
            let (done, rest) = self.columns.split_at_mut(j + 1);
            let column = &mut done[j];
            let pivot = column[0];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            let inverse = pivot.recip();
            // Behind the column, room for groups that reach beyond its end.
            let mut below = [0.0; 2 * BAND];
            below[..BAND].copy_from_slice(&column[1..=BAND]);
            // No column waits for the root of another.
            let scale = inverse.sqrt();
            column[0] = scale;
            column[1..=BAND].iter_mut().for_each(|value| *value *= scale);
            for (k, other) in rest[..BAND].iter_mut().enumerate() {
                let factor = Lanes::splat(simd, -below[k] * inverse);
                for part in 0..BAND / S::F32_LANES {
                    let values = Lanes::load(simd, &below[k..k + BAND], part);
                    factor.mul_add(values, Lanes::load(simd, other, part)).store(other, part);
                }
            }
        }
        true
    }

    /// Solves L X = B in place, L being this factor.
    #[inline(always)]
    pub(super) fn whiten<S: Simd, const WIDTH: usize>(&self, simd: S, b: &mut [[f32; WIDTH]]) {
        const { assert!(WIDTH.is_multiple_of(GROUP)) };
        for i in 0..self.count {
            let (done, rest) = b.split_at_mut(i);
            let first = i.saturating_sub(BAND);
            for part in 0..WIDTH / S::F32_LANES {
                let mut left = Lanes::load(simd, &rest[0], part);
                for (k, (other, column)) in done[first..].iter().zip(&self.columns[first..i]).enumerate() {
                    let factor = Lanes::splat(simd, -column[i - first - k]);
                    left = factor.mul_add(Lanes::load(simd, other, part), left);
                }
                (left * Lanes::splat(simd, self.columns[i][0])).store(&mut rest[0], part);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Factor and right sides solved.
    struct Solved<'a>(&'a mut Banded, &'a mut [[f32; 24]]);

    impl pulp::WithSimd for Solved<'_> {
        type Output = bool;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> bool {
            let whole = self.0.factor(simd);
            self.0.whiten(simd, self.1);
            whole
        }
    }

    #[test]
    fn it_agrees_with_the_general_solver() {
        for (n, band) in [(9_usize, 3_usize), (40, BAND), (5, 4)] {
            let entry = |i: usize, j: usize| match i.abs_diff(j) {
                0 => 20.0,
                apart if apart <= band => ((i * j) as f64).sin(),
                _ => 0.0,
            };
            let a = DMatrix::from_fn(n, n, entry);
            let mut plain = Banded::default();
            plain.set(n, |i, below| entry(i, i - below) as f32);
            let factors: Vec<f32> = (0..n + BAND).map(|i| 1.0 + 0.125 * i as f32).collect();
            let added = vec![1.0; n];
            let mut l = Banded::default();
            l.copy(&plain, &factors, &added);
            let scaled = DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| f64::from(factors[i])));
            let a = &scaled * a * &scaled + DMatrix::identity(n, n);
            let rhs = DVector::from_fn(n, |i, _| i as f64 - 2.0);
            let mut two = vec![[0.0; 24]; n];
            for (row, value) in two.iter_mut().zip(rhs.iter()) {
                (row[0], row[23]) = (*value as f32, 2.0 * *value as f32);
            }
            let (mut again, mut other) = (l.clone(), two.clone());
            assert!(pulp::Arch::new().dispatch(Solved(&mut l, &mut two)));
            assert!(pulp::Scalar::new().vectorize(Solved(&mut again, &mut other)));
            assert_eq!(two, other);
            let want = rhs.dot(&a.lu().solve(&rhs).expect("regular"));
            let got = two.iter().map(|x| f64::from(x[0] * x[23])).sum::<f64>();
            assert!((got - 2.0 * want).abs() < 1e-5 * want.abs(), "{got} for {want}");
        }
        let mut indefinite = Banded::default();
        indefinite.set(2, |i, below| if below == 1 { 2.0 } else { [1.0, 1.0][i] });
        assert!(!indefinite.factor(pulp::Scalar::new()));
    }
}
