//! Order statistics and distributions that several estimators need.

use statrs::function::beta::checked_beta_reg;

/// Half width of a 95 % interval of a normal error, in standard deviations.
pub const NORMAL_95: f64 = 1.959_964;

/// The upper median; not a number where there is none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Degrees of freedom from which on F is chi-square over its degrees of freedom, to a part in ten thousand.
const MANY: f64 = 1e4;

/// Probability that an F ratio exceeds `ratio` by chance; 1 for what is no ratio.
pub(crate) fn beyond_f(ratio: f64, above: f64, below: f64) -> f64 {
    let below = below.min(MANY);
    checked_beta_reg(0.5 * below, 0.5 * above, below / (below + above * ratio)).unwrap_or(1.0)
}
