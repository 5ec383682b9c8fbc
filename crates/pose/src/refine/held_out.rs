//! Whether a flight knows the cameras better than their calibration: observations that the refinement has not seen
//! decide.

use super::instants::instants_of;
use super::{Bundle, FlightPrior, validate};
use crate::moving::Instant;
use crate::{BodyMarker, Observations, PoseError, Rig};
use nalgebra::DMatrix;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Seconds from which the scatter between them is known well enough for a test.
const NEEDED_SECONDS: usize = 4;

/// Probability with which a gain that is chance is not taken for one.
const SURE: f64 = 0.99;

/// What a refinement of the cameras is worth to seconds of the flight that it has not seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOut {
    /// Seconds that were held out, each once.
    pub seconds: usize,
    /// Mean fall of the loss of a second, in squared standard deviations of a coordinate.
    pub gain: f64,
    /// Standard deviation of that mean, by the scatter between seconds; infinite below four of them.
    pub gain_std: f64,
}

impl HeldOut {
    /// Whether the refined cameras fit the seconds that they have not seen better, beyond chance: Student's t-test of
    /// the seconds' gains at 99 %, one-sided.
    pub fn knows_more(&self) -> bool {
        let freedom = self.seconds.saturating_sub(1) as f64;
        let least = StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |t| t.inverse_cdf(SURE));
        self.gain > least * self.gain_std
    }
}

/// Holds out every second second of a flight, then the others, and compares how well two fits to the rest predict
/// them: one with the cameras free within their covariance, and one with the cameras as calibrated (two-fold
/// cross-validation, Stone 1974). Markers and constant errors of centres are free in both, as a flight in one place
/// shows errors of centres that look like errors of a camera; only places elsewhere separate them. The poses of
/// the seconds that are held out are fitted in both. Arguments are those of [`super::refine_flight`].
///
/// # Errors
/// Those of [`super::refine_flight`].
pub fn hold_out(
    observations: &Observations,
    rig: &Rig,
    markers: &[BodyMarker],
    prior: FlightPrior,
) -> Result<HeldOut, PoseError> {
    validate(rig, prior)?;
    let seconds = instants_of(observations, rig, markers, prior.markers_std_m)?;
    if seconds.len() < NEEDED_SECONDS {
        return Ok(HeldOut { seconds: seconds.len(), gain: 0.0, gain_std: f64::INFINITY });
    }
    let calibrated = Rig { uncertainty: DMatrix::zeros(rig.uncertainty.nrows(), 0), ..rig.clone() };
    let every_other = |from: usize| seconds.iter().skip(from).step_by(2).cloned().collect::<Vec<_>>();
    let mut gains = Vec::with_capacity(seconds.len());
    for held in 0..2 {
        let (seen, held) = (every_other(1 - held), every_other(held));
        let mut of_calibrated = Bundle::new(&calibrated, markers, prior, seen.clone());
        let mut of_refined = Bundle::new(rig, markers, prior, seen);
        of_calibrated.fit(prior.centres_std_px.is_none())?;
        of_refined.fit(prior.centres_std_px.is_none())?;
        // One scale for both.
        of_refined.factor = of_calibrated.factor;
        let (before, after) = (of_calibrated.losses(held.clone())?, of_refined.losses(held)?);
        gains.extend(before.iter().zip(after).map(|(before, after)| before - after));
    }
    let n = gains.len() as f64;
    let gain = gains.iter().sum::<f64>() / n;
    let variance = gains.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / (n - 1.0);
    Ok(HeldOut { seconds: gains.len(), gain, gain_std: (variance / n).sqrt() })
}

impl Bundle<'_> {
    /// Losses of seconds that were not fitted, over the scale of the noise, with their poses at their minima.
    fn losses(&mut self, seconds: Vec<Vec<Instant>>) -> Result<Vec<f64>, PoseError> {
        self.instants = seconds;
        (0..self.instants.len()).map(|k| Ok(self.of_second(k)?.loss / self.factor)).collect()
    }
}
