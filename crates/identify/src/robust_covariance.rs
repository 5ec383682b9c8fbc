//! Sums of products of scores that are correlated over some rows.

use nalgebra::DMatrix;

/// How the errors of one row go with those of others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Correlation {
    /// Not at all, and all rows alike.
    White,
    /// Over up to so many rows; rows may differ in variance.
    Rows(usize),
}

impl Correlation {
    /// n times the long-run covariance of the rows of `scores`, the middle of a sandwich: [`bartlett_sum`]
    /// with the factor n/(n - p) for the fitted parameters.
    pub(crate) fn sum(self, scores: &DMatrix<f64>) -> DMatrix<f64> {
        let (rows, count) = scores.shape();
        let lag = match self {
            Self::White => 0,
            Self::Rows(lag) => lag,
        };
        bartlett_sum(scores, lag) * (rows as f64 / (rows - count).max(1) as f64)
    }
}

/// Σ_l w_l Σ_i ψ_i ψ_{i+l}ᵀ with Bartlett weights w_l = 1 - |l|/(lag + 1), of rows ψ_i (Newey & West 1987).
/// Positive semidefinite.
pub(crate) fn bartlett_sum(scores: &DMatrix<f64>, lag: usize) -> DMatrix<f64> {
    let rows = scores.nrows();
    let mut sum = scores.tr_mul(scores);
    for l in 1..=lag.min(rows.saturating_sub(1)) {
        let weight = 1.0 - l as f64 / (lag + 1) as f64;
        let product = scores.rows(0, rows - l).tr_mul(&scores.rows(l, rows - l));
        sum += (&product + product.transpose()) * weight;
    }
    sum
}

/// How much wider than by the normal distribution a 95 % interval is whose variance is a [`bartlett_sum`] over `lag` of
/// `rows` rows: where the lag is no small part of the record, that sum is itself uncertain, and too small in the mean. The
/// critical value of Kiefer & Vogelsang (2005, table 1, Bartlett kernel, 97.5 %) over that of the normal distribution.
pub(crate) fn widening(lag: usize, rows: usize) -> f64 {
    let part = ((lag + 1) as f64 / rows as f64).min(1.0);
    1.0 + part * (2.9694 + part * (0.4160 - part * 0.5324)) / 1.96
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    /// The mean of autoregressive rows, correlated over some ten, by a sum over a fifth of the record.
    #[test]
    fn a_long_lag_holds_the_mean_by_a_wider_interval() {
        let (rows, lag, runs) = (400, 80, 2000_u32);
        let mut random = Random::new(8, 0);
        let (mut normal, mut wider) = (0, 0);
        for _ in 0..runs {
            let mut value = random.normal() / (1.0_f64 - 0.8 * 0.8).sqrt();
            let record = DMatrix::from_fn(rows, 1, |_, _| {
                value = 0.8 * value + random.normal();
                value
            });
            let mean = record.mean();
            let std = bartlett_sum(&record.add_scalar(-mean), lag)[0].sqrt() / rows as f64;
            normal += usize::from(mean.abs() < 1.96 * std);
            wider += usize::from(mean.abs() < 1.96 * std * widening(lag, rows));
        }
        let share = |held: usize| held as f64 / f64::from(runs);
        assert!(share(normal) < 0.89, "{}", share(normal));
        assert!((0.91..0.97).contains(&share(wider)), "{}", share(wider));
    }

    #[test]
    fn follows_the_definition_term_by_term() {
        let scores = DMatrix::from_fn(20, 2, |i, j| ((i * (j + 3)) % 7) as f64 - 3.0);
        let mut slow = DMatrix::zeros(2, 2);
        for i in 0..20_usize {
            for k in 0..20_usize {
                let apart = i.abs_diff(k);
                if apart <= 3 {
                    slow += scores.row(i).transpose() * scores.row(k) * (1.0 - apart as f64 / 4.0);
                }
            }
        }
        assert!((Correlation::Rows(3).sum(&scores) - slow * (20.0 / 18.0)).norm() < 1e-9);
    }
}
