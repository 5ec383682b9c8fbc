//! From poses to motion and parameters.

use super::Flight;
use crate::cli::WrongCall;
use crate::progress::Bars;
use anyhow::Result;
use mavsight_flight::InputSeries;
use mavsight_identify::IdentifyError;
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, InputClock};
use mavsight_pipeline::{
    MARKERS_STD_M, PipelineError, body_markers, identify_motion, motion_from_poses, output_error_fits,
};
use mavsight_pose::{Motion, MotionSample};
use mavsight_session::RunResults;
use std::ops::Range;

/// Smooths the poses and fits the model; what the flight cannot tell becomes a note, what is wrong an error.
pub(crate) fn identify_into(
    results: &mut RunResults,
    flight: &Flight<'_>,
    bars: &Bars,
) -> Result<Vec<String>> {
    let motion = motion_from_poses(&results.poses, flight.vehicle, bars);
    with_motion(results, motion, flight, bars)
}

/// The same from what became of the motion.
pub(crate) fn with_motion(
    results: &mut RunResults,
    motion: Result<Motion, PipelineError>,
    flight: &Flight<'_>,
    bars: &Bars,
) -> Result<Vec<String>> {
    match motion {
        Ok(motion) => fit_into(results, motion, flight, bars),
        Err(refusal) => Ok(vec![format!("No motion: {refusal}")]),
    }
}

/// The same from a motion.
pub(crate) fn fit_into(
    results: &mut RunResults,
    mut motion: Motion,
    flight: &Flight<'_>,
    bars: &Bars,
) -> Result<Vec<String>> {
    let Some(recorded) = flight.inputs else {
        results.motion = Some(motion);
        return Ok(vec!["No parameters: the session names no inputs.".to_owned()]);
    };
    let mut notes = Vec::new();
    let mut inputs = None;
    let covered = recorded.covered_range(&motion.samples, |s| s.t_ns);
    // Where nothing is covered, the error says so.
    let is_part = !covered.is_empty() && covered.len() < motion.samples.len();
    if is_part {
        notes.push(part_covered(recorded, &motion));
    }
    let uncovered = is_part.then(|| taken_out(&mut motion.samples, covered));
    let solved = identify_motion(&motion, recorded, flight.vehicle, &flight.options, bars);
    if let Some((before, after)) = uncovered {
        motion.samples.splice(0..0, before);
        motion.samples.extend(after);
    }
    match solved {
        Ok(solution) => {
            notes.extend(solution.clocks.words());
            inputs = solution.inputs;
            results.coefficients = Some(solution.coefficients);
            results.identification = Some(solution.identification);
            results.clocks = Some(solution.clocks);
        }
        Err(PipelineError::Identify(IdentifyError::Flight(wrong))) => return Err(wrong.into()),
        Err(PipelineError::Identify(wrong)) if is_of_the_call(&wrong) => {
            return Err(WrongCall(wrong.to_string()).into());
        }
        Err(refusal) => notes.push(format!("No parameters: {refusal}")),
    }
    results.motion = Some(motion);
    if !flight.options.equation_error_only && !results.poses.is_empty() {
        results.output_error = output_error_of(results, flight, inputs.as_ref().unwrap_or(recorded), bars)?;
        notes.extend(results.output_error.refusals.iter().cloned());
        notes.extend(results.output_error.stretch_s.map(|(from_s, to_s)| {
            format!(
                "Output error fits the flight from {from_s:.1} s to {to_s:.1} s, where it turns most: of a longer flight a minute \
                 is fitted."
            )
        }));
    }
    Ok(notes)
}

/// What lies before and behind a part, which alone stays: of a long flight a copy of the part would be large.
fn taken_out<T>(all: &mut Vec<T>, part: Range<usize>) -> (Vec<T>, Vec<T>) {
    let after = all.split_off(part.end);
    (all.drain(..part.start).collect(), after)
}

fn part_covered(inputs: &InputSeries, motion: &Motion) -> String {
    let t_s = |sample: Option<&MotionSample>| sample.map_or(0.0, |s| s.t_ns as f64 * 1e-9);
    format!(
        "The inputs cover {:.3} to {:.3} s of a flight from {:.3} to {:.3} s: the parameters are of that part.",
        inputs.start_s(),
        inputs.end_s(),
        t_s(motion.samples.first()),
        t_s(motion.samples.last()),
    )
}

/// Output error from the poses, and from the images where they are at hand; with the body as the flight has shown it.
fn output_error_of(
    results: &RunResults,
    flight: &Flight<'_>,
    inputs: &InputSeries,
    bars: &Bars,
) -> Result<FlightFits> {
    let mut markers = body_markers(flight.vehicle);
    let mut markers_std_m: f64 = if results.body.is_empty() { MARKERS_STD_M } else { 0.0 };
    for (marker, built) in markers.iter_mut().zip(&results.body) {
        marker.marker_in_body_m = built.position_m;
        marker.radius_m = 0.5 * built.diameter_m;
        markers_std_m = markers_std_m.max(built.position_std_m.max());
    }
    let seen = (results.rig.as_ref())
        .filter(|_| !results.markers.is_empty())
        .map(|rig| (rig, markers.as_slice(), markers_std_m, inputs.covered(&results.markers, |m| m.t_ns)));
    let clock = if flight.options.lag_s.is_some() { InputClock::Known } else { InputClock::Free };
    let options = FlightFitOptions { clock, held_out_s: flight.options.fit.held_out_s };
    let poses = inputs.covered(&results.poses, |p| p.t_ns);
    Ok(output_error_fits(flight.vehicle, inputs, poses, seen, &options, bars)?)
}

/// Whether an error lies in what was asked for, and not in the flight.
fn is_of_the_call(error: &IdentifyError) -> bool {
    matches!(
        error,
        IdentifyError::UnknownSignal { .. }
            | IdentifyError::ModelFile { .. }
            | IdentifyError::BadSetting { .. }
            | IdentifyError::BadBand { .. }
    )
}
