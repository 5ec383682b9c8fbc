//! How well parameters are known: Cramér-Rao bounds, and their correction for coloured residuals.

use super::condense::{Bound, Linear};
use crate::IdentifyError;
use crate::robust_covariance::{bartlett_sum, widening};
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

pub(crate) struct Covariance {
    /// Of the parameters, for white rows.
    pub(crate) bound: DMatrix<f64>,
    /// Of the parameters, for rows of the colour that was found, widened where that lasts for no small part of the record.
    pub(crate) coloured: DMatrix<f64>,
    /// Of the parameters, for rows that are at times larger than at others; none where chance explains how
    /// they differ.
    pub(crate) uneven: Option<DMatrix<f64>>,
    pub(crate) lag: usize,
    /// What the parameters would still move by, bounds left aside.
    pub(crate) step: DVector<f64>,
}

impl Covariance {
    /// Channels of different series are correlated neither by colour nor by level.
    pub(crate) fn new(
        linear: &Linear,
        parameters: usize,
        series: &[Range<usize>],
    ) -> Result<Self, IdentifyError> {
        let Bound { covariance: bound, influence, step } = linear.bound(parameters)?;
        // The priors' part of the bound is kept.
        let mut coloured = &bound - &influence * influence.transpose();
        let (mut spread, mut is_uneven, mut longest) = (coloured.clone(), false, 0);
        for channels in series {
            let lag = correlation_lag(linear, channels);
            let by_instant = Instants::new(linear, &influence, channels);
            let own = if lag == 0 { by_instant.white() } else { by_instant.colour(lag) };
            if by_instant.is_uneven() {
                (spread, is_uneven) = (spread + by_instant.scores_spread(lag), true);
            } else {
                spread += &own;
            }
            coloured += own;
            longest = longest.max(lag);
        }
        Ok(Self { bound, coloured, uneven: is_uneven.then_some(spread), lag: longest, step })
    }
}

/// Autocorrelations in a row that remain small where residuals are uncorrelated (Politis 2003).
const QUIET: usize = 5;

/// The lag from which residuals are uncorrelated, by the rule of Politis (2003, section 2): twice the lag
/// after which five autocorrelations in a row remain below 2√(log₁₀ n/n), here of all channels of a series
/// together, and at most a fifth of the instants; 0 for white ones, and where there are too few instants for five.
pub(crate) fn correlation_lag(linear: &Linear, series: &Range<usize>) -> usize {
    let table = linear.table(series);
    let instants = table.nrows();
    let longest = instants / 5;
    if longest < QUIET {
        return 0;
    }
    let n = linear.places.iter().filter(|place| series.contains(&place.channel)).count() as f64;
    let limit = 2.0 * (n.log10() / n).sqrt();
    let zero = table.norm_squared();
    if zero == 0.0 {
        return 0;
    }
    let correlation = |lag: usize| {
        let product: f64 =
            table.rows(0, instants - lag).component_mul(&table.rows(lag, instants - lag)).sum();
        (product / zero).abs()
    };
    let mut quiet = 0;
    for lag in 1..=longest {
        quiet = if correlation(lag) < limit { quiet + 1 } else { 0 };
        if quiet == QUIET {
            return (2 * (lag - QUIET)).min(longest);
        }
    }
    longest
}

/// Residuals by instant and channel, and what a unit of each does to the parameters: parameters by channels
/// an instant.
struct Instants {
    residuals: DMatrix<f64>,
    influence: Vec<DMatrix<f64>>,
    rows: Vec<usize>,
}

impl Instants {
    fn new(linear: &Linear, influence: &DMatrix<f64>, series: &Range<usize>) -> Self {
        let residuals = linear.table(series);
        let mut by_instant = vec![DMatrix::zeros(influence.nrows(), series.len()); residuals.nrows()];
        let mut rows = vec![0; residuals.nrows()];
        for (place, influence) in linear.places.iter().zip(influence.column_iter()) {
            if series.contains(&place.channel) {
                by_instant[place.instant].set_column(place.channel - series.start, &influence);
                rows[place.instant] += 1;
            }
        }
        Self { residuals, influence: by_instant, rows }
    }

    /// The parameters' covariance for white rows.
    fn white(&self) -> DMatrix<f64> {
        let p = self.influence.first().map_or(0, DMatrix::nrows);
        self.influence.iter().fold(DMatrix::zeros(p, p), |sum, own| sum + own * own.transpose())
    }

    /// The parameters' covariance for rows that are correlated over instants and channels alike through the
    /// flight (Morelli & Klein 1997, equation 14): the sum of Gᵢᵀ R(j - i) Gⱼ over all i and j.
    ///
    /// R by lag is that of the residuals, tapered flat to half of `lag` and to zero at it (Politis & Romano
    /// 1995).
    ///
    /// The sum is widened as one of Bartlett weights over that lag is ([`widening`]).
    fn colour(&self, lag: usize) -> DMatrix<f64> {
        let p = self.influence.first().map_or(0, DMatrix::nrows);
        let mut out = DMatrix::zeros(p, p);
        let instants = self.residuals.nrows();
        let seen = self.rows.iter().sum::<usize>().max(1) as f64 / self.residuals.ncols() as f64;
        for l in 0..=lag {
            let taper = (2.0 * (1.0 - l as f64 / (lag as f64 + 1.0))).min(1.0);
            let pairs = instants.saturating_sub(l);
            let (before, after) = (self.residuals.rows(0, pairs), self.residuals.rows(l, pairs));
            let correlation = before.transpose() * after * (taper / seen);
            let mut sum = DMatrix::zeros(p, p);
            for i in 0..pairs {
                sum += &self.influence[i] * &correlation * self.influence[i + l].transpose();
            }
            out += &sum;
            if l > 0 {
                out += sum.transpose();
            }
        }
        out * widening(lag, instants).powi(2)
    }

    /// Whether the squares of the instants differ by more than chance, were all rows normal with one
    /// variance: by five standard deviations of their sum of squared deviations.
    fn is_uneven(&self) -> bool {
        let all = self.rows.iter().sum::<usize>() as f64;
        let variance = self.residuals.norm_squared() / all;
        let (mut excess, mut chance) = (0.0, 0.0);
        for (residuals, rows) in self.residuals.row_iter().zip(&self.rows).filter(|(_, rows)| **rows > 0) {
            let n = *rows as f64;
            // Of a chi-square: variance 2n, fourth central moment 12n² + 48n.
            excess += (residuals.norm_squared() / variance - n).powi(2) / (2.0 * n) - 1.0;
            chance += 2.0 + 12.0 / n;
        }
        excess > 5.0 * chance.sqrt()
    }

    /// The parameters' covariance for rows of any variance at any instant (White 1980; Newey & West 1987):
    /// the Bartlett-weighted sum of the products of what the residuals of instants, as they are, do to the
    /// parameters. `lag`, or what Newey & West (1994) take for the number of instants, whichever is more.
    fn scores_spread(&self, lag: usize) -> DMatrix<f64> {
        let effects = self.influence.iter().zip(self.residuals.row_iter());
        let scores: Vec<_> = effects.map(|(influence, r)| r * influence.transpose()).collect();
        let lag = lag.max((4.0 * (scores.len() as f64 / 100.0).powf(2.0 / 9.0)) as usize);
        bartlett_sum(&DMatrix::from_rows(&scores), lag) * widening(lag, scores.len()).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    /// Residuals whose standard deviation is three in a tenth of the flight, that of the most informative
    /// instants, and one else.
    #[test]
    fn a_burst_of_errors_is_found_and_its_spread_is_right() {
        let (instants, channels, runs) = (300, 16, 300_i32);
        let std = |i: usize, burst: f64| if (100..130).contains(&i) { burst } else { 1.0 };
        let influence: Vec<DMatrix<f64>> = (0..instants)
            .map(|i| {
                let informative = if (100..130).contains(&i) { 3.0 } else { 0.5 };
                DMatrix::from_fn(2, channels, |p, c| informative * ((p + 1) as f64 * (c + i) as f64).sin())
            })
            .collect();
        let mut random = Random::new(3, 0);
        let mut drawn = |burst: f64| Instants {
            residuals: DMatrix::from_fn(instants, channels, |i, _| std(i, burst) * random.normal()),
            influence: influence.clone(),
            rows: vec![channels; instants],
        };
        let even = (0..runs).filter(|_| drawn(1.0).is_uneven()).count();
        assert_eq!(even, 0, "of {runs} flights without a burst");
        let exact = influence
            .iter()
            .enumerate()
            .fold(DMatrix::zeros(2, 2), |sum, (i, g)| sum + g * g.transpose() * std(i, 3.0).powi(2));
        let mut mean = DMatrix::zeros(2, 2);
        for _ in 0..runs {
            let flight = drawn(3.0);
            assert!(flight.is_uneven());
            mean += flight.scores_spread(0) / f64::from(runs);
        }
        for k in 0..2 {
            let ratio = mean[(k, k)] / exact[(k, k)];
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
    }
}
