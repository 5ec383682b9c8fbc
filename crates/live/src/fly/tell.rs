//! What a flight tells its listeners.

use super::{Flight, Pace};
use crate::events;
use crate::parameters::Parameters;
use mavsight_link::{Event, Fix, Tracking};

/// Time from one telling of rates and latencies to the next.
const TELL_NS: i64 = 1_000_000_000;

impl Flight<'_> {
    pub(super) fn tell_instants(&mut self) {
        let recorder = self.recorder.current();
        let wants_events = self.listeners.want_events() || recorder.is_some();
        while let Some(told) = self.chain.next_told() {
            let sample = &told.association.sample;
            for moved in &told.moved[self.moved..] {
                self.seats[moved.camera].states.moved();
                self.tracking.cut();
            }
            self.moved = told.moved.len();
            let motion = self.motion.push(sample);
            let was = self.last;
            self.last = self.tracking.saw(told.t_ns, sample.estimate.is_some());
            let fix = Fix {
                sequence: self.flown.instants,
                captured_ns: self.clock.unix_ns(told.t_ns),
                received_ns: self.clock.unix_ns(self.received_ns),
                measured: sample.estimate.as_ref().map(|e| events::measured(e, motion.as_ref())),
                resets: self.tracking.resets(),
            };
            self.listeners.fix(fix.clone());
            let latency_ns = self.clock.now_ns() - self.received_ns;
            self.flown.latency.add_ns(latency_ns);
            self.flown.instants += 1;
            self.flown.measured += u64::from(fix.measured.is_some());
            self.flown.lost += u64::from(fix.measured.is_none() && was != Tracking::Acquiring);
            for seat in &mut self.seats {
                seat.instants += 1;
            }
            for (index, marker) in &told.association.pairs {
                let camera = told.seen[*index].camera;
                self.seats[camera].markers[*marker] += 1;
            }
            if let Some(parameters) = &self.parameters {
                parameters.push(sample);
            }
            if wants_events {
                let pose = events::pose(&fix, told.t_ns, self.last, latency_ns, sample.reason.as_deref());
                if let Some(recorder) = &recorder {
                    recorder.sent(&pose);
                }
                self.listeners.event(pose);
                events::sights(&told, (self.rig, self.vehicle)).for_each(|e| self.listeners.event(e));
            }
        }
    }

    /// Cameras in each other's place and the like, as soon as enough was seen.
    pub(super) fn tell_misfit(&mut self) {
        if self.is_fit_told {
            return;
        }
        let Some(said) = self.chain.misfit(self.rig) else { return };
        self.is_fit_told = true;
        if let Some(text) = said.unwrap_or_else(|mixed_up| Some(mixed_up.to_string())) {
            self.note(true, text);
        }
    }

    /// Rates, latencies and parameters, once a second.
    pub(super) fn tell_rates(&mut self) {
        if let Some(event) = self.parameters.as_ref().and_then(Parameters::latest) {
            self.listeners.event(event);
        }
        if let Some(event) = self.recorder.current().and_then(|r| r.news()) {
            self.listeners.event(event);
        }
        let now_ns = self.now_ns();
        if self.told_ns != i64::MIN && now_ns - self.told_ns < TELL_NS {
            return;
        }
        for camera in 0..self.seats.len() {
            self.tell_camera(camera, now_ns);
            let seat = &mut self.seats[camera];
            (seat.frames, seat.instants) = (0, 0);
            seat.markers.fill(0);
            seat.latency.clear();
        }
        self.told_ns = now_ns;
        self.listeners.event(self.recorder.event());
    }

    pub(super) fn tell_camera(&mut self, camera: usize, now_ns: i64) {
        let seat = &mut self.seats[camera];
        let state = seat.states.state(if self.pace == Pace::Fast { i64::MIN } else { now_ns });
        let over_s = if self.told_ns == i64::MIN { 0.0 } else { (now_ns - self.told_ns) as f64 * 1e-9 };
        let share = |n: &u64| if seat.instants > 0 { *n as f64 / seat.instants as f64 } else { 0.0 };
        let event = Event::Camera {
            camera,
            state,
            rate_hz: if over_s > 0.05 { seat.frames as f64 / over_s } else { 0.0 },
            latency_ms: seat.latency.quantile_ms(0.5),
            dropped: self.cameras[camera].dropped(),
            markers: seat.markers.iter().map(share).collect(),
            reason: seat.states.reason(state),
        };
        if let Some(recorder) = self.recorder.current() {
            recorder.sent(&event);
        }
        self.listeners.event(event);
    }

    pub(super) fn note(&mut self, fault: bool, text: String) {
        let t_s = self.now_ns() as f64 * 1e-9;
        self.listeners.event(Event::Note { t_s, fault, text });
    }
}
