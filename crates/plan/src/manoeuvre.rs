//! Prediction of the parameters' accuracy from a manoeuvre: cameras, poses, output error.

use crate::{Placed, PlanError, Planner, Solid};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Camera, Matrix6, Vector3};
use mavsight_identify::output_error::{
    ExpectedFit, FlightModel, OutputErrorOptions, StateMeasurement, expected_fit,
};
use mavsight_pose::PoseEstimator;
use mavsight_simulator::{AmplitudeUnit, FlightState, Scenario, Simulator, simulated_values};

/// Limits of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightLimits {
    /// Volume of the body's origin.
    pub volume: Solid,
    /// Largest bank or pitch.
    pub tilt_deg: f64,
    /// Largest change of an input that is an angle, from its value in steady flight.
    pub deflection_deg: f64,
    /// Largest change of another input that has a value in steady flight, in per cent of that value. An input
    /// without one is limited by the range that the model's file gives it.
    pub input_percent: f64,
}

/// Predicts the accuracy of parameters from manoeuvres of one vehicle in view of one rig.
#[derive(Debug, Clone)]
pub struct FlightPlanner<'a> {
    planner: &'a Planner,
    placed: Vec<Placed>,
    cameras: Vec<Camera>,
    estimator: PoseEstimator,
    vehicle: Vehicle,
    simulator: Simulator,
    limits: FlightLimits,
}

/// A manoeuvre as large as the limits allow, with its predicted fit.
#[derive(Debug, Clone)]
pub struct PlannedManoeuvre {
    /// The scenario: amplitudes and start as they may be flown.
    pub scenario: Scenario,
    /// Inputs of the flight.
    pub inputs: InputSeries,
    /// The motion at the frames.
    pub states: Vec<FlightState>,
    /// Covariance of the part of each frame's pose that is new.
    pub pose_covariance: Vec<Matrix6<f64>>,
    /// The largest of all shares of a limit that are used; 1 at a limit.
    pub used: f64,
    /// Predicted fit of output error.
    pub fit: ExpectedFit,
}

/// Rounds of scaling towards the limits, and the share of them that is near enough.
const ROUNDS: usize = 6;
const NEAR: f64 = 0.95;
/// A flight is aimed so far below its limits.
const AIM: f64 = 0.985;

impl<'a> FlightPlanner<'a> {
    /// A planner of flights before the cameras of a placement.
    ///
    /// # Errors
    /// A rig that cannot be calibrated; limits that are not positive.
    pub fn new(
        planner: &'a Planner,
        placed: &[Placed],
        vehicle: &Vehicle,
        limits: FlightLimits,
    ) -> Result<Self, PlanError> {
        let angles = [
            ("tilt", limits.tilt_deg),
            ("deflection", limits.deflection_deg),
            ("input", limits.input_percent),
        ];
        for (key, value) in angles {
            PlanError::unless(value.is_finite() && value > 0.0, key, || {
                format!("{value} is no limit: give a number above zero")
            })?;
        }
        let rig = planner.rig(placed)?;
        Ok(Self {
            planner,
            placed: placed.to_vec(),
            cameras: placed.iter().map(|p| planner.camera(p)).collect(),
            estimator: planner.estimator(&rig)?,
            simulator: Simulator::new(vehicle)?,
            vehicle: vehicle.clone(),
            limits,
        })
    }

    /// The vehicle.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// The manoeuvre, as large as the limits allow or as it is where that is less and `grow` is not set,
    /// centred in the volume; and its predicted fit. Free are the parameters that [`FlightModel::new`] frees
    /// for its inputs.
    ///
    /// # Errors
    /// [`PlanError::Flight`] for a flight that runs away; [`PlanError::OutOfView`]; [`PlanError::Identify`].
    pub fn predict(&self, scenario: &Scenario, grow: bool) -> Result<PlannedManoeuvre, PlanError> {
        let (scenario, used) = self.within_limits(scenario, grow)?;
        Ok(PlannedManoeuvre { used, ..self.predict_here(&scenario)? })
    }

    /// Prediction for a manoeuvre as it is; limits are not checked.
    ///
    /// # Errors
    /// Those of [`FlightPlanner::predict`], except the limits.
    pub fn predict_here(&self, scenario: &Scenario) -> Result<PlannedManoeuvre, PlanError> {
        let inputs = scenario.inputs(&self.vehicle)?;
        let states =
            self.simulator.fly(&inputs, &scenario.start(&self.vehicle)?, &scenario.frame_times_s())?;
        let mut measured = Vec::with_capacity(states.len());
        let mut pose_covariance = Vec::with_capacity(states.len());
        let mut systematic = Vec::with_capacity(states.len());
        for s in &states {
            let pose = s.pose();
            let estimate = self.planner.expected_pose(&self.placed, &self.cameras, &self.estimator, &pose);
            let estimate = estimate
                .ok_or_else(|| PlanError::OutOfView { t_s: s.t_s, at_m: s.position_in_world_m.into() })?;
            let covariance = estimate.own_covariance();
            let t_ns = mavsight_session::ns_from_s(s.t_s);
            measured.push(StateMeasurement::of_pose(t_ns, pose, covariance));
            pose_covariance.push(covariance);
            systematic.push(estimate.systematic());
        }
        let model = true_model(&self.vehicle, &inputs)?;
        let vectors: Vec<Vec<f64>> = states.iter().map(|s| s.as_start().packed()).collect();
        let fit = expected_fit(&model, &inputs, measured, &vectors, &OutputErrorOptions::default())?
            .with_systematic(&systematic)?;
        let scenario = scenario.clone();
        Ok(PlannedManoeuvre { scenario, inputs, states, pose_covariance, used: 1.0, fit })
    }

    /// The scenario scaled to the limits and shifted to the middle of the volume, and the largest share of a
    /// limit.
    fn within_limits(&self, scenario: &Scenario, grow: bool) -> Result<(Scenario, f64), PlanError> {
        let mut out = scenario.clone();
        let mut largest: Option<PlanError> = None;
        for _ in 0..ROUNDS {
            let (used, shift) = match self.used(&out) {
                Ok(used) => used,
                Err(error) => {
                    // A flight that runs away is too large by far.
                    largest = Some(error);
                    out.maneuver.iter_mut().for_each(|m| *m = m.scaled(0.25));
                    continue;
                }
            };
            if used <= 1.0 && (used >= NEAR || !grow) {
                let place = Vector3::from(out.position_m) + shift;
                out.position_m = place.into();
                return Ok((out, used));
            }
            if used < 1e-9 {
                return Err(PlanError::value("manoeuvre", "moves nothing: give it an amplitude"));
            }
            out.maneuver.iter_mut().for_each(|m| *m = m.scaled(AIM / used));
        }
        Err(largest
            .unwrap_or_else(|| PlanError::value("manoeuvre", "cannot be scaled to its limits: shorten it")))
    }

    /// The largest share of a limit that a flight uses, and by how much it must be shifted to be in the
    /// middle.
    fn used(&self, scenario: &Scenario) -> Result<(f64, Vector3<f64>), PlanError> {
        let inputs = scenario.inputs(&self.vehicle)?;
        let states =
            self.simulator.fly(&inputs, &scenario.start(&self.vehicle)?, &scenario.frame_times_s())?;
        let first = states.first().map_or_else(Vector3::zeros, |s| s.position_in_world_m);
        let places = || states.iter().map(|s| s.position_in_world_m);
        let (low, high) = places().fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0_f64, |most, v| most.max(v.abs()));
        let tilt_rad = most(&mut states.iter().flat_map(|s| [s.attitude.phi_rad, s.attitude.theta_rad]));
        let l = &self.limits;
        let side = Vector3::from(l.volume.high_m) - Vector3::from(l.volume.low_m);
        let used = (high - low)
            .component_div(&side)
            .max()
            .max(tilt_rad.to_degrees() / l.tilt_deg)
            .max(self.input_share(&inputs));
        Ok((used, l.volume.middle_m() - (low + high) / 2.0))
    }

    /// The largest share of its limit that an input uses, the model's own range being one.
    fn input_share(&self, inputs: &InputSeries) -> f64 {
        let model = &self.vehicle.model;
        let trim = model.trim(&simulated_values(&self.vehicle));
        let mut most = 0.0_f64;
        for (k, (input, trim)) in model.inputs.iter().zip(trim).enumerate() {
            let unit = AmplitudeUnit::of(input, trim);
            let largest = match unit {
                AmplitudeUnit::Degrees => self.limits.deflection_deg,
                AmplitudeUnit::PercentOfTrim { .. } => self.limits.input_percent,
                AmplitudeUnit::Own => f64::INFINITY,
            };
            for row in 0..inputs.times_s().len() {
                let change = inputs.row(row)[k] - trim;
                let range = if change < 0.0 { input.min - trim } else { input.max - trim };
                let of_range = if change == 0.0 { 0.0 } else { change / range };
                most = most.max(unit.of_change(change).abs() / largest).max(of_range);
            }
        }
        most
    }
}

/// The default model of a vehicle with the values of its simulation.
///
/// # Errors
/// A vehicle that is not valid.
pub fn true_model(vehicle: &Vehicle, inputs: &InputSeries) -> Result<FlightModel, PlanError> {
    let mut model = FlightModel::new(vehicle, inputs)?;
    for (parameter, value) in vehicle.model.parameters.iter().zip(simulated_values(vehicle)) {
        model = model.with_value(&parameter.name, value)?;
    }
    Ok(model)
}
