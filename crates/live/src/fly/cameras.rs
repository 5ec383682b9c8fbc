//! Cameras that are late, stall or end.

use super::{CHECK, Flight};
use crate::setup::Pace;
use crate::stamps::Backward;
use crate::status::{Lacking, PASSED_OVER};
use mavsight_link::CameraState;
use std::time::Duration;

/// A camera that is later than usual by this many intervals is not waited for.
const LATE_INTERVALS: f64 = 1.5;
/// An open source is opened again after this time without a frame, or without its first: networks are slow.
const HANGS_NS: i64 = 3_000_000_000;
const NEVER_STARTS_NS: i64 = 15_000_000_000;
/// Cameras without a frame this long after the first ones are not waited for.
const BEGIN_NS: i64 = 2_000_000_000;
/// Intervals by which others are ahead of a camera that has ended when this is reported.
const ENDED_INTERVALS: i64 = 2;

/// What to look at where a frame never came, from a camera and otherwise.
const LOOK: &str = "Look at its cable, at what else uses its bus or network or loads this computer, and whether its exposure is \
                    longer than its interval";
const NOT_RECORDED: &str = "Its recording lacks it, or this computer renders the virtual room too slowly: take fewer or smaller \
                            images (--rate, --size)";

impl Flight<'_> {
    /// Longest wait for a report before something else is due.
    pub(super) fn patience(&self) -> Duration {
        if self.setup.pace == Pace::Fast {
            return CHECK;
        }
        let waits = self.pipeline.waits();
        let waits = waits.and_then(|(t_ns, cameras)| cameras.map(|c| self.patient_until_ns(c, t_ns)).min());
        let open = self.status.iter().filter(|s| !s.is_left_out);
        let due = open.filter_map(|s| s.stalls_at_ns()).chain(waits).min();
        let now_ns = self.now_ns();
        let wait = due.map_or(CHECK, |at_ns| {
            Duration::from_nanos(u64::try_from(at_ns - now_ns + 100_000).unwrap_or(100_000))
        });
        wait.clamp(Duration::from_micros(100), CHECK)
    }

    /// Until when a camera is waited for at an instant.
    fn patient_until_ns(&self, camera: usize, t_ns: i64) -> i64 {
        let status = &self.status[camera];
        t_ns + status.usual_ns + (LATE_INTERVALS * status.interval_ns as f64) as i64
    }

    /// Goes on without a camera until it is back. Poses by the others follow from those before within their covariance.
    pub(super) fn leave_out(&mut self, camera: usize) {
        self.status[camera].is_left_out = true;
        self.pipeline.go_without(camera, i64::MAX);
    }

    pub(super) fn check_cameras(&mut self) {
        let now_ns = self.setup.clock.now_ns();
        if self.first_ns.is_some_and(|first_ns| now_ns - first_ns > BEGIN_NS) {
            self.pipeline.begin();
        }
        for camera in 0..self.status.len() {
            let status = &mut self.status[camera];
            if status.ended {
                continue;
            }
            let state = status.state(now_ns);
            let silent = match state {
                CameraState::Stalled => status.silent_since_ns().map(|at_ns| (at_ns, HANGS_NS)),
                CameraState::Starting => status.opened_ns.map(|at_ns| (at_ns, NEVER_STARTS_NS)),
                _ => None,
            };
            if let Some((since_ns, most_ns)) = silent
                && now_ns - since_ns.max(status.interrupted_ns) > most_ns
            {
                status.interrupted_ns = now_ns;
                self.cameras[camera].interrupt();
            }
            if state == CameraState::Stalled || (state == CameraState::Starting && self.pipeline.has_begun())
            {
                self.leave_out(camera);
            }
            if self.status[camera].has_changed(now_ns) {
                self.report_camera(camera, now_ns);
            }
        }
        self.lose_patience(now_ns);
        self.report_instants();
    }

    /// Reports that frames of a camera before one that came are lacking.
    pub(super) fn report_lacking(&mut self, camera: usize, t_ns: i64) {
        let (now_ns, dropped) = (self.now_ns(), self.cameras[camera].dropped());
        let status = &mut self.status[camera];
        let Some(found) = status.lacks_before(t_ns, dropped, now_ns) else { return };
        let (missing, is_played) = (status.missing, status.is_played);
        let name = &self.setup.rig.cameras[camera].name;
        let text = match found {
            Lacking::Missing => {
                let look = if is_played { NOT_RECORDED } else { LOOK };
                format!(
                    "{name}: a frame did not come in its turn, and the one after it did ({missing} missing so far). {look}."
                )
            }
            Lacking::Dropped => format!(
                "{name}: a frame was dropped, as newer ones were there already ({dropped} so far): frames come several at once, or \
                 this computer is too slow. Look at its network; close other programs, or take fewer or smaller images a second."
            ),
        };
        self.note(true, text);
    }

    /// Reports cameras that have ended and whose last frame is well before the latest of the others.
    pub(super) fn report_ended(&mut self) {
        for camera in 0..self.status.len() {
            let status = &mut self.status[camera];
            let ahead_ns = self.latest_ns.saturating_sub(status.latest_ns);
            if status.ended && ahead_ns > ENDED_INTERVALS * status.interval_ns && status.outlived() {
                let now_ns = self.now_ns();
                self.report_camera(camera, now_ns);
            }
        }
    }

    /// Takes that the clock of a camera was set, for which its stamps are corrected.
    pub(super) fn take_clock_step(&mut self, camera: usize, by_ns: i64) {
        let now_ns = self.now_ns();
        if self.status[camera].is_news(Backward::ClockSet, now_ns) {
            let name = &self.setup.rig.cameras[camera].name;
            let (by_s, way) = (by_ns.abs() as f64 * 1e-9, if by_ns < 0 { "back" } else { "forward" });
            let text = format!(
                "{name}: its clock was set {way} by {by_s:.4} s: frames go on to arrive in their beat, and their time stamps are \
                 corrected by that. Switch off what sets the clock in flight."
            );
            self.note(true, text);
        }
    }

    /// Takes a frame that is not later than the one before it: it is passed over, and the reason reported.
    pub(super) fn take_backward(&mut self, camera: usize, stamp_ns: i64) {
        let (now_ns, t_ns) = (self.now_ns(), self.pipeline.time_ns(camera, stamp_ns));
        let status = &mut self.status[camera];
        let found = status.stamps.why_backward(t_ns, status.interval_ns);
        let is_news = status.is_news(found, now_ns);
        let back_s = (status.latest_ns - t_ns) as f64 * 1e-9;
        if found == Backward::Overtaken {
            status.missing = status.missing.saturating_sub(1);
        }
        if found == Backward::ClockSet {
            status.passed_over(now_ns);
            if self.setup.pace == Pace::Own {
                status.stamps.clock_was_set(status.usual_ns);
                self.tracking.cut();
                self.leave_out(camera);
            }
        }
        if is_news {
            self.note(true, backward_words(&self.setup.rig.cameras[camera].name, found, back_s));
        }
    }

    /// Whether the clock of a camera was set and is not right again; its frames have no known time then.
    pub(super) fn has_other_clock(&mut self, camera: usize, t_ns: i64, received_ns: i64) -> bool {
        let status = &mut self.status[camera];
        let was_off = status.stamps.has_other_clock();
        if !status.stamps.is_off(received_ns - t_ns, status.usual_ns, status.interval_ns) {
            return false;
        }
        status.passed_over(received_ns);
        if !was_off {
            let ahead_s = (t_ns - received_ns) as f64 * 1e-9;
            let name = &self.setup.rig.cameras[camera].name;
            let text = format!(
                "{name}: its time stamps went ahead of this computer's clock by {ahead_s:.3} s, as of a clock that was set: {PASSED_OVER}."
            );
            self.note(true, text);
            self.tracking.cut();
        }
        self.leave_out(camera);
        true
    }

    /// Goes on without cameras that are too late for the instant that waits for them.
    fn lose_patience(&mut self, now_ns: i64) {
        let Some((t_ns, cameras)) = self.pipeline.waits() else { return };
        let late: Vec<usize> = cameras.filter(|c| now_ns > self.patient_until_ns(*c, t_ns)).collect();
        if late.is_empty() {
            return;
        }
        self.summary.not_waited += 1;
        for camera in late {
            self.pipeline.go_without(camera, t_ns);
        }
    }
}

/// What frames that are not later than those before them show, and what to do.
fn backward_words(name: &str, found: Backward, back_s: f64) -> String {
    match found {
        Backward::Twice => format!(
            "{name}: frames come twice, with one time stamp: the second of each is passed over. Look at what sends them."
        ),
        Backward::Overtaken => format!(
            "{name}: frames come out of order: one came {back_s:.3} s after its turn and is passed over. Take a connection \
             that keeps their order, such as TCP."
        ),
        Backward::ClockSet => {
            format!(
                "{name}: its time stamps went back by {back_s:.3} s, as of a clock that was set: {PASSED_OVER}."
            )
        }
    }
}
