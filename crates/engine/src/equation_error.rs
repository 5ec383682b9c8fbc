//! Equation error of a flight, with the inputs' clock set right.

use crate::parts::{
    begun_in_flight, held_long, longest_without_gap, part_covered, part_without_gap, with_part,
};
use crate::{EngineError, Flight};
use mavsight_flight::InputSeries;
use mavsight_identify::{Clocks, IdentifyError, Lag, delayed, far_lag};
use mavsight_pipeline::{PipelineError, Progress, Solution, identify_motion};
use mavsight_pose::Motion;

/// Inputs whose times a lag is added to. Within the margin of the fits, their ends are held.
///
/// # Errors
/// A lag that leaves none of the inputs within the flight.
pub(crate) fn moved_by(
    lag_s: f64,
    inputs: &InputSeries,
    motion: &Motion,
    flight: &Flight<'_>,
) -> Result<InputSeries, EngineError> {
    if lag_s.abs() <= flight.options.table.margin_s {
        return delayed(inputs, lag_s).map_err(EngineError::Setting);
    }
    let moved = inputs.at_times(|t_s| t_s + lag_s).ok();
    let covers = |inputs: &InputSeries| !inputs.covered_range(&motion.samples, |s| s.t_ns).is_empty();
    let must = "be such that some of the inputs are of the flight";
    let wrong = IdentifyError::BadSetting { what: "the lag", value: lag_s, must };
    moved.filter(covers).ok_or(EngineError::Setting(wrong))
}

/// Equation error with the lag that is given, or one that is searched. Where a lag beyond the margin of the fits explains
/// the motion clearly better than any within, the inputs are moved by it, and the lag is searched around it.
pub(crate) fn equation_error_by_clock(
    motion: &mut Motion,
    recorded: &InputSeries,
    flight: &Flight<'_>,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Solution, PipelineError> {
    let mut near_notes = Vec::new();
    let near = equation_error(motion, recorded, flight, &mut near_notes, progress);
    let far = match &near {
        Ok(solution) if are_apart(&solution.clocks) => far_clock(motion, recorded, flight),
        _ => None,
    };
    let Some((far, moved)) = far else {
        notes.append(&mut near_notes);
        return near;
    };
    let mut around = equation_error(motion, &moved, flight, notes, progress)?;
    around.clocks = Clocks::Lag(match around.clocks {
        Clocks::Lag(near) => Lag { lag_s: far.lag_s + near.lag_s, ..near },
        _ => far,
    });
    around.inputs = around.inputs.or(Some(moved));
    Ok(around)
}

/// Whether clocks may be further apart than was searched.
fn are_apart(clocks: &Clocks) -> bool {
    match clocks {
        Clocks::Lag(lag) => lag.significant(),
        Clocks::Beyond(_) | Clocks::Undetermined => true,
        Clocks::Known(_) => false,
    }
}

/// The lag beyond the margin of the fits, where one can be searched and is found, and the inputs moved by it.
fn far_clock(motion: &mut Motion, recorded: &InputSeries, flight: &Flight<'_>) -> Option<(Lag, InputSeries)> {
    let table = &flight.options.table;
    let covered = recorded.covered_range(&motion.samples, |s| s.t_ns);
    let far = with_part(motion, covered, |part| {
        let longest = longest_without_gap(part);
        with_part(part, longest, |part| far_lag(part, recorded, flight.vehicle, table, table.margin_s))
    });
    let far = far.ok()??;
    Some((far, moved_by(far.lag_s, recorded, motion, flight).ok()?))
}

/// Equation error over what the inputs cover of the motion; of that, over the longest part without a gap.
fn equation_error(
    motion: &mut Motion,
    recorded: &InputSeries,
    flight: &Flight<'_>,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Solution, PipelineError> {
    let all = 0..motion.samples.len();
    let mut covered = recorded.covered_range(&motion.samples, |s| s.t_ns);
    if covered.is_empty() {
        // Then the error says so.
        covered = all;
    } else if covered != all {
        notes.push(part_covered(recorded, motion));
    }
    notes.extend(held_long(recorded));
    let begun = begun_in_flight(recorded, &motion.samples[covered.clone()], flight.vehicle);
    let identify =
        |part: &mut Motion| identify_motion(part, recorded, flight.vehicle, &flight.options, progress);
    let solved = with_part(motion, covered, |covered| match identify(covered) {
        Err(PipelineError::Identify(IdentifyError::GapInMotion { .. })) => {
            let longest = longest_without_gap(covered);
            notes.push(part_without_gap(&covered.samples[longest.clone()]));
            with_part(covered, longest, identify)
        }
        solved => solved,
    })?;
    if !solved.identification.fits.is_empty() {
        notes.extend(begun);
    }
    Ok(solved)
}
