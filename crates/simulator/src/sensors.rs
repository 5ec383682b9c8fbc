//! What sensors on board show.

use crate::{FlightState, SimulatorError, simulated_values};
use mavsight_flight::{InputSeries, SensorSeries, Vehicle};
use mavsight_model::Dynamics;

/// What the sensors of a vehicle's model show at some states, without noise, under the inputs of their times.
///
/// # Errors
/// Inputs that lack a column or do not cover the states; times that do not increase.
pub fn sensed(
    vehicle: &Vehicle,
    inputs: &InputSeries,
    states: &[FlightState],
) -> Result<SensorSeries, SimulatorError> {
    let inputs = inputs.select(&vehicle.input_columns())?;
    let model = &vehicle.model;
    let dynamics = Dynamics::with_sensors(model, &simulated_values(vehicle), &[]);
    let mut evaluation = dynamics.with(&[]);
    let mut values = vec![0.0; states.len() * model.sensors.len()];
    for (state, row) in states.iter().zip(values.chunks_exact_mut(model.sensors.len().max(1))) {
        evaluation.set_inputs(inputs.require(state.t_s)?);
        evaluation.sense(&state.as_start().packed(), row);
    }
    let columns = model.sensors.iter().map(|s| s.column.clone()).collect();
    let times_ns = states.iter().map(|s| (s.t_s * 1e9).round() as i64).collect();
    Ok(SensorSeries::new(columns, times_ns, values)?)
}
