//! What is wrong with a camera's time stamps.

use mavsight_pipeline::usual_interval_ns;
use mavsight_pose::GAP_INTERVALS;
use std::collections::VecDeque;

/// Latest time stamps that are kept: a second of video.
const KEPT: usize = 32;
/// A stamp is off if it differs by more than this from what it should be: by less it could be that of any other
/// frame of an uneven camera.
const OFF_INTERVALS: f64 = 0.5;
/// Stamps are in an even beat where they are within this part of an interval of their turn: half of what would
/// make it doubtful whose turn it was.
const EVEN_INTERVALS: f64 = 0.25;
/// Intervals between stamps from which their beat is known.
const LEAST_INTERVALS: usize = 8;

/// Why a frame is not later than the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Backward {
    /// It has the same stamp.
    Twice,
    /// It is the one that was missing among those before: a later one has overtaken it.
    Overtaken,
    /// Frames of that time have come already: the clock was set back.
    ClockSet,
}

/// The latest time stamps of a camera, and whether its clock is what it was.
#[derive(Debug)]
pub(crate) struct Stamps {
    latest_ns: VecDeque<i64>,
    /// Whether the last frame was of a time of which frames had come already.
    is_set_back: bool,
    /// Least time from a stamp to its arrival so far, or 0 where that is more.
    least_ns: i64,
    /// Usual time from a stamp to its arrival before the clock was set.
    before_ns: Option<i64>,
}

impl Default for Stamps {
    fn default() -> Self {
        Self { latest_ns: VecDeque::with_capacity(KEPT), is_set_back: false, least_ns: 0, before_ns: None }
    }
}

impl Stamps {
    /// Takes the stamp of a frame that was later than the one before.
    pub(crate) fn push(&mut self, t_ns: i64) {
        if self.latest_ns.len() == KEPT {
            self.latest_ns.pop_front();
        }
        self.latest_ns.push_back(t_ns);
        self.is_set_back = false;
    }

    /// Whether one of the latest frames is of about a time.
    pub(crate) fn has_near(&self, t_ns: i64, within_ns: i64) -> bool {
        self.latest_ns.iter().rev().any(|known_ns| (known_ns - t_ns).abs() <= within_ns)
    }

    /// Frames that are missing between the last one and one of a later time.
    ///
    /// They are known by a gap of whole intervals between stamps in an even beat; where stamps are uneven, as those
    /// of arrival, or too few, none is.
    pub(crate) fn missing_before(&self, t_ns: i64) -> u64 {
        let Some(gap_ns) = self.latest_ns.back().map(|last_ns| t_ns.saturating_sub(*last_ns) as f64) else {
            return 0;
        };
        let mut apart_ns: Vec<i64> =
            self.latest_ns.iter().zip(self.latest_ns.iter().skip(1)).map(|(a, b)| b - a).collect();
        if apart_ns.len() < LEAST_INTERVALS {
            return 0;
        }
        apart_ns.sort_unstable();
        let quantile_ns = |quarters: usize| apart_ns[quarters * (apart_ns.len() - 1) / 4] as f64;
        let beat_ns = quantile_ns(2);
        if gap_ns <= GAP_INTERVALS * beat_ns {
            return 0;
        }
        let turns = (gap_ns / beat_ns).round();
        let most_ns = EVEN_INTERVALS * beat_ns;
        let is_even =
            quantile_ns(3) - quantile_ns(1) <= most_ns && (gap_ns - turns * beat_ns).abs() <= most_ns;
        if is_even { (turns as u64).saturating_sub(1) } else { 0 }
    }

    /// Why the frame that came now is not later than the last.
    pub(crate) fn why_backward(&mut self, t_ns: i64, interval_ns: i64) -> Backward {
        // A clock that was set back comes by the latest stamp once more.
        let found = if self.is_set_back { Backward::ClockSet } else { self.compared(t_ns, interval_ns) };
        self.is_set_back = found == Backward::ClockSet;
        found
    }

    fn compared(&self, t_ns: i64, interval_ns: i64) -> Backward {
        // The interval is not known yet where another camera begins later.
        let own_ns = usual_interval_ns(self.latest_ns.iter().copied());
        let interval_ns = own_ns.map_or(interval_ns, |own_ns| interval_ns.min(own_ns));
        let after = self.latest_ns.partition_point(|known_ns| *known_ns < t_ns);
        let later_ns = self.latest_ns.get(after);
        if later_ns == Some(&t_ns) && after + 1 == self.latest_ns.len() {
            return Backward::Twice;
        }
        let Some((later_ns, earlier_ns)) =
            later_ns.zip(after.checked_sub(1).and_then(|k| self.latest_ns.get(k)))
        else {
            return Backward::ClockSet;
        };
        let apart_ns = OFF_INTERVALS * interval_ns as f64;
        let is_apart = |from_ns: i64, to_ns: i64| (to_ns - from_ns) as f64 > apart_ns;
        let has_hole = (later_ns - earlier_ns) as f64 > GAP_INTERVALS * interval_ns as f64;
        if has_hole && is_apart(*earlier_ns, t_ns) && is_apart(t_ns, *later_ns) {
            Backward::Overtaken
        } else {
            Backward::ClockSet
        }
    }

    /// Notes that the clock was set; `usual_ns` passed from a stamp to its arrival before that.
    pub(crate) fn clock_was_set(&mut self, usual_ns: i64) {
        self.before_ns.get_or_insert(usual_ns);
    }

    /// Takes the time from a frame's stamp to its arrival. Returns whether the clock is off: no frame is there
    /// before it is filmed, so a stamp that is later than that by half an interval is by another clock. It is
    /// right again when the frames arrive as they did before.
    pub(crate) fn is_off(&mut self, late_ns: i64, usual_ns: i64, interval_ns: i64) -> bool {
        let apart_ns = (OFF_INTERVALS * interval_ns as f64) as i64;
        if late_ns < self.least_ns - apart_ns && !self.latest_ns.is_empty() {
            self.before_ns.get_or_insert(usual_ns);
        }
        self.before_ns = self.before_ns.filter(|before_ns| (late_ns - before_ns).abs() > apart_ns);
        if self.before_ns.is_none() {
            self.least_ns = self.least_ns.min(late_ns);
        }
        self.before_ns.is_some()
    }

    /// Whether its clock has been set and is not what it was.
    pub(crate) fn has_other_clock(&self) -> bool {
        self.before_ns.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 33_333_333;

    fn stamps(frames: impl IntoIterator<Item = i64>) -> Stamps {
        let mut stamps = Stamps::default();
        frames.into_iter().for_each(|k| stamps.push(k * STEP));
        stamps
    }

    #[test]
    fn a_frame_that_comes_late_again_or_by_another_clock_is_distinguished() {
        let mut regular = stamps(0..90);
        assert_eq!(regular.why_backward(89 * STEP, STEP), Backward::Twice);
        for back_ns in [1_000_000, STEP, 10_000_000, 200_000_000, 3_000_000_000] {
            let set = regular.why_backward(89 * STEP - back_ns, STEP);
            assert_eq!(set, Backward::ClockSet, "{back_ns}");
        }
        assert_eq!(regular.why_backward(89 * STEP, STEP), Backward::ClockSet);
        let mut with_hole = stamps((0..90).filter(|k| *k != 88));
        assert_eq!(with_hole.why_backward(88 * STEP, STEP), Backward::Overtaken);
        assert_eq!(with_hole.why_backward(87 * STEP, STEP), Backward::ClockSet);
        assert_eq!(Stamps::default().why_backward(0, STEP), Backward::ClockSet);
    }

    #[test]
    fn frames_are_missing_where_an_even_beat_leaves_a_gap_of_whole_intervals() {
        let even = stamps(0..40);
        for missing in 0..5 {
            for jitter_ns in [-6_000_000, 0, 6_000_000] {
                let t_ns = (40 + missing) * STEP + jitter_ns;
                assert_eq!(even.missing_before(t_ns), missing as u64, "{missing} {jitter_ns}");
            }
        }
        // Between two turns it may be a frame that was late.
        assert_eq!(even.missing_before(40 * STEP + STEP / 2 + 1_000_000), 0);
        // One hole does not make a beat uneven; stamps of arrival by a network are.
        assert_eq!(stamps((0..40).filter(|k| *k != 30)).missing_before(41 * STEP), 1);
        let mut uneven = Stamps::default();
        (0..40).for_each(|k| uneven.push(k * STEP + [0, 14_000_000, 3_000_000, 25_000_000][k as usize % 4]));
        assert_eq!(uneven.missing_before(41 * STEP), 0);
        assert_eq!(stamps(0..4).missing_before(9 * STEP), 0);
        // In dim light a camera takes every second frame: its beat is another one then.
        let slow = stamps((0..40).chain((40..80).step_by(2)));
        assert_eq!(slow.missing_before(80 * STEP), 0);
    }

    #[test]
    fn a_clock_that_is_ahead_is_off_until_it_is_right_and_a_line_that_catches_up_is_not() {
        let mut own = stamps(0..9);
        // Late, and in time again: a buffer was emptied.
        assert!([5, 5, 300, 300, 5, 5].iter().all(|ms| !own.is_off(ms * 1_000_000, 5_000_000, STEP)));
        assert!(own.is_off(-100_000_000, 5_000_000, STEP) && own.has_other_clock());
        // What becomes usual meanwhile changes nothing.
        assert!(own.is_off(-100_000_000, -100_000_000, STEP));
        assert!(!own.is_off(6_000_000, -100_000_000, STEP) && !own.has_other_clock());
        own.clock_was_set(5_000_000);
        assert!(own.is_off(250_000_000, 5_000_000, STEP) && !own.is_off(4_000_000, 5_000_000, STEP));
        // Stamps by the first camera's clock may be ahead of this computer's from the beginning.
        let mut ahead = Stamps::default();
        assert!((0..9).all(|k| {
            let is_off = ahead.is_off(-80_000_000, -80_000_000, STEP);
            ahead.push(k * STEP);
            !is_off
        }));
    }
}
