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

/// How a sensor was sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Mean time from one sample to the next, holes left out.
    pub interval_s: f64,
    /// Steps that are longer are holes.
    pub longest_ns: i64,
}

/// Steps between samples are holes where they are longer than this many times that step which one in twenty exceeds: a
/// log that comes in bursts has long steps that are no holes.
const LONGER: i64 = 3;
const ONE_IN: usize = 20;

impl Sampling {
    /// Of times in rising order; none of fewer than two.
    pub fn of(times_ns: &[i64]) -> Option<Self> {
        let mut steps_ns: Vec<i64> = times_ns.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps_ns.sort_unstable();
        let usual = steps_ns.len().checked_sub(1 + steps_ns.len() / ONE_IN)?;
        let longest_ns = steps_ns[usual].saturating_mul(LONGER);
        let own = &steps_ns[..steps_ns.partition_point(|step| *step <= longest_ns)];
        let interval_s = own.iter().map(|step| *step as f64).sum::<f64>() * 1e-9 / own.len() as f64;
        Some(Self { interval_s, longest_ns })
    }
}

/// Degrees of freedom from which on F is chi-square over its degrees of freedom, to a part in ten thousand.
const MANY: f64 = 1e4;

/// Probability that an F ratio exceeds `ratio` by chance; 1 for what is no ratio.
pub(crate) fn beyond_f(ratio: f64, above: f64, below: f64) -> f64 {
    let below = below.min(MANY);
    checked_beta_reg(0.5 * below, 0.5 * above, below / (below + above * ratio)).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(steps_ns: impl IntoIterator<Item = i64>) -> Vec<i64> {
        let sum = |at: &mut i64, step: i64| Some(std::mem::replace(at, *at + step));
        steps_ns.into_iter().chain([0]).scan(0, sum).collect()
    }

    /// A log of a minute with a hole of a minute had twice the noise density.
    #[test]
    fn holes_are_no_part_of_the_interval_between_samples() {
        let even = Sampling::of(&times([5_000_000; 200])).unwrap();
        let broken = Sampling::of(&times((0..200).map(|k| if k == 80 { 1_000_000_000 } else { 5_000_000 })));
        assert_eq!((even, even.interval_s), (broken.unwrap(), 5e-3));
        assert_eq!(Sampling::of(&[7]), None);
        assert_eq!(Sampling::of(&[7, 10]).map(|s| s.longest_ns), Some(9));
    }

    #[test]
    fn pauses_between_bursts_are_no_holes() {
        let bursts = Sampling::of(&times((0..400).map(|k| if k % 4 == 3 { 9_000_000 } else { 1_000_000 })));
        let Sampling { interval_s, longest_ns } = bursts.unwrap();
        assert!((interval_s - 3e-3).abs() < 1e-12 && longest_ns == 27_000_000, "{interval_s} {longest_ns}");
    }
}
