//! When an observation, a marker or a claim about noise is refuted.

use crate::statistics::beyond_f;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Share of correct observations that a gate rejects.
const GATE_PROBABILITY: f64 = 0.001;

/// Difference of two poses' chi-squares for odds of 999 to 1: 2 ln 999.
pub(super) const DECISIVE_CHI_SQUARE: f64 = 13.814;

/// Degrees of freedom of the claimed covariances against an instant's: four markers in two cameras.
pub(crate) const CLAIM_DEGREES: f64 = 10.0;

/// The 99.9 % quantile of chi-square.
pub(crate) fn chi_square_gate(degrees: usize) -> f64 {
    chi_square_beyond(degrees, GATE_PROBABILITY)
}

/// What chi-square exceeds with a probability.
pub(crate) fn chi_square_beyond(degrees: usize, probability: f64) -> f64 {
    ChiSquared::new(degrees.max(1) as f64).map_or(f64::INFINITY, |c| c.inverse_cdf(1.0 - probability))
}

/// Whether a ratio of variances is beyond the 99.9 % quantile of F.
pub(super) fn beyond_f_gate(ratio: f64, above: usize, below: usize) -> bool {
    beyond_f(ratio, above as f64, below as f64) < GATE_PROBABILITY
}

/// The factor on the claimed covariances that residuals suggest, where systematic errors raise the mean
/// chi-square by `explained`: the mean of claim and residuals, weighted by their degrees of freedom (the
/// conjugate scaled inverse chi-square; Gelman et al. 2013, section 2.6), or the residuals' alone where they
/// refute the claim. Then it is the noise that is larger, and systematic errors explain no more.
pub(super) fn noise_factor(chi_square: f64, explained: f64, degrees: usize) -> f64 {
    let nu = degrees as f64;
    if degrees == 0 {
        return 1.0;
    }
    let own = chi_square * nu / (nu + explained);
    if own > chi_square_gate(degrees) {
        return (chi_square - explained) / nu;
    }
    (CLAIM_DEGREES + own) / (CLAIM_DEGREES + nu)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gates_are_the_quantiles_of_tables() {
        for (degrees, quantile) in [(2, 13.816), (4, 18.467), (10, 29.588)] {
            assert!((chi_square_gate(degrees) / quantile - 1.0).abs() < 1e-4, "{degrees}");
        }
        for (below, quantile) in [(6, 21.92), (12, 9.633)] {
            assert!(!beyond_f_gate(quantile * 0.999, 4, below) && beyond_f_gate(quantile * 1.001, 4, below));
        }
        assert!(!beyond_f_gate(f64::NAN, 4, 6) && beyond_f_gate(f64::INFINITY, 4, 6));
    }

    #[test]
    fn a_refuted_claim_counts_for_nothing() {
        assert!((noise_factor(10.0, 0.0, 10) - 1.0).abs() < 1e-12);
        assert!((noise_factor(20.0, 0.0, 10) - 1.5).abs() < 1e-12);
        assert!((noise_factor(1000.0, 0.0, 10) - 100.0).abs() < 1e-12);
        assert_eq!(noise_factor(0.0, 0.0, 0), 1.0);
    }

    #[test]
    fn systematic_errors_explain_what_they_are_expected_to_and_no_more() {
        assert!((noise_factor(40.0, 30.0, 10) - 1.0).abs() < 1e-12);
        assert!((noise_factor(1030.0, 30.0, 10) - 100.0).abs() < 1e-12);
    }
}
