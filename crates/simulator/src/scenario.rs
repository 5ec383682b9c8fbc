//! A flight to simulate: a start, manoeuvres, and what else is in the room.

use crate::{InitialState, Maneuver, SimulatorError, Staging};
use mavsight_flight::{HelicopterInput, InputSeries, Vehicle, hover_rotor_speed_rad_s};
use mavsight_geometry::EulerAngles;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A flight to be simulated: the content of a scenario file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Length.
    pub duration_s: f64,
    /// Frames per second of the cameras.
    pub frame_rate_hz: f64,
    /// Rate at which inputs are recorded.
    pub input_rate_hz: f64,
    /// Where the body origin starts, in the world.
    pub position_m: [f64; 3],
    /// Where the nose points at the start, counted from world +X towards +Y.
    pub heading_deg: f64,
    /// What is done; movements of one input add.
    pub maneuver: Vec<Maneuver>,
    /// Other objects in the room, and disturbances of the cameras.
    #[serde(default, skip_serializing_if = "Staging::is_empty")]
    pub staging: Staging,
}

impl Scenario {
    /// Section 4.2 of the paper: 2 s of hover, swash-plate 5° down for 1 s and up for 1 s, 10 s in all. The
    /// heading of 22.5° keeps the balls apart in both views.
    pub fn paper() -> Self {
        Self {
            duration_s: 10.0,
            frame_rate_hz: 30.0,
            input_rate_hz: 100.0,
            position_m: [0.0, 0.0, 1.5],
            heading_deg: 22.5,
            maneuver: vec![Maneuver::Doublet {
                channel: crate::Channel::DeltaLon,
                start_s: 2.0,
                pulse_s: 1.0,
                amplitude: -5.0,
            }],
            staging: Staging::default(),
        }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`SimulatorError::Scenario`].
    pub fn validate(&self) -> Result<(), SimulatorError> {
        for (key, value) in [
            ("duration_s", self.duration_s),
            ("frame_rate_hz", self.frame_rate_hz),
            ("input_rate_hz", self.input_rate_hz),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(SimulatorError::NotPositive { key, value });
            }
        }
        if !self.heading_deg.is_finite() || self.position_m.iter().any(|v| !v.is_finite()) {
            return Err(SimulatorError::Scenario("position_m and heading_deg must be finite"));
        }
        if self.duration_s * self.input_rate_hz.max(self.frame_rate_hz) > 1e7 {
            return Err(SimulatorError::Scenario("more than ten million samples: shorten the flight"));
        }
        self.staging.check()?;
        self.maneuver.iter().try_for_each(Maneuver::check)
    }

    /// The inputs, from 0 to at least the end of the flight.
    ///
    /// # Errors
    /// A scenario that is not valid.
    pub fn inputs(&self, vehicle: &Vehicle) -> Result<InputSeries, SimulatorError> {
        self.validate()?;
        let hover = hover_rotor_speed_rad_s(vehicle);
        let samples = (self.duration_s * self.input_rate_hz).ceil() as usize + 1;
        let sample = |k: usize| {
            let t_s = k as f64 / self.input_rate_hz;
            let mut s =
                HelicopterInput { t_s, omega_u_rad_s: hover, omega_l_rad_s: hover, ..Default::default() };
            for maneuver in &self.maneuver {
                let value = maneuver.value(t_s);
                match maneuver.channel() {
                    crate::Channel::DeltaLon => s.delta_lon_rad += value.to_radians(),
                    crate::Channel::DeltaLat => s.delta_lat_rad += value.to_radians(),
                    crate::Channel::OmegaU => s.omega_u_rad_s += value / 100.0 * hover,
                    crate::Channel::OmegaL => s.omega_l_rad_s += value / 100.0 * hover,
                }
            }
            s
        };
        let samples: Vec<HelicopterInput> = (0..samples).map(sample).collect();
        Ok(HelicopterInput::recorded(&samples)?)
    }

    /// Where the flight starts: at rest, level.
    pub fn start(&self) -> InitialState {
        InitialState {
            position_in_world_m: Vector3::from(self.position_m),
            attitude: EulerAngles { psi_rad: -self.heading_deg.to_radians(), ..Default::default() },
            ..Default::default()
        }
    }

    /// Middle of each exposure: frame k at k over the frame rate.
    pub fn frame_times_s(&self) -> Vec<f64> {
        let frames = (self.duration_s * self.frame_rate_hz).round() as usize;
        (0..frames).map(|k| k as f64 / self.frame_rate_hz).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_doublet_is_down_then_up() {
        let inputs = Scenario::paper().inputs(&Vehicle::paper()).expect("inputs");
        let angle = inputs.select(&["delta_lon_rad"]).expect("the column");
        let at = |t: f64| angle.at(t).map_or(f64::NAN, |row| row[0].to_degrees());
        for (t, degrees) in [(1.9, 0.0), (2.5, -5.0), (3.5, 5.0), (4.5, 0.0)] {
            assert!((at(t) - degrees).abs() < 1e-12, "{t} s: {}", at(t));
        }
        assert!(inputs.end_s() >= 10.0);
    }

    #[test]
    fn a_scenario_without_length_is_refused() {
        let scenario = Scenario { duration_s: 0.0, ..Scenario::paper() };
        assert!(matches!(scenario.inputs(&Vehicle::paper()), Err(SimulatorError::NotPositive { .. })));
    }
}
