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

impl Bands {
    /// ∫ 1/(1 + (f/fc)⁶) df of the smoother's low-pass of a source.
    fn smoothed_hz(&self, source: Source) -> f64 {
        let own_hz = match source {
            Source::Position(_) => self.translation_hz,
            Source::Turn(_) => self.rotation_hz,
        };
        own_hz * PI / 3.0
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SourceVariance {
    pub(crate) by_row: Vec<f64>,
    /// What is usual over the flight.
    pub(crate) usual: f64,
}

/// Frequencies of a spectrum, up to five times the lowest bandwidth: beyond, next to nothing passes.
const FREQUENCIES: usize = 300;

/// Errors of some signals over time: their covariance at each time, and their spectrum.
///
/// Errors of the poses reach a signal through the smoother's and all further low-passes, H = 1/(1 + (f/fc)⁶)
/// each. Of white noise of density S a smoother states the variance S∫H, which holds what it could not
/// resolve as well; that is no error of a regression whose both sides have passed the same low-pass, of which
/// S∫H² is noise. The covariance of two signals over the stated variance is ∫ Re(F G*) Π H² df over ∫ H df,
/// with F and G their transfers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SignalErrors {
    step_hz: f64,
    sources: Vec<SourceErrors>,
}

#[derive(Debug, Clone, PartialEq)]
struct SourceErrors {
    variance: SourceVariance,
    ways: Vec<Way>,
    /// Responses of the ways (columns) at each frequency, in roots of the source's variance.
    responses: DMatrix<Complex<f64>>,
    /// Covariances of the ways over the source's variance.
    shares: DMatrix<f64>,
}

/// A way of a source to a signal, with its gain at each row.
#[derive(Debug, Clone, PartialEq)]
struct Way {
    signal: usize,
    gains: Vec<f64>,
}

impl SourceErrors {
    /// The ways to some signals: number, place of the signal among those, and gains.
    fn ways_to<'a>(
        &'a self,
        signals: &'a [usize],
    ) -> impl Iterator<Item = (usize, usize, &'a [f64])> + Clone {
        let place = |way: &Way| signals.iter().position(|s| *s == way.signal);
        self.ways.iter().enumerate().filter_map(move |(k, way)| Some((k, place(way)?, &*way.gains)))
    }
}

impl SignalErrors {
    /// The errors of signals, each the sum of terms, behind some bands.
    pub(crate) fn new(
        bands: &Bands,
        signals: &[&[Term]],
        variance: impl Fn(Source) -> SourceVariance,
    ) -> Self {
        let lowest_hz = bands.passed_hz.iter().copied().fold(f64::INFINITY, f64::min);
        let step_hz = 5.0 * lowest_hz / FREQUENCIES as f64;
        let mut out = Self { step_hz, sources: Vec::new() };
        for source in Source::all() {
            let terms = signals.iter().enumerate().flat_map(|(k, terms)| terms.iter().map(move |t| (k, t)));
            let terms: Vec<(usize, &Term)> = terms.filter(|(_, t)| t.source == source).collect();
            if terms.is_empty() {
                continue;
            }
            let root = (step_hz / bands.smoothed_hz(source)).sqrt();
            let responses = DMatrix::from_fn(FREQUENCIES, terms.len(), |k, j| {
                let f = step_hz * (k as f64 + 0.5);
                let passed: f64 = bands.passed_hz.iter().map(|fc| 1.0 / (1.0 + (f / fc).powi(6))).product();
                terms[j].1.transfer.at(f) * (root * passed)
            });
            let ways =
                terms.iter().map(|(signal, t)| Way { signal: *signal, gains: t.gains.clone() }).collect();
            let shares = responses.ad_mul(&responses).map(|c| c.re);
            out.sources.push(SourceErrors { variance: variance(source), ways, responses, shares });
        }
        out
    }

    /// The covariance of some of the signals at a time.
    pub fn covariance(&self, row: usize, signals: &[usize]) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(signals.len(), signals.len());
        for source in &self.sources {
            let ways = source.ways_to(signals);
            for (a, i, first) in ways.clone() {
                for (b, j, second) in ways.clone() {
                    out[(i, j)] +=
                        source.variance.by_row[row] * source.shares[(a, b)] * first[row] * second[row];
                }
            }
        }
        out
    }

    /// The variance of a signal's error at a time.
    pub fn variance(&self, row: usize, signal: usize) -> f64 {
        let own = [signal];
        let of = |source: &SourceErrors| {
            let ways = source.ways_to(&own);
            let squares = ways.clone().flat_map(|(a, _, first)| {
                ways.clone().map(move |(b, _, second)| source.shares[(a, b)] * first[row] * second[row])
            });
            source.variance.by_row[row] * squares.sum::<f64>()
        };
        self.sources.iter().map(of).sum()
    }

    pub(crate) fn of_signals(&self, kept: &[usize]) -> Self {
        let of = |source: &SourceErrors| {
            let own: Vec<usize> = source.ways_to(kept).map(|(k, ..)| k).collect();
            let way = |(_, signal, gains): (usize, usize, &[f64])| Way { signal, gains: gains.to_vec() };
            SourceErrors {
                ways: source.ways_to(kept).map(way).collect(),
                responses: source.responses.select_columns(&own),
                shares: source.shares.select_rows(&own).select_columns(&own),
                ..source.clone()
            }
        };
        Self { step_hz: self.step_hz, sources: self.sources.iter().map(of).collect() }
    }

    /// Autocovariances at lags 0, 1, ... of steps `dt_s` of the sum of the signals by the given weights, from
    /// the mean gain of each way and the usual variance of each source.
    pub(crate) fn autocovariances(&self, weights: &DVector<f64>, dt_s: f64, lags: usize) -> Vec<f64> {
        let mut power = DVector::zeros(FREQUENCIES);
        for source in &self.sources {
            let weight = |way: &Way| Complex::from(weights[way.signal] * mean(&way.gains));
            let weights = DVector::from_iterator(source.ways.len(), source.ways.iter().map(weight));
            power += (&source.responses * weights).map(|c| c.norm_sqr() * source.variance.usual);
        }
        let angle = 2.0 * PI * self.step_hz * dt_s;
        let at = |l: usize, k: usize| (angle * l as f64 * (k as f64 + 0.5)).cos();
        (0..lags).map(|l| power.iter().enumerate().map(|(k, s)| s * at(l, k)).sum()).collect()
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_pose::lowpass_like;
    use mavsight_random::Random;

    fn errors(bands: &Bands, signals: &[&[Term]], variance: f64) -> SignalErrors {
        SignalErrors::new(bands, signals, |_| SourceVariance { by_row: vec![variance; 2], usual: variance })
    }

    #[test]
    fn shares_are_those_of_the_closed_form() {
        // ∫ x^{2k}/(1 + x⁶)² = (1 - (2k + 1)/6) ∫ x^{2k}/(1 + x⁶), by parts; the latter is (π/6)/sin((2k +
        // 1)π/6).
        let bands = Bands { translation_hz: 2.0, rotation_hz: 5.0, passed_hz: vec![2.0] };
        for k in 0..3 {
            let term =
                Term { source: Source::Position(0), transfer: Transfer::Derivative(k), gains: vec![1.0] };
            let share = errors(&bands, &[&[term]], 1.0).variance(0, 0);
            let m = f64::from(2 * k + 1);
            let closed =
                (1.0 - m / 6.0) * (PI / 6.0) / (m * PI / 6.0).sin() / (PI / 3.0) * (4.0 * PI).powi(2 * k);
            assert!((share / closed - 1.0).abs() < 1e-3, "{k}: {share} is not {closed}");
        }
        let [angle, rate] = [0, 1]
            .map(|k| [Term { source: Source::Turn(1), transfer: Transfer::Derivative(k), gains: vec![1.0] }]);
        let odd = errors(&bands, &[&angle, &rate], 1.0).covariance(0, &[0, 1]);
        assert!(odd[(0, 1)].abs() < 1e-12 * odd[(1, 1)], "{odd}");
    }

    #[test]
    fn covariances_are_those_of_smoothed_white_noise() {
        let (dt, fc, n, tau) = (1.0 / 100.0, 3.0, 60_000, 0.08);
        let mut random = Random::new(12, 0);
        let white: Vec<f64> = (0..n).map(|_| random.normal()).collect();
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
        let term = |transfer, gain| [Term { source: Source::Turn(1), transfer, gains: vec![gain] }];
        let (angle, turn) = (term(Transfer::Derivative(0), 1.0), term(Transfer::Derivative(1), 1.0));
        let washout = term(Transfer::Washout { time_s: tau }, -1.0);
        // White noise of variance one at steps dt has the density 2 dt; the smoother's variance is that times
        // ∫H.
        let errors = errors(&bands, &[&angle, &turn, &washout], 2.0 * dt * fc * PI / 3.0);
        let got = errors.covariance(0, &[0, 1, 2]);
        // The sum of a rate and three times an angle, at some lags.
        let gamma = errors.autocovariances(&DVector::from_vec(vec![3.0, 1.0, 0.0]), dt, 40);
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
        let term = |source, gains| [Term { source, transfer: Transfer::Derivative(0), gains }];
        let (a, b) = (term(Source::Position(0), vec![1.0, 3.0]), term(Source::Turn(0), vec![1.0, 1.0]));
        let got = errors(&bands, &[&a, &b, &[]], 1.0);
        assert_eq!((got.covariance(0, &[0, 1])[(0, 1)], got.variance(0, 2)), (0.0, 0.0));
        assert!((got.variance(1, 0) / got.variance(0, 0) - 9.0).abs() < 1e-12);
        let some = got.of_signals(&[2, 0]);
        assert_eq!(some.covariance(1, &[0, 1]), got.covariance(1, &[2, 0]));
    }
}
