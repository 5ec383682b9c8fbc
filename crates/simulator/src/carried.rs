//! An aircraft that is carried about by hand.

use crate::FlightState;
use mavsight_geometry::{EulerAngles, Vector3, world_from_body};
use std::f64::consts::TAU;

/// Where and how an aircraft is carried: sums of sines of 0.2 to 0.7 Hz, at about half a metre a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// Middle of the motion, world.
    pub middle_in_world_m: Vector3<f64>,
    /// Middle of the heading psi.
    pub heading_rad: f64,
    /// Size of the motion: 1 for a third of a metre each way and a quarter of a radian.
    pub size: f64,
    /// How long ago the motion began at time 0.
    pub since_s: f64,
}

impl Default for Carried {
    /// Before the paper's cameras.
    fn default() -> Self {
        let middle_in_world_m = Vector3::new(0.0, 0.0, 1.5);
        Self { middle_in_world_m, heading_rad: -0.4, size: 1.0, since_s: 0.0 }
    }
}

/// Step of the central differences: their error, its square, is far below a film's.
const STEP_S: f64 = 1e-3;

fn sine(hz: f64, phase: f64, t_s: f64) -> f64 {
    (TAU * hz * t_s + phase).sin()
}

impl Carried {
    /// The states at a rate, with as many further states of the model, all zero.
    pub fn states(&self, duration_s: f64, rate_hz: f64, further: usize) -> Vec<FlightState> {
        let state = |k: usize| self.at(k as f64 / rate_hz, further);
        (0..(duration_s * rate_hz).round() as usize).map(state).collect()
    }

    fn place_m(&self, t_s: f64) -> Vector3<f64> {
        let t = t_s + self.since_s;
        let up_m = 0.15 * sine(0.43, 0.7, t) + 0.05 * sine(0.71, 0.1, t);
        let off_m = Vector3::new(0.35 * sine(0.27, 0.0, t), 0.3 * sine(0.37, 1.3, t), up_m);
        self.middle_in_world_m + self.size * off_m
    }

    fn attitude(&self, t_s: f64) -> EulerAngles {
        let t = t_s + self.since_s;
        EulerAngles {
            phi_rad: self.size * 0.2 * sine(0.53, 0.3, t),
            theta_rad: self.size * 0.25 * sine(0.41, 1.0, t),
            psi_rad: self.heading_rad + self.size * 0.3 * sine(0.21, 2.0, t),
        }
    }

    fn at(&self, t_s: f64, further: usize) -> FlightState {
        let turn = |t: f64| world_from_body(Vector3::zeros(), self.attitude(t)).rotation;
        let rates = |t: f64| (turn(t - STEP_S).inverse() * turn(t + STEP_S)).scaled_axis() / (2.0 * STEP_S);
        let velocity = |t: f64| {
            let moved_m = self.place_m(t + STEP_S) - self.place_m(t - STEP_S);
            turn(t).inverse() * (moved_m / (2.0 * STEP_S))
        };
        FlightState {
            t_s,
            position_in_world_m: self.place_m(t_s),
            velocity_in_body_m_s: velocity(t_s),
            attitude: self.attitude(t_s),
            rates_rad_s: rates(t_s),
            velocity_rate_m_s2: (velocity(t_s + STEP_S) - velocity(t_s - STEP_S)) / (2.0 * STEP_S),
            angular_acceleration_rad_s2: (rates(t_s + STEP_S) - rates(t_s - STEP_S)) / (2.0 * STEP_S),
            further: vec![0.0; further],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Velocities, integrated by the trapezoidal rule, lead from each place to the next.
    #[test]
    fn velocities_lead_from_place_to_place() {
        let carried = Carried { since_s: 7.0, ..Carried::default() };
        let states = carried.states(3.0, 200.0, 2);
        assert_eq!((states.len(), states[0].further.len()), (600, 2));
        let in_world = |s: &FlightState| s.pose().rotation * s.velocity_in_body_m_s;
        for pair in states.windows(2) {
            let moved_m = (in_world(&pair[0]) + in_world(&pair[1])) / 2.0 * 0.005;
            let off_m = pair[1].position_in_world_m - pair[0].position_in_world_m - moved_m;
            assert!(off_m.norm() < 1e-7, "{off_m}");
        }
    }
}
