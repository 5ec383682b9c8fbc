//! The noise of a flight, by greatest likelihood.

use crate::smoother::integrator::{JerkNoise, Place};
use crate::smoother::likelihood::{Innovations, Measured, Series, innovations};
use crate::smoother::state::{MotionNoise, PRIOR_ROTATION, PRIOR_TRANSLATION};
use crate::statistics::median;
use crate::{PoseError, PoseSample};
use mavsight_geometry::{Isometry3, Matrix3};

/// Poses needed: three fix the start, and two noise parameters want more than a handful of innovations.
pub(crate) const NEEDED: usize = 10;

/// Steps of the coarse search for the bandwidth; the fine one halves the bracket until it is within a
/// percent.
const COARSE_STEPS: usize = 16;

/// Least factor on covariances that nobody vouches for: a record without any scatter would claim no noise at
/// all.
const LEAST_FACTOR: f64 = 1e-4;

/// Twice the logarithm of the likelihood that two more parameters must gain: the 99.9 % quantile of
/// chi-square with two degrees of freedom.
const TWO_MORE: f64 = 13.816;

const SIGNIFICANT: f64 = 3.09;

/// Noise and the bandwidths that it implies, in Hz: of position, of attitude.
pub(crate) struct Likely {
    pub(crate) noise: MotionNoise,
    pub(crate) bandwidth_hz: (f64, f64),
}

/// The noise under which the poses of a flight are most likely: strength of the jerk and size of the
/// measurements' errors, for position and attitude apart, and where neighbouring innovations are correlated,
/// the part of those errors that is correlated and for how long.
///
/// # Errors
/// [`PoseError::TooFewPoses`] under 10 poses; [`PoseError::TimeNotIncreasing`]; [`PoseError::BadPose`].
pub fn motion_noise(poses: &[PoseSample]) -> Result<MotionNoise, PoseError> {
    check(poses)?;
    likely(poses).map(|l| l.noise)
}

pub(crate) fn check(poses: &[PoseSample]) -> Result<(), PoseError> {
    let measured = poses.iter().filter(|p| p.estimate.is_ok()).count();
    if measured < NEEDED {
        return Err(PoseError::TooFewPoses { measured, samples: poses.len(), needed: NEEDED });
    }
    for (index, pair) in poses.windows(2).enumerate() {
        if pair[1].t_ns <= pair[0].t_ns {
            let t_s = pair[1].t_ns as f64 * 1e-9;
            return Err(PoseError::TimeNotIncreasing { index: index + 1, t_s });
        }
    }
    poses.iter().enumerate().try_for_each(|(index, pose)| crate::smoother::causal::check_pose(index, pose))
}

pub(crate) fn likely(poses: &[PoseSample]) -> Result<Likely, PoseError> {
    let failed = PoseError::BadPose { index: 0, what: "the likelihood of the noise" };
    let first = poses.iter().position(|p| p.estimate.is_ok()).ok_or(failed.clone())?;
    let poses = &poses[first..];
    let origin_ns = poses[0].t_ns;
    let t_s: Vec<f64> = poses.iter().map(|p| (p.t_ns - origin_ns) as f64 * 1e-9).collect();
    // A table without the systematic errors has covariances whose size nobody vouches for.
    let vouched = poses.iter().filter_map(|p| p.estimate.as_ref().ok()).any(|e| e.systematic_columns() > 0);
    // One after the other, so that only one of the two series is held.
    let positions: Vec<_> = poses.iter().map(|p| measured(p, 0, |pose| pose.translation.vector)).collect();
    let series = Series { t_s: &t_s, measured: &positions, prior_std: PRIOR_TRANSLATION };
    let (translation, first_hz) = most_likely(&series, vouched).ok_or(failed.clone())?;
    drop(positions);
    let attitudes: Vec<_> = poses.iter().map(|p| measured(p, 3, |pose| pose.rotation)).collect();
    let series = Series { t_s: &t_s, measured: &attitudes, prior_std: PRIOR_ROTATION };
    let (rotation, second_hz) = most_likely(&series, vouched).ok_or(failed)?;
    Ok(Likely { noise: MotionNoise { translation, rotation }, bandwidth_hz: (first_hz, second_hz) })
}

fn measured<P>(pose: &PoseSample, at: usize, place: impl Fn(&Isometry3<f64>) -> P) -> Option<Measured<P>> {
    pose.estimate.as_ref().ok().map(|e| Measured {
        place: place(&e.world_from_body),
        covariance: e.own_covariance().fixed_view::<3, 3>(at, at).into_owned(),
    })
}

/// What the search moves: logarithms of the bandwidth in Hz, of the correlated part's variance over the new
/// part's, and of its time constant in s.
type Parameters = [f64; 3];

struct Search<'a, P> {
    series: &'a Series<'a, P>,
    interval_s: f64,
    duration_s: f64,
    variance: f64,
    covariance: Matrix3<f64>,
}

/// Noise of greatest likelihood, and the bandwidth, sought from one cycle in twice the flight to the Nyquist
/// frequency. The factor on the covariances is the mean square of the normalised innovations.
///
/// Innovations significantly below covariances that are vouched for show errors that move too slowly to be
/// distinguished from motion. The factor is then one: the estimate is the same, its covariance is not.
fn most_likely<P: Place>(series: &Series<'_, P>, vouched: bool) -> Option<(JerkNoise, f64)> {
    let times: Vec<f64> =
        series.t_s.iter().zip(series.measured).filter(|(_, m)| m.is_some()).map(|(t, _)| *t).collect();
    let count = times.len() as f64;
    let search = Search {
        series,
        interval_s: median(times.windows(2).map(|w| w[1] - w[0]).collect()),
        duration_s: times.last()? - times.first()?,
        variance: median(series.measured.iter().flatten().map(|m| m.covariance.trace() / 3.0).collect()),
        covariance: series.measured.iter().flatten().map(|m| m.covariance / count).sum(),
    };
    let white = |log_hz: f64| [log_hz, f64::NEG_INFINITY, 0.0];
    let (low, high) = ((0.5 / search.duration_s).ln(), (0.5 / search.interval_s).ln());
    let mut best = white(least(|x| search.cost(&white(x)), low, high, COARSE_STEPS));
    let sums = search.run(&best).filter(|s| s.count > 0)?;
    if sums.correlation() > SIGNIFICANT / (sums.count as f64).sqrt() {
        let coloured = search.coloured(best[0], (low, high));
        if search.cost(&coloured) + TWO_MORE < search.cost(&best) {
            best = coloured;
        }
    }
    let sums = search.run(&best).filter(|s| s.count > 0)?;
    let shown = (sums.chi_square / sums.count as f64).max(LEAST_FACTOR);
    let slow = vouched && shown < 1.0 - SIGNIFICANT * (2.0 / sums.count as f64).sqrt();
    let factor = if slow { 1.0 } else { shown };
    let unit = search.noise(&best);
    let noise = JerkNoise {
        intensity: unit.intensity * factor,
        variance_factor: factor,
        correlated: unit.correlated * factor,
        ..unit
    };
    Some((noise, best[0].exp()))
}

impl<P: Place> Search<'_, P> {
    /// Noise with a factor of one on the covariances.
    fn noise(&self, at: &Parameters) -> JerkNoise {
        let angular = 2.0 * std::f64::consts::PI * at[0].exp();
        JerkNoise {
            intensity: angular.powi(6) * self.variance * self.interval_s,
            variance_factor: 1.0,
            correlated: self.covariance * at[1].exp(),
            correlated_s: at[2].exp(),
        }
    }

    fn run(&self, at: &Parameters) -> Option<Innovations> {
        innovations(self.series, &self.noise(at))
    }

    /// Minus twice the logarithm of the likelihood, with the best factor, but for a constant.
    fn cost(&self, at: &Parameters) -> f64 {
        self.run(at).filter(|s| s.count > 0).map_or(f64::INFINITY, |s| {
            s.log_det + s.count as f64 * (s.chi_square / s.count as f64).max(f64::MIN_POSITIVE).ln()
        })
    }

    /// The best noise with a correlated part, one parameter after the other: variance ratios from a hundredth
    /// to a hundred, time constants from one interval to a fifth of the flight.
    fn coloured(&self, log_hz: f64, bandwidths: (f64, f64)) -> Parameters {
        let mut best = [log_hz, 0.0, (4.0 * self.interval_s).ln()];
        let ranges = [
            bandwidths,
            (0.01_f64.ln(), 100_f64.ln()),
            (self.interval_s.ln(), (0.2 * self.duration_s).max(2.0 * self.interval_s).ln()),
        ];
        let mut cost = f64::INFINITY;
        for _ in 0..6 {
            for k in [1, 0, 2] {
                let at = |x: f64| {
                    let mut tried = best;
                    tried[k] = x;
                    self.cost(&tried)
                };
                best[k] = least(at, ranges[k].0, ranges[k].1, COARSE_STEPS / 2);
            }
            let now = self.cost(&best);
            if cost - now < 0.1 {
                break;
            }
            cost = now;
        }
        best
    }
}

/// The least of a function of one variable: a grid, then golden sections of the bracket around its best
/// point.
fn least(cost: impl Fn(f64) -> f64, low: f64, high: f64, steps: usize) -> f64 {
    let step = (high - low) / steps as f64;
    let mut best = (low, f64::INFINITY);
    for k in 0..=steps {
        let x = low + step * k as f64;
        let c = cost(x);
        if c < best.1 {
            best = (x, c);
        }
    }
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    let (mut a, mut b) = ((best.0 - step).max(low), (best.0 + step).min(high));
    let (mut x, mut y) = (b - golden * (b - a), a + golden * (b - a));
    let (mut at_x, mut at_y) = (cost(x), cost(y));
    while b - a > 0.01 {
        if at_x < at_y {
            (b, y, at_y) = (y, x, at_x);
            x = b - golden * (b - a);
            at_x = cost(x);
        } else {
            (a, x, at_x) = (x, y, at_y);
            y = a + golden * (b - a);
            at_y = cost(y);
        }
    }
    0.5 * (a + b)
}
