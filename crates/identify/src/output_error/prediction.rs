//! How a fitted model predicts a part of the flight that it was not fitted to.

use super::fitter::{Fitter, LONGEST_STEP_S, PROMISE, Recorded, TIGHTNESS};
use super::measure::{Measurements, StateMeasurement};
use super::model::FlightModel;
use super::options::{InitialStates, NoiseModel, OutputErrorOptions};
use super::result::{OutputErrorFit, Prediction};
use super::row::pose_of;
use super::start::begin;
use crate::{IdentifyError, agreement};
use mavsight_flight::InputSeries;
use mavsight_geometry::{EulerAngles, Isometry3};
use mavsight_pose::PoseSample;
use std::f64::consts::PI;

/// Flies the fitted model through the part of a flight in which the poses lie, in one piece.
///
/// Of that part only its start is found (position, attitude, velocity, rates and further states): no
/// parameter of the model is. This is how prediction is judged where the start of a record is not known
/// (Klein & Morelli 2006, section 11.3). What an unstable aircraft does with a small error of the start grows
/// with the length of the part, so that a few seconds are what it can be judged by.
///
/// # Errors
/// Those of [`super::output_error`] for too few poses, inputs that do not cover them, or no convergence.
pub fn predict_poses(
    model: &FlightModel,
    fit: &OutputErrorFit,
    inputs: &InputSeries,
    poses: &[PoseSample],
) -> Result<Prediction, IdentifyError> {
    let fitted = fit.model(model)?;
    let states: Vec<StateMeasurement> =
        poses.iter().filter(|p| p.estimate.is_ok()).map(StateMeasurement::from_pose).collect();
    let measured = Measurements::States(states);
    measured.check()?;
    let options = OutputErrorOptions {
        segment_s: f64::INFINITY,
        initial: InitialStates::Free,
        noise: NoiseModel::Given,
        ..OutputErrorOptions::default()
    };
    let inputs = &fitted.inputs_of(inputs)?;
    let recorded = Recorded { inputs, measurements: &measured };
    let mut fitter = Fitter::new(&fitted, begin(&fitted, recorded, f64::INFINITY)?, recorded, &options)?;
    fitter.stage(false, LONGEST_STEP_S[1])?;
    fitter.converge(TIGHTNESS[3], PROMISE[3]);
    if !fitter.converged {
        return Err(fitter.not_converged(TIGHTNESS[3]));
    }
    let times_s = measured.times_s();
    let seen: Vec<[f64; 6]> = measured.poses().iter().map(|(_, pose)| coordinates(pose)).collect();
    let flown: Vec<[f64; 6]> = fitter.at.states.iter().map(|y| coordinates(&pose_of(y))).collect();
    let agreements = std::array::from_fn(|k| {
        let turned = |y: f64, z: f64| if k < 3 { z } else { y + (z - y + PI).rem_euclid(2.0 * PI) - PI };
        let measured: Vec<f64> = seen.iter().map(|c| c[k]).collect();
        let predicted: Vec<f64> = seen.iter().zip(&flown).map(|(y, z)| turned(y[k], z[k])).collect();
        agreement(&measured, &predicted)
    });
    Ok(Prediction { span_s: (times_s[0], times_s[times_s.len() - 1]), agreements })
}

fn coordinates(pose: &Isometry3<f64>) -> [f64; 6] {
    let (p, e) = (pose.translation.vector, EulerAngles::from_world_from_body(pose));
    [p.x, p.y, p.z, e.phi_rad, e.theta_rad, e.psi_rad]
}
