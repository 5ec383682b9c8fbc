//! Errors of measurements that last: part of each channel's variance is new at every instant, part dies away slowly.

use super::covariance::inverse;
use super::linear::Linear;
use crate::IdentifyError;
use nalgebra::DMatrix;

/// The errors of all channels: each is the sum of a white one and of one with the autocorrelation exp(-|t|/τ)
/// (Ornstein & Uhlenbeck 1930), with one τ for all.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Colour {
    /// τ.
    pub(crate) time_s: f64,
    /// Variance of the white part, and of the lasting part over it, by channel.
    pub(crate) channels: Vec<(f64, f64)>,
    /// Share of the lasting part in the variance of all rows together.
    pub(crate) lasting_share: f64,
}

/// Ratios of the lasting part's variance to the white one's that are tried, beside none, each twice the one before.
const FIRST_RATIO: f64 = 1.0 / 16.0;
const RATIOS: usize = 15;
/// Rounds in which unknowns and noise determine each other; each leaves less than a third of the error of the one before.
const ROUNDS: usize = 4;

/// The filter of one channel.
struct Whitener {
    /// By row of the channel: how much of the state is kept since the row before, its gain, one over the standard
    /// deviation of the innovation.
    steps: Vec<(f64, f64, f64)>,
    /// Sum of the logarithms of the innovations' variances.
    log_determinant: f64,
}

impl Whitener {
    fn new(times_s: &[f64], tau_s: f64, ratio: f64) -> Self {
        let (mut variance, mut log_determinant) = (ratio, 0.0);
        let mut before_s = None;
        let steps = times_s
            .iter()
            .map(|t_s| {
                let kept = before_s.map_or(0.0, |b: f64| (-(t_s - b) / tau_s).exp());
                before_s = Some(*t_s);
                variance = kept * kept * variance + (1.0 - kept * kept) * ratio;
                let innovation = variance + 1.0;
                let gain = variance / innovation;
                variance *= 1.0 - gain;
                log_determinant += innovation.ln();
                (kept, gain, innovation.sqrt().recip())
            })
            .collect();
        Self { steps, log_determinant }
    }

    /// Whitens the given columns of a matrix, one after the other, in place.
    fn apply(&self, columns: &[usize], matrix: &mut DMatrix<f64>, mean: &mut [f64]) {
        mean.fill(0.0);
        for (column, (kept, gain, unit)) in columns.iter().zip(&self.steps) {
            for (value, m) in matrix.column_mut(*column).iter_mut().zip(mean.iter_mut()) {
                *m *= kept;
                let innovation = *value - *m;
                *m += gain * innovation;
                *value = innovation * unit;
            }
        }
    }

    /// The sum of squares of the whitened columns.
    fn squares(&self, columns: &[usize], matrix: &DMatrix<f64>, mean: &mut [f64]) -> f64 {
        mean.fill(0.0);
        let mut sum = 0.0;
        for (column, (kept, gain, unit)) in columns.iter().zip(&self.steps) {
            let mut here = 0.0;
            for (value, m) in matrix.column(*column).iter().zip(mean.iter_mut()) {
                *m *= kept;
                let innovation = value - *m;
                *m += gain * innovation;
                here += innovation * innovation;
            }
            sum += here * unit * unit;
        }
        sum
    }
}

/// Rows of each channel, and their times.
struct Channels {
    rows: Vec<Vec<usize>>,
    times_s: Vec<Vec<f64>>,
}

impl Channels {
    fn new(linear: &Linear, times_s: &[f64], channels: usize) -> Self {
        let mut out = Self { rows: vec![Vec::new(); channels], times_s: vec![Vec::new(); channels] };
        for (row, (instant, channel)) in linear.place.iter().enumerate() {
            out.rows[*channel].push(row);
            out.times_s[*channel].push(times_s[*instant]);
        }
        out
    }
}

impl Colour {
    /// Finds the noise by restricted maximum likelihood (Patterson & Thompson 1971), in rounds of expectation and
    /// maximisation (Dempster, Laird & Rubin 1977): what the unknowns have taken from the residuals is given back to them.
    pub(crate) fn find(linear: &Linear, times_s: &[f64], channels: usize) -> Result<Self, IdentifyError> {
        let places = Channels::new(linear, times_s, channels);
        let series = DMatrix::from_row_slice(1, linear.residual.len(), linear.residual.as_slice());
        let mut found = Self::most_likely(&places, &series, times_s);
        for _ in 0..ROUNDS {
            let white = found.whitened(linear, times_s);
            let covariance = inverse(&white.information()).ok_or(IdentifyError::RankZero)?;
            let left = linear.residual_after(&white.step(&covariance));
            let root = covariance.cholesky().ok_or(IdentifyError::RankZero)?.l();
            let taken = root.tr_mul(&linear.by);
            let mut series = DMatrix::zeros(taken.nrows() + 1, left.len());
            series.rows_mut(0, 1).copy_from(&left.transpose());
            series.rows_mut(1, taken.nrows()).copy_from(&taken);
            let next = Self::most_likely(&places, &series, times_s);
            let settled = next.is_like(&found);
            found = next;
            if settled {
                break;
            }
        }
        Ok(found)
    }

    fn is_like(&self, other: &Self) -> bool {
        self.time_s == other.time_s
            && self
                .channels
                .iter()
                .zip(&other.channels)
                .all(|(a, b)| a.1 == b.1 && (a.0 / b.0 - 1.0).abs() < 0.02)
    }

    /// The most likely of all τ and ratios tried; variances follow from the squares of the series' columns.
    fn most_likely(places: &Channels, series: &DMatrix<f64>, times_s: &[f64]) -> Self {
        let first_s = places.times_s.iter().flatten().fold(f64::INFINITY, |a, b| a.min(*b));
        let span_s = times_s.last().map_or(0.0, |t| t - first_s);
        let interval_s = span_s / times_s.len().max(2) as f64;
        let mut mean = vec![0.0; series.nrows()];
        let white =
            Self { time_s: interval_s, channels: vec![(1.0, 0.0); places.rows.len()], lasting_share: 0.0 };
        let mut best = (f64::INFINITY, white);
        let mut time_s = 2.0 * interval_s;
        while time_s < span_s {
            let (mut total, mut lasting, mut all) = (0.0, 0.0, 0.0);
            let mut channels = Vec::with_capacity(places.rows.len());
            for place in places.rows.iter().zip(&places.times_s) {
                let (deviance, (white, ratio)) = likeliest_ratio(place, series, time_s, &mut mean);
                let rows = place.0.len() as f64;
                total += deviance;
                lasting += rows * white * ratio;
                all += rows * white * (1.0 + ratio);
                channels.push((white, ratio));
            }
            if total < best.0 {
                best = (total, Self { time_s, channels, lasting_share: lasting / all });
            }
            time_s *= 2.0;
        }
        best.1
    }

    /// The model with rows of unit variance that do not hang together, if these are the errors.
    pub(crate) fn whitened(&self, linear: &Linear, times_s: &[f64]) -> Linear {
        let places = Channels::new(linear, times_s, self.channels.len());
        let mut out = linear.clone();
        let mut residual = DMatrix::from_row_slice(1, linear.residual.len(), linear.residual.as_slice());
        let mut mean = vec![0.0; linear.by.nrows()];
        for ((rows, times_s), (variance, ratio)) in
            places.rows.iter().zip(&places.times_s).zip(&self.channels)
        {
            let filter = Whitener::new(times_s, self.time_s, *ratio);
            filter.apply(rows, &mut out.by, &mut mean);
            filter.apply(rows, &mut residual, &mut mean[..1]);
            let unit = variance.sqrt().recip();
            for row in rows {
                out.by.column_mut(*row).scale_mut(unit);
                out.residual[*row] = residual[(0, *row)] * unit;
            }
        }
        out
    }

    /// Variance of each channel, both parts together, in the units of the weights.
    pub(crate) fn variances(&self) -> impl Iterator<Item = f64> {
        self.channels.iter().map(|(white, ratio)| white * (1.0 + ratio))
    }
}

/// Minus twice the logarithm of a channel's likelihood at a τ, and the white variance and the ratio that make it largest.
fn likeliest_ratio(
    (rows, times_s): (&Vec<usize>, &Vec<f64>),
    series: &DMatrix<f64>,
    tau_s: f64,
    mean: &mut [f64],
) -> (f64, (f64, f64)) {
    if rows.is_empty() {
        return (0.0, (1.0, 0.0));
    }
    let n = rows.len() as f64;
    let mut best = (f64::INFINITY, (1.0, 0.0));
    for k in 0..=RATIOS {
        let ratio = if k == 0 { 0.0 } else { FIRST_RATIO * 2f64.powi(k as i32 - 1) };
        let filter = Whitener::new(times_s, tau_s, ratio);
        let variance = (filter.squares(rows, series, mean) / n).max(f64::MIN_POSITIVE);
        let deviance = n * variance.ln() + filter.log_determinant;
        if deviance < best.0 {
            best = (deviance, (variance, ratio));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_is_the_inverse_root_of_the_covariance() {
        let times_s = [0.0, 0.1, 0.13, 0.5, 0.51, 2.0];
        let x = [0.3, -1.2, 0.7, 2.0, 1.9, -0.4];
        for (tau_s, ratio) in [(0.2, 3.0), (1.5, 100.0), (0.4, 0.0)] {
            let sigma = DMatrix::from_fn(6, 6, |i, j| {
                let lasting = ratio * (-f64::abs(times_s[i] - times_s[j]) / tau_s).exp();
                lasting + if i == j { 1.0 } else { 0.0 }
            });
            let dense = sigma.cholesky().expect("positive definite");
            let column = DMatrix::from_column_slice(6, 1, &x);
            let squares = column.dot(&dense.solve(&column));
            let filter = Whitener::new(&times_s, tau_s, ratio);
            let mut series = DMatrix::from_row_slice(1, 6, &x);
            let rows: Vec<usize> = (0..6).collect();
            assert!((filter.squares(&rows, &series, &mut [0.0]) - squares).abs() < 1e-10 * squares);
            assert!((filter.log_determinant - dense.ln_determinant()).abs() < 1e-10);
            filter.apply(&rows, &mut series, &mut [0.0]);
            assert!((series.norm_squared() - squares).abs() < 1e-10 * squares);
        }
    }
}
