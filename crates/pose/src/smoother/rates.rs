//! Rates of a gyroscope, as measurements of the smoother beside the poses.
//!
//! How strongly the body is shaken, and what is new in each sample, are those of greatest likelihood of the innovations of
//! the rates alone, as [`crate::smoother::noise`] has them of poses. Of neighbouring samples the smoother takes means that are
//! short against what it passes, so that it costs by the band of the motion and not by the rate of the sensor.

use crate::smoother::noise::{COARSE_STEPS, least};
use crate::statistics::Sampling;
use crate::{PoseError, RatesRefusal};
use mavsight_geometry::{Matrix3, Vector3};
use std::f64::consts::PI;
use std::ops::Range;

/// Samples needed for their noise.
const NEEDED: usize = 30;
/// Means are over this share of the period at which half of a rate passes: there they take (π/16)²/6, 0.6 %, of it.
const MEANS_IN_A_PERIOD: f64 = 16.0;
/// The longest gap between poses that rates bridge. Attitude is known much longer, position is not: 1 g that nobody measures
/// is g t³/6 for white jerk of that size, 1.6 m after a second.
const LONGEST_BRIDGE_S: f64 = 1.0;

/// What one standard deviation along one direction of what is uncertain of a gyroscope, and lasts for a flight, does to its rates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RateError {
    /// The same of every rate.
    pub bias_rad_s: Vector3<f64>,
    /// Times the rate: scale, and how the sensor sits in the body.
    pub gain: Matrix3<f64>,
    /// By how much a rate is given too early, at time zero of the poses' clock.
    pub early_s: f64,
    /// And by how much more with each second.
    pub drift: f64,
}

impl RateError {
    /// Of a rate at a time, by its derivative.
    fn of(&self, t_s: f64, rate_rad_s: &Vector3<f64>, acceleration_rad_s2: &Vector3<f64>) -> Vector3<f64> {
        self.bias_rad_s + self.gain * rate_rad_s + acceleration_rad_s2 * (self.early_s + self.drift * t_s)
    }
}

/// Rates about body axes at increasing times by the clock of the poses.
#[derive(Debug, Clone, PartialEq)]
pub struct RateSeries {
    times_ns: Vec<i64>,
    rates_rad_s: Vec<Vector3<f64>>,
    errors: Vec<RateError>,
}

impl RateSeries {
    /// Takes a rate for each time, and what is uncertain of all of them alike.
    ///
    /// # Errors
    /// [`RatesRefusal::Bad`] for numbers of times and rates that differ, times that do not increase, and what is not finite.
    pub fn new(
        times_ns: Vec<i64>,
        rates_rad_s: Vec<Vector3<f64>>,
        errors: Vec<RateError>,
    ) -> Result<Self, PoseError> {
        let bad = |index, what| Err(RatesRefusal::Bad { index, what }.into());
        if times_ns.len() != rates_rad_s.len() {
            return bad(times_ns.len().min(rates_rad_s.len()), "has not both a time and a rate");
        }
        if let Some(k) = times_ns.windows(2).position(|pair| pair[1] <= pair[0]) {
            return bad(k + 1, "does not come after the one before it");
        }
        if let Some(k) = rates_rad_s.iter().position(|rate| !rate.iter().all(|x| x.is_finite())) {
            return bad(k, "is not finite");
        }
        let is_sound = |e: &RateError| {
            let all = e.bias_rad_s.iter().chain(e.gain.iter()).chain([&e.early_s, &e.drift]);
            all.into_iter().all(|x| x.is_finite())
        };
        if let Some(k) = errors.iter().position(|e| !is_sound(e)) {
            return bad(k, "has an uncertainty that is not finite");
        }
        Ok(Self { times_ns, rates_rad_s, errors })
    }

    /// Times by the clock of the poses.
    pub fn times_ns(&self) -> &[i64] {
        &self.times_ns
    }

    /// Rates about the body's axes.
    pub fn rates_rad_s(&self) -> &[Vector3<f64>] {
        &self.rates_rad_s
    }
}

/// The mean of neighbouring samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MeanRate {
    pub(crate) t_ns: i64,
    pub(crate) rate_rad_s: Vector3<f64>,
    pub(crate) variance: f64,
}

/// Rates as the smoother takes them.
#[derive(Debug, Clone)]
pub(crate) struct Rates {
    means: Vec<MeanRate>,
    errors: Vec<RateError>,
    /// Spectral density of the jerk of the attitude, rad²/s⁵.
    pub(crate) intensity: f64,
    /// Frequency at which the smoother passes one half of a rate.
    pub(crate) bandwidth_hz: f64,
}

impl Rates {
    /// Of the samples between two times.
    ///
    /// # Errors
    /// [`RatesRefusal::TooFew`].
    pub(crate) fn of(series: &RateSeries, span_ns: (i64, i64)) -> Result<Self, PoseError> {
        let times = &series.times_ns;
        let within = times.partition_point(|t| *t < span_ns.0)..times.partition_point(|t| *t <= span_ns.1);
        let too_few: PoseError = RatesRefusal::TooFew { found: within.len(), needed: NEEDED }.into();
        if within.len() < NEEDED {
            return Err(too_few);
        }
        let Some(sampling) = Sampling::of(&times[within.clone()]) else { return Err(too_few) };
        let (times_ns, rates_rad_s) = (&times[within.clone()], &series.rates_rad_s[within]);
        let samples = Samples { times_ns, rates_rad_s, sampling };
        let found = samples.most_likely().ok_or(too_few)?;
        let means = samples.means(found.variance, 1.0 / (MEANS_IN_A_PERIOD * found.bandwidth_hz));
        let (intensity, bandwidth_hz) = (found.intensity, found.bandwidth_hz);
        Ok(Self { means, errors: series.errors.clone(), intensity, bandwidth_hz })
    }

    pub(crate) fn columns(&self) -> usize {
        self.errors.len()
    }

    pub(crate) fn mean(&self, k: usize) -> &MeanRate {
        &self.means[k]
    }

    /// Numbers of the means between two times.
    pub(crate) fn between(&self, from_ns: i64, to_ns: i64) -> Range<usize> {
        self.means.partition_point(|m| m.t_ns < from_ns)..self.means.partition_point(|m| m.t_ns <= to_ns)
    }

    /// What an uncertainty does to a mean where the body's angular acceleration is known.
    pub(crate) fn error(
        &self,
        column: usize,
        mean: &MeanRate,
        acceleration_rad_s2: &Vector3<f64>,
    ) -> Vector3<f64> {
        self.errors[column].of(mean.t_ns as f64 * 1e-9, &mean.rate_rad_s, acceleration_rad_s2)
    }

    /// Whether rates without a hole longer than `longest_ns` lead from one pose to the next.
    pub(crate) fn bridge(&self, from_ns: i64, to_ns: i64, longest_ns: i64) -> bool {
        if (to_ns - from_ns) as f64 * 1e-9 > LONGEST_BRIDGE_S {
            return false;
        }
        let inner = self.means[self.between(from_ns, to_ns)].iter().map(|m| m.t_ns);
        let mut before_ns = from_ns;
        inner.chain([to_ns]).all(|t_ns| t_ns - std::mem::replace(&mut before_ns, t_ns) <= longest_ns)
    }
}

/// Noise of samples, and the band that it implies.
struct RateNoise {
    variance: f64,
    intensity: f64,
    bandwidth_hz: f64,
}

/// Samples of three axes.
struct Samples<'a> {
    times_ns: &'a [i64],
    rates_rad_s: &'a [Vector3<f64>],
    sampling: Sampling,
}

impl Samples<'_> {
    fn step_s(&self, k: usize) -> f64 {
        (self.times_ns[k] - self.times_ns[k - 1]) as f64 * 1e-9
    }

    /// The noise of greatest likelihood, sought as that of poses from one cycle in twice the record to the Nyquist frequency:
    /// of white jerk, a smoother of rates passes 1/(1 + (f/fc)⁴) of them, with (2π fc)⁴ = q/(r dt).
    fn most_likely(&self) -> Option<RateNoise> {
        let interval_s = self.sampling.interval_s;
        let duration_s = interval_s * (self.times_ns.len() - 1) as f64;
        let unit = |log_hz: f64| (2.0 * PI * log_hz.exp()).powi(4) * interval_s;
        let cost = |log_hz: f64| {
            self.innovations(unit(log_hz)).map_or(f64::INFINITY, |(count, log_det, squares)| {
                log_det + count * (squares / count).max(f64::MIN_POSITIVE).ln()
            })
        };
        let best = least(cost, (0.5 / duration_s).ln(), (0.5 / interval_s).ln(), COARSE_STEPS);
        let (count, _, squares) = self.innovations(unit(best))?;
        // A sensor of few digits may stand still.
        let variance = (squares / count).max(f64::EPSILON.powi(2));
        Some(RateNoise { variance, intensity: unit(best) * variance, bandwidth_hz: best.exp() })
    }

    /// Number, Σ log S and Σ y²/S of the innovations of all axes, for samples of unit variance and a jerk of some density over
    /// that. The covariance of a rate and its derivative is the same of each axis.
    fn innovations(&self, density: f64) -> Option<(f64, f64, f64)> {
        let (mut rate, mut slope) = (self.rates_rad_s[0], Vector3::zeros());
        // Of the slope nothing is known: two samples give it.
        let step_s = self.step_s(1);
        let mut p = [1.0, 0.0, 1e4 / (step_s * step_s)];
        let (mut count, mut log_det, mut squares) = (0.0, 0.0, 0.0);
        for k in 1..self.rates_rad_s.len() {
            let dt = self.step_s(k);
            rate += slope * dt;
            p[0] += dt * (2.0 * p[1] + dt * p[2]) + density * dt * dt * dt / 3.0;
            p[1] += dt * p[2] + density * dt * dt / 2.0;
            p[2] += density * dt;
            let s = p[0] + 1.0;
            let y = self.rates_rad_s[k] - rate;
            let gain = [p[0] / s, p[1] / s];
            rate += y * gain[0];
            slope += y * gain[1];
            p = [p[0] / s, p[1] / s, p[2] - gain[1] * p[1]];
            if k > 1 {
                count += 3.0;
                log_det += 3.0 * s.ln();
                squares += y.norm_squared() / s;
            }
        }
        Some((count, log_det, squares)).filter(|(.., squares)| squares.is_finite())
    }

    /// Means over at most a span, and never across a gap.
    fn means(&self, variance: f64, span_s: f64) -> Vec<MeanRate> {
        let Sampling { longest_ns, interval_s } = self.sampling;
        let mut out: Vec<MeanRate> = Vec::new();
        let mut first = 0;
        for end in 1..=self.times_ns.len() {
            let goes_on = end < self.times_ns.len()
                && self.times_ns[end] - self.times_ns[end - 1] <= longest_ns
                && (self.times_ns[end] - self.times_ns[first]) as f64 * 1e-9 + interval_s <= span_s;
            if goes_on {
                continue;
            }
            let count = (end - first) as f64;
            let since_ns: i64 = self.times_ns[first..end].iter().map(|t| t - self.times_ns[first]).sum();
            out.push(MeanRate {
                t_ns: self.times_ns[first] + since_ns / (end - first) as i64,
                rate_rad_s: self.rates_rad_s[first..end].iter().sum::<Vector3<f64>>() / count,
                variance: variance / count,
            });
            first = end;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    /// Rates of white jerk of a known density, at 400 Hz with noise.
    fn shaken(density: f64, std: f64, count: usize) -> RateSeries {
        let (mut random, dt) = (Random::new(11, 0), 1.0 / 400.0);
        let (mut rate, mut slope) = (Vector3::zeros(), Vector3::zeros());
        let mut rates = Vec::new();
        for _ in 0..count {
            rate += slope * dt;
            slope += Vector3::from(random.normals()) * (density * dt).sqrt();
            rates.push(rate + Vector3::from(random.normals()) * std);
        }
        let times_ns = (0..count as i64).map(|k| k * 2_500_000).collect();
        RateSeries::new(times_ns, rates, Vec::new()).unwrap()
    }

    #[test]
    fn noise_and_jerk_are_those_of_the_samples() {
        let series = shaken(400.0, 2.5e-3, 8000);
        let rates = Rates::of(&series, (0, i64::MAX)).unwrap();
        assert!((rates.intensity / 400.0).ln().abs() < 0.2, "{}", rates.intensity);
        let mean = rates.mean(5);
        let samples = (2.5e-3_f64).powi(2) / mean.variance;
        assert!((samples / samples.round() - 1.0).abs() < 0.06, "{samples}");
        // Nothing is lost: the weights of all means are those of all samples.
        let weight: f64 = (0..rates.means.len()).map(|k| 1.0 / rates.mean(k).variance).sum();
        assert!((weight * 2.5e-3_f64.powi(2) / 8000.0 - 1.0).abs() < 0.06, "{weight}");
    }

    #[test]
    fn bad_rates_are_refused() {
        let rate = Vector3::new(0.0, 0.0, 1.0);
        let refused = |times: Vec<i64>, rates: Vec<Vector3<f64>>| RateSeries::new(times, rates, Vec::new());
        assert!(matches!(
            refused(vec![0, 1], vec![rate]),
            Err(PoseError::Rates(RatesRefusal::Bad { index: 1, .. }))
        ));
        assert!(matches!(
            refused(vec![0, 0], vec![rate; 2]),
            Err(PoseError::Rates(RatesRefusal::Bad { index: 1, .. }))
        ));
        let wild = refused(vec![0, 1], vec![rate, rate * f64::NAN]);
        assert!(matches!(wild, Err(PoseError::Rates(RatesRefusal::Bad { index: 1, .. }))));
        let few = RateSeries::new(vec![0, 1], vec![rate; 2], Vec::new()).unwrap();
        assert!(matches!(
            Rates::of(&few, (0, 9)),
            Err(PoseError::Rates(RatesRefusal::TooFew { found: 2, .. }))
        ));
    }
}
