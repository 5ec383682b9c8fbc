//! QR of scaled columns, and solutions of normal equations refined beyond it with sums of products as if
//! formed in twice the working precision.

use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};

/// Refinements at most: each gains as many digits as the condition leaves, so a handful reaches the last.
const MAX_REFINEMENTS: usize = 12;

/// Columns scaled to lengths between one and two by powers of two, which rounds nothing, and their thin QR.
pub(crate) struct Factored {
    columns: DMatrix<f64>,
    scales: DVector<f64>,
    pub(crate) q: DMatrix<f64>,
    r: DMatrix<f64>,
}

impl Factored {
    /// Householder QR.
    ///
    /// # Errors
    /// [`IdentifyError::RankZero`] for a column of zeros.
    pub(crate) fn new(columns: &DMatrix<f64>) -> Result<Self, IdentifyError> {
        let lengths = columns.column_iter().map(|c| power_of_two(c.amax(), c.norm()));
        let scales = DVector::from_iterator(columns.ncols(), lengths);
        if scales.iter().any(|s| !s.is_normal()) {
            return Err(IdentifyError::RankZero);
        }
        let mut scaled = columns.clone();
        for (mut column, scale) in scaled.column_iter_mut().zip(&scales) {
            column /= *scale;
        }
        let qr = scaled.clone().qr();
        let (q, r) = (qr.q(), qr.r());
        if r.diagonal().iter().any(|d| *d == 0.0) {
            return Err(IdentifyError::RankZero);
        }
        Ok(Self { columns: scaled, scales, q, r })
    }

    pub(crate) fn solve(&self, output: &DVector<f64>) -> Result<(DVector<f64>, DVector<f64>), IdentifyError> {
        let zero = DVector::zeros(self.columns.ncols());
        let (x, residuals) = self.augmented(output, &zero)?;
        Ok((x.component_div(&self.scales), residuals))
    }

    pub(crate) fn inverse_gram(&self) -> Result<DMatrix<f64>, IdentifyError> {
        let (rows, count) = self.columns.shape();
        let none = DVector::zeros(rows);
        let mut out = DMatrix::zeros(count, count);
        for j in 0..count {
            let unit = DVector::from_fn(count, |i, _| if i == j { -1.0 / self.scales[j] } else { 0.0 });
            let (x, _) = self.augmented(&none, &unit)?;
            out.set_column(j, &x.component_div(&self.scales));
        }
        Ok((&out + out.transpose()) * 0.5)
    }

    /// x and r of r + X x = f, Xᵀ r = g, by fixed-precision refinement (Björck 1967): what is left of both
    /// sides is formed in twice the working precision, so that x is right to nearly the last digit as long as
    /// condition × ε is below one.
    fn augmented(
        &self,
        f: &DVector<f64>,
        g: &DVector<f64>,
    ) -> Result<(DVector<f64>, DVector<f64>), IdentifyError> {
        let (rows, count) = self.columns.shape();
        let (mut x, mut r) = (DVector::<f64>::zeros(count), DVector::<f64>::zeros(rows));
        let mut last_step = f64::INFINITY;
        for _ in 0..MAX_REFINEMENTS {
            // What is left of f and g.
            let at = |i: usize, j: usize| self.columns[(i, j)];
            let left_f =
                DVector::from_fn(rows, |i, _| remainder(f[i], -r[i], (0..count).map(|j| (at(i, j), x[j]))));
            let left_g =
                DVector::from_fn(count, |j, _| remainder(g[j], 0.0, (0..rows).map(|i| (at(i, j), r[i]))));
            let along = self.q.tr_mul(&left_f);
            let h = self.r.tr_solve_upper_triangular(&left_g).ok_or(IdentifyError::RankZero)?;
            let dx = self.r.solve_upper_triangular(&(&along - &h)).ok_or(IdentifyError::RankZero)?;
            let step = dx.norm();
            if !step.is_finite() {
                return Err(IdentifyError::RankZero);
            }
            // A step no smaller than half the one before is rounding.
            if step > 0.5 * last_step {
                break;
            }
            x += dx;
            r += left_f - &self.q * (along - h);
            last_step = step;
            if step <= f64::EPSILON * 0.25 * x.norm() {
                break;
            }
        }
        Ok((x, r))
    }
}

/// A sum of two numbers less products, as if formed in twice the working precision: what roundings of sums
/// and products lose is found without error (Knuth 1969, theorem 4.2.2 B) and summed up (Ogita, Rump & Oishi
/// 2005, algorithm 5.3, `Dot2`).
fn remainder(first: f64, second: f64, products: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut sum, mut lost) = (first, 0.0);
    let mut add = |term: f64, rounding: f64| {
        let next = sum + term;
        let part = next - sum;
        lost += (sum - (next - part)) + (term - part) + rounding;
        sum = next;
    };
    add(second, 0.0);
    products.for_each(|(a, b)| add(-a * b, (-a).mul_add(b, a * b)));
    sum + lost
}

/// The power of two at or below the length of a column; zero where it has none.
fn power_of_two(largest: f64, length: f64) -> f64 {
    let size = if length.is_finite() { length } else { largest };
    if size > 0.0 { size.log2().floor().exp2() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cancels_in_working_precision_is_kept() {
        assert_eq!(remainder(1e16, 1.0, [(1e16, 1.0), (-1e-3, 1.0)].into_iter()), 1.001);
        let a = 1.0 + f64::EPSILON;
        let dot = remainder(0.0, 0.0, [(-a, a), (1.0, 1.0 + 2.0 * f64::EPSILON)].into_iter());
        assert_eq!(dot, f64::EPSILON * f64::EPSILON);
    }
}
