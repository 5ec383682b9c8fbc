//! Whether estimates vary from block to block of a flight by more than their covariance says.

use crate::coloured::{Coloured, ResidualErrors};
use crate::output_error::chi_square_tail;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Blocks of a flight: with fewer, their scatter says little; with more, what is wrong over seconds averages out in none.
const BLOCKS: usize = 8;
/// Chance, over all parameters of a fit, that a covariance is widened which is right.
const LEVEL: f64 = 0.01;

/// Widens the covariance of estimates x = B Xᵀ y where the scores Xᵀr of blocks of rows scatter by more than errors of
/// the known colour would make them.
///
/// The scatter of the scores of eight blocks needs no model of how residuals are correlated within a block (Liang & Zeger
/// 1986): where a model lacks something, residuals have one sign for seconds. What it is over what the known colour lets
/// expect is a chi-square over its degrees of freedom, one less than there are blocks. Where that fails at the level of 1 %,
/// variances are multiplied by it, for the parameters that it enlarges. `correlated` is the number of rows over which errors
/// are correlated all the same; blocks are at least twice as long, and nothing is done where fewer than four fit.
pub(crate) fn widened(
    known: Coloured,
    columns: &DMatrix<f64>,
    bread: &DMatrix<f64>,
    scores: &DMatrix<f64>,
    errors: &ResidualErrors,
    correlated: usize,
) -> Coloured {
    let (rows, count) = columns.shape();
    let blocks = BLOCKS.min(rows / (2 * correlated.max(1)));
    if blocks < 4 {
        return known;
    }
    let whole = spread_of(columns, bread, errors, 0..rows);
    let mut expected = DVector::zeros(count);
    let mut sums = DMatrix::zeros(count, blocks);
    for block in 0..blocks {
        let own = block * rows / blocks..(block + 1) * rows / blocks;
        expected += spread_of(columns, bread, errors, own.clone());
        sums.set_column(block, &scores.rows(own.start, own.len()).row_sum().transpose());
    }
    // Total least squares leaves a mean score, which is of the regressors' errors.
    let mean = sums.column_mean();
    sums.column_iter_mut().for_each(|mut sum| sum -= &mean);
    let moved = bread * sums;
    let degrees = (blocks - 1) as f64;
    let ratio = |k: usize| {
        let level = known.covariance[(k, k)] / whole[k];
        moved.row(k).norm_squared() * blocks as f64 / (degrees * level * expected[k])
    };
    let is_beyond = |k: &usize| chi_square_tail(degrees * ratio(*k), blocks - 1) < LEVEL / count as f64;
    if !(0..count).any(|k| is_beyond(&k)) {
        return known;
    }
    let factors = DVector::from_fn(count, |k, _| ratio(k).max(1.0).sqrt());
    let covariance = known.covariance.component_mul(&(&factors * factors.transpose()));
    Coloured { covariance, degrees: known.degrees.min(degrees) }
}

/// The variances of B Xᵀ e of the rows of a block, for errors e of the known colour.
fn spread_of(
    columns: &DMatrix<f64>,
    bread: &DMatrix<f64>,
    errors: &ResidualErrors,
    own: Range<usize>,
) -> DVector<f64> {
    let mut block = DMatrix::zeros(columns.nrows(), columns.ncols());
    block.rows_mut(own.start, own.len()).copy_from(&columns.rows(own.start, own.len()));
    (bread * block.tr_mul(&errors.spread(&block)) * bread).diagonal()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    const ROWS: usize = 400;

    /// A constant and a column that changes within a second, with white errors and what `missing` adds.
    fn fitted(random: &mut Random, missing: impl Fn(f64) -> f64) -> (Coloured, Coloured, DVector<f64>) {
        let t_s = |k: usize| k as f64 / 30.0;
        let columns = DMatrix::from_fn(ROWS, 2, |k, j| if j == 0 { 1.0 } else { (5.0 * t_s(k)).sin() });
        let y = DVector::from_fn(ROWS, |k, _| missing(t_s(k)) + random.normal());
        let bread = columns.tr_mul(&columns).try_inverse().expect("an inverse");
        let values = &bread * columns.tr_mul(&y);
        let residuals = y - &columns * &values;
        let level = residuals.norm_squared() / (ROWS - 2) as f64;
        let known = Coloured { covariance: &bread * level, degrees: (ROWS - 2) as f64 };
        let white = ResidualErrors { gamma: vec![1.0], once: Vec::new() };
        let mut scores = columns.clone();
        scores.column_iter_mut().for_each(|mut c| c.component_mul_assign(&residuals));
        let wide = widened(known.clone(), &columns, &bread, &scores, &white, 5);
        (known, wide, values)
    }

    #[test]
    fn white_errors_are_widened_as_seldom_as_the_level_says() {
        let mut random = Random::new(8, 0);
        let runs = 1000;
        let changed = (0..runs).filter(|_| {
            let (known, wide, _) = fitted(&mut random, |_| 0.0);
            known != wide
        });
        let count = changed.count();
        assert!(count <= 20, "{count} of {runs}");
    }

    /// An offset that drifts over seconds: the constant's interval holds the mean of many such flights no less than 90 %.
    #[test]
    fn a_slow_drift_widens_the_interval_until_it_holds() {
        let mut random = Random::new(9, 0);
        let runs = 300;
        let (mut by_known, mut by_wide) = (0, 0);
        for _ in 0..runs {
            let phase = random.between(0.0, std::f64::consts::TAU);
            let (known, wide, values) = fitted(&mut random, |t| 2.0 * (1.1 * t + phase).sin());
            let holds = |c: &Coloured| {
                let quantile = crate::student_quantile_975(c.degrees as usize);
                values[0].abs() <= quantile * c.covariance[(0, 0)].sqrt()
            };
            by_known += usize::from(holds(&known));
            by_wide += usize::from(holds(&wide));
        }
        assert!(by_wide * 100 >= 90 * runs, "{by_wide} of {runs}");
        assert!(by_known * 100 <= 80 * runs, "{by_known} of {runs}");
    }

    #[test]
    fn few_rows_are_left_as_they_are() {
        let columns = DMatrix::from_element(20, 1, 1.0);
        let bread = DMatrix::from_element(1, 1, 0.05);
        let scores = DMatrix::from_fn(20, 1, |k, _| if k < 10 { 1.0 } else { -1.0 });
        let white = ResidualErrors { gamma: vec![1.0], once: Vec::new() };
        let known = Coloured { covariance: DMatrix::from_element(1, 1, 1e-6), degrees: 19.0 };
        assert_eq!(widened(known.clone(), &columns, &bread, &scores, &white, 5), known);
        assert_ne!(widened(known.clone(), &columns, &bread, &scores, &white, 1), known);
    }
}
