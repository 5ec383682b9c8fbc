//! When an observation, a marker or a claim about noise is refuted.

/// The share of true observations that a gate lets pass is 99.9 %: this is the normal quantile of it.
const GATE_NORMAL_QUANTILE: f64 = 3.090;

/// What two poses' chi-squares must differ by for the odds of the better one to be 999 to 1: 2 ln 999. It is also the
/// 99.9 % quantile of chi-square with two degrees of freedom.
pub(super) const DECISIVE_CHI_SQUARE: f64 = 13.814;

/// Weight of the claimed covariances against one instant's residuals when its noise is judged, in degrees of freedom: as
/// much as four markers in two cameras have.
pub(super) const CLAIM_DEGREES: f64 = 10.0;

/// Huber's bound for the length of a whitened residual in the plane: 95 % efficient where the noise is normal.
/// From (E[ψ'/2 + ψ/2r])² / (E[ψ²]/2) = 0.95 with r of a Rayleigh distribution (Huber 1981, section 8).
pub(super) const HUBER_BOUND: f64 = 1.501;

/// Mean of half a squared whitened residual in the plane as Huber's weights with that bound leave it, where the noise is normal: what a
/// scale estimated from them is to be divided by (Huber's proposal 2; Huber 1981, section 6.4).
pub(crate) const HUBER_MEAN: f64 = 0.801;

/// The 99.9 % quantile of chi-square (Wilson & Hilferty 1931; within 3 % from 2 degrees of freedom on, within 2 % from 4).
pub(crate) fn chi_square_gate(degrees: usize) -> f64 {
    let d = degrees.max(1) as f64;
    let c = 2.0 / (9.0 * d);
    d * (1.0 - c + GATE_NORMAL_QUANTILE * c.sqrt()).powi(3)
}

/// Whether a ratio of variances is beyond the 99.9 % quantile of F (Paulson 1942; a seventh too high for 6
/// degrees of freedom below, right from 12 on).
pub(super) fn beyond_f_gate(ratio: f64, above: usize, below: usize) -> bool {
    let (a, b) = (2.0 / (9.0 * above as f64), 2.0 / (9.0 * below as f64));
    let root = ratio.cbrt();
    let normal = ((1.0 - b) * root - (1.0 - a)) / (b * root * root + a).sqrt();
    normal > GATE_NORMAL_QUANTILE
}

/// The factor on the claimed covariances that residuals suggest, where errors that stay raise the mean chi-square by
/// `explained`: the mean of claim and residuals, weighted by their degrees of freedom (the conjugate scaled inverse
/// chi-square; Gelman et al. 2013, section 2.6), or the residuals' alone where they refute the claim.
///
/// A claim that stands gives noise and errors that stay their expected shares of the chi-square. Where it is refuted it is the
/// noise that is larger than was said, and the errors that stay explain no more than they did.
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
    fn the_mean_under_the_bound_is_that_of_a_rayleigh_distribution() {
        let (step, mut mean) = (1e-4, 0.0);
        for k in 0..100_000 {
            let r = (f64::from(k) + 0.5) * step;
            mean += 0.5 * (r * r).min(HUBER_BOUND * r) * r * (-0.5 * r * r).exp() * step;
        }
        assert!((mean - HUBER_MEAN).abs() < 5e-4, "{mean}");
    }

    #[test]
    fn gates_are_the_quantiles_of_tables() {
        for (degrees, quantile) in [(2u32, 13.816), (4, 18.467), (10, 29.588)] {
            assert!(
                (chi_square_gate(degrees as usize) / quantile - 1.0).abs() < 0.06 / f64::from(degrees),
                "{degrees}"
            );
        }
        // F(4, 6) at 99.9 % is 21.92, F(4, 12) is 9.633; the approximation errs upwards, by a seventh at most here.
        assert!(!beyond_f_gate(19.5, 4, 6) && beyond_f_gate(26.0, 4, 6));
        assert!(!beyond_f_gate(9.2, 4, 12) && beyond_f_gate(10.6, 4, 12));
    }

    #[test]
    fn a_refuted_claim_counts_for_nothing() {
        assert!((noise_factor(10.0, 0.0, 10) - 1.0).abs() < 1e-12);
        assert!((noise_factor(20.0, 0.0, 10) - 1.5).abs() < 1e-12);
        assert!((noise_factor(1000.0, 0.0, 10) - 100.0).abs() < 1e-12);
        assert_eq!(noise_factor(0.0, 0.0, 0), 1.0);
    }

    #[test]
    fn errors_that_stay_explain_what_they_are_expected_to_and_no_more() {
        assert!((noise_factor(40.0, 30.0, 10) - 1.0).abs() < 1e-12);
        assert!((noise_factor(1030.0, 30.0, 10) - 100.0).abs() < 1e-12);
    }
}
