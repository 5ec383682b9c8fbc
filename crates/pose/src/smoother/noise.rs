//! The noise of a flight, by greatest likelihood.

use crate::smoother::integrator::{
    CHAIN, CORRELATED, Integrator, JerkNoise, Place, add_process_noise, start_covariance,
};
use crate::smoother::rates::Rates;
use crate::smoother::state::{MotionNoise, PRIOR_ROTATION, PRIOR_TRANSLATION};
use crate::statistics::median;
use crate::{PoseError, PoseEstimate, PoseSample};
use mavsight_geometry::{Isometry3, Matrix3, Vector3};

/// Poses needed: three fix the start, and two noise parameters want more than a handful of innovations.
pub(crate) const NEEDED: usize = 10;

/// Steps of the coarse search for the bandwidth.
pub(crate) const COARSE_STEPS: usize = 16;

/// Least factor on covariances that nobody vouches for: a record may have no scatter at all.
const LEAST_FACTOR: f64 = 1e-4;

/// Twice the log likelihood that two more parameters must gain: the 99.9 % quantile of chi-square.
const TWO_MORE: f64 = 13.816;

/// Standard deviations that a standard normal variable exceeds by chance once in a thousand times.
const SIGNIFICANT: f64 = 3.09;

/// Noise and the bandwidths that it implies, in Hz: of position, of attitude.
pub(crate) struct Likely<'a> {
    pub(crate) noise: MotionNoise,
    /// Where that has correlated errors the noise without: that of a flight in which they are motion.
    pub(crate) if_motion: Option<MotionNoise>,
    pub(crate) bandwidth_hz: (f64, f64),
    /// Share of the stated covariances, of position and of attitude, that the innovations do not show.
    pub(crate) unseen: [f64; 2],
    /// What is measured beside the poses.
    pub(crate) rates: Option<&'a Rates>,
}

impl<'a> Likely<'a> {
    /// With rates, whose innovations show the jerk of the attitude at frequencies that poses do not.
    pub(crate) fn with_rates(mut self, rates: Option<&'a Rates>) -> Self {
        self.rates = rates;
        if let Some(rates) = rates {
            let noises = std::iter::once(&mut self.noise).chain(&mut self.if_motion);
            noises.for_each(|noise| noise.rotation.intensity = rates.intensity);
            self.bandwidth_hz.1 = rates.bandwidth_hz;
        }
        self
    }
}

/// The noise under which the poses of a flight are most likely: strength of the jerk and size of the
/// measurements' errors, for position and attitude apart, and where neighbouring innovations are correlated,
/// the part of those errors that is correlated and for how long.
///
/// # Errors
/// [`PoseError::TooFewPoses`] under 10 poses; [`PoseError::TimeNotIncreasing`]; [`PoseError::BadPose`].
pub fn motion_noise(poses: &[PoseSample]) -> Result<MotionNoise, PoseError> {
    check(poses)?;
    Ok(crate::smoother::believed::believed(poses, None)?.found.noise)
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

/// The noise of poses between which the motion begins anew at some, by their indices.
pub(crate) fn likely(poses: &[PoseSample], anew: &[usize]) -> Result<Likely<'static>, PoseError> {
    let failed = PoseError::BadPose { index: 0, what: "the likelihood of the noise" };
    let first = poses.iter().position(|p| p.estimate.is_ok()).ok_or(failed.clone())?;
    let poses = &poses[first..];
    let anew: Vec<usize> = anew.iter().filter_map(|k| k.checked_sub(first)).collect();
    // A table without the systematic errors has covariances whose size nobody vouches for.
    let vouched = poses.iter().filter_map(|p| p.estimate.as_ref().ok()).any(|e| e.systematic_columns() > 0);
    let series = Series::of(poses, &anew, PRIOR_TRANSLATION, 0, |pose| pose.translation.vector);
    let place = most_likely(&series, vouched).ok_or(failed.clone())?;
    let series = Series::of(poses, &anew, PRIOR_ROTATION, 3, |pose| pose.rotation);
    let attitude = most_likely(&series, vouched).ok_or(failed)?;
    let is_coloured = place.white.is_some() || attitude.white.is_some();
    let if_motion = MotionNoise {
        translation: place.white.unwrap_or(place.noise),
        rotation: attitude.white.unwrap_or(attitude.noise),
    };
    Ok(Likely {
        noise: MotionNoise { translation: place.noise, rotation: attitude.noise },
        if_motion: is_coloured.then_some(if_motion),
        bandwidth_hz: (place.bandwidth_hz, attitude.bandwidth_hz),
        unseen: [place.unseen, attitude.unseen],
        rates: None,
    })
}

/// What the search moves: logarithms of the bandwidth in Hz, of the correlated part's variance over the new
/// part's, and of its time constant in s.
type Parameters = [f64; 3];

/// The noise of position or of attitude.
struct MostLikely {
    noise: JerkNoise,
    /// The best without a correlated part of the errors, where that has one.
    white: Option<JerkNoise>,
    bandwidth_hz: f64,
    unseen: f64,
}

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
/// distinguished from motion. The factor is then one: the estimate is the same, its covariance is not. What is unseen
/// is the share of the covariances that the innovations then do not show, which no smoother
/// averages out; otherwise zero.
fn most_likely<P: Place>(series: &Series<'_, P>, vouched: bool) -> Option<MostLikely> {
    let times: Vec<f64> =
        series.t_s.iter().zip(&series.measured).filter(|(_, m)| m.is_some()).map(|(t, _)| *t).collect();
    let count = times.len() as f64;
    let search = Search {
        series,
        interval_s: median(times.windows(2).map(|w| w[1] - w[0]).collect()).unwrap_or(f64::NAN),
        duration_s: times.last()? - times.first()?,
        variance: median(series.measured.iter().flatten().map(|m| m.covariance.trace() / 3.0).collect())?,
        covariance: series.measured.iter().flatten().map(|m| m.covariance / count).sum(),
    };
    let white = |log_hz: f64| [log_hz, f64::NEG_INFINITY, 0.0];
    let (low, high) = ((0.5 / search.duration_s).ln(), (0.5 / search.interval_s).ln());
    let white = white(least(|x| search.cost(&white(x)), low, high, COARSE_STEPS));
    let sums = search.run(&white).filter(|s| s.count > 0)?;
    if sums.correlation() > SIGNIFICANT / (sums.count as f64).sqrt() {
        let coloured = search.coloured(white[0], (low, high));
        if search.cost(&coloured) + TWO_MORE < search.cost(&white) {
            let white = search.scaled(&white, vouched)?.noise;
            return Some(MostLikely { white: Some(white), ..search.scaled(&coloured, vouched)? });
        }
    }
    search.scaled(&white, vouched)
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

    /// Noise with the factor on the covariances that the innovations show, where the covariances do not speak against it.
    fn scaled(&self, at: &Parameters, vouched: bool) -> Option<MostLikely> {
        let sums = self.run(at).filter(|s| s.count > 0)?;
        let shown = (sums.chi_square / sums.count as f64).max(LEAST_FACTOR);
        let slow = vouched && shown < 1.0 - SIGNIFICANT * (2.0 / sums.count as f64).sqrt();
        let factor = if slow { 1.0 } else { shown };
        let unit = self.noise(at);
        let (intensity, correlated) = (unit.intensity * factor, unit.correlated * factor);
        Some(MostLikely {
            noise: JerkNoise { intensity, variance_factor: factor, correlated, ..unit },
            white: None,
            bandwidth_hz: at[0].exp(),
            unseen: if slow { 1.0 - shown } else { 0.0 },
        })
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
                let at = |x: f64| self.cost(&std::array::from_fn(|i| if i == k { x } else { best[i] }));
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

/// The least of a function of one variable: a grid, then halved steps from its best point.
pub(crate) fn least(cost: impl Fn(f64) -> f64, low: f64, high: f64, steps: usize) -> f64 {
    let mut step = (high - low) / steps as f64;
    let at = |x: f64| (cost(x), x);
    let lower = |a: (f64, f64), b: (f64, f64)| if b.0 < a.0 { b } else { a };
    let mut best = (0..=steps).map(|k| at(low + step * k as f64)).fold((f64::INFINITY, low), lower);
    while step > 0.005 {
        step *= 0.5;
        let below = lower(best, at((best.1 - step).max(low)));
        // Where it falls on one side it rises on the other.
        best = if below.1 < best.1 { below } else { lower(best, at((best.1 + step).min(high))) };
    }
    best.1
}

#[derive(Debug, Clone, Copy)]
struct Measured<P> {
    place: P,
    covariance: Matrix3<f64>,
}

/// Times and what was measured then; the first entry is measured.
struct Series<'a, P> {
    t_s: Vec<f64>,
    measured: Vec<Option<Measured<P>>>,
    /// Where the motion begins anew.
    anew: &'a [usize],
    /// Standard deviations of rate and acceleration before anything is known.
    prior_std: (f64, f64),
}

impl<'a, P> Series<'a, P> {
    /// The places of poses, with the block of their covariances that begins at a coordinate.
    fn of(
        poses: &[PoseSample],
        anew: &'a [usize],
        prior_std: (f64, f64),
        at: usize,
        place: impl Fn(&Isometry3<f64>) -> P,
    ) -> Self {
        let measured = |e: &PoseEstimate| Measured {
            place: place(&e.world_from_body),
            covariance: e.own_covariance().fixed_view::<3, 3>(at, at).into_owned(),
        };
        Self {
            t_s: poses.iter().map(|p| (p.t_ns - poses[0].t_ns) as f64 * 1e-9).collect(),
            measured: poses.iter().map(|p| p.estimate.as_ref().ok().map(measured)).collect(),
            anew,
            prior_std,
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Innovations {
    /// Coordinates.
    count: usize,
    /// Σ log det S.
    log_det: f64,
    /// Σ yᵀ S⁻¹ y.
    chi_square: f64,
    /// Σ wᵀ w' over neighbours, w the whitened innovations.
    neighbours: f64,
}

impl Innovations {
    /// Correlation of an innovation with the one before.
    fn correlation(&self) -> f64 {
        if self.chi_square > 0.0 { self.neighbours / self.chi_square } else { 0.0 }
    }
}

/// Measurements that the diffuse start uses up: place, rate and acceleration.
const DIFFUSE: usize = 3;

/// The innovations of a whole series; `None` where the arithmetic fails.
fn innovations<P: Place>(series: &Series<'_, P>, noise: &JerkNoise) -> Option<Innovations> {
    let begun = |first: &Measured<P>| {
        let start = first.covariance * noise.variance_factor;
        (Integrator::at(first.place), start_covariance(&start, noise, series.prior_std))
    };
    let (mut chain, mut covariance) = begun(series.measured.first()?.as_ref()?);
    let mut sums = Innovations::default();
    let (mut seen_count, mut before) = (1, None);
    for k in 1..series.t_s.len() {
        let dt_s = series.t_s[k] - series.t_s[k - 1];
        let (predicted, transition) = chain.predicted(dt_s, noise);
        chain = predicted;
        transition.forward(covariance.as_mut_slice(), CHAIN, 0);
        covariance.transpose_mut();
        transition.forward(covariance.as_mut_slice(), CHAIN, 0);
        add_process_noise(covariance.as_mut_slice(), CHAIN, 0, dt_s, noise);
        let Some(seen) = &series.measured[k] else { continue };
        if series.anew.contains(&k) {
            ((chain, covariance), seen_count, before) = (begun(seen), 1, None);
            continue;
        }
        let y = chain.innovation(&seen.place);
        let rows = covariance.fixed_rows::<3>(0) + covariance.fixed_rows::<3>(CORRELATED);
        let s = rows.fixed_columns::<3>(0)
            + rows.fixed_columns::<3>(CORRELATED)
            + seen.covariance * noise.variance_factor;
        let factor = s.cholesky()?;
        let root = factor.l();
        let (whitened, white) = (root.solve_lower_triangular(&rows)?, root.solve_lower_triangular(&y)?);
        covariance -= whitened.tr_mul(&whitened);
        covariance = (covariance + covariance.transpose()) * 0.5;
        chain.correct(whitened.tr_mul(&white).as_slice());
        seen_count += 1;
        if seen_count > DIFFUSE {
            sums.count += 3;
            sums.log_det += 2.0 * root.diagonal().map(f64::ln).sum();
            sums.chi_square += white.norm_squared();
            sums.neighbours += before.map_or(0.0, |b: Vector3<f64>| b.dot(&white));
            before = Some(white);
        }
    }
    Some(sums).filter(|s| s.log_det.is_finite() && s.chi_square.is_finite())
}
