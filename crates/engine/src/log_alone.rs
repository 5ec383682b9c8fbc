//! Parameters from a log without poses.

use crate::means::{FAST_INPUTS_S, MEANS_S, mean_inputs, mean_sensors};
use crate::{EngineError, Flight};
use mavsight_flight::FlightError;
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, InputClock};
use mavsight_pipeline::{PipelineError, Progress, Stage};
use mavsight_session::RunResults;

/// Identifies the parameters of a flight's model from the sensors of a log alone, by output error and filter error, over parts
/// of the log, or over the whole where none are named.
///
/// Samples within the same 10 ms count as their means, and so do inputs whose rows are 5 ms apart or less on average; a note says
/// so. Between parts that are
/// more than two seconds apart the motion starts anew. Without a known lag, that with which the inputs act is estimated too.
///
/// # Errors
/// A model, a setting or a vehicle that is wrong; a log without inputs and sensors in that part.
pub fn identify_from_log(
    results: &mut RunResults,
    within_s: &[(f64, f64)],
    flight: &Flight<'_>,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    let (Some(inputs), Some(sensors)) = (flight.inputs, flight.log_sensors) else {
        results.notes.push("No parameters: the log has to give inputs and sensors of the model.".to_owned());
        return Ok(());
    };
    progress.begin(Stage::Identify, None);
    let is_within = |t_ns: i64| {
        let t_s = t_ns as f64 * 1e-9;
        within_s.is_empty() || within_s.iter().any(|(from_s, to_s)| (*from_s..=*to_s).contains(&t_s))
    };
    let failed = |e: FlightError| EngineError::from(e);
    let sensors = mean_sensors(&sensors.within(is_within)).map_err(failed)?;
    let inputs = mean_inputs(inputs).map_err(failed)?;
    let inputs = inputs.at_times(|t_s| t_s + flight.options.lag_s.unwrap_or(0.0)).map_err(failed)?;
    let covered = |t_ns: i64| {
        let t_s = t_ns as f64 * 1e-9;
        t_s >= inputs.start_s() && t_s <= inputs.end_s()
    };
    let sensors = sensors.within(covered);
    if sensors.times_ns().is_empty() {
        results.notes.push("No parameters: inputs and sensors have no time in common.".to_owned());
        return Ok(());
    }
    results.notes.push(format!(
        "Samples within the same {:.0} ms count as their means, and so do inputs whose rows are {:.0} ms apart or less on average.",
        1e3 * MEANS_S,
        1e3 * FAST_INPUTS_S
    ));
    let options = FlightFitOptions {
        clock: if flight.options.lag_s.is_some() { InputClock::Known } else { InputClock::Free },
        held_out_s: flight.options.fit.held_out_s,
        fits: flight.options.motion_fits,
        search: false,
        sensors: Some(&sensors),
        anew_ns: &[],
        begins_in_flight: true,
        at_most: flight.options.at_most,
    };
    let fits = FlightFits::of_log(flight.vehicle, &inputs, &sensors, &options);
    results.output_error = fits.map_err(PipelineError::from)?;
    results.notes.extend(results.output_error.refusals.iter().cloned());
    Ok(())
}
