//! Cameras that are late, stall or end.

use super::{Flight, LOOK, Pace};
use mavsight_link::CameraState;
use std::time::Duration;

/// A camera that is late by this many intervals against what it usually is, is not waited for.
const LATE_INTERVALS: f64 = 1.5;
/// After so long without a frame an open source is opened again, and one that has not shown any yet: a camera over a network takes
/// some seconds to answer.
const HANGS_NS: i64 = 3_000_000_000;
const NEVER_STARTS_NS: i64 = 15_000_000_000;
/// Cameras that show nothing so long after the first ones are not waited for.
const BEGIN_NS: i64 = 2_000_000_000;
/// Time from one word of stamps that went back to the next.
const TELL_BACK_NS: i64 = 10_000_000_000;
/// Intervals by which others are ahead of a camera that has ended, when it is told that they go on without it.
const OUTLIVED_INTERVALS: i64 = 2;

impl Flight<'_> {
    /// How long a report may be waited for before something else is due.
    pub(super) fn patience(&self) -> Duration {
        let now_ns = self.now_ns();
        if self.pace == Pace::Fast {
            return LOOK;
        }
        let waits =
            self.chain.waits().and_then(|(t, cameras)| cameras.map(|c| self.patient_until_ns(c, t)).min());
        let stalls = self.seats.iter().filter(|s| !s.is_left).filter_map(|s| s.states.stalls_at_ns()).min();
        let due = waits.into_iter().chain(stalls).min().map_or(LOOK, |at_ns| {
            Duration::from_nanos(u64::try_from(at_ns - now_ns + 100_000).unwrap_or(100_000))
        });
        due.clamp(Duration::from_micros(100), LOOK)
    }

    /// Until when a camera is waited for at an instant.
    fn patient_until_ns(&self, camera: usize, t_ns: i64) -> i64 {
        let seat = &self.seats[camera];
        t_ns + seat.usual_ns + (LATE_INTERVALS * seat.states.interval_ns() as f64) as i64
    }

    /// The chain goes on without a camera until it is back.
    pub(super) fn leave(&mut self, camera: usize) {
        if !std::mem::replace(&mut self.seats[camera].is_left, true) {
            self.tracking.cut();
        }
        self.chain.go_without(camera, i64::MAX);
    }

    pub(super) fn look_at_cameras(&mut self) {
        let now_ns = self.clock.now_ns();
        if self.first_ns.is_some_and(|first_ns| now_ns - first_ns > BEGIN_NS) {
            self.begin();
        }
        for camera in 0..self.seats.len() {
            let seat = &mut self.seats[camera];
            if seat.ended {
                continue;
            }
            let state = seat.states.state(now_ns);
            let silent = match state {
                CameraState::Stalled => seat.states.stalls_at_ns().map(|at_ns| (at_ns, HANGS_NS)),
                CameraState::Starting => seat.opened_ns.map(|at_ns| (at_ns, NEVER_STARTS_NS)),
                _ => None,
            };
            if let Some((since_ns, most_ns)) = silent
                && now_ns - since_ns.max(seat.interrupted_ns) > most_ns
            {
                seat.interrupted_ns = now_ns;
                self.cameras[camera].interrupt();
            }
            if state == CameraState::Stalled || (state == CameraState::Starting && self.chain.has_begun()) {
                self.leave(camera);
            }
            if self.seats[camera].states.change(now_ns).is_some() {
                self.tell_camera(camera, now_ns);
            }
        }
        self.lose_patience(now_ns);
        self.tell_instants();
    }

    /// Tells of cameras that have ended while others go on to a time.
    pub(super) fn tell_outlived(&mut self, t_ns: i64) {
        for camera in 0..self.seats.len() {
            let seat = &mut self.seats[camera];
            let ahead_ns = t_ns.saturating_sub(seat.latest_ns);
            if seat.ended
                && ahead_ns > OUTLIVED_INTERVALS * seat.states.interval_ns()
                && seat.states.outlived()
            {
                let now_ns = self.now_ns();
                self.tell_camera(camera, now_ns);
            }
        }
    }

    /// Tells, now and then, of a camera whose stamps went back.
    pub(super) fn tell_back(&mut self, camera: usize, stamp_ns: i64) {
        let (now_ns, seat) = (self.now_ns(), &mut self.seats[camera]);
        if seat.went_back_ns.is_some_and(|told_ns| now_ns - told_ns < TELL_BACK_NS) {
            return;
        }
        seat.went_back_ns = Some(now_ns);
        let back_s = (seat.latest_ns - self.chain.time_ns(camera, stamp_ns)) as f64 * 1e-9;
        let name = &self.rig.cameras[camera].name;
        self.note(
            true,
            format!(
                "{name}: its time stamps went back by {back_s:.3} s: was a clock set? Its frames are passed over until they are \
                 later again; to have it sooner, begin the flight anew."
            ),
        );
    }

    /// Goes on without cameras that are later than ever at the instant that waits for them.
    fn lose_patience(&mut self, now_ns: i64) {
        let Some((t_ns, cameras)) = self.chain.waits() else { return };
        let late: Vec<usize> = cameras.filter(|c| now_ns > self.patient_until_ns(*c, t_ns)).collect();
        if late.is_empty() {
            return;
        }
        self.flown.not_waited += 1;
        for camera in late {
            self.chain.go_without(camera, t_ns);
        }
    }
}
