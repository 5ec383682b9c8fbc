//! Sums of products as if formed in twice the working precision.

/// A running sum and what its roundings lost (Ogita, Rump & Oishi 2005, algorithm 5.3, `Dot2`).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Compensated {
    sum: f64,
    lost: f64,
}

impl Compensated {
    pub(crate) fn new(start: f64) -> Self {
        Self { sum: start, lost: 0.0 }
    }

    /// Adds a number; the rounding error is found without error (Knuth 1969, theorem 4.2.2 B).
    pub(crate) fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        let part = sum - self.sum;
        self.lost += (self.sum - (sum - part)) + (term - part);
        self.sum = sum;
    }

    /// Adds a product with the rounding error of the product.
    pub(crate) fn add_product(&mut self, a: f64, b: f64) {
        let product = a * b;
        self.lost += a.mul_add(b, -product);
        self.add(product);
    }

    pub(crate) fn value(self) -> f64 {
        self.sum + self.lost
    }
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
