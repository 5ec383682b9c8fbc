//! Order statistics and distributions that several estimators need.

use statrs::function::beta::checked_beta_reg;

/// Half width of a 95 % interval of a normal error, in standard deviations.
pub const NORMAL_95: f64 = 1.959_964;

/// Standard deviation of a normal error over the median of its absolute values.
pub const MAD_TO_STD: f64 = 1.482_602;

/// The value in the middle of all in rising order, the upper one of two; nothing where there are none. What is not a number is
/// above all numbers, or below them if its sign is negative.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Degrees of freedom from which on F is chi-square over its degrees of freedom, to a part in ten thousand.
const MANY: f64 = 1e4;

/// Probability that an F ratio exceeds `ratio` by chance; 1 for what is no ratio.
pub(crate) fn beyond_f(ratio: f64, above: f64, below: f64) -> f64 {
    let below = below.min(MANY);
    checked_beta_reg(0.5 * below, 0.5 * above, below / (below + above * ratio)).unwrap_or(1.0)
}
