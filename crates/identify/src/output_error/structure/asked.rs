//! What the residuals of a fit ask for.

use super::score::score_tests;
use super::{LEVEL, NotAdded, TriedTerm, candidates};
use crate::IdentifyError;
use crate::output_error::assemble::Solved;
use crate::output_error::fit::solve;
use crate::output_error::fitter::Recorded;
use crate::output_error::measure::Measurements;
use crate::output_error::model::{FlightModel, ModelParameter};
use crate::output_error::options::OutputErrorOptions;
use mavsight_flight::InputSeries;

/// What the residuals of output error ask for, by score tests over the whole flight, none of which is followed by a fit:
/// the candidate terms of the model's file; terms that follow one signal of the flight
/// ([`mavsight_model::Model::with_signal_terms`]) with the lag of the inputs; and a scale and an offset of each sensor
/// ([`mavsight_model::Model::with_sensor_terms`]). Of each kind those that pass at the level of 1 % over all of it, the
/// strongest first. In the first two sensors take no part.
///
/// # Errors
/// Those of [`crate::output_error`].
pub(in crate::output_error) fn terms_asked_for(
    model: &FlightModel,
    inputs: &InputSeries,
    measurements: &Measurements,
    options: &OutputErrorOptions,
) -> Result<AskedFor, IdentifyError> {
    let inputs = &model.inputs_of(inputs)?;
    let (seen, _) = model.clone().without_outputs();
    let mut solved = solve(&seen, Recorded { inputs, measurements: measurements.seen() }, options)?;
    let with_signals = solved.fitter.point.model.clone().with_signal_terms();
    let mut all = candidates(&with_signals);
    all.extend(late_inputs(&with_signals));
    solved.fitter.problem.inputs = inputs.with_time()?;
    solved.fitter.point.model = with_signals;
    test(solved, &mut all)?;
    let signals = passing(all.split_off(candidates(&seen).len()));
    // Where the flight with its sensors has no fit, output error says why.
    let sensors = of_sensors(model, Recorded { inputs, measurements }, options).unwrap_or_default();
    Ok(AskedFor { candidates: passing(all), signals, sensors })
}

/// Scales and offsets of sensors that the residuals of the fit with sensors ask for.
fn of_sensors(
    model: &FlightModel,
    recorded: Recorded<'_>,
    options: &OutputErrorOptions,
) -> Result<Vec<TriedTerm>, IdentifyError> {
    if !matches!(recorded.measurements, Measurements::Sensed(_)) {
        return Ok(Vec::new());
    }
    let mut solved = solve(model, recorded, options)?;
    let with_terms = solved.fitter.point.model.clone().with_sensor_terms();
    let mut all = candidates(&with_terms).split_off(candidates(model).len());
    solved.fitter.point.model = with_terms;
    test(solved, &mut all)?;
    Ok(passing(all))
}

/// Tests each term at a fit whose model has them all.
fn test(solved: Solved<'_>, terms: &mut [TriedTerm]) -> Result<(), IdentifyError> {
    let parameters: Vec<ModelParameter> = terms.iter().map(|t| t.parameter).collect();
    let tests = score_tests(solved, &parameters)?;
    terms.iter_mut().zip(tests).for_each(|(term, test)| term.test = test);
    Ok(())
}

/// Inputs that act later than they are recorded, where the fit does not find that by itself.
fn late_inputs(model: &FlightModel) -> Option<TriedTerm> {
    let parameter = ModelParameter::InputLag;
    (!model.free().contains(&parameter)).then(|| TriedTerm {
        parameter,
        name: model.name(parameter).to_owned(),
        unit: model.unit(parameter),
        explains: "inputs that act later than they are recorded".to_owned(),
        test: None,
        reason: NotAdded::NoEvidence,
    })
}

/// Terms that pass their score tests.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AskedFor {
    /// Candidates of the model's file.
    pub candidates: Vec<TriedTerm>,
    /// Forces and moments that follow one signal of the flight, and a lag of the inputs.
    pub signals: Vec<TriedTerm>,
    /// Scales and offsets of sensors.
    pub sensors: Vec<TriedTerm>,
}

impl AskedFor {
    pub(in crate::output_error) fn is_empty(&self) -> bool {
        self.candidates.is_empty() && self.signals.is_empty() && self.sensors.is_empty()
    }
}

/// The terms that pass at the level of all of them together, the strongest first.
fn passing(mut terms: Vec<TriedTerm>) -> Vec<TriedTerm> {
    let chi_square = |t: &TriedTerm| t.test.map_or(0.0, |test| test.chi_square);
    let level = LEVEL / terms.len() as f64;
    terms.retain(|t| t.test.is_some_and(|test| test.p_value <= level));
    terms.sort_by(|a, b| chi_square(b).total_cmp(&chi_square(a)));
    terms
}
