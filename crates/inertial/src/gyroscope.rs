//! Samples of a gyroscope, and the turns that they add up to.

use crate::InertialError;
use mavsight_geometry::{UnitQuaternion, Vector3};
use mavsight_pose::Sampling;

/// Samples of a gyroscope at increasing times by the clock of its log, in its own axes.
#[derive(Debug, Clone, PartialEq)]
pub struct GyroscopeSeries {
    times_ns: Vec<i64>,
    rates_rad_s: Vec<Vector3<f64>>,
    sampling: Sampling,
}

impl GyroscopeSeries {
    /// Takes a rate for each time.
    ///
    /// # Errors
    /// [`InertialError::Table`], [`InertialError::Time`], [`InertialError::NotFinite`].
    pub fn new(times_ns: Vec<i64>, rates_rad_s: Vec<Vector3<f64>>) -> Result<Self, InertialError> {
        let (times, rates) = (times_ns.len(), rates_rad_s.len());
        let sampling = Sampling::of(&times_ns).filter(|_| times == rates);
        let Some(sampling) = sampling else { return Err(InertialError::Table { times, rates }) };
        let seconds = |t_ns: i64| t_ns as f64 * 1e-9;
        if let Some(k) = times_ns.windows(2).position(|pair| pair[1] <= pair[0]) {
            let (before_s, t_s) = (seconds(times_ns[k]), seconds(times_ns[k + 1]));
            return Err(InertialError::Time { row: k + 2, t_s, before_s });
        }
        if let Some(k) = rates_rad_s.iter().position(|rate| !rate.iter().all(|x| x.is_finite())) {
            return Err(InertialError::NotFinite { t_s: seconds(times_ns[k]) });
        }
        Ok(Self { times_ns, rates_rad_s, sampling })
    }

    /// Times by the log's clock.
    pub fn times_ns(&self) -> &[i64] {
        &self.times_ns
    }

    /// Rates about the sensor's axes.
    pub fn rates_rad_s(&self) -> &[Vector3<f64>] {
        &self.rates_rad_s
    }

    /// The standard deviation of what is new in each sample, from second differences of neighbours: of white noise they
    /// have six times its variance (von Neumann et al. 1941), and of motion within a millisecond or two next to nothing. The
    /// median of squares keeps out shocks; that of a chi-square of one degree is 0.4549.
    pub(crate) fn noise_rad_s(&self) -> f64 {
        let second = |w: &[Vector3<f64>]| (w[0] - 2.0 * w[1] + w[2]).map(|x| x * x / 6.0);
        let mut squares: Vec<f64> =
            self.rates_rad_s.windows(3).flat_map(|w| <[f64; 3]>::from(second(w))).collect();
        if squares.is_empty() {
            return 0.0;
        }
        let middle = squares.len() / 2;
        (*squares.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.4549).sqrt()
    }

    /// The number of holes before each sample: what turned meanwhile, no sample shows.
    fn holes(&self) -> Vec<u32> {
        let mut count = 0;
        let later = self.times_ns.windows(2).map(|pair| {
            count += u32::from(pair[1] - pair[0] > self.sampling.longest_ns);
            count
        });
        std::iter::once(0).chain(later).collect()
    }

    /// Mean time from one sample to the next, holes left out.
    pub(crate) fn interval_s(&self) -> f64 {
        self.sampling.interval_s
    }
}

/// Where the sensor is in its own turns at a time.
pub(crate) struct Instant {
    pub(crate) attitude: UnitQuaternion<f64>,
    pub(crate) rate_rad_s: Vector3<f64>,
    /// Holes of the log before.
    holes: u32,
}

/// What is not right of a gyroscope's rates: true rates are (measured - bias) times 1 + scale, axis by axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RateErrors {
    pub(crate) bias_rad_s: Vector3<f64>,
    pub(crate) scale: Vector3<f64>,
}

/// The sensor's attitude over its log, from its first sample on; rates are joined by lines, and nothing is known across holes.
pub(crate) struct Turned<'a> {
    series: &'a GyroscopeSeries,
    errors: RateErrors,
    attitudes: Vec<UnitQuaternion<f64>>,
    /// Number of holes before each sample.
    holes: Vec<u32>,
}

impl<'a> Turned<'a> {
    pub(crate) fn new(series: &'a GyroscopeSeries, errors: RateErrors) -> Self {
        let holes = series.holes();
        let mut out = Self { series, errors, attitudes: Vec::with_capacity(series.times_ns.len()), holes };
        let mut attitude = UnitQuaternion::identity();
        out.attitudes.push(attitude);
        for k in 0..series.times_ns.len() - 1 {
            let span_s = (series.times_ns[k + 1] - series.times_ns[k]) as f64 * 1e-9;
            let middle = 0.5 * (out.rate_of(k) + out.rate_of(k + 1));
            attitude *= UnitQuaternion::from_scaled_axis(middle * span_s);
            out.attitudes.push(attitude);
        }
        out
    }

    fn rate_of(&self, k: usize) -> Vector3<f64> {
        let RateErrors { bias_rad_s, scale } = self.errors;
        (self.series.rates_rad_s[k] - bias_rad_s).component_mul(&scale.add_scalar(1.0))
    }

    /// Two times by the log's clock; none where one of them is outside of the log, or a hole is at or between them.
    pub(crate) fn between(&self, from_s: f64, to_s: f64) -> Option<[Instant; 2]> {
        let (from, to) = (self.at(from_s)?, self.at(to_s)?);
        (from.holes == to.holes).then_some([from, to])
    }

    /// A time by the log's clock; none outside of the log and in a hole.
    fn at(&self, t_s: f64) -> Option<Instant> {
        let times = &self.series.times_ns;
        let t_ns = t_s * 1e9;
        let after = times.partition_point(|t| (*t as f64) <= t_ns);
        if after == 0 || after == times.len() {
            return None;
        }
        let before = after - 1;
        let holes = self.holes[before];
        if self.holes[after] != holes {
            return None;
        }
        let span_ns = (times[after] - times[before]) as f64;
        let since_ns = t_ns - times[before] as f64;
        let (from, to) = (self.rate_of(before), self.rate_of(after));
        let rate_rad_s = from + (to - from) * (since_ns / span_ns);
        let turn = 0.5 * (from + rate_rad_s) * (since_ns * 1e-9);
        let attitude = self.attitudes[before] * UnitQuaternion::from_scaled_axis(turn);
        Some(Instant { attitude, rate_rad_s, holes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(rate: impl Fn(f64) -> Vector3<f64>) -> GyroscopeSeries {
        let times_ns: Vec<i64> = (0..401).map(|k| k * 2_500_000).collect();
        let rates = times_ns.iter().map(|t| rate(*t as f64 * 1e-9)).collect();
        GyroscopeSeries::new(times_ns, rates).expect("a series")
    }

    const NONE: RateErrors =
        RateErrors { bias_rad_s: Vector3::new(0.0, 0.0, 0.0), scale: Vector3::new(0.0, 0.0, 0.0) };

    /// A steady turn about one axis has a closed form, also between samples.
    #[test]
    fn a_steady_turn_is_its_rate_times_time() {
        let rate = Vector3::new(0.3, -0.4, 1.2);
        let measured = series(|_| rate);
        let turned = Turned::new(&measured, NONE);
        let at = turned.at(0.7512).expect("within");
        assert!((at.attitude.scaled_axis() - rate * 0.7512).norm() < 1e-12);
        assert!((at.rate_rad_s - rate).norm() < 1e-12);
        assert!(turned.at(-0.1).is_none() && turned.at(1.1).is_none());
    }

    /// Steps of three usual ones are jitter, longer ones are holes, and what is beside these remains known.
    #[test]
    fn nothing_is_known_across_a_hole() {
        let times_ns: Vec<i64> = (0..100).chain(102..200).chain(203..300).map(|k| k * 2_500_000).collect();
        let rates = vec![Vector3::new(0.3, -0.4, 1.2); times_ns.len()];
        let measured = GyroscopeSeries::new(times_ns, rates).expect("a series");
        let turned = Turned::new(&measured, NONE);
        assert!(turned.between(0.2, 0.4).is_some() && turned.between(0.51, 0.7).is_some());
        assert!(turned.between(0.4, 0.6).is_none());
        assert!(turned.at(0.501).is_none() && turned.at(0.2505).is_some());
    }

    #[test]
    fn errors_of_the_rates_are_taken_off() {
        let errors = RateErrors {
            bias_rad_s: Vector3::new(0.01, 0.02, -0.03),
            scale: Vector3::new(0.01, -0.02, 0.03),
        };
        let rate = Vector3::new(0.3, -0.4, 1.2);
        let measured = series(|_| rate.component_div(&errors.scale.add_scalar(1.0)) + errors.bias_rad_s);
        let attitude = Turned::new(&measured, errors).at(0.5).expect("within").attitude;
        assert!((attitude.scaled_axis() - rate * 0.5).norm() < 1e-12);
    }

    #[test]
    fn bad_tables_are_refused() {
        let rate = Vector3::new(0.0, 0.0, 1.0);
        assert_eq!(
            GyroscopeSeries::new(vec![0, 1], vec![rate]),
            Err(InertialError::Table { times: 2, rates: 1 })
        );
        let back = GyroscopeSeries::new(vec![0, 5, 5], vec![rate; 3]).unwrap_err();
        assert!(matches!(back, InertialError::Time { row: 3, .. }), "{back}");
        let bad = GyroscopeSeries::new(vec![0, 5], vec![rate, rate * f64::NAN]).unwrap_err();
        assert!(matches!(bad, InertialError::NotFinite { .. }), "{bad}");
    }
}
