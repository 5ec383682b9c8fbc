//! How the errors of poses, behind a smoother, reach what is computed from the motion.

use crate::error_rows::ErrorRows;
use std::f64::consts::PI;

/// What errs: the position or the turn of each pose along a body axis, white from pose to pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    Position(usize),
    Turn(usize),
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
    /// Real and imaginary part.
    fn at(self, omega_rad_s: f64) -> (f64, f64) {
        match self {
            Self::Derivative(order) => {
                let size = omega_rad_s.powi(order);
                match order.rem_euclid(4) {
                    0 => (size, 0.0),
                    1 => (0.0, size),
                    2 => (-size, 0.0),
                    _ => (0.0, -size),
                }
            }
            Self::Washout { time_s } => {
                let x = omega_rad_s * time_s;
                (x * x / (1.0 + x * x), x / (1.0 + x * x))
            }
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

/// Frequencies at half steps, and the power that all low-passes let through.
struct Grid {
    step_hz: f64,
    passed: Vec<f64>,
}

impl Bands {
    fn own_hz(&self, source: Source) -> f64 {
        match source {
            Source::Position(_) => self.translation_hz,
            Source::Turn(_) => self.rotation_hz,
        }
    }

    /// Covariance of two signals over the smoother's variance of their source: ∫ Re(F G*) Π H² df over ∫ H
    /// df, where H = 1/(1 + (f/fc)⁶).
    ///
    /// The variance that a smoother states holds what it could not resolve as well, which is no error of a
    /// regression whose both sides have passed the same low-pass: of white noise of density S it is S∫H, of
    /// which S∫H² is noise.
    fn share(&self, a: Transfer, b: Transfer, source: Source, grid: &Grid) -> f64 {
        let sum: f64 = grid
            .passed
            .iter()
            .enumerate()
            .map(|(k, passed)| {
                let omega_rad_s = 2.0 * PI * grid.step_hz * (k as f64 + 0.5);
                let (x, y) = (a.at(omega_rad_s), b.at(omega_rad_s));
                (x.0 * y.0 + x.1 * y.1) * passed
            })
            .sum();
        // ∫ 1/(1 + x⁶) dx from nought on is π/3.
        sum * grid.step_hz / (self.own_hz(source) * PI / 3.0)
    }

    /// Steps up to six times the lowest bandwidth, beyond which next to nothing passes.
    fn grid(&self) -> Grid {
        const POINTS: usize = 600;
        let lowest = self.passed_hz.iter().copied().fold(f64::INFINITY, f64::min);
        let step_hz = 6.0 * lowest / POINTS as f64;
        let passed = |k: usize| {
            let f = step_hz * (k as f64 + 0.5);
            self.passed_hz.iter().map(|fc| (1.0 + (f / fc).powi(6)).powi(-2)).product()
        };
        Grid { step_hz, passed: (0..POINTS).map(passed).collect() }
    }

    /// Covariance of the signals at each row, given the smoother's variance of each source there.
    pub(crate) fn covariances(
        &self,
        signals: &[&[Term]],
        rows: usize,
        variance: &dyn Fn(Source, usize) -> f64,
    ) -> ErrorRows {
        let count = signals.len();
        let grid = self.grid();
        let mut out = ErrorRows::zeros(count, rows);
        let mut sums = vec![0.0; rows];
        let sources = (0..3).flat_map(|axis| [Source::Position(axis), Source::Turn(axis)]);
        let is_met = |s: &Source| signals.iter().any(|terms| terms.iter().any(|t| t.source == *s));
        let variances: Vec<(Source, Vec<f64>)> = sources
            .filter(is_met)
            .map(|source| (source, (0..rows).map(|row| variance(source, row)).collect()))
            .collect();
        for i in 0..count {
            for j in 0..=i {
                sums.fill(0.0);
                for a in signals[i] {
                    for b in signals[j].iter().filter(|b| b.source == a.source) {
                        let share = self.share(a.transfer, b.transfer, a.source, &grid);
                        let own = variances.iter().find(|(source, _)| *source == a.source).map(|v| &v.1);
                        for (row, (sum, variance)) in
                            sums.iter_mut().zip(own.into_iter().flatten()).enumerate()
                        {
                            *sum += share * a.gains[row] * b.gains[row] * variance;
                        }
                    }
                }
                sums.iter().enumerate().for_each(|(row, sum)| out.set(row, (i, j), *sum));
            }
        }
        out
    }
}

/// Spectrum of the errors of some signals, from the mean gain and variance of each way.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorSpectrum {
    step_hz: f64,
    /// For each source, at each frequency, the signals' responses, with the root of the density.
    responses: Vec<Vec<Vec<(f64, f64)>>>,
}

impl ErrorSpectrum {
    /// The spectrum of some of the signals.
    pub(crate) fn of_signals(&self, kept: &[usize]) -> Self {
        let at = |signals: &Vec<(f64, f64)>| kept.iter().map(|j| signals[*j]).collect();
        let responses = self.responses.iter().map(|source| source.iter().map(at).collect()).collect();
        Self { step_hz: self.step_hz, responses }
    }

    /// Power of the sum of the signals by the given weights in each step of the grid.
    fn density(&self, weights: &[f64]) -> Vec<f64> {
        let points = self.responses.first().map_or(0, Vec::len);
        let mut density = vec![0.0; points];
        for responses in &self.responses {
            for (density, signals) in density.iter_mut().zip(responses) {
                let sum = signals.iter().zip(weights).fold((0.0, 0.0), |sum, (response, weight)| {
                    (sum.0 + weight * response.0, sum.1 + weight * response.1)
                });
                *density += sum.0 * sum.0 + sum.1 * sum.1;
            }
        }
        density
    }

    /// Autocovariances at lags 0, 1, ... of steps `dt_s` of the sum of the signals by the given weights.
    pub(crate) fn autocovariances(&self, weights: &[f64], dt_s: f64, lags: usize) -> Vec<f64> {
        let density = self.density(weights);
        let angle = 2.0 * PI * self.step_hz * dt_s;
        (0..lags)
            .map(|l| {
                let at = |(k, s): (usize, &f64)| s * (angle * l as f64 * (k as f64 + 0.5)).cos();
                density.iter().enumerate().map(at).sum::<f64>()
            })
            .collect()
    }
}

impl Bands {
    /// The spectrum of the signals' errors, given the mean variance of each source.
    pub(crate) fn spectrum(&self, signals: &[&[Term]], variance: &dyn Fn(Source) -> f64) -> ErrorSpectrum {
        const POINTS: usize = 300;
        let lowest = self.passed_hz.iter().copied().fold(f64::INFINITY, f64::min);
        let step_hz = 5.0 * lowest / POINTS as f64;
        let mut sources: Vec<Source> = Vec::new();
        for term in signals.iter().flat_map(|s| s.iter()) {
            if !sources.contains(&term.source) {
                sources.push(term.source);
            }
        }
        let responses = sources.into_iter().map(|source| {
            let own = variance(source) / (self.own_hz(source) * PI / 3.0) * step_hz;
            (0..POINTS)
                .map(|k| {
                    let f = step_hz * (k as f64 + 0.5);
                    let passed: f64 =
                        self.passed_hz.iter().map(|fc| 1.0 / (1.0 + (f / fc).powi(6))).product();
                    let root = own.sqrt() * passed;
                    signals.iter().map(|terms| response(terms, source, f, root)).collect()
                })
                .collect()
        });
        ErrorSpectrum { step_hz, responses: responses.collect() }
    }
}

/// Response of a signal to a source at a frequency, times a factor.
fn response(terms: &[Term], source: Source, f_hz: f64, factor: f64) -> (f64, f64) {
    terms.iter().filter(|t| t.source == source).fold((0.0, 0.0), |sum, term| {
        let mean = term.gains.iter().sum::<f64>() / term.gains.len().max(1) as f64;
        let at = term.transfer.at(2.0 * PI * f_hz);
        (sum.0 + factor * mean * at.0, sum.1 + factor * mean * at.1)
    })
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
            let share = bands.share(
                Transfer::Derivative(k),
                Transfer::Derivative(k),
                Source::Position(0),
                &bands.grid(),
            );
            let m = f64::from(2 * k + 1);
            let closed =
                (1.0 - m / 6.0) * (PI / 6.0) / (m * PI / 6.0).sin() / (PI / 3.0) * (4.0 * PI).powi(2 * k);
            assert!((share / closed - 1.0).abs() < 1e-3, "{k}: {share} is not {closed}");
        }
        let odd =
            bands.share(Transfer::Derivative(0), Transfer::Derivative(1), Source::Turn(1), &bands.grid());
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
        let gamma = spectrum.autocovariances(&[3.0, 1.0, 0.0], dt, 40);
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
