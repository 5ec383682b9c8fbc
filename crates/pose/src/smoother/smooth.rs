//! From measured poses to motion: a smoother whose bandwidth the data choose.
//!
//! What errors of cameras and marker positions do to the poses goes through the same smoother as the poses
//! do, so that it arrives at the rates as their derivative.

use crate::smoother::believed::{Believed, believed};
use crate::smoother::density::Densities;
use crate::smoother::hidden::hidden_gaps;
use crate::smoother::jumps::{Jumps, disturbances};
use crate::smoother::noise::{Likely, NEEDED, check};
use crate::smoother::passes::{EffectsOf, Flown, each_smoothed};
#[cfg(test)]
use crate::smoother::passes::{forward, informed_start};
use crate::smoother::rates::Rates;
use crate::smoother::state::{Joint, MotionNoise};
use crate::smoother::wider::{WiderBy, differing, knowing};
use crate::statistics::median;
use crate::{Motion, MotionSample, PoseError, PoseSample, RateSeries};
use std::ops::Range;

mod agree;

/// Smooths and differentiates the poses of one flight.
///
/// Position and attitude are driven by white jerk and smoothed together (Bryson & Frazier 1963). The spectral
/// density of that jerk and a factor on the measurements' covariances are those of greatest likelihood of the
/// innovations ([`crate::motion_noise`]). For a steady rate of poses and errors that are not correlated the
/// smoother passes 1/(1 + (f/fc)⁶) of a position, with (2π fc)⁶ = q/(r dt). Times may be unevenly spaced.
///
/// Instants without a pose are predicted only. In gaps longer than [`crate::MotionNoise::longest_gap_s`], before the
/// first pose and behind the last the motion is not known; each side of a gap is smoothed by itself. Poses
/// that disagree with all others beyond chance are left out. Where the poses behind a gap contradict the motion before it, or the
/// flight shows a gap's length too seldom, the motion in between is not known ([`crate::Doubts`]).
///
/// # Errors
/// [`PoseError::TooFewPoses`] under 10 poses, or where no part without a longer gap has as many;
/// [`PoseError::TimeNotIncreasing`]; [`PoseError::BadPose`].
pub fn smooth(poses: &[PoseSample], gravity_m_s2: f64) -> Result<Motion, PoseError> {
    smooth_with_effects(poses, &|_| None, gravity_m_s2)
}

/// [`smooth`] of poses whose systematic columns are formed when they are asked for
/// ([`crate::PoseEstimator::systematic_effects`]), which is three times for each, three times more where inputs
/// jumped, and as often where errors are correlated, and not held.
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
    let Believed { poses: flown, anew, found, mut doubts } = believed;
    let (poses, mut samples) = (&*flown, Vec::with_capacity(flown.len()));
    let parts = known_parts(poses, &anew, &found);
    doubts.hidden_ns = hidden_gaps(poses, &parts, found.rates);
    let is_hidden = |t_ns: i64| doubts.hidden_ns.iter().any(|(from, to)| (from + 1..*to).contains(&t_ns));
    let is_known = |k: &usize| parts.iter().any(|part| part.contains(k)) && !is_hidden(poses[*k].t_ns);
    let unknown_ns = (0..poses.len()).filter(|k| !is_known(k)).map(|k| poses[k].t_ns).collect();
    for part in parts.iter().rev().cloned() {
        let part = Part { first: part.start, poses: &poses[part], found: &found, gravity_m_s2 };
        part.smooth_into(&mut samples, effects).map_err(|k| {
            let what = "the smoother's covariance";
            PoseError::BadPose { index: part.first + k, what }
        })?;
    }
    if samples.is_empty() {
        let measured = poses.iter().filter(|p| p.estimate.is_ok()).count();
        return Err(PoseError::TooFewPoses { measured, samples: poses.len(), needed: NEEDED });
    }
    samples.retain(|sample| !is_hidden(sample.t_ns));
    samples.reverse();
    let (translation_bandwidth_hz, rotation_bandwidth_hz) = found.bandwidth_hz;
    let intervals_s = poses.windows(2).map(|w| (w[1].t_ns - w[0].t_ns) as f64 * 1e-9).collect();
    Ok(Motion {
        samples,
        unknown_ns,
        doubts,
        translation_bandwidth_hz,
        rotation_bandwidth_hz,
        sample_interval_s: median(intervals_s).unwrap_or(f64::NAN),
    })
}

/// Calls `take` with each pose's number and the smoothed state there, the last first; an error has the number at which that is
/// none, or has none of its own.
fn each_state(
    flown: &Flown<'_>,
    noise: &MotionNoise,
    mut take: impl FnMut(usize, Joint) -> Option<()>,
) -> Result<(), usize> {
    let mut at = 0;
    let visit = |k: usize, state: Joint, _| {
        at = k;
        take(k, state)
    };
    each_smoothed(flown, noise, visit).ok_or(at)
}

/// A part of a flight that is smoothed by itself.
struct Part<'a> {
    /// Number of its first pose.
    first: usize,
    poses: &'a [PoseSample],
    found: &'a Likely<'a>,
    gravity_m_s2: f64,
}

impl<'a> Part<'a> {
    /// Adds the motion of the part, the last first. An error has the number at which the arithmetic fails.
    fn smooth_into(&self, samples: &mut Vec<MotionSample>, effects: EffectsOf<'_>) -> Result<(), usize> {
        let noise = &self.found.noise;
        let (jumps, claims) = self.disturbed(noise)?;
        let mut flown = Flown::new(self.poses, self.first, effects, self.found.rates);
        let begin = samples.len();
        let take = |k, state| {
            samples.push(claims.sample(k, state)?);
            Some(())
        };
        each_state(&flown, noise, take)?;
        let own = &mut samples[begin..];
        if !jumps.is_empty() {
            flown.jumps = jumps;
            widen(own, &flown, noise, &claims, knowing)?;
        }
        if let Some(if_motion) = &self.found.if_motion {
            let (jumps, claims) = self.disturbed(if_motion)?;
            flown.jumps = jumps;
            widen(own, &flown, if_motion, &claims, differing)?;
        }
        Ok(())
    }

    /// Where a flight of some noise jumps, and what its states claim.
    fn disturbed(&self, noise: &MotionNoise) -> Result<(Jumps, Claims<'a>), usize> {
        let without = Flown::without_effects(self.poses, self.first, self.found.rates);
        let (jumps, densities) = disturbances(&without, noise).ok_or(0_usize)?;
        Ok((jumps, Claims::of(self.poses, self.found, densities, self.gravity_m_s2)))
    }
}

/// Widens the claims of samples, the last first, by their states under another noise or with jumps.
fn widen(
    own: &mut [MotionSample],
    flown: &Flown<'_>,
    noise: &MotionNoise,
    claims: &Claims<'_>,
    by: WiderBy,
) -> Result<(), usize> {
    let last = own.len() - 1;
    let widen = |k: usize, state| {
        let sample = &mut own[last - k];
        sample.covariance = by(sample, &claims.sample(k, state)?);
        sample.is_finite().then_some(())
    };
    each_state(flown, noise, widen)
}

/// What smoothed states of a part of a flight claim beyond its noise.
struct Claims<'a> {
    poses: &'a [PoseSample],
    precisions: Vec<[f64; 2]>,
    found: &'a Likely<'a>,
    densities: Densities,
    gravity_m_s2: f64,
}

impl<'a> Claims<'a> {
    fn of(poses: &'a [PoseSample], found: &'a Likely<'a>, densities: Densities, gravity_m_s2: f64) -> Self {
        Self { poses, precisions: poses.iter().map(own_precisions).collect(), found, densities, gravity_m_s2 }
    }

    /// The motion at a pose.
    fn sample(&self, k: usize, mut state: Joint) -> Option<MotionSample> {
        let Self { poses, found, .. } = self;
        let unseen = own_variances(poses, &self.precisions, k, found.bandwidth_hz);
        let claimed = |mut state: Joint| {
            state.widen_by_unseen(unseen, found.unseen, found.rates.is_some());
            state.sample(poses[k].t_ns, self.gravity_m_s2)
        };
        let of_flight = claimed(state.clone())?.covariance;
        state.scale_cut_off(self.densities.at(k));
        let sample = claimed(state)?;
        Some(MotionSample { covariance: sample.covariance.with_noise_of(&of_flight), ..sample })
    }
}

/// One over the sum of the variances of position and of attitude that are a pose's own; zero without a pose.
fn own_precisions(pose: &PoseSample) -> [f64; 2] {
    let Ok(estimate) = &pose.estimate else { return [0.0; 2] };
    let own = estimate.own_covariance();
    [0, 3].map(|at| 1.0 / own.fixed_view::<3, 3>(at, at).trace())
}

/// The sums of variances that poses have of their own within half a period of what the smoother passes, of
/// position and of attitude: their harmonic mean, as it weighs them. The arithmetic mean is that of the few
/// poses which are known least and hardly weigh at all.
fn own_variances(
    poses: &[PoseSample],
    precisions: &[[f64; 2]],
    k: usize,
    bandwidth_hz: (f64, f64),
) -> [f64; 2] {
    std::array::from_fn(|i| {
        let half_ns = (0.5e9 / if i == 0 { bandwidth_hz.0 } else { bandwidth_hz.1 }) as i64;
        let is_near = |other: &usize| (poses[*other].t_ns - poses[k].t_ns).abs() <= half_ns;
        let near = (0..=k).rev().take_while(is_near).chain((k + 1..poses.len()).take_while(is_near));
        let (sum, count) = near
            .map(|other| precisions[other][i])
            .filter(|precision| *precision > 0.0)
            .fold((0.0, 0.0), |(sum, count), precision| (sum + precision, count + 1.0));
        if sum > 0.0 { count / sum } else { 0.0 }
    })
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

/// Smoothed states of all instants.
#[cfg(test)]
fn smoothed(poses: &[PoseSample], noise: &MotionNoise) -> Option<Vec<Joint>> {
    let mut out = Vec::with_capacity(poses.len());
    let take = |_, state, _| {
        out.push(state);
        Some(())
    };
    each_smoothed(&Flown::new(poses, 0, &|_| None, None), noise, take)?;
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
    steps.iter().zip(poses).map(|(s, p)| s.filtered.sample(p.t_ns, gravity_m_s2).unwrap()).collect()
}

#[cfg(test)]
mod gyroscope_tests;
#[cfg(test)]
pub(crate) mod tests;
