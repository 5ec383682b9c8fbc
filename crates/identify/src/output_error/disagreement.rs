//! Whether two estimates of the same parameters disagree more than their uncertainties allow.

use super::covariance::inverse;
use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// How the errors of two estimates hang together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correlation {
    /// Independent, or of the same flight and so pulling the same way: the sum of the covariances, which is then too
    /// large rather than too small.
    IndependentOrAlike,
    /// Anything: the smallest bound of the kind (1 + 1/ω)C₁ + (1 + ω)C₂, which holds for every correlation.
    Unknown,
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

/// Compares two estimates with their covariances.
///
/// # Errors
/// [`IdentifyError::BadColumn`] for sizes that differ or numbers that are not finite; [`IdentifyError::RankZero`] for
/// covariances whose sum is not positive definite.
pub fn disagreement(
    (first, first_covariance): (&DVector<f64>, &DMatrix<f64>),
    (second, second_covariance): (&DVector<f64>, &DMatrix<f64>),
    correlation: Correlation,
) -> Result<Disagreement, IdentifyError> {
    let n = first.len();
    for (what, values, covariance) in
        [("first estimate", first, first_covariance), ("second estimate", second, second_covariance)]
    {
        let finite = values.iter().chain(covariance.iter()).all(|v| v.is_finite());
        if n == 0 || values.len() != n || covariance.shape() != (n, n) || !finite {
            return Err(IdentifyError::BadColumn { what: what.to_owned(), rows: n });
        }
    }
    let total = match correlation {
        Correlation::IndependentOrAlike => first_covariance + second_covariance,
        Correlation::Unknown => {
            // Of all ω the one with the smallest volume in the units of the first: the ratio of mean standard deviations.
            let ratio: f64 = (0..n)
                .map(|k| (first_covariance[(k, k)] / second_covariance[(k, k)].max(f64::MIN_POSITIVE)).sqrt())
                .sum::<f64>()
                / n as f64;
            let omega = ratio.clamp(1e-6, 1e6);
            first_covariance * (1.0 + 1.0 / omega) + second_covariance * (1.0 + omega)
        }
    };
    let d = first - second;
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
        let at = |x: f64, y: f64| DVector::from_vec(vec![x, y]);
        let apart = |x, y, how| disagreement((&at(x, y), &c), (&at(0.0, 0.0), &c), how).expect("a test");
        assert!(apart(3.0 * 0.02f64.sqrt(), 0.0, Correlation::IndependentOrAlike).is_significant());
        assert!(!apart(0.02f64.sqrt(), 1.0, Correlation::IndependentOrAlike).is_significant());
        let loose = apart(3.0 * 0.02f64.sqrt(), 0.0, Correlation::Unknown);
        assert!(
            (loose.chi_square - 4.5).abs() < 1e-9,
            "the bound doubles the variance: {}",
            loose.chi_square
        );
    }

    #[test]
    fn sizes_that_differ_are_refused() {
        let c = DMatrix::identity(2, 2);
        let refused =
            disagreement((&DVector::zeros(2), &c), (&DVector::zeros(3), &c), Correlation::IndependentOrAlike);
        assert!(matches!(refused, Err(IdentifyError::BadColumn { .. })));
    }
}
