//! How the errors of poses, behind a smoother, reach what is computed from the motion.

use nalgebra::{Complex, DMatrix, DVector};
use std::f64::consts::PI;

/// What errs: the position or the turn of each pose along a body axis, white from pose to pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    Position(usize),
    Turn(usize),
}

impl Source {
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        (0..3).flat_map(|axis| [Self::Position(axis), Self::Turn(axis)])
    }
}

/// The frequency response from that to a signal, in addition to the low-passes that all signals have passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Transfer {
    /// (iω)ⁿ.
    Derivative(i32),
    /// iωτ/(1 + iωτ): a disc that follows the body with a time constant.
    Washout { time_s: f64 },
}

impl Transfer {
    fn at(self, f_hz: f64) -> Complex<f64> {
        let i_omega = Complex::new(0.0, 2.0 * PI * f_hz);
        match self {
            Self::Derivative(order) => i_omega.powi(order),
            Self::Washout { time_s } => i_omega * time_s / (i_omega * time_s + 1.0),
        }
    }
}

/// One way from a source to a signal, with its gain at each row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Term {
    pub(crate) source: Source,
    pub(crate) transfer: Transfer,
    pub(crate) gains: Vec<f64>,
}

/// The bandwidths behind which errors are seen.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bands {
    pub(crate) translation_hz: f64,
    pub(crate) rotation_hz: f64,
    /// All low-passes that every signal has passed, the smoother's own among them.
    pub(crate) passed_hz: Vec<f64>,
}

/// Frequencies at half steps, with the amplitude that all low-passes let through.
struct Grid {
    step_hz: f64,
    points: Vec<(f64, f64)>,
}

impl Bands {
    /// ∫ 1/(1 + (f/fc)⁶) df of the smoother's low-pass of a source.
    fn smoothed_hz(&self, source: Source) -> f64 {
        let own_hz = match source {
            Source::Position(_) => self.translation_hz,
            Source::Turn(_) => self.rotation_hz,
        };
        own_hz * PI / 3.0
    }

    /// So many points up to a multiple of the lowest bandwidth, of which five lets next to nothing pass.
    fn grid(&self, count: usize, multiple: f64) -> Grid {
        let lowest_hz = self.passed_hz.iter().copied().fold(f64::INFINITY, f64::min);
        let step_hz = multiple * lowest_hz / count as f64;
        let passed = |f: f64| self.passed_hz.iter().map(|fc| 1.0 / (1.0 + (f / fc).powi(6))).product();
        let points = (0..count).map(|k| step_hz * (k as f64 + 0.5)).map(|f| (f, passed(f))).collect();
        Grid { step_hz, points }
    }

    /// Covariance of two signals over the smoother's variance of their source: ∫ Re(F G*) Π H² df over ∫ H
    /// df, where H = 1/(1 + (f/fc)⁶).
    ///
    /// The variance that a smoother states holds what it could not resolve as well, which is no error of a
    /// regression whose both sides have passed the same low-pass: of white noise of density S it is S∫H, of
    /// which S∫H² is noise.
    fn share(&self, a: &Term, b: &Term, grid: &Grid) -> f64 {
        let power = |(f, h): &(f64, f64)| (a.transfer.at(*f) * b.transfer.at(*f).conj()).re * h * h;
        grid.points.iter().map(power).sum::<f64>() * grid.step_hz / self.smoothed_hz(a.source)
    }

    /// Covariance of the signals at each row, given the smoother's variance of each source there.
    pub(crate) fn covariances(
        &self,
        signals: &[&[Term]],
        rows: usize,
        variance: &dyn Fn(Source, usize) -> f64,
    ) -> ErrorRows {
        let grid = self.grid(600, 6.0);
        let mut out = ErrorRows::zeros(signals.len(), rows);
        let mut sums = vec![0.0; rows];
        let variances: Vec<(Source, Vec<f64>)> = Source::all()
            .map(|source| (source, (0..rows).map(|row| variance(source, row)).collect()))
            .collect();
        for (i, first) in signals.iter().enumerate() {
            for (j, second) in signals[..=i].iter().enumerate() {
                sums.fill(0.0);
                for (source, variance) in &variances {
                    for a in first.iter().filter(|a| a.source == *source) {
                        for b in second.iter().filter(|b| b.source == *source) {
                            let share = self.share(a, b, &grid);
                            let gains = a.gains.iter().zip(&b.gains).zip(variance);
                            sums.iter_mut()
                                .zip(gains)
                                .for_each(|(sum, ((a, b), v))| *sum += share * a * b * v);
                        }
                    }
                }
                sums.iter().enumerate().for_each(|(row, sum)| out.set(row, (i, j), *sum));
            }
        }
        out
    }

    /// The spectrum of the signals' errors, given the mean variance of each source.
    pub(crate) fn spectrum(&self, signals: &[&[Term]], variance: &dyn Fn(Source) -> f64) -> ErrorSpectrum {
        let Grid { step_hz, points } = self.grid(300, 5.0);
        let is_met = |s: &Source| signals.iter().any(|terms| terms.iter().any(|t| t.source == *s));
        let responses = Source::all().filter(is_met).map(|source| {
            let root = (variance(source) / self.smoothed_hz(source) * step_hz).sqrt();
            DMatrix::from_fn(points.len(), signals.len(), |k, j| {
                let own = signals[j].iter().filter(|t| t.source == source);
                let (f, passed) = points[k];
                own.map(|t| t.transfer.at(f) * (mean(&t.gains) * root * passed)).sum()
            })
        });
        ErrorSpectrum { step_hz, responses: responses.collect() }
    }
}

/// One covariance of the same signals at each time, in single precision: seven digits of a variance, and a
/// quarter of the bytes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorRows {
    signals: usize,
    /// Lower triangles by rows.
    triangles: Vec<f32>,
}

impl ErrorRows {
    /// So many covariances of so many signals, all zero.
    pub(crate) fn zeros(signals: usize, rows: usize) -> Self {
        Self { signals, triangles: vec![0.0; rows * signals * (signals + 1) / 2] }
    }

    fn place(&self, row: usize, i: usize, j: usize) -> usize {
        let (low, high) = (i.min(j), i.max(j));
        row * self.signals * (self.signals + 1) / 2 + high * (high + 1) / 2 + low
    }

    /// Number of times.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len() / (self.signals * (self.signals + 1) / 2).max(1)
    }

    /// One element of the covariance at a time.
    pub fn at(&self, row: usize, i: usize, j: usize) -> f64 {
        f64::from(self.triangles[self.place(row, i, j)])
    }

    /// Sets an element, and the one across the diagonal.
    pub(crate) fn set(&mut self, row: usize, (i, j): (usize, usize), value: f64) {
        let place = self.place(row, i, j);
        self.triangles[place] = value as f32;
    }

    /// The covariance of some of the signals at a time.
    pub fn block(&self, row: usize, signals: &[usize]) -> DMatrix<f64> {
        DMatrix::from_fn(signals.len(), signals.len(), |i, j| self.at(row, signals[i], signals[j]))
    }

    pub(crate) fn of_signals(&self, kept: &[usize]) -> Self {
        let mut out = Self::zeros(kept.len(), self.len());
        for row in 0..self.len() {
            for i in 0..kept.len() {
                (0..=i).for_each(|j| out.set(row, (i, j), self.at(row, kept[i], kept[j])));
            }
        }
        out
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Spectrum of the errors of some signals, from the mean gain and variance of each way.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorSpectrum {
    step_hz: f64,
    /// For each source, the signals' responses (columns) at each frequency, with the root of the density.
    responses: Vec<DMatrix<Complex<f64>>>,
}

impl ErrorSpectrum {
    /// The spectrum of some of the signals.
    pub(crate) fn of_signals(&self, kept: &[usize]) -> Self {
        let responses = self.responses.iter().map(|r| r.select_columns(kept)).collect();
        Self { step_hz: self.step_hz, responses }
    }

    /// Autocovariances at lags 0, 1, ... of steps `dt_s` of the sum of the signals by the given weights.
    pub(crate) fn autocovariances(&self, weights: &DVector<f64>, dt_s: f64, lags: usize) -> Vec<f64> {
        let mut power = DVector::zeros(self.responses.first().map_or(0, DMatrix::nrows));
        for responses in &self.responses {
            power += (responses * weights.map(Complex::from)).map(|c| c.norm_sqr());
        }
        let angle = 2.0 * PI * self.step_hz * dt_s;
        let at = |l: usize, k: usize| (angle * l as f64 * (k as f64 + 0.5)).cos();
        (0..lags).map(|l| power.iter().enumerate().map(|(k, s)| s * at(l, k)).sum()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal;
    use mavsight_pose::lowpass_like;

    #[test]
    fn shares_are_those_of_the_closed_form() {
        // ∫ x^{2k}/(1 + x⁶)² = (1 - (2k + 1)/6) ∫ x^{2k}/(1 + x⁶), by parts; the latter is (π/6)/sin((2k +
        // 1)π/6).
        let bands = Bands { translation_hz: 2.0, rotation_hz: 5.0, passed_hz: vec![2.0] };
        for k in 0..3 {
            let term =
                Term { source: Source::Position(0), transfer: Transfer::Derivative(k), gains: Vec::new() };
            let share = bands.share(&term, &term, &bands.grid(600, 6.0));
            let m = f64::from(2 * k + 1);
            let closed =
                (1.0 - m / 6.0) * (PI / 6.0) / (m * PI / 6.0).sin() / (PI / 3.0) * (4.0 * PI).powi(2 * k);
            assert!((share / closed - 1.0).abs() < 1e-3, "{k}: {share} is not {closed}");
        }
        let [angle, rate] = [0, 1].map(|k| Term {
            source: Source::Turn(1),
            transfer: Transfer::Derivative(k),
            gains: Vec::new(),
        });
        let odd = bands.share(&angle, &rate, &bands.grid(600, 6.0));
        assert_eq!(odd, 0.0);
    }

    #[test]
    fn covariances_are_those_of_smoothed_white_noise() {
        let (dt, fc, n, tau) = (1.0 / 100.0, 3.0, 60_000, 0.08);
        let mut seed = 12;
        let white: Vec<f64> = (0..n).map(|_| normal(&mut seed)).collect();
        let smooth = lowpass_like(&white, dt, fc);
        let rate: Vec<f64> = (0..n)
            .map(|i| if i == 0 || i == n - 1 { 0.0 } else { (smooth[i + 1] - smooth[i - 1]) / (2.0 * dt) })
            .collect();
        let mut disc = vec![0.0; n];
        for i in 1..n {
            disc[i] = disc[i - 1] * (1.0 - dt / tau) - 0.5 * dt * (rate[i] + rate[i - 1]);
        }
        let mean = |x: &[f64], y: &[f64]| -> f64 {
            (1000..x.len() - 1000).map(|i| x[i] * y[i]).sum::<f64>() / (x.len() - 2000) as f64
        };
        let bands = Bands { translation_hz: fc, rotation_hz: fc, passed_hz: vec![fc] };
        let term = |transfer, gain| vec![Term { source: Source::Turn(1), transfer, gains: vec![gain] }];
        let signals = [
            term(Transfer::Derivative(0), 1.0),
            term(Transfer::Derivative(1), 1.0),
            term(Transfer::Washout { time_s: tau }, -1.0),
        ];
        // White noise of variance one at steps dt has the density 2 dt; the smoother's variance is that times
        // ∫H.
        let stated = 2.0 * dt * fc * PI / 3.0;
        let signals: Vec<&[Term]> = signals.iter().map(Vec::as_slice).collect();
        let got = bands.covariances(&signals, 1, &|_, _| stated).block(0, &[0, 1, 2]);
        // The sum of a rate and three times an angle, at some lags.
        let spectrum = bands.spectrum(&signals, &|_| stated);
        let gamma = spectrum.autocovariances(&DVector::from_vec(vec![3.0, 1.0, 0.0]), dt, 40);
        let sum: Vec<f64> = smooth.iter().zip(&rate).map(|(a, b)| 3.0 * a + b).collect();
        for lag in [0, 5, 15, 39] {
            let seen = mean(&sum[..n - lag], &[&sum[lag..], &vec![0.0; lag]].concat()[..n - lag]);
            assert!((gamma[lag] - seen).abs() < 0.06 * gamma[0], "lag {lag}: {} is not {seen}", gamma[lag]);
        }
        let series = [&smooth, &rate, &disc];
        for i in 0..3 {
            for j in 0..3 {
                let size = (got[(i, i)] * got[(j, j)]).sqrt();
                let seen = mean(series[i], series[j]);
                assert!((got[(i, j)] - seen).abs() < 0.06 * size, "{i} {j}: {} is not {seen}", got[(i, j)]);
            }
        }
    }

    #[test]
    fn sources_do_not_mix_and_gains_may_change() {
        let bands = Bands { translation_hz: 2.0, rotation_hz: 2.0, passed_hz: vec![2.0] };
        let a =
            [Term { source: Source::Position(0), transfer: Transfer::Derivative(0), gains: vec![1.0, 3.0] }];
        let b = [Term { source: Source::Turn(0), transfer: Transfer::Derivative(0), gains: vec![1.0, 1.0] }];
        let got = bands.covariances(&[&a, &b, &[]], 2, &|_, _| 1.0);
        assert_eq!((got.at(0, 0, 1), got.at(0, 2, 2)), (0.0, 0.0));
        assert!((got.at(1, 0, 0) / got.at(0, 0, 0) - 9.0).abs() < 1e-6);
    }
}
