//! The flight's knowledge of one camera.

use crate::Latencies;
use crate::stamps::{Backward, Stamps};
use mavsight_link::CameraState;
use std::collections::VecDeque;

/// Frames over which a camera's usual lateness is the median.
const LATENESS_FRAMES: usize = 31;
/// Intervals without a frame after which a camera stalls: where one is missing, the next is due after two.
const STALLED_INTERVALS: f64 = 2.5;
/// Instants running without a ball after which a camera is blind: one may be chance.
const BLIND_AFTER: u32 = 2;
/// What goes on is reported again after this time.
const REPORT_AGAIN_NS: i64 = 10_000_000_000;
/// Interval until it is known: that of the slowest camera that can serve an autopilot, four frames a second.
const SLOWEST_NS: i64 = 250_000_000;

/// What becomes of frames whose stamps are of another clock, and what to do.
pub(crate) const PASSED_OVER: &str =
    "its frames are passed over until their time stamps fit again; to have it sooner, start the flight again";

/// Why a frame is lacking.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lacking {
    /// It never came.
    Missing,
    /// It came and was dropped, as a later one had come before it was tracked.
    Dropped,
}

/// Whether something that goes on is to be reported, and notes that it is.
fn is_due(reported_ns: &mut Option<i64>, now_ns: i64) -> bool {
    let is_due = reported_ns.is_none_or(|at_ns| now_ns - at_ns >= REPORT_AGAIN_NS);
    if is_due {
        *reported_ns = Some(now_ns);
    }
    is_due
}

#[derive(Debug, Default)]
pub(crate) struct CameraStatus {
    pub(crate) interval_ns: i64,
    /// Whether its frames are recorded or rendered: no cable and no exposure keeps them.
    pub(crate) is_played: bool,
    last_frame_ns: Option<i64>,
    gone: Option<String>,
    /// Whether it is gone for good.
    is_over: bool,
    /// What its images show of it beside those of other cameras: moved or frozen.
    pub(crate) off: Option<CameraState>,
    is_dark: bool,
    reported: Option<CameraState>,
    /// Latest latenesses of its frames, and their median.
    lateness_ns: VecDeque<i64>,
    pub(crate) usual_ns: i64,
    pub(crate) is_left_out: bool,
    pub(crate) ended: bool,
    /// Since the last report: frames, frames in which each marker was identified, instants, latencies.
    pub(crate) frames: u64,
    pub(crate) markers: Vec<u64>,
    pub(crate) instants: u64,
    pub(crate) latency: Latencies,
    /// When its source was last opened, and interrupted.
    pub(crate) opened_ns: Option<i64>,
    pub(crate) interrupted_ns: i64,
    pub(crate) stamps: Stamps,
    /// What was last reported of its stamps, and when.
    reported_stamps: Option<(Backward, i64)>,
    pub(crate) latest_ns: i64,
    /// When its image last came once more, since the last new one.
    repeated_ns: Option<i64>,
    /// When a frame last came that was passed over for its stamp.
    passed_over_ns: i64,
    /// Frames that never came, that this computer dropped, and gaps that those have left, since the start.
    pub(crate) missing: u64,
    dropped: u64,
    dropped_gaps: u64,
    /// When a frame that is lacking was last reported.
    lacking_ns: Option<i64>,
    /// Instants running at which it saw none of the balls, and when that was last reported.
    blind: u32,
    blind_ns: Option<i64>,
}

impl CameraStatus {
    pub(crate) fn new(markers: usize) -> Self {
        Self {
            interval_ns: SLOWEST_NS,
            markers: vec![0; markers],
            interrupted_ns: i64::MIN,
            latest_ns: i64::MIN,
            passed_over_ns: i64::MIN,
            ..Self::default()
        }
    }

    pub(crate) fn opened(&mut self, now_ns: i64) {
        (self.opened_ns, self.gone, self.last_frame_ns) = (Some(now_ns), None, None);
    }

    pub(crate) fn gone(&mut self, reason: String) {
        self.gone = Some(reason);
    }

    /// Its source, which is not opened again, has ended before the others'. Returns whether that is new.
    pub(crate) fn outlived(&mut self) -> bool {
        self.gone("its source has ended before the others'".to_owned());
        !std::mem::replace(&mut self.is_over, true)
    }

    pub(crate) fn arrived(&mut self, t_ns: i64, received_ns: i64, is_dark: bool) {
        (self.last_frame_ns, self.is_dark, self.latest_ns) = (Some(received_ns), is_dark, t_ns);
        self.repeated_ns = None;
        self.stamps.push(t_ns);
        self.frames += 1;
        if self.lateness_ns.len() == LATENESS_FRAMES {
            self.lateness_ns.pop_front();
        }
        self.lateness_ns.push_back(received_ns - t_ns);
        let mut sorted: Vec<i64> = self.lateness_ns.iter().copied().collect();
        let middle = sorted.len() / 2;
        self.usual_ns = *sorted.select_nth_unstable(middle).1;
    }

    /// Takes how many frames this computer has dropped so far, before a frame of a time has [arrived](Self::arrived).
    /// Returns why frames are lacking where that is to be reported; that a camera has stalled has been reported.
    pub(crate) fn lacks_before(&mut self, t_ns: i64, dropped: u64, now_ns: i64) -> Option<Lacking> {
        let has_dropped = std::mem::replace(&mut self.dropped, dropped) < dropped;
        let missing = self.missing_before(t_ns);
        self.missing = self.missing.saturating_add(missing);
        let found = match (missing > 0, has_dropped) {
            (true, _) => Lacking::Missing,
            (false, true) => Lacking::Dropped,
            (false, false) => return None,
        };
        (self.reported != Some(CameraState::Stalled) && is_due(&mut self.lacking_ns, now_ns)).then_some(found)
    }

    /// Frames before one of a time that never came: neither dropped here nor passed over.
    fn missing_before(&mut self, t_ns: i64) -> u64 {
        let was_passed_over = self.last_frame_ns.is_none_or(|at_ns| self.passed_over_ns > at_ns);
        if was_passed_over || self.repeated_ns.is_some() {
            return 0;
        }
        let lacking = self.stamps.missing_before(t_ns);
        // A frame that was dropped while an earlier one was tracked leaves its gap later.
        let dropped = lacking.min(self.dropped - self.dropped_gaps);
        self.dropped_gaps += dropped;
        lacking - dropped
    }

    /// Whether a frame of about a time has come.
    pub(crate) fn has_frame_of(&self, t_ns: i64) -> bool {
        self.stamps.has_near(t_ns, self.interval_ns / 2)
    }

    pub(crate) fn is_dark(&self) -> bool {
        self.is_dark
    }

    /// Its image came once more.
    pub(crate) fn repeated(&mut self, received_ns: i64) {
        self.repeated_ns = Some(received_ns);
    }

    /// A frame came that is passed over for its stamp.
    pub(crate) fn passed_over(&mut self, received_ns: i64) {
        self.passed_over_ns = received_ns;
    }

    /// Since when its source has been silent if it has stalled.
    pub(crate) fn silent_since_ns(&self) -> Option<i64> {
        self.stalls_at_ns().map(|at_ns| at_ns.max(self.passed_over_ns))
    }

    /// Whether something of its stamps is to be reported: not again within some time.
    pub(crate) fn is_news(&mut self, found: Backward, now_ns: i64) -> bool {
        let is_old = |(last, at_ns): (Backward, i64)| last == found && now_ns - at_ns < REPORT_AGAIN_NS;
        let is_news = !self.reported_stamps.is_some_and(is_old);
        if is_news {
            self.reported_stamps = Some((found, now_ns));
        }
        is_news
    }

    /// Takes whether it saw any ball at an instant at which another camera saw the aircraft in its view.
    /// Returns whether that it sees none is to be reported.
    pub(crate) fn is_newly_blind(&mut self, sees: bool, now_ns: i64) -> bool {
        self.blind = if sees { 0 } else { self.blind.saturating_add(1) };
        self.blind == BLIND_AFTER && is_due(&mut self.blind_ns, now_ns)
    }

    /// Time at which it has stalled if no frame comes.
    pub(crate) fn stalls_at_ns(&self) -> Option<i64> {
        self.last_frame_ns.map(|t| t + (STALLED_INTERVALS * self.interval_ns as f64) as i64)
    }

    pub(crate) fn state(&self, now_ns: i64) -> CameraState {
        match self.stalls_at_ns() {
            _ if self.gone.is_some() => CameraState::Gone,
            None => CameraState::Starting,
            Some(stalls_ns) if now_ns > stalls_ns => CameraState::Stalled,
            _ => self.off.unwrap_or(if self.is_dark { CameraState::Dark } else { CameraState::Running }),
        }
    }

    /// Whether its state at a time differs from that of the last call.
    pub(crate) fn has_changed(&mut self, now_ns: i64) -> bool {
        let now = Some(self.state(now_ns));
        std::mem::replace(&mut self.reported, now) != now
    }

    /// Whether its image has come once more within the time after which it stalls.
    fn repeats(&self, now_ns: i64) -> bool {
        let long_ns = (STALLED_INTERVALS * self.interval_ns as f64) as i64;
        self.repeated_ns.is_some_and(|at_ns| now_ns - at_ns <= long_ns)
    }

    pub(crate) fn reason(&self, state: CameraState, now_ns: i64) -> Option<String> {
        let words = match state {
            CameraState::Running => return None,
            CameraState::Starting => {
                "it waits for its first frame; if none comes, look at its connection and exposure".to_owned()
            }
            CameraState::Stalled if self.stamps.has_other_clock() => {
                format!("its clock was set: {PASSED_OVER}")
            }
            CameraState::Stalled if self.repeats(now_ns) => {
                "one image comes over and over: what sends it hangs; switch it off and on".to_owned()
            }
            CameraState::Stalled => format!(
                "no frame for {:.0} ms and more: {}",
                1e-6 * STALLED_INTERVALS * self.interval_ns as f64,
                if self.is_played {
                    "this computer reads or renders its images too slowly: close other programs; of the virtual room \
                     take fewer or smaller ones (--rate, --size)"
                } else {
                    "look at its cable and the load of this computer"
                }
            ),
            CameraState::Gone => {
                let why = self.gone.as_deref().unwrap_or("its source has ended");
                let then = if self.is_over { "poses go on without it" } else { "it is being opened again" };
                format!("{why}; {then}")
            }
            CameraState::Moved => {
                "the aircraft is shifted in its image as a whole: the camera was moved, or its clock was set; until it fits \
                 again it is left out: fix it and calibrate again"
                    .to_owned()
            }
            CameraState::Frozen => {
                "its balls stand still while the aircraft moves: what sends it hangs; until its image \
                 changes and fits again it is left out: switch it off and on"
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
    fn a_frame_that_never_came_is_counted_and_reported_and_one_that_was_passed_over_is_not() {
        let mut camera = CameraStatus::new(4);
        camera.opened(0);
        camera.interval_ns = STEP;
        let take = |camera: &mut CameraStatus, k: i64, dropped| {
            let found = camera.lacks_before(k * STEP, dropped, k * STEP + 1000);
            camera.arrived(k * STEP, k * STEP + 1000, false);
            found
        };
        assert!((0..40).all(|k| take(&mut camera, k, 0).is_none()));
        assert_eq!(take(&mut camera, 41, 0), Some(Lacking::Missing));
        // Within ten seconds it is counted only.
        assert_eq!((take(&mut camera, 44, 0), camera.missing), (None, 3));
        assert!((45..900).all(|k| take(&mut camera, k, 0).is_none()));
        // The queue has dropped a frame while the one before it was tracked.
        assert_eq!((take(&mut camera, 900, 1), camera.missing), (Some(Lacking::Dropped), 3));
        assert_eq!((take(&mut camera, 902, 1), camera.missing), (None, 3));
        assert!((903..1800).all(|k| take(&mut camera, k, 1).is_none()));
        camera.passed_over(1801 * STEP);
        assert_eq!((take(&mut camera, 1802, 1), camera.missing), (None, 3));
        camera.repeated(1803 * STEP);
        assert_eq!((take(&mut camera, 1804, 1), camera.missing), (None, 3));
        // Stamps of any size are counted.
        camera.missing = u64::MAX;
        assert_eq!((take(&mut camera, 1806, 1), camera.missing), (Some(Lacking::Missing), u64::MAX));
    }

    #[test]
    fn a_camera_stalls_when_a_second_frame_is_missing_and_comes_back() {
        let mut camera = CameraStatus::new(4);
        let change =
            |camera: &mut CameraStatus, now_ns| camera.has_changed(now_ns).then(|| camera.state(now_ns));
        assert_eq!(change(&mut camera, 0), Some(CameraState::Starting));
        camera.opened(0);
        assert_eq!(change(&mut camera, 1), None);
        camera.interval_ns = STEP;
        camera.arrived(0, 1000, false);
        assert_eq!(change(&mut camera, 1000), Some(CameraState::Running));
        assert_eq!(change(&mut camera, 1000 + 5 * STEP / 2 - 10), None);
        assert_eq!(change(&mut camera, 1000 + 5 * STEP / 2 + 10), Some(CameraState::Stalled));
        let remedy = |camera: &CameraStatus| camera.reason(CameraState::Stalled, 0).unwrap();
        assert!(remedy(&camera).contains("cable"));
        camera.is_played = true;
        assert!(remedy(&camera).contains("--rate") && !remedy(&camera).contains("cable"));
        camera.gone("the cable is off".into());
        assert_eq!(change(&mut camera, 1000), Some(CameraState::Gone));
        assert!(camera.reason(CameraState::Gone, 1000).is_some_and(|r| r.contains("the cable is off")));
        camera.opened(1500);
        assert_eq!(change(&mut camera, 2000), Some(CameraState::Starting));
        camera.arrived(2500, 3000, true);
        assert_eq!(change(&mut camera, 3000), Some(CameraState::Dark));
        camera.arrived(3500, 4000, false);
        camera.off = Some(CameraState::Moved);
        assert_eq!(change(&mut camera, 4000), Some(CameraState::Moved));
        assert!(camera.reason(CameraState::Running, 4000).is_none());
    }
}
