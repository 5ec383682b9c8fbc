//! Frames that are missing, and stretches in which frames come more slowly.

use super::{GAP_INTERVALS, Stream};

/// So many intervals in a row that are alike, and longer than usual, are no chance: where half of the frames were lost, an interval
/// would be twice as long in one case of four, and ten in a row in one of a million.
const ALIKE_IN_A_ROW: usize = 10;

/// Intervals that differ by less than this part are alike: stamps of phones scatter by a millisecond or two.
const ALIKE: f64 = 0.1;

/// A time between two frames that came one after the other.
#[derive(Debug, Clone, Copy)]
struct Interval {
    from_ns: i64,
    to_ns: i64,
}

impl Interval {
    fn length(&self) -> f64 {
        (self.to_ns - self.from_ns) as f64
    }
}

impl Stream {
    /// Frames missing between those that came, and stretches in which they came more slowly; copies came.
    pub(super) fn gaps(&self) -> Vec<String> {
        let usual_ns = self.interval_s() * 1e9;
        let mut came: Vec<i64> = self.stamps_ns.iter().chain(&self.faults.copies_ns).copied().collect();
        came.sort_unstable();
        let all: Vec<Interval> = came.windows(2).map(|w| Interval { from_ns: w[0], to_ns: w[1] }).collect();
        let is_long = |i: &Interval| i.length() > GAP_INTERVALS * usual_ns;
        let are_alike = |a: &Interval, b: &Interval| {
            is_long(a) && is_long(b) && (a.length() - b.length()).abs() < ALIKE * a.length()
        };
        let (slow, rest): (Vec<_>, Vec<_>) =
            all.chunk_by(are_alike).partition(|run| run.len() >= ALIKE_IN_A_ROW);
        let missing: Vec<Interval> = rest.into_iter().flatten().filter(|i| is_long(i)).copied().collect();
        let slow = slow.into_iter().map(|run| self.slow_note(run, usual_ns));
        slow.chain(self.missing_note(&missing, usual_ns)).collect()
    }

    fn slow_note(&self, run: &[Interval], usual_ns: f64) -> String {
        let (from_ns, to_ns) = (run[0].from_ns, run[run.len() - 1].to_ns);
        let times = (to_ns - from_ns) as f64 / run.len() as f64 / usual_ns;
        format!(
            "{}: from {:.3} to {:.3} s its frames are {times:.1} times as far apart as usual. In slow motion, time is stretched there \
             and every speed is as many times too small: film without it. In the dark, a phone films more slowly: add light.",
            self.name,
            from_ns as f64 * 1e-9,
            to_ns as f64 * 1e-9
        )
    }

    fn missing_note(&self, gaps: &[Interval], usual_ns: f64) -> Option<String> {
        let count = |gap: &Interval| ((gap.length() / usual_ns).round() as i64 - 1).max(1);
        let first = gaps.first()?;
        let missing: i64 = gaps.iter().map(count).sum();
        let places =
            if gaps.len() > 1 { format!(" in {} places, the first", gaps.len()) } else { String::new() };
        let first_s = first.from_ns as f64 * 1e-9;
        Some(format!(
            "{}: {missing} frame(s) are missing{places} after {first_s:.3} s ({} there).",
            self.name,
            count(first)
        ))
    }
}
