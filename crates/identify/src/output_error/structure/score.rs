//! Score tests of terms that a fit does not have.

use super::super::condense::Linear;
use super::super::covariance::correlation_lag;
use super::super::disagreement::chi_square_tail;
use super::super::fit::Solved;
use super::super::fitter::TIGHTNESS;
use super::super::model::{Equations, ModelParameter};
use super::ScoreTest;
use crate::IdentifyError;
use crate::inverse::inverse;
use crate::robust_covariance::bartlett_sum;
use nalgebra::{DMatrix, DVector};

/// Share of the information on a term alone that must be left once all that is free has been fitted: less is
/// rounding.
const LEAST_SHARE: f64 = 1e-8;

/// The score test of each candidate beside all that the fit has found; none of one that does nothing to the
/// measurements which the free parameters, the start and the nuisances could not do as well.
///
/// The flight is linearised at the fit, where each candidate has its present value.
pub(super) fn score_tests(
    solved: Solved<'_>,
    candidates: &[ModelParameter],
) -> Result<Vec<Option<ScoreTest>>, IdentifyError> {
    let Solved { mut fitter, colour, .. } = solved;
    let model = &fitter.point.model;
    let free = model.free().len();
    let names: Vec<&str> = model.free().iter().chain(candidates).map(|p| model.name(*p)).collect();
    let model = model.clone().with_free(&names)?;
    fitter.problem.equations = Equations::new(&model);
    fitter.point.model = model;
    fitter.at = fitter.problem.evaluate(&fitter.point)?;
    let mut linear = fitter.linearised(TIGHTNESS[3])?;
    if let Some(colour) = colour {
        linear = colour.whitened(&linear, &fitter.problem.times_s);
    }
    let first = linear.tangent + free;
    let rows: Vec<usize> = (first..first + candidates.len()).collect();
    tests_of(&linear, &rows, fitter.problem.weights.len())
}

/// The tests of unknowns of a linear model, by their rows, beside all others that are not among them.
///
/// With e what the others leave of an unknown's column and r the residuals, the score is s = eᵀr, and
/// s² over its variance a chi-square of one degree (Rao 1948; Breusch & Pagan 1980). The variance is the
/// Bartlett sum of the scores of instants (Newey & West 1987), and no less than eᵀe, which it is for white
/// residuals of unit variance. The scores in that sum are those that the step s/eᵀe along the unknown leaves:
/// a term that is really missing makes residuals that hang together, and would hide in a variance taken from
/// them.
fn tests_of(
    linear: &Linear,
    unknowns: &[usize],
    channels: usize,
) -> Result<Vec<Option<ScoreTest>>, IdentifyError> {
    let last = linear.unknowns();
    let others: Vec<usize> = (0..last).filter(|k| !unknowns.contains(k)).collect();
    let base = linear.rows.select_rows(&others);
    let covariance = inverse(&(&base * base.transpose())).ok_or(IdentifyError::RankZero)?;
    let residuals = linear.rows.row(last).transpose();
    let mut left = linear.clone();
    let mut one = |unknown: &usize| {
        let column = linear.rows.row(*unknown).transpose();
        let own = &column - base.tr_mul(&(&covariance * (&base * &column)));
        let information = own.norm_squared();
        if information <= LEAST_SHARE * column.norm_squared() {
            return None;
        }
        let score = own.dot(&residuals);
        let step = score / information;
        left.rows.set_row(last, &(&residuals - &own * step).transpose());
        let spread = spread(&left, &own, channels).max(information);
        let chi_square = score * score / spread;
        Some(ScoreTest { chi_square, degrees: 1, p_value: chi_square_tail(chi_square, 1), step })
    };
    Ok(unknowns.iter().map(&mut one).collect())
}

/// The variance of the score of a column, from the scores of instants.
fn spread(left: &Linear, own: &DVector<f64>, channels: usize) -> f64 {
    let residuals = left.residuals();
    let instants = left.places.last().map_or(0, |p| p.instant) + 1;
    let mut scores = DMatrix::zeros(instants, 1);
    for ((place, own), residual) in left.places.iter().zip(own).zip(&residuals) {
        scores[(place.instant, 0)] += own * residual;
    }
    // At least what Newey & West (1994) take for the number of instants.
    let lag = correlation_lag(left, channels).max((4.0 * (instants as f64 / 100.0).powf(2.0 / 9.0)) as usize);
    bartlett_sum(&scores, lag)[(0, 0)]
}
