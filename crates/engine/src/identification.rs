//! From poses to motion and parameters.

use crate::equation_error::{equation_error_by_clock, moved_by};
use crate::input_range::beyond_range;
use crate::log_clock::{LogBesidePoses, sensors_of_log};
use crate::parts::moves_before;
use crate::weight::wrong_weight;
use crate::{EngineError, Flight};
use mavsight_flight::{FlightError, InputSeries, Vehicle};
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, Images, InputClock, MotionFits};
use mavsight_identify::{Clocks, IdentifyError, RegressionError};
use mavsight_pipeline::{MARKERS_STD_M, PipelineError, Progress, Stage, body_markers, motion_from_poses};
use mavsight_pose::{Motion, RateSeries};
use mavsight_session::RunResults;
use std::borrow::Cow;

/// Smooths the poses of the results into motion and identifies its parameters; what the flight does not
/// determine becomes a note.
///
/// # Errors
/// A model, a setting or a vehicle that is wrong.
pub fn identify_from_poses(
    results: &mut RunResults,
    flight: &Flight<'_>,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    let of_poses =
        |rates: Option<&RateSeries>| motion_from_poses(&results.poses, rates, flight.vehicle, progress);
    let motion = of_poses(None);
    let log = LogBesidePoses::of(&results.poses, flight, |rates| of_poses(Some(rates)));
    identify_into(results, motion, log, flight, progress)
}

pub(crate) fn identify_into(
    results: &mut RunResults,
    motion: Result<Motion, PipelineError>,
    log: Option<LogBesidePoses>,
    flight: &Flight<'_>,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    match motion {
        Ok(motion) => identify_beside_log(results, motion, log, flight, progress),
        Err(refusal) => {
            results.notes.push(no_motion(&refusal));
            Ok(())
        }
    }
}

/// The motion becomes part of the results, with the log's gyroscope where that gave one, or a note says why there is none.
pub(crate) fn motion_into(
    results: &mut RunResults,
    motion: Result<Motion, PipelineError>,
    log: Option<LogBesidePoses>,
) {
    match motion {
        Ok(motion) => {
            let log = log.unwrap_or_default();
            let motion = log.motion.unwrap_or(motion);
            results.notes.extend(motion.doubts.words());
            results.notes.extend(log.notes);
            (results.log, results.motion) = (log.alignment, Some(motion));
        }
        Err(refusal) => results.notes.push(no_motion(&refusal)),
    }
}

fn no_motion(refusal: &PipelineError) -> String {
    format!("No motion: {refusal}")
}

/// Identifies the parameters from a motion, which becomes part of the results: by equation error, and by
/// output error where the results have poses.
///
/// # Errors
/// A model, a setting or a vehicle that is wrong.
pub fn identify_from_motion(
    results: &mut RunResults,
    motion: Motion,
    flight: &Flight<'_>,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    identify_beside_log(results, motion, None, flight, progress)
}

/// Of a model without inputs: no columns, from before the motion until after it.
fn without_inputs(motion: &Motion) -> Result<InputSeries, FlightError> {
    let [from_s, to_s] = [motion.samples.first(), motion.samples.last()]
        .map(|sample| sample.map_or(0.0, |sample| sample.t_ns as f64 * 1e-9));
    InputSeries::new(Vec::new(), vec![from_s - 1.0, to_s + 1.0], Vec::new())
}

fn identify_beside_log(
    results: &mut RunResults,
    mut motion: Motion,
    mut log: Option<LogBesidePoses>,
    flight: &Flight<'_>,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    results.notes.extend(earlier_schema(flight.vehicle));
    let moved = log.as_mut().map(|log| flight.inputs.and_then(|recorded| log.moved(recorded)));
    let log = log.unwrap_or_default();
    results.notes.extend(log.motion.as_ref().unwrap_or(&motion).doubts.words());
    results.notes.extend(log.notes);
    results.log = log.alignment;
    let has_none = flight.vehicle.model.inputs.is_empty();
    let none = has_none.then(|| without_inputs(&motion)).transpose()?;
    let Some(recorded) = flight.inputs.or(none.as_ref()) else {
        results.motion = log.motion.or(Some(motion));
        results.notes.push("No parameters: the session names no inputs.".to_owned());
        return Ok(());
    };
    let recorded = match &moved {
        Some(None) => {
            results.motion = log.motion.or(Some(motion));
            return Ok(());
        }
        Some(Some(inputs)) => inputs,
        None => recorded,
    };
    let given_s = flight.options.lag_s;
    let by_lag = given_s.map(|lag_s| moved_by(lag_s, recorded, &motion, flight)).transpose()?;
    let recorded = by_lag.as_ref().unwrap_or(recorded);
    let mut found = beyond_range(recorded, &flight.vehicle.model);
    found.extend(wrong_weight(&motion, recorded, flight.vehicle));
    results.notes.extend(found.iter().map(|finding| finding.note.clone()));
    results.findings.extend(found);
    let mut unmoved = flight.clone();
    unmoved.options.lag_s = given_s.map(|_| 0.0);
    let solved = equation_error_by_clock(&mut motion, recorded, &unmoved, &mut results.notes, progress);
    results.motion = log.motion.or(Some(motion));
    let mut inputs = None;
    let fits_motion = flight.options.motion_fits != MotionFits::NONE && !results.poses.is_empty();
    match solved {
        Ok(solution) => {
            if !recorded.names().is_empty() {
                results.notes.extend(solution.clocks.words());
            }
            inputs = solution.inputs;
            results.coefficients = Some(solution.coefficients);
            results.identification = Some(solution.identification);
            results.clocks = Some(given_s.map_or(solution.clocks, Clocks::Known));
        }
        Err(PipelineError::Identify(IdentifyError::Flight(wrong))) => return Err(wrong.into()),
        Err(PipelineError::Identify(wrong)) if is_of_the_settings(&wrong) => {
            return Err(EngineError::Setting(wrong));
        }
        Err(PipelineError::Identify(IdentifyError::NoEquations(_)))
            if flight.options.fit.estimators.is_empty() => {}
        Err(refusal) => {
            let missing = if fits_motion { "equation error" } else { "parameters" };
            results.notes.push(format!("No {missing}: {refusal}"));
        }
    }
    if fits_motion {
        fit_motion(results, flight, inputs.as_ref().unwrap_or(recorded), progress)?;
    }
    Ok(())
}

/// Output error and filter error, into the results.
fn fit_motion(
    results: &mut RunResults,
    flight: &Flight<'_>,
    inputs: &InputSeries,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    progress.begin(Stage::Identify, None);
    let of_log = sensors_of_log(results.log.as_ref(), flight, &mut results.notes)?;
    let flight = &Flight { sensors: of_log.as_ref().or(flight.sensors), ..flight.clone() };
    results.output_error = output_error(results, flight, inputs)?;
    results.notes.extend(results.output_error.refusals.iter().cloned());
    results.notes.extend(whole_lag(results));
    results.notes.extend(unused_outputs(flight));
    results.notes.extend(results.output_error.stretch_s.map(|(from_s, to_s)| {
        format!(
            "Output error fits the flight from {from_s:.1} s to {to_s:.1} s, where it turns most: of a longer flight a \
             minute is fitted."
        )
    }));
    Ok(())
}

/// The lag that equation error moved the inputs by, and what the next fit found on top of it.
fn whole_lag(results: &RunResults) -> Option<String> {
    let moved_s = results.clocks.as_ref().filter(|c| matches!(c, Clocks::Lag(_)))?.correction_s();
    let (name, fit) = results.output_error.named().next()?;
    let rest = fit.parameter("input_lag_s").filter(|_| moved_s != 0.0)?;
    Some(format!(
        "In all the motion follows the inputs' time stamps by {:+.2} ± {:.2} ms by {name}: {:+.2} ms by which they were \
             moved, and {:+.2} ms that it found on top.",
        1e3 * (moved_s + rest.value),
        1e3 * rest.std,
        1e3 * moved_s,
        1e3 * rest.value
    ))
}

/// That the model describes sensors of which there are no samples.
fn unused_outputs(flight: &Flight<'_>) -> Option<String> {
    let model = &flight.vehicle.model;
    let has_none = flight.sensors.is_none() && flight.log_sensors.is_none();
    (has_none && !model.sensors.is_empty()).then(|| {
        let names: Vec<&str> = model.sensors.iter().map(|s| s.name.as_str()).collect();
        format!(
            "The sensors of the model ({}) are not used: there are no samples of them; give a table with --sensors, or as `sensors` \
             of the session, or name fields of the log for them as for inputs.",
            names.join(", ")
        )
    })
}

/// That the vehicle file is of schema 1, and what was made of it.
fn earlier_schema(vehicle: &Vehicle) -> Option<String> {
    vehicle.is_of_schema_1.then(|| {
        format!(
            "The vehicle file has the [rotor] of schema 1: it is read as the model {:?}; `mavsight convert vehicle.toml \
             new-vehicle.toml` writes it anew.",
            vehicle.model.name
        )
    })
}

/// Output error from the poses, and from the images where there are any, with the body as refined. What the smoother
/// has left out, which disagrees with all other poses, is left out here too, and the motion begins anew where the
/// smoother's does.
fn output_error(
    results: &RunResults,
    flight: &Flight<'_>,
    inputs: &InputSeries,
) -> Result<FlightFits, EngineError> {
    let mut markers = body_markers(flight.vehicle);
    let mut markers_std_m: f64 = if results.body.is_empty() { MARKERS_STD_M } else { 0.0 };
    for (marker, built) in markers.iter_mut().zip(&results.body) {
        marker.marker_in_body_m = built.position_m;
        marker.radius_m = 0.5 * built.diameter_m;
        markers_std_m = markers_std_m.max(built.position_std_m.max());
    }
    let doubts = results.motion.as_ref().map(|m| &m.doubts);
    let left_out = doubts.map_or(&[][..], |d| &d.left_out_ns);
    let anew_ns: Vec<i64> =
        doubts.iter().flat_map(|d| &d.severed_ns).map(|(_, behind_ns)| *behind_ns).collect();
    let observations = without(inputs.covered(&results.markers, |m| m.t_ns), left_out, |m| m.t_ns);
    let poses = without(inputs.covered(&results.poses, |p| p.t_ns), left_out, |p| p.t_ns);
    let images = results.rig.as_ref().filter(|_| !results.markers.is_empty()).map(|rig| Images {
        rig,
        markers: &markers,
        markers_std_m,
        observations: &observations,
    });
    let clock = if flight.options.lag_s.is_some() { InputClock::Known } else { InputClock::Free };
    let options = FlightFitOptions {
        clock,
        held_out_s: flight.options.fit.held_out_s,
        fits: flight.options.motion_fits,
        search: flight.options.search,
        sensors: flight.sensors,
        anew_ns: &anew_ns,
        // Poses before the first inputs are not fitted; inputs that moved before the first pose have moved the aircraft.
        begins_in_flight: inputs.covered_range(&results.poses, |p| p.t_ns).start > 0
            || poses.first().is_some_and(|p| moves_before(inputs, flight.vehicle, p.t_ns)),
        at_most: flight.options.at_most,
    };
    let fits = FlightFits::of_flight(flight.vehicle, inputs, &poses, images, &options);
    Ok(fits.map_err(PipelineError::from)?)
}

/// Items without those of some times, which are in order.
fn without<'a, T: Clone>(items: &'a [T], left_out_ns: &[i64], t_ns: impl Fn(&T) -> i64) -> Cow<'a, [T]> {
    if left_out_ns.is_empty() {
        return Cow::Borrowed(items);
    }
    let is_kept = |item: &&T| left_out_ns.binary_search(&t_ns(item)).is_err();
    items.iter().filter(is_kept).cloned().collect()
}

/// Whether an error lies in what was asked for, and not in the flight.
fn is_of_the_settings(error: &IdentifyError) -> bool {
    matches!(
        error,
        IdentifyError::Regression(RegressionError::UnknownSignal { .. } | RegressionError::Scale { .. })
            | IdentifyError::ModelFile { .. }
            | IdentifyError::BadSetting { .. }
            | IdentifyError::BadBand { .. }
    )
}
