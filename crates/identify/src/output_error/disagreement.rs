//! Whether two estimates of the same parameters disagree more than their uncertainties allow.

use crate::IdentifyError;
use crate::inverse::inverse;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Estimates of some parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    /// Value of each parameter.
    pub values: DVector<f64>,
    /// Covariance of their errors.
    pub covariance: DMatrix<f64>,
}

/// The chi-square test of a difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disagreement {
    /// dᵀ C⁻¹ d.
    pub chi_square: f64,
    /// Parameters compared.
    pub degrees: usize,
    /// Probability of as much or more were the estimates of the same truth.
    pub p_value: f64,
}

impl Disagreement {
    /// Whether the estimates disagree at the 5 % level.
    pub fn is_significant(&self) -> bool {
        self.p_value < 0.05
    }
}

/// Compares two estimates by chi-square with the sum of their covariances, which is right for independent
/// errors and too large, hence cautious, for estimates of one flight, whose errors are correlated positively.
///
/// # Errors
/// [`IdentifyError::BadColumn`] for sizes that differ or numbers that are not finite;
/// [`IdentifyError::RankZero`] for covariances whose sum is not positive definite.
pub fn disagreement(first: &Estimates, second: &Estimates) -> Result<Disagreement, IdentifyError> {
    let n = first.values.len();
    for (what, e) in [("first estimate", first), ("second estimate", second)] {
        let finite = e.values.iter().chain(e.covariance.iter()).all(|v| v.is_finite());
        if n == 0 || e.values.len() != n || e.covariance.shape() != (n, n) || !finite {
            return Err(IdentifyError::BadColumn { what: what.to_owned(), rows: n });
        }
    }
    let total = &first.covariance + &second.covariance;
    let d = &first.values - &second.values;
    let chi_square = d.dot(&(inverse(&total).ok_or(IdentifyError::RankZero)? * &d));
    Ok(Disagreement { chi_square, degrees: n, p_value: chi_square_tail(chi_square, n) })
}

/// Probability that a chi-square of `degrees` exceeds `x`.
pub(crate) fn chi_square_tail(x: f64, degrees: usize) -> f64 {
    ChiSquared::new(degrees as f64).map_or(1.0, |c| c.sf(x.max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_table() {
        // Abramowitz & Stegun, table 26.8: 5 % and 1 % points.
        for (degrees, five, one) in
            [(1, 3.84146, 6.63490), (2, 5.99146, 9.21034), (3, 7.81473, 11.3449), (10, 18.3070, 23.2093)]
        {
            assert!((chi_square_tail(five, degrees) - 0.05).abs() < 1e-6, "{degrees}");
            assert!((chi_square_tail(one, degrees) - 0.01).abs() < 1e-6, "{degrees}");
        }
    }

    #[test]
    fn a_difference_of_three_sigma_is_seen_and_of_one_is_not() {
        let c = DMatrix::from_diagonal(&DVector::from_vec(vec![0.01, 4.0]));
        let at = |x: f64, y: f64| Estimates { values: DVector::from_vec(vec![x, y]), covariance: c.clone() };
        let apart = |x, y| disagreement(&at(x, y), &at(0.0, 0.0)).expect("a test");
        assert!(apart(3.0 * 0.02f64.sqrt(), 0.0).is_significant());
        assert!(!apart(0.02f64.sqrt(), 1.0).is_significant());
    }

    #[test]
    fn sizes_that_differ_are_refused() {
        let of_size = |n| Estimates { values: DVector::zeros(n), covariance: DMatrix::identity(2, 2) };
        let refused = disagreement(&of_size(2), &of_size(3));
        assert!(matches!(refused, Err(IdentifyError::BadColumn { .. })));
    }
}
