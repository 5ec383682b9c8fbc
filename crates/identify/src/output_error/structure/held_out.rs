//! The part of a flight by which a term that was added is judged.

use super::super::assemble::Solved;
use super::super::fitter::{Fitter, LONGEST_STEP_S, PROMISE, Recorded, TIGHTNESS};
use super::super::measure::{LeftOut, Measurements};
use super::super::model::FlightModel;
use super::super::options::{InitialStates, NoiseModel, OutputErrorOptions};
use super::super::start::begin;
use crate::IdentifyError;
use mavsight_flight::InputSeries;

/// Length of a piece: short for an unstable aircraft, long enough for a small force to show in the path. A
/// constant force of a hundredth of the weight moves the aircraft by 0.2 m in it, of which the start, found from the
/// piece itself, leaves 15 mm (root mean square of a parabola about its line): well above the noise of poses.
const PIECE_S: f64 = 2.0;
/// Of so many pieces one is held out, the second.
const OF: usize = 3;

/// Deviance by which a term must lower that of the held-out part: twice the logarithm of a Bayes factor from which evidence
/// is strong (Kass & Raftery 1995, section 3.2).
pub(super) const STRONG: f64 = 6.0;

/// A flight in two parts.
///
/// Every third piece is held out, and never the first: a manoeuvre of any axis, and the beginning
/// in trim, are then in the part that is fitted, and the held-out part is flown under the same conditions.
/// The last third of a flight may have another manoeuvre, or the landing.
pub(super) struct Parts {
    pub(super) fitted: Measurements,
    pub(super) held_out: Vec<Measurements>,
}

impl Parts {
    pub(super) fn of(measurements: &Measurements) -> Self {
        let times_s = measurements.times_s();
        let (first_s, last_s) = (times_s.first().copied(), times_s.last().copied());
        let (first_s, last_s) = (first_s.unwrap_or_default(), last_s.unwrap_or_default());
        let count = ((last_s - first_s) / PIECE_S).round().max(OF as f64) as usize;
        let piece_s = (last_s - first_s) / count as f64;
        let piece_of = |t_s: f64| (((t_s - first_s) / piece_s) as usize).min(count - 1);
        let (mut left_out, mut held_out) = (vec![false; times_s.len()], vec![Vec::new(); count]);
        for (instant, t_s) in times_s.iter().enumerate() {
            let piece = piece_of(*t_s);
            if piece % OF == 1 {
                left_out[instant] = true;
                held_out[piece].push(instant);
            }
        }
        held_out.retain(|piece| !piece.is_empty());
        let held_out = held_out.iter().map(|piece| measurements.at(piece)).collect();
        Self { fitted: Measurements::Part(Box::new(measurements.clone()), LeftOut(left_out)), held_out }
    }

    /// By how much the deviance of the held-out part, minus twice the logarithm of its likelihood, is lower
    /// after a term was added than before, with the weights of the fit after.
    ///
    /// Of each piece the start is found anew, with further states anywhere within their usual excursions
    /// about trim. Pieces that cannot be flown with both are left out.
    ///
    /// # Errors
    /// None of the pieces can be flown.
    pub(super) fn gain(
        &self,
        inputs: &InputSeries,
        before: &FlightModel,
        after: &Found,
    ) -> Result<f64, IdentifyError> {
        let (mut sum, mut refusal) = (None, None);
        for piece in &self.held_out {
            let squares = |model| squares(model, Recorded { inputs, measurements: piece }, &after.weights);
            match squares(before).and_then(|before| Ok(before - squares(&after.model)?)) {
                Ok(gain) => *sum.get_or_insert(0.0) += gain,
                Err(why) => refusal = Some(why),
            }
        }
        sum.ok_or_else(|| refusal.unwrap_or(IdentifyError::NoStart(0)))
    }
}

/// What a fit has found.
pub(super) struct Found {
    pub(super) model: FlightModel,
    /// One over the standard deviation factor of each channel.
    weights: Vec<f64>,
}

impl Found {
    pub(super) fn of(solved: &Solved<'_>) -> Self {
        let mut weights = solved.fitter.problem.weights.clone();
        let variances = solved.colour.iter().flat_map(|colour| colour.variances());
        weights.iter_mut().zip(variances).for_each(|(weight, variance)| *weight /= variance.sqrt());
        Self { model: solved.fitter.point.model.clone(), weights }
    }
}

/// Weighted squares of the residuals of a piece that is flown from the start that makes them least.
fn squares(model: &FlightModel, recorded: Recorded<'_>, weights: &[f64]) -> Result<f64, IdentifyError> {
    let model = &model.clone().with_free(&[])?;
    let options = OutputErrorOptions {
        segment_s: f64::INFINITY,
        initial: InitialStates::Free,
        noise: NoiseModel::Given,
        ..OutputErrorOptions::default()
    };
    let mut fitter = Fitter::new(model, begin(model, recorded, f64::INFINITY)?, recorded, &options)?;
    fitter.problem.weights = weights.to_vec();
    fitter.stage(false, LONGEST_STEP_S[1])?;
    fitter.converge(TIGHTNESS[3], PROMISE[3]);
    if fitter.converged { Ok(fitter.at.merit(TIGHTNESS[3])) } else { Err(fitter.not_converged(TIGHTNESS[3])) }
}
