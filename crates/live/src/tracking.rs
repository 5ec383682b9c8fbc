//! The state of tracking.

use mavsight_link::Tracking;

/// Instants without a pose after which the aircraft is lost.
const LOST_AFTER: u32 = 2;
/// Time without an instant, ns, in which an autopilot still takes poses for one stream: PX4's `EV_MAX_INTERVAL`.
const APART_NS: i64 = 200_000_000;
/// Time for which the aircraft counts as found again.
const FOUND_NS: i64 = 1_000_000_000;

#[derive(Debug, Clone, Default)]
pub(crate) struct TrackingState {
    pub(crate) state: Tracking,
    missed: u32,
    /// Time of the latest pose.
    seen_ns: i64,
    found_ns: i64,
    /// Number of poses that do not continue those before, modulo 256.
    pub(crate) resets: u8,
    /// Whether the next pose does not continue the last, because a camera that was wrong was left out or came back.
    is_cut: bool,
}

impl TrackingState {
    /// Takes an instant, and whether it has a pose; `interval_ns` is that of the slowest camera.
    pub(crate) fn saw(&mut self, t_ns: i64, measured: bool, interval_ns: i64) -> Tracking {
        if !measured {
            self.missed = self.missed.saturating_add(1);
        }
        // While no camera gives frames, no instant is missed. With as many missing, the next is due half an interval later.
        let most_ns = APART_NS.max(((f64::from(LOST_AFTER) + 0.5) * interval_ns as f64) as i64);
        let is_lost = self.missed >= LOST_AFTER || t_ns.saturating_sub(self.seen_ns) > most_ns;
        if is_lost && matches!(self.state, Tracking::Tracking | Tracking::Reacquired) {
            self.state = Tracking::Lost;
        }
        if !measured {
            return self.state;
        }
        (self.missed, self.seen_ns) = (0, t_ns);
        if std::mem::take(&mut self.is_cut) || self.state == Tracking::Lost {
            self.resets = self.resets.wrapping_add(1);
        }
        match self.state {
            Tracking::Acquiring => self.state = Tracking::Tracking,
            Tracking::Lost => {
                self.state = Tracking::Reacquired;
                self.found_ns = t_ns;
            }
            Tracking::Reacquired if t_ns - self.found_ns >= FOUND_NS => self.state = Tracking::Tracking,
            _ => {}
        }
        self.state
    }

    /// A camera that was wrong is left out, or is right again: the next pose does not continue the one before.
    pub(crate) fn cut(&mut self) {
        self.is_cut |= self.state != Tracking::Acquiring;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 16_666_667;

    #[test]
    fn tracking_goes_through_its_states() {
        let mut tracking = TrackingState::default();
        let mut t = 0;
        let mut saw = |measured: bool, n: usize| {
            let mut last = Tracking::Acquiring;
            for _ in 0..n {
                t += STEP;
                last = tracking.saw(t, measured, STEP);
            }
            (last, tracking.resets)
        };
        assert_eq!(saw(false, 10), (Tracking::Acquiring, 0));
        assert_eq!(saw(true, 1), (Tracking::Tracking, 0));
        // One instant missed is no loss; two are.
        assert_eq!(saw(false, 1), (Tracking::Tracking, 0));
        assert_eq!(saw(true, 1), (Tracking::Tracking, 0));
        assert_eq!(saw(false, 2), (Tracking::Lost, 0));
        assert_eq!(saw(true, 59), (Tracking::Reacquired, 1));
        assert_eq!(saw(true, 3), (Tracking::Tracking, 1));
        // Whatever was left out and came back at once, one pose does not follow.
        tracking.cut();
        tracking.cut();
        assert_eq!(tracking.resets, 1);
        tracking.saw(t + STEP, true, STEP);
        tracking.saw(t + 2 * STEP, true, STEP);
        assert_eq!(tracking.resets, 2);
        let mut early = TrackingState::default();
        early.cut();
        early.saw(0, true, STEP);
        assert_eq!(early.resets, 0);
    }
    /// While no camera gives frames there are no instants that could be missed.
    #[test]
    fn an_aircraft_of_which_nothing_comes_for_long_is_lost() {
        for (interval_ns, gap_ns, is_lost) in [
            (STEP, 190_000_000, false),
            (STEP, 210_000_000, true),
            // Of a slow camera as many intervals as instants.
            (250_000_000, 500_000_000, false),
            (250_000_000, 750_000_000, true),
        ] {
            let mut tracking = TrackingState::default();
            tracking.saw(0, true, interval_ns);
            let found = tracking.saw(gap_ns, true, interval_ns);
            let wanted = if is_lost { (Tracking::Reacquired, 1) } else { (Tracking::Tracking, 0) };
            assert_eq!((found, tracking.resets), wanted, "{gap_ns} ns");
            let empty = tracking.saw(2 * gap_ns, false, interval_ns);
            assert_eq!(empty == Tracking::Lost, is_lost, "{gap_ns} ns");
        }
    }
}
