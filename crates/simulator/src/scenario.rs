//! A flight to simulate: a start, manoeuvres, and what else is in the room.

use crate::{AmplitudeUnit, InitialState, Maneuver, SimulatorError, Staging, simulated_values};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::EulerAngles;
use mavsight_model::Input;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Most samples of a flight: eleven hours at 100 Hz, and a tenth of a gigabyte of inputs.
const MOST_SAMPLES: f64 = 4e6;

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
    /// By how much the nose is lifted at the start.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pitch_deg: f64,
    /// By how much the right side is lowered at the start.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub roll_deg: f64,
    /// Velocity u, v, w at the start, body axes.
    #[serde(default, skip_serializing_if = "are_zero")]
    pub velocity_m_s: [f64; 3],
    /// Rates p, q, r at the start.
    #[serde(default, skip_serializing_if = "are_zero")]
    pub rates_deg_s: [f64; 3],
    /// What is done; movements of one input add. May be left out: a thrown body has no inputs, and recorded
    /// inputs may be flown instead.
    #[serde(default)]
    pub maneuver: Vec<Maneuver>,
    /// Other objects in the room, and disturbances of the cameras.
    #[serde(default, skip_serializing_if = "Staging::is_empty")]
    pub staging: Staging,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn are_zero(values: &[f64; 3]) -> bool {
    values.iter().all(is_zero)
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
            pitch_deg: 0.0,
            roll_deg: 0.0,
            velocity_m_s: [0.0; 3],
            rates_deg_s: [0.0; 3],
            maneuver: vec![Maneuver::Doublet {
                channel: "delta_lon".to_owned(),
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
        let angles = [self.heading_deg, self.pitch_deg, self.roll_deg];
        let start = [self.position_m, angles, self.velocity_m_s, self.rates_deg_s];
        if start.iter().flatten().any(|v| !v.is_finite()) {
            let what =
                "position_m, heading_deg, pitch_deg, roll_deg, velocity_m_s and rates_deg_s must be finite";
            return Err(SimulatorError::Scenario(what));
        }
        if self.duration_s * self.input_rate_hz.max(self.frame_rate_hz) > MOST_SAMPLES {
            return Err(SimulatorError::Scenario("more than four million samples: shorten the flight"));
        }
        self.staging.check()?;
        self.maneuver.iter().try_for_each(Maneuver::check)
    }

    /// The inputs of the vehicle's model, from 0 to at least the end of the flight: those of steady flight
    /// and the manoeuvres.
    ///
    /// # Errors
    /// A scenario that is not valid, that moves an input which the model does not have, or further than the
    /// model allows.
    pub fn inputs(&self, vehicle: &Vehicle) -> Result<InputSeries, SimulatorError> {
        self.validate()?;
        let controls = self.controls(vehicle)?;
        let samples = (self.duration_s * self.input_rate_hz).ceil() as usize + 1;
        let times_s: Vec<f64> = (0..samples).map(|k| k as f64 / self.input_rate_hz).collect();
        let mut values = Vec::with_capacity(samples * controls.trim.len());
        for &t_s in &times_s {
            let row = controls.at(t_s);
            controls.check(t_s, &row)?;
            values.extend(row);
        }
        let names = vehicle.input_columns().into_iter().map(str::to_owned);
        Ok(InputSeries::new(names.collect::<Vec<String>>(), times_s, values)?)
    }

    /// Which inputs the manoeuvres move, and from where.
    fn controls<'a>(&'a self, vehicle: &'a Vehicle) -> Result<Controls<'a>, SimulatorError> {
        let model = &vehicle.model;
        let trim = model.trim(&simulated_values(vehicle));
        let moved = self.maneuver.iter().map(|maneuver| {
            let name = maneuver.channel();
            let Some(input) = model.input(name) else {
                return Err(SimulatorError::UnknownInput {
                    name: name.to_owned(),
                    model: model.name.clone(),
                    near: model.near_inputs(name),
                    inputs: model.inputs.iter().map(|i| i.name.clone()).collect(),
                });
            };
            Ok(Moved { input, unit: AmplitudeUnit::of(&model.inputs[input], trim[input]), maneuver })
        });
        Ok(Controls { moved: moved.collect::<Result<_, _>>()?, trim, inputs: &model.inputs })
    }

    /// Where the flight starts: where the scenario says, and with the further states that the model begins
    /// with under the first inputs.
    ///
    /// # Errors
    /// A scenario that moves an input which the model does not have.
    pub fn start(&self, vehicle: &Vehicle) -> Result<InitialState, SimulatorError> {
        let at_rest = InitialState::at_rest(vehicle, &self.controls(vehicle)?.at(0.0));
        Ok(InitialState {
            position_in_world_m: Vector3::from(self.position_m),
            attitude: EulerAngles {
                phi_rad: self.roll_deg.to_radians(),
                theta_rad: self.pitch_deg.to_radians(),
                psi_rad: -self.heading_deg.to_radians(),
            },
            velocity_in_body_m_s: Vector3::from(self.velocity_m_s),
            rates_rad_s: Vector3::from(self.rates_deg_s).map(f64::to_radians),
            ..at_rest
        })
    }

    /// Middle of each exposure: frame k at k over the frame rate.
    pub fn frame_times_s(&self) -> Vec<f64> {
        let frames = (self.duration_s * self.frame_rate_hz).round() as usize;
        (0..frames).map(|k| k as f64 / self.frame_rate_hz).collect()
    }
}

/// A manoeuvre and the input that it moves.
struct Moved<'a> {
    input: usize,
    unit: AmplitudeUnit,
    maneuver: &'a Maneuver,
}

/// The inputs of a scenario over time.
struct Controls<'a> {
    trim: Vec<f64>,
    moved: Vec<Moved<'a>>,
    inputs: &'a [Input],
}

impl Controls<'_> {
    fn at(&self, t_s: f64) -> Vec<f64> {
        let mut row = self.trim.clone();
        for Moved { input, unit, maneuver } in &self.moved {
            row[*input] += unit.in_own_unit(maneuver.value(t_s));
        }
        row
    }

    fn check(&self, t_s: f64, row: &[f64]) -> Result<(), SimulatorError> {
        for (Input { name, min, max, .. }, &value) in self.inputs.iter().zip(row) {
            if !(*min..=*max).contains(&value) {
                let (input, min, max) = (name.clone(), *min, *max);
                return Err(SimulatorError::InputRange { input, t_s, value, min, max });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_model::Model;
    use std::sync::Arc;

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

    #[test]
    fn amplitudes_are_degrees_per_cent_of_trim_or_the_inputs_unit() {
        let text = r#"
            schema = 2
            name = "three"
            [inputs]
            flap = { unit = "rad", trim = 0.1 }
            throttle = { unit = "1", trim = 0.4 }
            motor = { column = "motor_n", unit = "N", max = 3 }
            [parameters]
            tau = { unit = "s", value = 0.1 }
            [states]
            lagged = { unit = "rad", derivative = "(flap - lagged)/tau", initial = "2*flap" }
            [forces]
            x = "motor*(1 + lagged*throttle)"
        "#;
        let mut vehicle = Vehicle::paper();
        vehicle.model = Arc::new(Model::parse("three.toml", text).expect("a model"));
        (vehicle.parameters, vehicle.simulation) = Default::default();
        let step = |channel: &str, amplitude| Maneuver::Step {
            channel: channel.to_owned(),
            start_s: 0.0,
            amplitude,
        };
        let mut scenario = Scenario {
            pitch_deg: 10.0,
            velocity_m_s: [12.0, 0.0, 1.0],
            maneuver: vec![step("flap", 2.0), step("throttle", 50.0), step("motor", 2.5)],
            ..Scenario::paper()
        };
        let inputs = scenario.inputs(&vehicle).expect("inputs");
        assert_eq!(inputs.names(), ["flap", "throttle", "motor_n"]);
        let flap = 0.1 + 2.0_f64.to_radians();
        for (got, want) in inputs.row(5).iter().zip([flap, 0.6, 2.5]) {
            assert!((got - want).abs() < 1e-12, "{got} is not {want}");
        }
        let start = scenario.start(&vehicle).expect("a start");
        assert_eq!(start.further, [2.0 * flap]);
        assert_eq!(start.velocity_in_body_m_s, Vector3::new(12.0, 0.0, 1.0));
        assert!((start.attitude.theta_rad.to_degrees() - 10.0).abs() < 1e-12);
        let written = toml::to_string(&scenario).expect("TOML");
        assert_eq!(toml::from_str::<Scenario>(&written).expect("a scenario"), scenario);

        scenario.maneuver[2] = step("motor", 3.5);
        let refused = scenario.inputs(&vehicle).expect_err("beyond its range").to_string();
        assert!(refused.contains("motor is 3.5000 at 0.000 s, but the model allows"), "{refused}");
        scenario.maneuver[2] = step("throtle", 1.0);
        let refused = scenario.inputs(&vehicle).expect_err("no such input").to_string();
        assert!(refused.contains("no input throtle; did you mean throttle?"), "{refused}");
        assert!(matches!(scenario.start(&vehicle), Err(SimulatorError::UnknownInput { .. })));
    }
}
