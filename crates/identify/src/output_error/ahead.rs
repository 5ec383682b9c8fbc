//! How a fitted model predicts a second ahead.

use super::SAME_TIME_S;
use super::filter::{SEGMENT_S, VELOCITY};
use super::fitter::{Fitter, LONGEST_STEP_S, PROMISE, Recorded, TIGHTNESS};
use super::measure::{Measurements, StateMeasurement};
use super::model::{Equations, FlightModel};
use super::options::{InitialStates, OutputErrorOptions};
use super::propagate::{Propagator, Raster, fastest, longest_step_s};
use super::result::OutputErrorFit;
use super::row::pose_of;
use super::start::begin;
use crate::IdentifyError;
use mavsight_flight::InputSeries;
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};

/// How long a part of the flight before a prediction its start is filtered from: a few time constants of
/// what the poses show.
pub(super) const FILTERED_S: f64 = 2.0;
/// Poses that a state is filtered from, at least.
const FEWEST: usize = 10;
/// Horizons over which a prediction may go where poses are missing: beyond, it is one of another time.
const LONGEST: f64 = 1.5;

/// Errors of a pose, or root mean squares of many.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseErrors {
    /// Distance.
    pub position_m: f64,
    /// Angle of the turn between them.
    pub attitude_rad: f64,
}

/// Root mean square errors of poses that were predicted from the state some time before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AheadErrors {
    /// How far ahead.
    pub horizon_s: f64,
    /// Predictions.
    pub count: usize,
    /// Predictions by the model that ran away: they are in no root mean square.
    pub ran_away: usize,
    /// Times at which no state was found, as its filter did not converge: nothing was predicted from them.
    pub not_started: usize,
    /// Of the model with the recorded inputs; none where all predictions ran away.
    pub model: Option<PoseErrors>,
    /// Of holding velocity (in the world) and rates (in the body): without any model.
    pub held: PoseErrors,
}

/// Predicts poses a time ahead, from a state at each multiple of it.
///
/// Each state is filtered from the poses of the two seconds up to it, with the fitted parameters and process
/// noise: nothing after it is known but the inputs. Predicted is the first pose after the horizon, if it is less than half of
/// it late. None where the poses are too few for one prediction.
///
/// # Errors
/// Those of [`super::filter_error`] but [`IdentifyError::FitNotConverged`], which is counted, unless no state converges at all.
pub fn predict_ahead(
    model: &FlightModel,
    fit: &OutputErrorFit,
    inputs: &InputSeries,
    poses: &[StateMeasurement],
    horizon_s: f64,
) -> Result<Option<AheadErrors>, IdentifyError> {
    let fitted = fit.model(model)?;
    let inputs = &fitted.inputs_of(inputs)?;
    let known: Vec<StateMeasurement> = poses.iter().filter(|p| p.pose.is_some()).cloned().collect();
    let Some(first_s) = known.first().map(StateMeasurement::t_s) else { return Ok(None) };
    let place = |t_s: f64| known.partition_point(|p| p.t_s() < t_s - SAME_TIME_S);
    let (mut by_model, mut by_holding) = (Vec::new(), Vec::new());
    let mut not_started = Vec::new();
    for k in 0..known.len() {
        let at_s = first_s + FILTERED_S + k as f64 * horizon_s;
        let (from, to) = (place(at_s - FILTERED_S), place(at_s + SAME_TIME_S * 2.0));
        let Some(measured) = known.get(place(at_s + horizon_s)) else { break };
        let before = &known[from..to];
        let (Some(last), Some((pose, _))) = (before.last(), measured.pose) else { continue };
        let span = Span { from_s: last.t_s(), to_s: measured.t_s() };
        if before.len() < FEWEST || span.to_s - span.from_s > LONGEST * horizon_s {
            continue;
        }
        let y = match filtered(&fitted, fit, inputs, before) {
            Err(why @ IdentifyError::FitNotConverged { .. }) => {
                not_started.push(why);
                continue;
            }
            found => found?,
        };
        by_model.extend(flown(&fitted, inputs, &y, span).map(|p| PoseErrors::between(&p, &pose)));
        by_holding.push(PoseErrors::between(&held(&y, span), &pose));
    }
    if by_holding.is_empty() {
        return not_started.pop().map_or(Ok(None), Err);
    }
    Ok(Some(AheadErrors {
        horizon_s,
        count: by_holding.len(),
        ran_away: by_holding.len() - by_model.len(),
        not_started: not_started.len(),
        model: (!by_model.is_empty()).then(|| PoseErrors::rms(&by_model)),
        held: PoseErrors::rms(&by_holding),
    }))
}

impl PoseErrors {
    fn between(predicted: &Isometry3<f64>, measured: &Isometry3<f64>) -> Self {
        let apart = predicted.translation.vector - measured.translation.vector;
        Self { position_m: apart.norm(), attitude_rad: predicted.rotation.angle_to(&measured.rotation) }
    }

    fn rms(all: &[Self]) -> Self {
        let rms =
            |of: fn(&Self) -> f64| (all.iter().map(|e| of(e).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        Self { position_m: rms(|e| e.position_m), attitude_rad: rms(|e| e.attitude_rad) }
    }
}

#[derive(Clone, Copy)]
struct Span {
    from_s: f64,
    to_s: f64,
}

/// The state at the last of some poses.
fn filtered(
    model: &FlightModel,
    fit: &OutputErrorFit,
    inputs: &InputSeries,
    poses: &[StateMeasurement],
) -> Result<Vec<f64>, IdentifyError> {
    let measurements = Measurements::States(poses.to_vec());
    let recorded = Recorded { inputs, measurements: &measurements };
    let options = OutputErrorOptions { initial: InitialStates::Free, ..OutputErrorOptions::default() };
    let mut fitter = Fitter::new(model, begin(model, recorded, SEGMENT_S)?, recorded, &options)?;
    let roots = fit.process_noise.iter().map(|(_, root)| root);
    let densities = &mut fitter.problem.process_noise.as_mut_slice()[VELOCITY..];
    roots.zip(densities).for_each(|(root, density)| *density = root * root);
    // A fit of images says nothing of the poses' own errors, whose standard deviations then stand as they are.
    for (name, weight) in measurements.channels().iter().zip(&mut fitter.problem.weights) {
        let own = fit.variance_factors.iter().find(|(channel, _)| channel == name);
        *weight = own.map_or(1.0, |(_, factor)| factor.sqrt().recip());
    }
    fitter.stage(false, LONGEST_STEP_S[0])?;
    fitter.converge(TIGHTNESS[3], PROMISE[3]);
    if !fitter.converged {
        return Err(fitter.not_converged(TIGHTNESS[3]));
    }
    Ok(fitter.at.states[fitter.at.states.len() - 1].clone())
}

/// The pose after a span; none where the model runs away.
fn flown(model: &FlightModel, inputs: &InputSeries, y: &[f64], span: Span) -> Option<Isometry3<f64>> {
    let equations = Equations::new(model);
    let mut evaluation = equations.dynamics.with(&[]);
    let raster = Raster { inputs, lag_s: model.input_lag_s, times_s: &[], longest_s: LONGEST_STEP_S[0] };
    evaluation.set_inputs(inputs.row(raster.input_at(span.from_s)));
    let longest_s = raster.longest_s.min(longest_step_s(fastest(&mut evaluation, y)));
    let mut flyer = Propagator::new(&equations, y);
    for step in (Raster { longest_s, ..raster }).steps(span.from_s, span.to_s, 0..0) {
        flyer.step(&mut evaluation, inputs, &step);
    }
    flyer.is_finite().then(|| pose_of(&flyer.y))
}

fn held(y: &[f64], span: Span) -> Isometry3<f64> {
    let now = pose_of(y);
    let time_s = span.to_s - span.from_s;
    let (velocity, rates) = (Vector3::new(y[7], y[8], y[9]), Vector3::new(y[10], y[11], y[12]));
    let place = now.translation.vector + now.rotation * velocity * time_s;
    Isometry3::from_parts(place.into(), now.rotation * UnitQuaternion::from_scaled_axis(rates * time_s))
}
