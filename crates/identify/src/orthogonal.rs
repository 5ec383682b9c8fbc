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
    /// Orthonormal columns.
    pub(crate) q: DMatrix<f64>,
    r: DMatrix<f64>,
}

impl Factored {
    /// Householder QR.
    ///
    /// # Errors
    /// [`IdentifyError::RankZero`] for a column of zeros.
    pub(crate) fn new(columns: &DMatrix<f64>) -> Result<Self, IdentifyError> {
        let scales = DVector::from_iterator(
            columns.ncols(),
            columns.column_iter().map(|c| power_of_two(c.amax(), c.norm())),
        );
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

    /// Coefficients and residuals of least squares.
    pub(crate) fn solve(&self, output: &DVector<f64>) -> Result<(DVector<f64>, DVector<f64>), IdentifyError> {
        let zero = DVector::zeros(self.columns.ncols());
        let (x, residuals) = self.augmented(output, &zero)?;
        Ok((x.component_div(&self.scales), residuals))
    }

    /// (XᵀX)⁻¹.
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

    /// x and r of r + X x = f, Xᵀ r = g, by fixed-precision refinement (Björck 1967): both right sides are
    /// formed in twice the working precision, so x is right to nearly the last digit as long as condition × ε
    /// is below one. Rounding of r cancels: it enters both sides and is taken out again.
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
            let (dx, dr) = self.correction(&left_f, &left_g)?;
            let step = dx.norm();
            if !step.is_finite() {
                return Err(IdentifyError::RankZero);
            }
            // A step no smaller than half the one before is rounding.
            if step > 0.5 * last_step {
                break;
            }
            x += &dx;
            r += &dr;
            last_step = step;
            if step <= f64::EPSILON * 0.25 * x.norm() {
                break;
            }
        }
        Ok((x, r))
    }

    fn correction(
        &self,
        f: &DVector<f64>,
        g: &DVector<f64>,
    ) -> Result<(DVector<f64>, DVector<f64>), IdentifyError> {
        let along = self.q.tr_mul(f);
        let h = self.r.tr_solve_upper_triangular(g).ok_or(IdentifyError::RankZero)?;
        let dx = self.r.solve_upper_triangular(&(&along - &h)).ok_or(IdentifyError::RankZero)?;
        let dr = f - &self.q * (along - h);
        Ok((dx, dr))
    }
}

/// A running sum and what its roundings lost (Ogita, Rump & Oishi 2005, algorithm 5.3, `Dot2`).
#[derive(Debug, Clone, Copy, Default)]
struct Compensated {
    sum: f64,
    lost: f64,
}

impl Compensated {
    fn new(start: f64) -> Self {
        Self { sum: start, lost: 0.0 }
    }

    /// Adds a number; the rounding error is found without error (Knuth 1969, theorem 4.2.2 B).
    fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        let part = sum - self.sum;
        self.lost += (self.sum - (sum - part)) + (term - part);
        self.sum = sum;
    }

    /// Adds a product with the rounding error of the product.
    fn add_product(&mut self, a: f64, b: f64) {
        let product = a * b;
        self.lost += a.mul_add(b, -product);
        self.add(product);
    }

    fn value(self) -> f64 {
        self.sum + self.lost
    }
}

/// A sum of two numbers less products, as if formed in twice the working precision.
fn remainder(first: f64, second: f64, products: impl Iterator<Item = (f64, f64)>) -> f64 {
    let mut sum = Compensated::new(first);
    sum.add(second);
    products.for_each(|(a, b)| sum.add_product(-a, b));
    sum.value()
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
        let mut sum = Compensated::new(1e16);
        for term in [1.0, -1e16, 1e-3] {
            sum.add(term);
        }
        assert_eq!(sum.value(), 1.001);
        let a = 1.0 + f64::EPSILON;
        let mut dot = Compensated::default();
        dot.add_product(a, a);
        dot.add_product(-1.0, 1.0 + 2.0 * f64::EPSILON);
        assert_eq!(dot.value(), f64::EPSILON * f64::EPSILON);
    }
}
