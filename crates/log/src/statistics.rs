//! Rate and gaps of a stream from its times, without keeping them.

use crate::topic::Gap;
use std::collections::BTreeMap;

/// An interval of more than so many medians is a gap: at the usual jitter of a logger, of less than a period,
/// one lost sample gives up to three.
const GAP_MEDIANS: i64 = 3;

/// Classes of intervals in each octave: an interval's class is right to 6 %.
const CLASSES_AN_OCTAVE: u32 = 16;

/// Intervals of a class.
#[derive(Debug, Clone, Copy, Default)]
struct Class {
    count: u64,
    sum_ns: i128,
    longest_ns: i64,
}

/// The intervals between the samples of a stream, in classes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Intervals {
    classes: BTreeMap<u16, Class>,
    longest: Option<Gap>,
}

/// What the intervals show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Regularity {
    pub(crate) rate_hz: Option<f64>,
    pub(crate) gaps: u64,
    pub(crate) longest_gap: Option<Gap>,
}

/// Floor of the logarithm, in parts of an octave that are of one length.
fn class_of(interval_ns: i64) -> u16 {
    let interval = interval_ns.unsigned_abs().max(1);
    let octave = interval.ilog2();
    let above = (u128::from(interval) * u128::from(CLASSES_AN_OCTAVE)) >> octave;
    (octave * CLASSES_AN_OCTAVE) as u16 + (above as u16 - CLASSES_AN_OCTAVE as u16)
}

impl Intervals {
    /// Takes an interval above zero that begins at a time.
    pub(crate) fn add(&mut self, at_ns: i64, length_ns: i64) {
        let class = self.classes.entry(class_of(length_ns)).or_default();
        class.count += 1;
        class.sum_ns += i128::from(length_ns);
        class.longest_ns = class.longest_ns.max(length_ns);
        if self.longest.is_none_or(|longest| longest.length_ns < length_ns) {
            self.longest = Some(Gap { at_ns, length_ns });
        }
    }

    pub(crate) fn regularity(&self) -> Regularity {
        let all: u64 = self.classes.values().map(|c| c.count).sum();
        let mut before = 0;
        let median = self.classes.values().find(|class| {
            before += class.count;
            2 * before >= all
        });
        let Some(median) = median else { return Regularity { rate_hz: None, gaps: 0, longest_gap: None } };
        let bound_ns = (median.sum_ns / i128::from(median.count)) as i64;
        let bound_ns = bound_ns.saturating_mul(GAP_MEDIANS);
        let (gaps, usual): (Vec<&Class>, Vec<&Class>) = self
            .classes
            .values()
            .partition(|class| class.sum_ns > i128::from(bound_ns) * i128::from(class.count));
        let usual_s: f64 = usual.iter().map(|c| c.sum_ns as f64 * 1e-9).sum();
        let count: u64 = usual.iter().map(|c| c.count).sum();
        let gaps: u64 = gaps.iter().map(|c| c.count).sum();
        Regularity {
            rate_hz: Some(count as f64 / usual_s),
            gaps,
            longest_gap: self.longest.filter(|_| gaps > 0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_follow_each_other() {
        let classes: Vec<u16> = [1, 2, 3, 16, 17, 31, 32, 33, 34, i64::MAX].map(class_of).to_vec();
        assert!(classes.is_sorted(), "{classes:?}");
        assert_eq!((class_of(32), class_of(33), class_of(34)), (80, 80, 81));
    }

    #[test]
    fn rate_and_gaps_are_those_of_the_times() {
        let mut intervals = Intervals::default();
        assert_eq!(intervals.regularity().rate_hz, None);
        let mut t_ns = 5_000;
        // 400 Hz with a jitter of 0.2 ms, one sample lost twice, 80 ms lost once.
        for k in 0..1000 {
            let jitter_ns = if k % 2 == 0 { 200_000 } else { -200_000 };
            let length_ns = 2_500_000 + jitter_ns + if k % 500 == 499 { 2_500_000 } else { 0 };
            let length_ns = if k == 700 { 80_000_000 } else { length_ns };
            intervals.add(t_ns, length_ns);
            t_ns += length_ns;
        }
        let found = intervals.regularity();
        let rate_hz = found.rate_hz.unwrap();
        assert!((rate_hz - 400.0).abs() < 1.0, "{rate_hz}");
        let gap = found.longest_gap.unwrap();
        assert_eq!((found.gaps, gap.length_ns), (1, 80_000_000));
        assert!(gap.at_ns > 1_700_000_000 && gap.at_ns < 1_800_000_000, "{gap:?}");
    }
}
