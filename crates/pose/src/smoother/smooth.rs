//! From measured poses to motion: a smoother whose bandwidth the data choose.
//!
//! What errors of cameras and marker positions do to the poses goes through the same smoother as the poses
//! do, so that it arrives at the rates as their derivative.

use crate::smoother::believed::{Believed, believed};
use crate::smoother::integrator::{CHAIN, Transition};
use crate::smoother::noise::{Likely, NEEDED, check};
use crate::smoother::rates::Rates;
use crate::smoother::state::{Adjoint, Joint, MotionNoise, Update};
use crate::statistics::median;
use crate::{Motion, PoseError, PoseEstimate, PoseSample, RateSeries};
use mavsight_geometry::Matrix6;
use nalgebra::Matrix6xX;
use std::borrow::Cow;
use std::ops::Range;

mod agree;

/// Smooths and differentiates the poses of one flight.
///
/// Position and attitude are driven by white jerk and smoothed together (Bryson & Frazier 1963). The spectral
/// density of that jerk and a factor on the measurements' covariances are those of greatest likelihood of the
/// innovations ([`crate::motion_noise`]). For a steady rate of poses and errors that are not correlated the
/// smoother passes 1/(1 + (f/fc)⁶) of a position, with (2π fc)⁶ = q/(r dt). Times may be unevenly spaced.
///
/// Instants without a pose are predicted only. In gaps longer than [`MotionNoise::longest_gap_s`], before the
/// first pose and behind the last the motion is not known; each side of a gap is smoothed by itself. Poses
/// that disagree with all others beyond chance are left out, and where the poses behind a gap contradict the
/// motion before it, the motion in between is not known ([`crate::Doubts`]).
///
/// # Errors
/// [`PoseError::TooFewPoses`] under 10 poses, or where no part without a longer gap has as many;
/// [`PoseError::TimeNotIncreasing`]; [`PoseError::BadPose`].
pub fn smooth(poses: &[PoseSample], gravity_m_s2: f64) -> Result<Motion, PoseError> {
    smooth_with_effects(poses, &|_| None, gravity_m_s2)
}

/// Systematic columns of a pose by its index; none: those that it holds.
pub type EffectsOf<'a> = &'a dyn Fn(usize) -> Option<Matrix6xX<f64>>;

/// [`smooth`] of poses whose systematic columns are formed when they are asked for
/// ([`crate::PoseEstimator::systematic_effects`]), which is three times for each, and not held.
///
/// # Errors
/// Those of [`smooth`].
pub fn smooth_with_effects(
    poses: &[PoseSample],
    effects: EffectsOf<'_>,
    gravity_m_s2: f64,
) -> Result<Motion, PoseError> {
    check(poses)?;
    motion_of(believed(poses, None)?, effects, gravity_m_s2)
}

/// [`smooth_with_effects`] with the rates of a gyroscope as further measurements: attitude and rates then follow it between
/// poses, and through gaps between poses of up to a second.
///
/// What is new in each of its samples, and the density of the jerk of the attitude, are those of greatest likelihood of the
/// innovations of its rates. What is uncertain of all rates alike passes through the smoother as systematic errors of poses do.
/// Rates under which the poses are less likely than without them (each by what comes before it; Dawid 1984) are refused.
///
/// # Errors
/// Those of [`smooth`]; [`crate::RatesRefusal`].
pub fn smooth_with_rates(
    poses: &[PoseSample],
    effects: EffectsOf<'_>,
    rates: &RateSeries,
    gravity_m_s2: f64,
) -> Result<Motion, PoseError> {
    check(poses)?;
    let span_ns = (poses[0].t_ns, poses[poses.len() - 1].t_ns);
    let rates = Rates::of(rates, span_ns)?;
    agree::require(poses, &rates)?;
    motion_of(believed(poses, Some(&rates))?, effects, gravity_m_s2)
}

fn motion_of(believed: Believed<'_>, effects: EffectsOf<'_>, gravity_m_s2: f64) -> Result<Motion, PoseError> {
    if !gravity_m_s2.is_finite() {
        return Err(PoseError::BadPose { index: 0, what: "gravity" });
    }
    let Believed { poses: flown, anew, found, doubts } = believed;
    let (poses, mut samples) = (&*flown, Vec::with_capacity(flown.len()));
    let parts = known_parts(poses, &anew, &found);
    let is_known = |k: &usize| parts.iter().any(|part| part.contains(k));
    let unknown_ns = (0..poses.len()).filter(|k| !is_known(k)).map(|k| poses[k].t_ns).collect();
    for part in parts.iter().rev().cloned() {
        let (first, flown) = (part.start, &poses[part]);
        let flown = Flown::new(flown, first, effects, found.rates);
        let failed = PoseError::BadPose { index: first, what: "the smoother's covariance" };
        let own = mean_own_covariance(flown.poses);
        let visit = |k: usize, mut s: Joint, _: Option<Checked>| {
            s.widen_by_unseen(&own, found.unseen, found.rates.is_some());
            samples.push(s.sample(poses[first + k].t_ns, gravity_m_s2));
        };
        each_smoothed(&flown, &found.noise, visit).ok_or(failed)?;
    }
    if samples.is_empty() {
        let measured = poses.iter().filter(|p| p.estimate.is_ok()).count();
        return Err(PoseError::TooFewPoses { measured, samples: poses.len(), needed: NEEDED });
    }
    samples.reverse();
    let (translation_bandwidth_hz, rotation_bandwidth_hz) = found.bandwidth_hz;
    let sample_interval_s = median(poses.windows(2).map(|w| (w[1].t_ns - w[0].t_ns) as f64 * 1e-9).collect());
    Ok(Motion {
        samples,
        unknown_ns,
        doubts,
        translation_bandwidth_hz,
        rotation_bandwidth_hz,
        sample_interval_s,
    })
}

fn mean_own_covariance(poses: &[PoseSample]) -> Matrix6<f64> {
    let count = poses.iter().filter(|p| p.estimate.is_ok()).count().max(1) as f64;
    poses.iter().filter_map(|p| p.estimate.as_ref().ok()).map(|e| e.own_covariance() / count).sum()
}

/// The instants whose motion is known, in parts without a longer gap in which it does not begin anew, each
/// from a pose to a pose. Rates bridge gaps.
pub(crate) fn known_parts(poses: &[PoseSample], anew: &[usize], found: &Likely<'_>) -> Vec<Range<usize>> {
    let longest_ns = (found.noise.longest_gap_s() * 1e9).min(i64::MAX as f64) as i64;
    let is_crossed = |from_ns: i64, to_ns: i64| {
        to_ns - from_ns <= longest_ns || found.rates.is_some_and(|r| r.bridge(from_ns, to_ns, longest_ns))
    };
    let measured: Vec<usize> = (0..poses.len()).filter(|k| poses[*k].estimate.is_ok()).collect();
    measured
        .chunk_by(|a, b| is_crossed(poses[*a].t_ns, poses[*b].t_ns) && !anew.contains(b))
        .filter(|part| part.len() >= NEEDED)
        .map(|part| part[0]..part[part.len() - 1] + 1)
        .collect()
}

/// What happens at a time: an instant of the poses, measured or not, or a mean of rates, by their numbers.
#[derive(Debug, Clone, Copy)]
enum Instant {
    Pose(usize),
    Rates(usize),
}

/// Poses with their systematic columns, formed as they are asked for, and the rates between them.
pub(crate) struct Flown<'a> {
    poses: &'a [PoseSample],
    /// Index of the first of the poses among all.
    first: usize,
    effects: EffectsOf<'a>,
    rates: Option<&'a Rates>,
    /// In order, from the first pose to the last.
    instants: Vec<Instant>,
    /// Systematic columns of the pose that has most; those of the rates follow.
    pose_columns: usize,
    rate_columns: usize,
}

impl<'a> Flown<'a> {
    pub(crate) fn new(
        poses: &'a [PoseSample],
        first: usize,
        effects: EffectsOf<'a>,
        rates: Option<&'a Rates>,
    ) -> Self {
        let rate_columns = rates.map_or(0, Rates::columns);
        let mut flown =
            Self { poses, first, effects, rates, instants: Vec::new(), pose_columns: 0, rate_columns };
        flown.pose_columns = flown.columns();
        for (k, pose) in poses.iter().enumerate() {
            flown.instants.push(Instant::Pose(k));
            let (Some(rates), Some(next)) = (rates, poses.get(k + 1)) else { continue };
            flown.instants.extend(rates.between(pose.t_ns, next.t_ns - 1).map(Instant::Rates));
        }
        flown
    }

    /// With systematic errors of the rates alone, whatever the poses hold.
    fn with_errors_of_rates(poses: &'a [PoseSample], first: usize, rates: Option<&'a Rates>) -> Self {
        Self { pose_columns: 0, ..Self::new(poses, first, &|_| Some(Matrix6xX::zeros(0)), rates) }
    }

    /// Without systematic errors, which do not change how poses agree.
    pub(crate) fn without_effects(poses: &'a [PoseSample], first: usize, rates: Option<&'a Rates>) -> Self {
        Self { rate_columns: 0, ..Self::with_errors_of_rates(poses, first, rates) }
    }

    fn t_ns(&self, instant: Instant) -> i64 {
        match (instant, self.rates) {
            (Instant::Rates(j), Some(rates)) => rates.mean(j).t_ns,
            (Instant::Pose(k) | Instant::Rates(k), _) => self.poses[k].t_ns,
        }
    }

    /// Updates a state by what is measured at an instant.
    fn update(&self, instant: Instant, state: &mut Joint, noise: &MotionNoise) -> Option<Updates> {
        let mut done = Updates::default();
        match (instant, self.rates) {
            (Instant::Rates(j), Some(rates)) => {
                let mut blank = state.blank_update();
                state.update_by_rates(rates, rates.mean(j), self.pose_columns, &mut blank)?;
                done.rates = Some(blank);
            }
            (Instant::Pose(k) | Instant::Rates(k), _) => {
                if let Some(seen) = self.estimate(k) {
                    let mut blank = state.blank_update();
                    state.update(&seen, noise, &mut blank)?;
                    done.pose = Some(blank);
                }
            }
        }
        Some(done)
    }

    fn estimate(&self, k: usize) -> Option<Cow<'a, PoseEstimate>> {
        let estimate = self.poses[k].estimate.as_ref().ok()?;
        Some(match (self.effects)(self.first + k) {
            Some(columns) => Cow::Owned(estimate.clone().with_rounded(&columns)),
            None => Cow::Borrowed(estimate),
        })
    }

    /// Systematic columns of the pose that has most.
    fn columns(&self) -> usize {
        let formed =
            (0..self.poses.len()).find_map(|k| self.estimate(k)).map_or(0, |e| e.systematic_columns());
        let held = self.poses.iter().filter_map(|p| Some(p.estimate.as_ref().ok()?.systematic_columns()));
        held.fold(formed, usize::max)
    }
}

/// What was measured at an instant.
#[derive(Default)]
struct Updates {
    pose: Option<Update>,
    rates: Option<Update<3>>,
}

/// What the forward pass leaves at an instant.
struct Step {
    filtered: Joint,
    transitions: Option<[Transition; 2]>,
    updates: Updates,
}

/// Share of the whole record's information that the smoother's start carries: little enough not to count,
/// enough that the backward pass does not cancel a diffuse covariance digit by digit.
const START_SHARE: f64 = 1e-4;

/// The state at the first time as the whole record, filtered backwards, gives it, with a covariance that
/// makes it next to worthless; the first steps of an attitude are linearised there.
fn informed_start(flown: &Flown<'_>, noise: &MotionNoise) -> Option<Joint> {
    let last = flown.poses.iter().rposition(|p| p.estimate.is_ok())?;
    let columns = flown.pose_columns + flown.rate_columns;
    let mut state = Joint::start(flown.estimate(last)?.as_ref(), columns, noise);
    let mut after_ns = flown.poses[last].t_ns;
    for instant in
        flown.instants.iter().rev().skip_while(|i| !matches!(i, Instant::Pose(k) if *k == last)).skip(1)
    {
        let t_ns = flown.t_ns(*instant);
        state.predict((t_ns - after_ns) as f64 * 1e-9, noise);
        flown.update(*instant, &mut state, noise)?;
        after_ns = t_ns;
    }
    state.covariance /= START_SHARE;
    // Its variance is known beforehand: what is not known of the motion must not be sought in it.
    state.forget_correlated(noise);
    Some(state)
}

/// The filter over some instants, from the state before them; the first of all is measured.
fn forward(
    flown: &Flown<'_>,
    instants: Range<usize>,
    noise: &MotionNoise,
    state: &mut Joint,
) -> Option<Vec<Step>> {
    let t_ns = |k: usize| flown.t_ns(flown.instants[k]);
    let mut steps = Vec::with_capacity(instants.len());
    for k in instants {
        let dt_s = k.checked_sub(1).map(|before| (t_ns(k) - t_ns(before)) as f64 * 1e-9);
        let transitions = dt_s.map(|dt_s| state.predict(dt_s, noise));
        let updates = flown.update(flown.instants[k], state, noise)?;
        steps.push(Step { filtered: state.clone(), transitions, updates });
    }
    Some(steps)
}

/// What a pose is next to the others, each chi-square with six degrees of freedom.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Checked {
    /// Its innovation.
    pub(crate) innovation: f64,
    /// Its difference from what all others say of it.
    pub(crate) disagreement: f64,
}

/// Calls `visit` with each pose's number, the smoothed state there and how the pose agrees, the last first; the first of the
/// instants is a measured pose. Only one
/// stretch of √n steps is held at a time: each is filtered once more when the backward pass comes to it
/// (checkpoints, Griewank 1992).
pub(crate) fn each_smoothed(
    flown: &Flown<'_>,
    noise: &MotionNoise,
    mut visit: impl FnMut(usize, Joint, Option<Checked>),
) -> Option<()> {
    let count = flown.instants.len();
    let stretch = ((count as f64).sqrt() as usize).max(64);
    let instants = |part: usize| part * stretch..((part + 1) * stretch).min(count);
    let mut state = informed_start(flown, noise)?;
    let mut starts = Vec::new();
    for part in 0..count.div_ceil(stretch) {
        starts.push(state.clone());
        forward(flown, instants(part), noise, &mut state)?;
    }
    let mut adjoint = Adjoint::nothing(state.effects.ncols());
    for (part, start) in starts.iter().enumerate().rev() {
        let steps = forward(flown, instants(part), noise, &mut start.clone())?;
        for (k, step) in instants(part).zip(&steps).rev() {
            if let Instant::Pose(k) = flown.instants[k] {
                let smoothed = adjoint.smoothed(&step.filtered);
                is_sound(&smoothed).then_some(())?;
                let mut checked = None;
                if let Some(update) = &step.updates.pose {
                    let (innovation, disagreement) = (update.chi_square(), adjoint.disagreement(update)?);
                    checked = Some(Checked { innovation, disagreement });
                    adjoint.before_update(update);
                }
                visit(k, smoothed, checked);
            }
            if let Some(update) = &step.updates.rates {
                adjoint.before_rates(update);
            }
            if let Some(transitions) = &step.transitions {
                adjoint.before_predict(transitions);
            }
        }
    }
    Some(())
}

fn is_sound(state: &Joint) -> bool {
    let mut known = (0..9).chain(CHAIN..CHAIN + 9);
    state.covariance.iter().all(|v| v.is_finite()) && known.all(|i| state.covariance[(i, i)] > 0.0)
}

/// Smoothed states of all instants.
#[cfg(test)]
fn smoothed(poses: &[PoseSample], noise: &MotionNoise) -> Option<Vec<Joint>> {
    let mut out = Vec::with_capacity(poses.len());
    each_smoothed(&Flown::new(poses, 0, &|_| None, None), noise, |_, state, _| out.push(state))?;
    out.reverse();
    Some(out)
}

/// The states of the forward pass, as samples.
#[cfg(test)]
pub(crate) fn forward_samples(
    poses: &[PoseSample],
    noise: &MotionNoise,
    gravity_m_s2: f64,
) -> Vec<crate::MotionSample> {
    let flown = Flown::new(poses, 0, &|_| None, None);
    let mut start = informed_start(&flown, noise).unwrap();
    let steps = forward(&flown, 0..poses.len(), noise, &mut start).unwrap();
    steps.iter().zip(poses).map(|(s, p)| s.filtered.sample(p.t_ns, gravity_m_s2)).collect()
}

#[cfg(test)]
mod gyroscope_tests;
#[cfg(test)]
pub(crate) mod tests;
