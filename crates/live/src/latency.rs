//! Statistics of durations in constant memory.

use smart_default::SmartDefault;

/// Ratio of neighbouring bin edges of the histogram.
const STEP: f64 = 1.05;
/// Bins from 1 µs to beyond 10 s.
const STEPS: usize = 340;

/// A histogram of durations from a microsecond to ten seconds, exact to 5 %.
#[derive(Debug, Clone, SmartDefault)]
pub struct Latencies {
    #[default(vec![0; STEPS])]
    counts: Vec<u64>,
    total: u64,
    most_ms: f64,
}

impl Latencies {
    /// Adds a duration.
    pub fn add_ns(&mut self, ns: i64) {
        let us = (ns as f64 * 1e-3).max(1.0);
        let at = (us.ln() / STEP.ln()) as usize;
        self.counts[at.min(STEPS - 1)] += 1;
        self.total += 1;
        self.most_ms = self.most_ms.max(us * 1e-3);
    }

    /// Longest duration.
    pub fn most_ms(&self) -> f64 {
        self.most_ms
    }

    /// Quantile of the durations, the upper edge of its bin; 0 if there are none.
    pub fn quantile_ms(&self, share: f64) -> f64 {
        let wanted = (share * self.total as f64).ceil() as u64;
        let mut sum = 0;
        for (k, count) in self.counts.iter().enumerate() {
            sum += count;
            if sum >= wanted && sum > 0 {
                return (STEP.powi(k as i32 + 1) * 1e-3).min(self.most_ms);
            }
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_exact_to_a_step() {
        let mut all = Latencies::default();
        assert_eq!(all.quantile_ms(0.5), 0.0);
        (1..=10_000).for_each(|k| all.add_ns(k * 1000));
        for (share, want_ms) in [(0.5, 5.0), (0.99, 9.9), (1.0, 10.0)] {
            let got = all.quantile_ms(share);
            assert!((want_ms..=want_ms * 1.05).contains(&got), "{share}: {got}");
        }
        all.add_ns(i64::MAX);
        all.add_ns(-5);
        assert_eq!(all.total, 10_002);
    }
}
