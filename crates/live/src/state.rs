//! States of tracking and of the cameras.

use mavsight_link::{CameraState, Tracking};

/// Instants without a pose after which the aircraft is lost.
const LOST_AFTER: u32 = 2;
/// Time for which the aircraft counts as found again.
const FOUND_NS: i64 = 1_000_000_000;
/// Intervals without a frame after which a camera stalls.
const STALLED_INTERVALS: f64 = 2.0;

/// The state of tracking, instant by instant.
#[derive(Debug, Clone)]
pub(crate) struct TrackingState {
    state: Tracking,
    missed: u32,
    found_ns: i64,
    resets: u8,
    has_measured: bool,
    /// Whether the next pose does not continue the last, because a camera was left out or came back.
    is_cut: bool,
}

impl Default for TrackingState {
    fn default() -> Self {
        Self {
            state: Tracking::Acquiring,
            missed: 0,
            found_ns: 0,
            resets: 0,
            has_measured: false,
            is_cut: false,
        }
    }
}

impl TrackingState {
    /// Updates the state by an instant.
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
        self.has_measured = true;
        self.state
    }

    /// A camera is left out, or back: the next pose does not continue the one before.
    pub(crate) fn cut(&mut self) {
        self.is_cut |= self.has_measured;
    }

    /// Number of poses that do not continue those before, modulo 256.
    pub(crate) fn resets(&self) -> u8 {
        self.resets
    }

    /// The state after the last instant.
    pub(crate) fn state(&self) -> Tracking {
        self.state
    }
}

/// The state of one camera.
#[derive(Debug, Clone)]
pub(crate) struct CameraStates {
    interval_ns: i64,
    last_frame_ns: Option<i64>,
    opened: bool,
    /// Reason why the source is gone.
    gone: Option<String>,
    /// Whether it is gone for good.
    is_over: bool,
    moved: bool,
    dark: bool,
    reported: Option<CameraState>,
}

impl Default for CameraStates {
    fn default() -> Self {
        Self {
            // Until it is known, that of the slowest camera that can serve an autopilot: four frames a
            // second.
            interval_ns: 250_000_000,
            last_frame_ns: None,
            opened: false,
            gone: None,
            is_over: false,
            moved: false,
            dark: false,
            reported: None,
        }
    }
}

impl CameraStates {
    /// Sets the time between its frames.
    pub(crate) fn set_interval_s(&mut self, interval_s: f64) {
        self.interval_ns = (interval_s * 1e9) as i64;
    }

    /// The time between its frames.
    pub(crate) fn interval_ns(&self) -> i64 {
        self.interval_ns
    }

    /// Its source was opened.
    pub(crate) fn opened(&mut self) {
        (self.opened, self.gone, self.last_frame_ns) = (true, None, None);
    }

    /// Its source has ended or cannot be opened.
    pub(crate) fn gone(&mut self, reason: String) {
        (self.opened, self.gone) = (false, Some(reason));
    }

    /// Its source, which is not opened again, has ended before the others'. Returns whether that is new.
    pub(crate) fn outlived(&mut self) -> bool {
        self.gone("its source has ended before the others'".to_owned());
        !std::mem::replace(&mut self.is_over, true)
    }

    /// A frame has arrived.
    pub(crate) fn frame(&mut self, now_ns: i64, dark: bool) {
        (self.last_frame_ns, self.dark) = (Some(now_ns), dark);
    }

    /// It was found to be moved.
    pub(crate) fn moved(&mut self) {
        self.moved = true;
    }

    /// Time at which it has stalled if no frame comes.
    pub(crate) fn stalls_at_ns(&self) -> Option<i64> {
        self.last_frame_ns.map(|t| t + (STALLED_INTERVALS * self.interval_ns as f64) as i64)
    }

    /// Its state at a time.
    pub(crate) fn state(&self, now_ns: i64) -> CameraState {
        if self.gone.is_some() {
            return CameraState::Gone;
        }
        let Some(stalls_ns) = self.stalls_at_ns() else { return CameraState::Starting };
        match () {
            () if now_ns > stalls_ns => CameraState::Stalled,
            () if self.moved => CameraState::Moved,
            () if self.dark => CameraState::Dark,
            () => CameraState::Running,
        }
    }

    /// Its state at a time, if it differs from that of the last call.
    pub(crate) fn change(&mut self, now_ns: i64) -> Option<CameraState> {
        let now = Some(self.state(now_ns));
        if std::mem::replace(&mut self.reported, now) == now { None } else { now }
    }

    /// The reason of a state, and its remedy.
    pub(crate) fn reason(&self, state: CameraState) -> Option<String> {
        let words = match state {
            CameraState::Running => return None,
            CameraState::Starting => {
                "it waits for its first frame; if none comes, look at its connection and exposure".to_owned()
            }
            CameraState::Stalled => format!(
                "no frame for {:.0} ms and more: look at its cable and the load of this computer",
                2e-6 * self.interval_ns as f64
            ),
            CameraState::Gone => {
                let why = self.gone.as_deref().unwrap_or("its source has ended");
                let then = if self.is_over { "poses go on without it" } else { "it is being opened again" };
                format!("{why}; {then}")
            }
            CameraState::Moved => {
                "the aircraft is shifted in its image as a whole: fix it and calibrate again to use it"
                    .to_owned()
            }
            CameraState::Dark => {
                "its image is black: check its power, its shutter, and that nothing covers it".to_owned()
            }
        };
        Some(words)
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
            (last, tracking.resets())
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
        assert_eq!(tracking.resets(), 1);
        tracking.saw(t + STEP, true);
        tracking.saw(t + 2 * STEP, true);
        assert_eq!(tracking.resets(), 2);
        let mut early = TrackingState::default();
        early.cut();
        early.saw(0, true);
        assert_eq!(early.resets(), 0);
    }

    #[test]
    fn a_camera_stalls_after_two_intervals_and_comes_back() {
        let mut camera = CameraStates::default();
        assert_eq!(camera.change(0), Some(CameraState::Starting));
        camera.opened();
        assert_eq!(camera.change(1), None);
        camera.set_interval_s(1.0 / 60.0);
        camera.frame(1000, false);
        assert_eq!(camera.change(1000), Some(CameraState::Running));
        assert_eq!(camera.change(1000 + 2 * STEP - 10), None);
        assert_eq!(camera.change(1000 + 2 * STEP + 10), Some(CameraState::Stalled));
        camera.gone("the cable is off".into());
        assert_eq!(camera.change(1000), Some(CameraState::Gone));
        assert!(camera.reason(CameraState::Gone).is_some_and(|r| r.contains("the cable is off")));
        camera.opened();
        assert_eq!(camera.change(2000), Some(CameraState::Starting));
        camera.frame(3000, true);
        assert_eq!(camera.change(3000), Some(CameraState::Dark));
        camera.frame(4000, false);
        camera.moved();
        assert_eq!(camera.change(4000), Some(CameraState::Moved));
        assert!(camera.reason(CameraState::Running).is_none());
    }
}
