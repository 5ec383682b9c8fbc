//! Filter error: output error whose process is not free of noise.

use super::assemble::{Solved, assemble};
use super::condense::SegmentCovariance;
use super::determined::refuse_undetermined;
use super::fitter::{Fitter, LONGEST_STEP_S, Recorded, TIGHTNESS};
use super::innovations::innovations;
use super::measure::Measurements;
use super::model::FlightModel;
use super::options::{NoiseModel, OutputErrorOptions};
use super::result::OutputErrorFit;
use super::squares::Squares;
use crate::IdentifyError;
use crate::inverse::inverse;
use mavsight_flight::InputSeries;
use nalgebra::{DVector, DVectorView};

/// Names of the process noise that is estimated.
pub(super) const NOISES: [&str; 6] = ["force x", "force y", "force z", "moment x", "moment y", "moment z"];
/// Its first degree of freedom in a state: velocity, then rates.
pub(super) const VELOCITY: usize = 6;
/// Process noise acts where segments meet: at 30 Hz, or at each measurement if there are fewer.
pub(super) const SEGMENT_S: f64 = 0.03;
/// Specific force from which the search of the noise starts, over gravity: a tenth for a tenth of a second.
const FIRST_SHARE: f64 = 0.1;
const FIRST_S: f64 = 0.1;
/// Part of the first density below which there is no noise.
const LEAST_PART: f64 = 1e-8;
/// Rounds in which noise and parameters determine each other.
const ROUNDS: usize = 60;
/// Relative change of a variance that ends them.
const CHANGE: f64 = 0.02;
/// The most that the logarithm of a density changes by in a round.
const LARGEST_CHANGE: f64 = 3.0;
/// The most that a round is multiplied by.
const LONGEST_LEAP: f64 = 4.0;
/// Between rounds a fit is left where a step promises less than a standard deviation, and at last less than a tenth
/// of one.
const ROUND_PROMISE: f64 = 1.0;
const LAST_PROMISE: f64 = 0.01;
/// Steps in all, over those of output error: noise and parameters are found in turn.
const MORE_STEPS: usize = 2;

/// Fits the free parameters of a model together with what it lacks: unmodelled forces and moments count as
/// white process noise along each axis of the body, whose densities are estimated with the noise of the
/// measurements (Maine & Iliff 1985, chapter 5; Jategaonkar 2015, chapter 5).
///
/// States and parameters are found together: with Gaussian noise and equations that are linear about the
/// result, the parameters that minimise the squares of residuals and process noise are those of the Kalman
/// filter's innovations. The densities are where each axis' squares equal what the flight says of them, its
/// degrees of freedom counted as those that the measurements decide (MacKay 1992, equation 4.10; the same
/// point as that of the most likely densities). Standard deviations are the larger of the Cramér-Rao bound with
/// that noise and of the spread of the scores over the flight (Newey & West 1987).
///
/// The model's further states have no noise of their own. Inputs and measurements are those of
/// [`super::output_error`].
///
/// # Errors
/// Those of [`super::output_error`].
pub fn filter_error(
    model: &FlightModel,
    inputs: &InputSeries,
    measurements: &Measurements,
    options: &OutputErrorOptions,
) -> Result<OutputErrorFit, IdentifyError> {
    let inputs = &model.inputs_of(inputs)?;
    let max_iterations = MORE_STEPS * options.max_iterations;
    let options = &OutputErrorOptions { segment_s: SEGMENT_S, max_iterations, ..*options };
    let mut fitter = Fitter::begin(model, Recorded { inputs, measurements }, options)?;
    fitter.problem.process_noise = first_noise(model, fitter.at.tangent);
    fitter.close_gaps()?;
    let tightness = TIGHTNESS[3];
    let mut search = [Secant::default(); NOISES.len()];
    for _ in 0..ROUNDS {
        let change = fitter.match_noise(&mut search, tightness, options.noise)?;
        if change < CHANGE || fitter.limit.too_long_s().is_some() {
            break;
        }
        fitter.converge(tightness, ROUND_PROMISE);
    }
    fitter.stage(false, LONGEST_STEP_S[1])?;
    fitter.converge(tightness, LAST_PROMISE);
    let linear = innovations(&fitter.at, tightness);
    refuse_undetermined(&fitter, &linear)?;
    if !fitter.converged {
        return Err(fitter.not_converged(tightness));
    }
    assemble(&Solved { fitter, linear, colour: None })
}

/// Densities to start from.
fn first_noise(model: &FlightModel, tangent: usize) -> DVector<f64> {
    let mut out = DVector::zeros(tangent);
    let Some((linear_m_s2, turning_rad_s2)) = model.accelerations(FIRST_SHARE) else { return out };
    for (k, turning_rad_s2) in turning_rad_s2.into_iter().enumerate() {
        out[VELOCITY + k] = linear_m_s2.powi(2) * FIRST_S;
        out[VELOCITY + 3 + k] = turning_rad_s2.powi(2) * FIRST_S;
    }
    out
}

/// The search of a density by its logarithm, along what each round would change it by.
#[derive(Debug, Clone, Copy, Default)]
struct Secant {
    /// The logarithm at the round before, and what that round would have changed it by.
    before: Option<(f64, f64)>,
}

impl Secant {
    /// The step of a logarithm that a round would change: on to where the change would vanish if it went on
    /// along a straight line, at least as far as the round itself and at most four times.
    fn step(&mut self, at: f64, change: f64) -> f64 {
        let slope = self.before.replace((at, change)).map(|(x, y)| (change - y) / (at - x));
        let times = slope.map_or(1.0, |slope| -1.0 / slope);
        let times = if times.is_finite() && times > 0.0 { times.clamp(1.0, LONGEST_LEAP) } else { 1.0 };
        (times * change).clamp(-LARGEST_CHANGE, LARGEST_CHANGE)
    }
}

impl Fitter<'_> {
    /// Moves densities of the process noise, and weights of the channels where they are scaled, to what the
    /// flight says; the largest relative change of one.
    fn match_noise(
        &mut self,
        search: &mut [Secant],
        tightness: f64,
        noise: NoiseModel,
    ) -> Result<f64, IdentifyError> {
        let linear = innovations(&self.at, tightness);
        let Some(first) = inverse(&linear.information()) else {
            // Where a parameter makes it singular, that is named.
            refuse_undetermined(self, &linear)?;
            return Err(IdentifyError::RankZero);
        };
        let smoothed = self.condensed(tightness, 0.0)?.smoothed(&self.at, first);
        let mut change = self.match_process(search, &smoothed);
        if noise == NoiseModel::Scaled {
            change = change.max(self.match_weights(&smoothed));
        }
        self.at = self.problem.evaluate(&self.point)?;
        Ok(change)
    }

    fn match_process(&mut self, search: &mut [Secant], smoothed: &[SegmentCovariance]) -> f64 {
        let least = first_noise(&self.start, self.at.tangent) * LEAST_PART;
        let mut found = vec![Squares::default(); self.at.tangent];
        for (s, (gap, known)) in self.at.gaps().zip(smoothed).enumerate() {
            let Some(variances) = &known.gap else { continue };
            for (k, std) in self.at.noise_std(s) {
                let prior = std * std;
                found[k].add(gap[k] * gap[k] / prior, 1.0 - variances[k] / prior);
            }
        }
        let mut change: f64 = 0.0;
        for (k, search) in (VELOCITY..).zip(search) {
            let density = &mut self.problem.process_noise[k];
            if *density <= least[k] {
                continue;
            }
            let to = if found[k].decided < 1.0 {
                least[k]
            } else {
                (density.ln() + search.step(density.ln(), found[k].factor().ln())).exp().max(least[k])
            };
            change = change.max((to / *density).ln().abs());
            *density = to;
        }
        change
    }

    fn match_weights(&mut self, smoothed: &[SegmentCovariance]) -> f64 {
        let mut found = vec![Squares::default(); self.problem.weights.len()];
        let mut places = self.at.places.iter();
        for (segment, known) in self.at.segments.iter().zip(smoothed) {
            let n = known.variables.nrows();
            for row in segment.rows.column_iter() {
                let Some(place) = places.next() else { break };
                let by: DVectorView<'_, f64> = row.rows(0, n);
                found[place.channel].add(row[n] * row[n], 1.0 - by.dot(&(&known.variables * by)));
            }
        }
        self.weigh(&found)
    }
}
