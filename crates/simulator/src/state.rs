//! The aircraft at an instant, and where a flight begins.

use crate::simulated_values;
use mavsight_flight::Vehicle;
use mavsight_geometry::{EulerAngles, Isometry3, world_from_body};
use mavsight_model::RIGID_STATES;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Where a flight begins.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InitialState {
    /// Body origin in the world, metres.
    pub position_in_world_m: Vector3<f64>,
    /// Attitude.
    pub attitude: EulerAngles,
    /// Velocity in body axes, m/s.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// The states of the model beyond those of the rigid body, in its order.
    pub further: Vec<f64>,
}

impl InitialState {
    /// At rest and level at the world's origin, with the further states that the model begins with under
    /// these inputs, which are in the model's order.
    pub fn at_rest(vehicle: &Vehicle, inputs: &[f64]) -> Self {
        Self { further: vehicle.model.initial(&simulated_values(vehicle), inputs), ..Self::default() }
    }

    /// The state as the equations of motion take it: position, level_from_body as w, x, y, z, velocity,
    /// rates, further states.
    pub fn packed(&self) -> Vec<f64> {
        let (p, v, w) = (self.position_in_world_m, self.velocity_in_body_m_s, self.rates_rad_s);
        let q = self.attitude.level_from_body();
        let rigid: [f64; RIGID_STATES] = [p.x, p.y, p.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, w.x, w.y, w.z];
        rigid.into_iter().chain(self.further.iter().copied()).collect()
    }
}

/// The aircraft at one instant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FlightState {
    /// Time.
    pub t_s: f64,
    /// Body origin in the world, metres.
    pub position_in_world_m: Vector3<f64>,
    /// Attitude.
    pub attitude: EulerAngles,
    /// u, v, w.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// The states of the model beyond those of the rigid body, in its order.
    pub further: Vec<f64>,
    /// u̇, v̇, ẇ.
    pub velocity_rate_m_s2: Vector3<f64>,
    /// ṗ, q̇, ṙ.
    pub angular_acceleration_rad_s2: Vector3<f64>,
}

impl FlightState {
    /// From a packed state ([`InitialState::packed`]) and its time derivative.
    pub(crate) fn unpacked(t_s: f64, y: &[f64], rates: &[f64]) -> Self {
        let vector = |values: &[f64], at: usize| Vector3::new(values[at], values[at + 1], values[at + 2]);
        let level_from_body = UnitQuaternion::from_quaternion(Quaternion::new(y[3], y[4], y[5], y[6]));
        Self {
            t_s,
            position_in_world_m: vector(y, 0),
            attitude: EulerAngles::from_level_from_body(&level_from_body),
            velocity_in_body_m_s: vector(y, 7),
            rates_rad_s: vector(y, 10),
            further: y[RIGID_STATES..].to_vec(),
            velocity_rate_m_s2: vector(rates, 7),
            angular_acceleration_rad_s2: vector(rates, 10),
        }
    }

    /// The pose of the body in the world.
    pub fn pose(&self) -> Isometry3<f64> {
        world_from_body(self.position_in_world_m, self.attitude)
    }

    /// The state without its time and accelerations: where another flight may begin.
    pub fn as_start(&self) -> InitialState {
        let Self { position_in_world_m, attitude, velocity_in_body_m_s, rates_rad_s, .. } = *self;
        let further = self.further.clone();
        InitialState { position_in_world_m, attitude, velocity_in_body_m_s, rates_rad_s, further }
    }
}
