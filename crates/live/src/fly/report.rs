//! Reports of a flight to its listeners.

use super::Flight;
use crate::parameters::Parameters;
use crate::setup::{Pace, Setup};
use crate::status::CameraStatus;
use crate::{InstantEstimate, Latencies, events};
use mavsight_geometry::UnitQuaternion;
use mavsight_link::{CameraState, Event, Fix, Tracking};
use mavsight_pipeline::PipelineError;
use mavsight_pose::PoseError;

/// Time over which frames are counted for a report: a rate is then known to one frame a second.
const REPORT_NS: i64 = 1_000_000_000;

impl Flight<'_> {
    pub(super) fn report_instants(&mut self) {
        let interval_ns = self.pipeline.longest_interval_ns();
        while let Some(mut instant) = self.pipeline.next_instant() {
            if self.is_mixed_up {
                instant.association.sample.estimate = Err(PoseError::MixedUp);
            }
            let sample = &instant.association.sample;
            for (camera, status) in self.status.iter_mut().enumerate() {
                let found = instant.moved.iter().find(|m| m.camera == camera);
                let is_frozen = found.is_some_and(|m| m.still_since_ns.is_some());
                let off = if is_frozen || instant.stale.contains(&camera) {
                    Some(CameraState::Frozen)
                } else {
                    found.map(|_| CameraState::Moved)
                };
                if std::mem::replace(&mut status.off, off).is_some() != off.is_some() {
                    self.tracking.cut();
                }
            }
            let motion = self.motion.push(sample);
            let was_acquiring = self.tracking.state == Tracking::Acquiring;
            let tracking = self.tracking.saw(instant.t_ns, sample.estimate.is_ok(), interval_ns);
            let mut measured = sample.estimate.as_ref().ok().map(|e| events::measured(e, motion.as_ref()));
            if let Some(measured) = &mut measured {
                let turn = &mut measured.world_from_body.rotation;
                *turn = continued(*turn, self.attitude);
                self.attitude = Some(*turn);
            }
            let fix = Fix {
                sequence: self.summary.instants,
                captured_ns: self.setup.clock.unix_ns(instant.t_ns),
                received_ns: self.setup.clock.unix_ns(self.received_ns),
                measured,
                resets: self.tracking.resets,
            };
            self.setup.listeners.fix(fix.clone());
            let latency_ns = self.setup.clock.now_ns() - self.received_ns;
            self.summary.latency.add_ns(latency_ns);
            self.summary.instants += 1;
            self.summary.measured += u64::from(fix.measured.is_some());
            self.summary.lost += u64::from(fix.measured.is_none() && !was_acquiring);
            for status in &mut self.status {
                status.instants += 1;
            }
            for (index, marker) in &instant.association.pairs {
                self.status[instant.seen[*index].camera].markers[*marker] += 1;
            }
            if let Some(parameters) = &self.parameters {
                parameters.push(sample);
            }
            let error = sample.estimate.as_ref().err();
            let pose = events::pose(&fix, instant.t_ns, tracking, latency_ns, error);
            self.setup.send(pose);
            for camera in newly_blind(&instant, &self.setup, &mut self.status) {
                let name = &self.setup.rig.cameras[camera].name;
                let text = format!(
                    "{name} sees none of the balls where another camera sees the aircraft: look at its focus and exposure, \
                     and at what is before it."
                );
                let t_s = instant.t_ns as f64 * 1e-9;
                self.setup.send(Event::Note { t_s, fault: true, text });
            }
            let detections = events::detections(&instant, self.setup.rig, self.setup.vehicle);
            detections.for_each(|e| self.setup.listeners.event(e));
        }
    }

    /// Cameras that are exchanged and the like, as soon as there are enough detections; no pose is given from then on.
    pub(super) fn report_misfit(&mut self) {
        if self.is_fit_checked {
            return;
        }
        let Some(misfit) = self.pipeline.misfit(self.setup.rig) else { return };
        self.is_fit_checked = true;
        match misfit {
            Ok(findings) => findings.into_iter().for_each(|found| self.note(true, found.note)),
            Err(mixed_up) => {
                self.is_mixed_up = matches!(mixed_up, PipelineError::MixedUp { .. });
                self.note(true, mixed_up.to_string());
            }
        }
    }

    /// Rates, latencies and parameters, once a second.
    pub(super) fn report_rates(&mut self) {
        if let Some(event) = self.parameters.as_ref().and_then(Parameters::latest) {
            self.setup.send(event);
        }
        if let Some(event) = self.setup.recorder.current().and_then(|r| r.news()) {
            self.setup.listeners.event(event);
        }
        let now_ns = self.now_ns();
        if self.reported_ns.is_some_and(|reported_ns| now_ns - reported_ns < REPORT_NS) {
            return;
        }
        for camera in 0..self.status.len() {
            self.report_camera(camera, now_ns);
            let status = &mut self.status[camera];
            (status.frames, status.instants) = (0, 0);
            status.markers.fill(0);
            status.latency = Latencies::default();
        }
        self.reported_ns = Some(now_ns);
        self.setup.listeners.event(self.setup.recorder.event());
    }

    pub(super) fn report_camera(&mut self, camera: usize, now_ns: i64) {
        let status = &mut self.status[camera];
        let state = status.state(if self.setup.pace == Pace::Fast { i64::MIN } else { now_ns });
        let over_s = self.reported_ns.map_or(0.0, |reported_ns| (now_ns - reported_ns) as f64 * 1e-9);
        let share = |n: &u64| if status.instants > 0 { *n as f64 / status.instants as f64 } else { 0.0 };
        let event = Event::Camera {
            camera,
            state,
            rate_hz: if over_s > 0.05 { status.frames as f64 / over_s } else { 0.0 },
            latency_ms: status.latency.quantile_ms(0.5),
            missing: status.missing,
            dropped: self.cameras[camera].dropped(),
            markers: status.markers.iter().map(share).collect(),
            reason: status.reason(state, now_ns),
        };
        self.setup.send(event);
    }

    pub(super) fn note(&mut self, fault: bool, text: String) {
        let t_s = self.now_ns() as f64 * 1e-9;
        self.setup.send(Event::Note { t_s, fault, text });
    }
}

/// Of the two quaternions of a turn, the one next to that of the turn before: who filters components needs no jumps of sign.
fn continued(turn: UnitQuaternion<f64>, before: Option<UnitQuaternion<f64>>) -> UnitQuaternion<f64> {
    let is_opposite = before.is_some_and(|before| before.coords.dot(&turn.coords) < 0.0);
    if is_opposite { UnitQuaternion::new_unchecked(-turn.into_inner()) } else { turn }
}

/// Cameras that, though their frames came, have just missed all balls at instants running at which another camera
/// saw the aircraft in their view.
fn newly_blind(instant: &InstantEstimate<'_>, setup: &Setup<'_>, status: &mut [CameraStatus]) -> Vec<usize> {
    let Ok(estimate) = &instant.association.sample.estimate else { return Vec::new() };
    let is_in_view = |camera: usize| {
        let own = &setup.rig.cameras[camera].camera;
        let sees = |marker| {
            let at = events::expected_px(own, setup.vehicle, marker, &estimate.world_from_body);
            at.is_some_and(|px| own.size.contains(&px, 0.0))
        };
        (0..setup.vehicle.marker.len()).all(sees)
    };
    let found = |camera: usize| instant.association.pairs.iter().any(|p| instant.seen[p.0].camera == camera);
    let is_blind = |(camera, status): (usize, &mut CameraStatus)| {
        let has_come = status.has_frame_of(instant.t_ns) && !status.is_left_out && status.off.is_none();
        let sees = found(camera) || !has_come || status.is_dark() || !is_in_view(camera);
        status.is_newly_blind(sees, instant.t_ns).then_some(camera)
    };
    status.iter_mut().enumerate().filter_map(is_blind).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_attitude_is_sent_without_jumps_of_sign() {
        let turn = |angle_rad: f64| UnitQuaternion::from_euler_angles(0.0, 0.0, angle_rad);
        let mut sent = turn(0.0);
        // Once around, of which the second half is the quaternion of the other sign.
        for step in 1..=12 {
            let own = turn(f64::from(step) * std::f64::consts::TAU / 12.0);
            let next = continued(own, Some(sent));
            assert!(next.angle_to(&own) < 1e-9 && next.coords.dot(&sent.coords) > 0.9, "step {step}");
            sent = next;
        }
    }
}
