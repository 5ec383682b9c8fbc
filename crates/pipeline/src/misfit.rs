//! What explains that the cameras' observations fit no pose of the body: every alternative is tried, and one is
//! named where all others lose.

mod clocks;
mod decoys;
mod exchanges;
mod moved;
mod moving_decoys;
mod sample;
mod scale;
#[cfg(test)]
mod tests;

pub(crate) use clocks::ClockEvidence;
pub(crate) use moving_decoys::{MovingDecoy, MovingDecoys};
pub(crate) use sample::ObservationSample;

use crate::{Cause, Finding, PipelineError};
use mavsight_pose::{MarkerObservation, PoseEstimator, ReprojectionFit, Rig};

/// Observations that lie so many standard deviations from where any pose has them do not fit: the stated
/// covariance explains 4 % of their variance.
const FITS: f64 = 5.0;

/// From here on alternatives are tried: the stated covariance explains a quarter of the variance, and of the
/// median over tens of instants no chance does that.
const SUSPECT: f64 = 2.0;

/// What is taken for a cause has to bring the residuals down to this part: over hundreds of degrees of
/// freedom no chance does.
const EXPLAINS: f64 = 1.0 / 3.0;

/// Alternatives whose residuals are within this factor explain them alike.
const ALIKE: f64 = 1.5;

/// What is known of a flight whose observations may not fit.
pub(crate) struct Evidence<'a> {
    estimator: &'a PoseEstimator,
    rig: &'a Rig,
    /// Of some instants, what is identified without a pose.
    instants: Vec<Vec<MarkerObservation>>,
    clocks: Option<ClockEvidence>,
}

/// A cause, and what would remain without it.
#[derive(Debug, Clone)]
struct Alternative {
    cause: Cause,
    camera: Option<usize>,
    fit: ReprojectionFit,
    /// What was done, and what to do; after "it lies so many pixels from there".
    words: String,
}

/// Findings on the observations of a flight, none where they fit; an error where recordings exchanged,
/// mirrored or turned upside down explain why they do not.
pub(crate) fn findings(
    estimator: &PoseEstimator,
    rig: &Rig,
    sample: &ObservationSample,
    clocks: Option<ClockEvidence>,
) -> Result<Vec<Finding>, PipelineError> {
    if let Some(associated) = sample.associated() {
        let instants = sample::sampled(associated);
        if median_fit(estimator, &instants)?.is_some_and(|fit| fit.ratio <= SUSPECT) {
            // Balls that the association has left aside are others'.
            let evidence = Evidence { estimator, rig, instants, clocks: None };
            return Ok(evidence.not_upright()?.into_iter().collect());
        }
    }
    of_observations(estimator, rig, sample.lone(), clocks)
}

/// [`findings`] of observations that are identified.
pub(crate) fn of_observations(
    estimator: &PoseEstimator,
    rig: &Rig,
    observations: &mavsight_pose::Observations,
    clocks: Option<ClockEvidence>,
) -> Result<Vec<Finding>, PipelineError> {
    let mut instants = sample::sampled(observations);
    // One camera's fit says little of the others.
    if instants.iter().any(|seen| is_by_two(seen)) {
        instants.retain(|seen| is_by_two(seen));
    }
    let evidence = Evidence { estimator, rig, instants, clocks };
    let Some(given) = evidence.median_fit(&evidence.instants)? else { return Ok(vec![]) };
    if given.ratio <= SUSPECT {
        return Ok(evidence.not_upright()?.into_iter().collect());
    }
    let explains = |a: &Alternative| a.fit.ratio <= FITS && a.fit.ratio <= EXPLAINS * given.ratio;
    let mut found = evidence.exchanged_recordings()?;
    found.extend(evidence.exchanged_colors()?);
    found.retain(explains);
    // What has nothing to adjust and explains all the same needs no rival that can be adjusted.
    if found.is_empty() {
        found.extend(evidence.another_scale()?);
        found.extend(evidence.other_clocks(explains)?);
        found.extend(evidence.exchanged_recordings_by_other_clocks()?);
        found.extend(evidence.moved_cameras()?);
        found.retain(explains);
    }
    let best = found.iter().map(|a| a.fit.ratio).fold(f64::INFINITY, f64::min);
    found.retain(|a| a.fit.ratio <= ALIKE * best);
    conclude(&given, found, || evidence.tried())
}

/// What is made of the alternatives that explain the residuals best.
fn conclude(
    given: &ReprojectionFit,
    found: Vec<Alternative>,
    tried: impl Fn() -> String,
) -> Result<Vec<Finding>, PipelineError> {
    let (given_px, ratio) = (given.residual_px, given.ratio);
    let lies = if given_px.is_finite() { format!("lies {given_px:.2} px from") } else { "is not".to_owned() };
    let mut causes: Vec<Cause> = found.iter().map(|a| a.cause).collect();
    causes.sort_unstable();
    causes.dedup();
    let Some(first) = found.first() else {
        let note = || {
            format!(
                "What the cameras saw {lies} where any pose of the body has it, {ratio:.0} times what their noise explains. {}.",
                tried()
            )
        };
        let is_worth_it = ratio.is_finite() && ratio > FITS;
        return Ok(is_worth_it.then(|| Finding { causes, camera: None, note: note() }).into_iter().collect());
    };
    let words: Vec<&str> = found.iter().map(|a| a.words.as_str()).collect();
    let instead_px = first.fit.residual_px;
    if causes.iter().all(|c| matches!(c, Cause::CamerasExchanged | Cause::ImageTurned)) {
        let mistake = words.join("; or ");
        return Err(PipelineError::MixedUp { causes, given: lies, instead_px, mistake });
    }
    let camera = first.camera.filter(|_| found.iter().all(|a| a.camera == first.camera));
    let alike = if found.len() > 1 { " Which of these it is, this flight does not show." } else { "" };
    let note = format!(
        "What the cameras saw {lies} where any pose of the body has it, and lies {instead_px:.2} px from it {}.{alike}",
        words.join("; or ")
    );
    Ok(vec![Finding { causes, camera, note }])
}

/// Whether two cameras see two balls or more each.
fn is_by_two(seen: &[MarkerObservation]) -> bool {
    let count = |camera: usize| seen.iter().filter(|o| o.camera == camera).count();
    let of_one = seen.iter().map(|o| o.camera).find(|camera| count(*camera) > 1);
    of_one.is_some_and(|one| seen.iter().any(|o| o.camera != one && count(o.camera) > 1))
}

impl Evidence<'_> {
    /// What was tried, in words, where nothing of it explains the residuals.
    fn tried(&self) -> String {
        let clocks = if self.clocks.is_some() { "other clocks and frame rates, " } else { "" };
        format!(
            "{}, another scale of the body, {clocks}and one camera elsewhere were tried, and none brings them together: check the \
             marker positions of the vehicle file ([refine] finds those of a ruler) and calibrate again",
            self.exchanges_tried()
        )
    }

    fn median_fit(
        &self,
        instants: &[Vec<MarkerObservation>],
    ) -> Result<Option<ReprojectionFit>, PipelineError> {
        median_fit(self.estimator, instants)
    }
}

/// That of the instant in the middle, by standard deviations; `None` where no instant has enough
/// observations.
fn median_fit(
    estimator: &PoseEstimator,
    instants: &[Vec<MarkerObservation>],
) -> Result<Option<ReprojectionFit>, PipelineError> {
    let mut fits = Vec::new();
    for seen in instants {
        let fit = estimator.reprojection_fit(seen);
        fits.extend(fit.map_err(|source| PipelineError::Pose { place: "centres".into(), source })?);
    }
    fits.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    Ok(fits.get(fits.len() / 2).copied())
}
