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
    notes.extend(held_long(recorded));
    let identify = |motion: &Motion| identify_motion(motion, recorded, flight.vehicle, &flight.options, bars);
    let uncovered = is_part.then(|| taken_out(&mut motion.samples, covered));
    let mut solved = identify(&motion);
    if matches!(solved, Err(PipelineError::Identify(IdentifyError::GapInMotion { .. }))) {
        let whole = longest_whole(&motion);
        notes.push(part_whole(&motion.samples[whole.clone()]));
        let others = taken_out(&mut motion.samples, whole);
        solved = identify(&motion);
        put_back(&mut motion.samples, others);
    }
    if let Some(others) = uncovered {
        put_back(&mut motion.samples, others);
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

/// The longest part of a motion without a gap over which it cannot be read: what rotors do depends on all that they did before.
fn longest_whole(motion: &Motion) -> Range<usize> {
    let longest_ns = (1e9 * motion.longest_step_s()) as i64;
    let mut parts = motion.samples.chunk_by(|a, b| b.t_ns - a.t_ns <= longest_ns).scan(0, |at, part| {
        let from = std::mem::replace(at, *at + part.len());
        Some(from..*at)
    });
    let first = parts.next().unwrap_or(0..0);
    parts.fold(first, |best, part| if part.len() > best.len() { part } else { best })
}

fn part_whole(part: &[MotionSample]) -> String {
    let (from_s, to_s) = span_s(part);
    format!(
        "Equation error has the flight from {from_s:.3} to {to_s:.3} s alone: beside is a gap in which the motion is not known."
    )
}

/// First and last time.
fn span_s(samples: &[MotionSample]) -> (f64, f64) {
    let t_s = |sample: Option<&MotionSample>| sample.map_or(0.0, |s| s.t_ns as f64 * 1e-9);
    (t_s(samples.first()), t_s(samples.last()))
}

/// What lies before and behind a part, which alone stays: of a long flight a copy of the part would be large.
fn taken_out<T>(all: &mut Vec<T>, part: Range<usize>) -> (Vec<T>, Vec<T>) {
    let after = all.split_off(part.end);
    (all.drain(..part.start).collect(), after)
}

fn put_back<T>(all: &mut Vec<T>, (before, after): (Vec<T>, Vec<T>)) {
    all.splice(0..0, before);
    all.extend(after);
}

/// A word on rows of the inputs that are missing: in a log of changes nothing is, in one of an even clock something may be.
fn held_long(inputs: &InputSeries) -> Option<String> {
    const LONG_S: f64 = 0.2;
    const MANY: f64 = 10.0;
    let samples = inputs.samples();
    let mut steps_s: Vec<f64> = samples.windows(2).map(|w| w[1].t_s - w[0].t_s).collect();
    let middle = steps_s.len() / 2;
    let usual_s = *steps_s.select_nth_unstable_by(middle, f64::total_cmp).1;
    let (from, to) = samples
        .windows(2)
        .map(|w| (w[0].t_s, w[1].t_s))
        .max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)))
        .filter(|(from, to)| to - from > LONG_S.max(MANY * usual_s))?;
    Some(format!(
        "The inputs have no row from {from:.3} to {to:.3} s, where one every {usual_s:.3} s is usual: the last one counts as held."
    ))
}

fn part_covered(inputs: &InputSeries, motion: &Motion) -> String {
    let (from_s, to_s) = span_s(&motion.samples);
    format!(
        "The inputs cover {:.3} to {:.3} s of a flight from {from_s:.3} to {to_s:.3} s: the parameters are of that part.",
        inputs.start_s(),
        inputs.end_s(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_flight::InputSample;
    use mavsight_geometry::{Isometry3, Vector3};
    use mavsight_pose::MotionCovariance;

    fn motion(frames: impl Iterator<Item = i64>) -> Motion {
        let sample = |k: i64| MotionSample {
            t_ns: k * 33_333_333,
            world_from_body: Isometry3::identity(),
            velocity_in_body_m_s: Vector3::zeros(),
            rates_rad_s: Vector3::zeros(),
            specific_force_m_s2: Vector3::zeros(),
            angular_acceleration_rad_s2: Vector3::zeros(),
            covariance: MotionCovariance::default(),
        };
        Motion {
            samples: frames.map(sample).collect(),
            unknown_ns: Vec::new(),
            translation_bandwidth_hz: 4.0,
            rotation_bandwidth_hz: 5.0,
            sample_interval_s: 1.0 / 30.0,
        }
    }

    #[test]
    fn the_longest_part_is_taken_out_and_put_back() {
        let mut motion = motion((0..40).chain(80..150).chain(152..170).chain(200..230));
        let before = motion.samples.clone();
        // Two frames that are missing are no gap; those before 80 and behind 169 are.
        let whole = longest_whole(&motion);
        assert_eq!(whole, 40..128);
        assert!(part_whole(&motion.samples[whole.clone()]).contains("2.667 to 5.633 s"));
        let others = taken_out(&mut motion.samples, whole);
        assert_eq!(motion.samples[..], before[40..128]);
        put_back(&mut motion.samples, others);
        assert_eq!(motion.samples, before);
    }

    #[test]
    fn a_gap_in_an_even_log_is_told_and_a_log_of_changes_has_none() {
        let inputs = |times_s: &mut dyn Iterator<Item = f64>| {
            let sample = |t_s| InputSample {
                t_s,
                omega_u_rad_s: 200.0,
                omega_l_rad_s: 200.0,
                delta_lon_rad: 0.0,
                delta_lat_rad: 0.0,
            };
            InputSeries::new(times_s.map(sample).collect()).expect("inputs")
        };
        let even = |k: i32| f64::from(k) * 0.01;
        assert_eq!(held_long(&inputs(&mut (0..500).map(even))), None);
        let told = held_long(&inputs(&mut (0..200).chain(400..500).map(even))).expect("a word");
        assert!(told.contains("from 1.990 to 4.000 s") && told.contains("0.010 s is usual"), "{told}");
        assert_eq!(held_long(&inputs(&mut [0.0, 2.0, 3.0, 5.5].into_iter())), None);
    }
}
