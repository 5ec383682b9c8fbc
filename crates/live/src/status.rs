//! The flight's knowledge of one camera.

use crate::Latencies;
use mavsight_link::CameraState;
use std::collections::VecDeque;

/// Frames over which a camera's usual lateness is the median.
const LATENESS_FRAMES: usize = 31;
/// Intervals without a frame after which a camera stalls.
const STALLED_INTERVALS: f64 = 2.0;
/// Interval until it is known: that of the slowest camera that can serve an autopilot, four frames a second.
const SLOWEST_NS: i64 = 250_000_000;

#[derive(Debug, Default)]
pub(crate) struct CameraStatus {
    pub(crate) interval_ns: i64,
    last_frame_ns: Option<i64>,
    gone: Option<String>,
    /// Whether it is gone for good.
    is_over: bool,
    pub(crate) is_moved: bool,
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
    /// When a jump back of its stamps was last reported.
    pub(crate) went_back_ns: Option<i64>,
    pub(crate) latest_ns: i64,
}

impl CameraStatus {
    pub(crate) fn new(markers: usize) -> Self {
        Self {
            interval_ns: SLOWEST_NS,
            markers: vec![0; markers],
            interrupted_ns: i64::MIN,
            latest_ns: i64::MIN,
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
        self.frames += 1;
        if self.lateness_ns.len() == LATENESS_FRAMES {
            self.lateness_ns.pop_front();
        }
        self.lateness_ns.push_back(received_ns - t_ns);
        let mut sorted: Vec<i64> = self.lateness_ns.iter().copied().collect();
        let middle = sorted.len() / 2;
        self.usual_ns = *sorted.select_nth_unstable(middle).1;
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
            _ if self.is_moved => CameraState::Moved,
            _ if self.is_dark => CameraState::Dark,
            _ => CameraState::Running,
        }
    }

    /// Whether its state at a time differs from that of the last call.
    pub(crate) fn has_changed(&mut self, now_ns: i64) -> bool {
        let now = Some(self.state(now_ns));
        std::mem::replace(&mut self.reported, now) != now
    }

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
    fn a_camera_stalls_after_two_intervals_and_comes_back() {
        let mut camera = CameraStatus::new(4);
        let change =
            |camera: &mut CameraStatus, now_ns| camera.has_changed(now_ns).then(|| camera.state(now_ns));
        assert_eq!(change(&mut camera, 0), Some(CameraState::Starting));
        camera.opened(0);
        assert_eq!(change(&mut camera, 1), None);
        camera.interval_ns = STEP;
        camera.arrived(0, 1000, false);
        assert_eq!(change(&mut camera, 1000), Some(CameraState::Running));
        assert_eq!(change(&mut camera, 1000 + 2 * STEP - 10), None);
        assert_eq!(change(&mut camera, 1000 + 2 * STEP + 10), Some(CameraState::Stalled));
        camera.gone("the cable is off".into());
        assert_eq!(change(&mut camera, 1000), Some(CameraState::Gone));
        assert!(camera.reason(CameraState::Gone).is_some_and(|r| r.contains("the cable is off")));
        camera.opened(1500);
        assert_eq!(change(&mut camera, 2000), Some(CameraState::Starting));
        camera.arrived(2500, 3000, true);
        assert_eq!(change(&mut camera, 3000), Some(CameraState::Dark));
        camera.arrived(3500, 4000, false);
        camera.is_moved = true;
        assert_eq!(change(&mut camera, 4000), Some(CameraState::Moved));
        assert!(camera.reason(CameraState::Running).is_none());
    }
}
