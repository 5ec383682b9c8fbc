//! The state of tracking.

use mavsight_link::Tracking;

/// Instants without a pose after which the aircraft is lost.
const LOST_AFTER: u32 = 2;
/// Time for which the aircraft counts as found again.
const FOUND_NS: i64 = 1_000_000_000;

#[derive(Debug, Clone, Default)]
pub(crate) struct TrackingState {
    pub(crate) state: Tracking,
    missed: u32,
    found_ns: i64,
    /// Number of poses that do not continue those before, modulo 256.
    pub(crate) resets: u8,
    /// Whether the next pose does not continue the last, because a camera that was wrong was left out or came back.
    is_cut: bool,
}

impl TrackingState {
    pub(crate) fn saw(&mut self, t_ns: i64, measured: bool) -> Tracking {
        if !measured {
            self.missed = self.missed.saturating_add(1);
            if self.missed >= LOST_AFTER && matches!(self.state, Tracking::Tracking | Tracking::Reacquired) {
                self.state = Tracking::Lost;
            }
            return self.state;
        }
        self.missed = 0;
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
                last = tracking.saw(t, measured);
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
        tracking.saw(t + STEP, true);
        tracking.saw(t + 2 * STEP, true);
        assert_eq!(tracking.resets, 2);
        let mut early = TrackingState::default();
        early.cut();
        early.saw(0, true);
        assert_eq!(early.resets, 0);
    }
}
