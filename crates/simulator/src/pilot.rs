//! A pilot who flies the simulated helicopter for as long as it is wanted: holds it in the middle of the
//! room, wanders, and moves the swash-plate now and then so that the parameters show themselves.

use crate::{FlightState, InitialState, Simulator, SimulatorError, simulated_values};
use mavsight_flight::{FlightError, InputSeries, Vehicle};
use mavsight_geometry::{EulerAngles, Vector3};
use std::collections::VecDeque;
use std::sync::Arc;

/// Steps of the controls in one frame.
const STEPS: u32 = 2;
/// Frames that are kept for cameras that come late to them.
const KEPT_FRAMES: usize = 256;
/// Seconds of commands that are kept.
const KEPT_INPUTS_S: f64 = 40.0;

/// Where the aircraft is held: the middle of the paper's room.
const MIDDLE_M: [f64; 3] = [0.0, 0.0, 1.5];
/// Heading, so that balls are apart in both views (`Scenario::paper`).
const HEADING_RAD: f64 = -0.393;

/// The swash-plate's largest angle.
const MOST_RAD: f64 = 0.1;
/// Seconds from one manoeuvre to the next.
const EVERY_S: f64 = 8.0;
/// Length of one of a manoeuvre's pulses.
const PULSE_S: f64 = 0.35;

/// The inputs that the pilot moves: speeds of the upper and lower rotor, swash-plate longitudinal and
/// lateral.
const MOVED: [&str; 4] = ["omega_u", "omega_l", "delta_lon", "delta_lat"];

/// What the pilot commands from a time on.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Time.
    pub t_s: f64,
    /// Values of the inputs, in the order of the vehicle's model.
    pub values: Vec<f64>,
}

/// The flight so far.
#[derive(Debug)]
pub struct Pilot {
    simulator: Simulator,
    columns: Arc<[String]>,
    /// Where the inputs of [`MOVED`] are among the model's.
    moved: [usize; 4],
    gravity_m_s2: f64,
    frame_s: f64,
    trim: Vec<f64>,
    state: FlightState,
    /// Frames from the first one that is kept on.
    frames: VecDeque<FlightState>,
    first: u64,
    inputs: VecDeque<Command>,
    /// Commands that nobody has taken yet.
    fresh: Vec<Command>,
    step: u64,
}

impl Pilot {
    /// A pilot whose aircraft stands still in the middle of the room at time 0.
    ///
    /// # Errors
    /// [`SimulatorError::Pilot`] for a model that lacks an input of the coaxial helicopter; a vehicle that
    /// cannot fly.
    pub fn new(vehicle: &Vehicle, frame_rate_hz: f64) -> Result<Self, SimulatorError> {
        let model = &vehicle.model;
        let mut moved = [0; 4];
        for (place, name) in moved.iter_mut().zip(MOVED) {
            *place = model.input(name).ok_or_else(|| SimulatorError::Pilot {
                model: model.name.clone(),
                needed: MOVED.join(", "),
                missing: name.to_owned(),
            })?;
        }
        let trim = model.trim(&simulated_values(vehicle));
        let start = InitialState {
            position_in_world_m: MIDDLE_M.into(),
            attitude: EulerAngles { psi_rad: HEADING_RAD, ..EulerAngles::default() },
            ..InitialState::at_rest(vehicle, &trim)
        };
        let columns: Arc<[String]> = vehicle.input_columns().into_iter().map(str::to_owned).collect();
        let frame_s = 1.0 / frame_rate_hz;
        let simulator = Simulator::new(vehicle)?;
        let still = [0.0, frame_s].map(|t_s| Command { t_s, values: trim.clone() });
        let states = simulator.fly(&series(&columns, &still)?, &start, &[0.0])?;
        let state = states.into_iter().next().ok_or(FlightError::TooFewInputs(0))?;
        Ok(Self {
            simulator,
            columns,
            moved,
            gravity_m_s2: vehicle.environment.gravity_m_s2,
            frame_s,
            trim,
            frames: VecDeque::from([state.clone()]),
            state,
            first: 0,
            inputs: VecDeque::new(),
            fresh: Vec::new(),
            step: 0,
        })
    }

    /// The aircraft at a frame's time; flies on to it where that is to come. None for frames long past.
    ///
    /// # Errors
    /// A state that runs away.
    pub fn at(&mut self, frame: u64) -> Result<Option<FlightState>, SimulatorError> {
        while self.first + self.frames.len() as u64 <= frame {
            for _ in 0..STEPS {
                self.fly()?;
            }
            self.frames.push_back(self.state.clone());
            if self.frames.len() > KEPT_FRAMES {
                self.frames.pop_front();
                self.first += 1;
            }
        }
        Ok(frame.checked_sub(self.first).and_then(|k| self.frames.get(k as usize).cloned()))
    }

    /// What was commanded from one time to another; none where that is not known any more, or not yet.
    pub fn span(&self, from_s: f64, to_s: f64) -> Option<InputSeries> {
        let (first, last) = (self.inputs.front()?, self.inputs.back()?);
        if first.t_s > from_s || last.t_s < to_s {
            return None;
        }
        let before = self.inputs.partition_point(|i| i.t_s <= from_s).saturating_sub(1);
        let after = self.inputs.partition_point(|i| i.t_s < to_s) + 1;
        let kept = self.inputs.range(before..after.min(self.inputs.len()));
        series(&self.columns, kept).ok()
    }

    /// What has been commanded since the last call.
    pub fn fresh(&mut self) -> std::vec::Drain<'_, Command> {
        self.fresh.drain(..)
    }

    /// One step of the controls.
    fn fly(&mut self) -> Result<(), SimulatorError> {
        let step_s = self.frame_s / f64::from(STEPS);
        let (t_s, next_s) = (self.step as f64 * step_s, (self.step + 1) as f64 * step_s);
        let input = self.command(t_s);
        let held = [input.clone(), Command { t_s: next_s, ..input.clone() }];
        let inputs = series(&self.columns, &held)?;
        if let Some(state) = self.simulator.fly(&inputs, &self.state.as_start(), &[t_s, next_s])?.pop() {
            self.state = state;
        }
        self.step += 1;
        self.inputs.push_back(input.clone());
        self.fresh.push(input);
        while self.inputs.front().is_some_and(|i| i.t_s < t_s - KEPT_INPUTS_S) {
            self.inputs.pop_front();
        }
        Ok(())
    }

    /// Position by tilt, tilt by the swash-plate, height by both rotors and heading by their difference.
    fn command(&self, t_s: f64) -> Command {
        let s = &self.state;
        let to_level = |v: Vector3<f64>| Vector3::new(v.x, -v.y, -v.z);
        let velocity = s.attitude.level_from_body() * s.velocity_in_body_m_s;
        let off = to_level(goal_m(t_s) - s.position_in_world_m);
        let wanted = off * 1.0 - velocity * 1.4;
        let (sin, cos) = s.attitude.psi_rad.sin_cos();
        let g = self.gravity_m_s2;
        let forward = wanted.x * cos + wanted.y * sin;
        let right = wanted.y * cos - wanted.x * sin;
        let pitch = (-forward / g).clamp(-0.15, 0.15);
        let roll = (right / g).clamp(-0.15, 0.15);
        let (p, q, r) = (s.rates_rad_s.x, s.rates_rad_s.y, s.rates_rad_s.z);
        let (lon, lat) = manoeuvre_rad(t_s);
        let heave = 0.15 * -off.z + 0.14 * velocity.z + collective(t_s);
        let turn = (0.1 * (HEADING_RAD - s.attitude.psi_rad) - 0.1 * r).clamp(-0.1, 0.1);
        let mean = 1.0 + heave.clamp(-0.1, 0.1);
        let bounded = |angle: f64| angle.clamp(-MOST_RAD, MOST_RAD);
        let [upper, lower, longitudinal, lateral] = self.moved;
        let mut values = self.trim.clone();
        values[upper] *= mean * (1.0 - turn);
        values[lower] *= mean * (1.0 + turn);
        values[longitudinal] += bounded(0.5 * (pitch - s.attitude.theta_rad) - 0.03 * q + lon);
        values[lateral] += bounded(0.5 * (roll - s.attitude.phi_rad) - 0.03 * p + lat);
        Command { t_s, values }
    }
}

/// Commands as a series of inputs.
fn series<'a>(
    columns: &Arc<[String]>,
    commands: impl IntoIterator<Item = &'a Command>,
) -> Result<InputSeries, FlightError> {
    let (mut times_s, mut values) = (Vec::new(), Vec::new());
    for command in commands {
        times_s.push(command.t_s);
        values.extend_from_slice(&command.values);
    }
    InputSeries::new(Arc::clone(columns), times_s, values)
}

/// Where the pilot wants to be: wandering about the middle.
fn goal_m(t_s: f64) -> Vector3<f64> {
    let sine = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * t_s + phase).sin() - phase.sin();
    Vector3::from(MIDDLE_M)
        + Vector3::new(0.25 * sine(0.05, 0.3), 0.25 * sine(0.037, 0.0), 0.12 * sine(0.061, 1.0))
}

/// Doublets of the swash-plate, forth and back, by turns longitudinal and lateral.
fn manoeuvre_rad(t_s: f64) -> (f64, f64) {
    let (count, within_s) = ((t_s / EVERY_S).floor(), t_s.rem_euclid(EVERY_S));
    let pulse = ((within_s - 3.0) / PULSE_S).floor();
    let angle = match pulse {
        0.0 => 0.06,
        1.0 => -0.06,
        _ => 0.0,
    };
    if count % 2.0 == 0.0 { (angle, 0.0) } else { (0.0, angle) }
}

/// Pulses of both rotors' speeds, as a share.
fn collective(t_s: f64) -> f64 {
    match ((t_s.rem_euclid(EVERY_S) - 6.0) / 0.4).floor() {
        0.0 => 0.03,
        1.0 => -0.03,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_minutes_remain_in_the_middle_of_the_room_and_swing() {
        let mut pilot = Pilot::new(&Vehicle::paper(), 60.0).expect("a pilot");
        let (mut far_m, mut tilt, mut turned, mut fastest) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for k in 0..60 * 120 {
            let s = pilot.at(k).expect("a flight").expect("a frame");
            assert!((s.t_s - k as f64 / 60.0).abs() < 1e-9);
            far_m = far_m.max((s.position_in_world_m - Vector3::from(MIDDLE_M)).norm());
            tilt = tilt.max(s.attitude.theta_rad.abs().max(s.attitude.phi_rad.abs()));
            turned = turned.max((s.attitude.psi_rad - HEADING_RAD).abs());
            fastest = fastest.max(s.rates_rad_s.norm());
        }
        println!("{far_m:.2} m, {tilt:.2} rad, {turned:.2} rad, {fastest:.2} rad/s");
        assert!(far_m < 0.9 && tilt < 0.35 && turned < 0.3 && fastest > 0.3);
        // The past is kept for a while, and what was commanded beside it.
        assert!(pilot.at(60 * 120 - 100).expect("kept").is_some() && pilot.at(0).expect("gone").is_none());
        let span = pilot.span(100.0, 110.0).expect("inputs");
        assert!(span.start_s() <= 100.0 && span.end_s() >= 110.0 && span.start_s() > 99.9);
        assert!(pilot.span(1.0, 10.0).is_none() && pilot.span(110.0, 130.0).is_none());
        assert_eq!(pilot.fresh().count(), 2 * (60 * 120 - 1));
    }

    #[test]
    fn another_aircraft_is_refused_by_the_input_that_it_lacks() {
        let mut vehicle = Vehicle::paper();
        vehicle.model = Arc::new(mavsight_model::Model::rigid_body());
        (vehicle.parameters, vehicle.simulation) = Default::default();
        let refused = Pilot::new(&vehicle, 60.0).expect_err("it has no rotor").to_string();
        assert!(refused.contains("coaxial helicopter") && refused.contains("has no omega_u"), "{refused}");
    }
}
