//! Score tests of terms that a fit does not have.

use super::super::assemble::Solved;
use super::super::colour::Colour;
use super::super::condense::Linear;
use super::super::covariance::correlation_lag;
use super::super::disagreement::chi_square_tail;
use super::super::fitter::TIGHTNESS;
use super::super::model::ModelParameter;
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
    fitter.problem.equations = fitter.problem.measurements.equations(&model);
    fitter.point.model = model;
    fitter.at = fitter.problem.evaluate(&fitter.point)?;
    let linear = fitter.linearised(TIGHTNESS[3])?;
    let channels = fitter.problem.weights.len();
    let first = linear.tangent + free;
    let unknowns: Vec<usize> = (first..first + candidates.len()).collect();
    if colour.is_none() {
        return tests_of(&linear, &unknowns, channels);
    }
    unknowns.iter().map(|unknown| coloured_test_of(&linear, &unknowns, *unknown, channels)).collect()
}

/// The test of one of several unknowns, the colour of the errors being that which is the most likely beside it: a term that
/// is missing makes residuals that hang together, and would hide in a colour taken from them.
fn coloured_test_of(
    linear: &Linear,
    unknowns: &[usize],
    unknown: usize,
    channels: usize,
) -> Result<Option<ScoreTest>, IdentifyError> {
    let kept: Vec<usize> =
        (0..linear.rows.nrows()).filter(|k| *k == unknown || !unknowns.contains(k)).collect();
    let place = kept.iter().position(|k| *k == unknown).unwrap_or_default();
    let beside = Linear { rows: linear.rows.select_rows(&kept), ..linear.clone() };
    let whitened = match Colour::find(&beside, channels) {
        Ok(colour) => colour.whitened(&beside),
        // What is free does all that it does.
        Err(IdentifyError::RankZero) => return Ok(None),
        Err(why) => return Err(why),
    };
    Ok(tests_of(&whitened, &[place], channels)?[0])
}

/// The tests of unknowns of a linear model, by their rows, beside all others that are not among them.
///
/// With e what the others leave of an unknown's column, and r of the residuals, the score is s = eᵀr, and
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
    let beside = |k: usize| {
        let column = linear.rows.row(k).transpose();
        let own = &column - base.tr_mul(&(&covariance * (&base * &column)));
        (column, own)
    };
    let (_, residuals) = beside(last);
    let mut left = linear.clone();
    let mut one = |unknown: &usize| {
        let (column, own) = beside(*unknown);
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
    let instants = left.places.iter().map(|p| p.instant).max().unwrap_or(0) + 1;
    let mut scores = DMatrix::zeros(instants, 1);
    for ((place, own), residual) in left.places.iter().zip(own).zip(&residuals) {
        scores[(place.instant, 0)] += own * residual;
    }
    // At least what Newey & West (1994) take for the number of instants.
    let lag =
        correlation_lag(left, &(0..channels)).max((4.0 * (instants as f64 / 100.0).powf(2.0 / 9.0)) as usize);
    bartlett_sum(&scores, lag)[(0, 0)]
}

#[cfg(test)]
mod tests {
    use super::super::super::shooting::Place;
    use super::*;
    use mavsight_random::Random;

    const INSTANTS: usize = 300;
    const CHANNELS: usize = 6;

    /// A slow and a fast column that are free, then a column that is not and is partly like the first, and
    /// residuals of which so much is kept from instant to instant, with `effect` times the last column.
    fn drawn(kept: f64, effect: f64, random: &mut Random) -> Linear {
        let columns = |i: usize, c: usize| {
            let t = i as f64 / 30.0;
            let own = (1.1 * t + c as f64).sin() + 0.5 * (0.4 * t).cos();
            [(0.4 * t).cos(), (2.3 * t + c as f64).sin(), own]
        };
        let mut rows = DMatrix::zeros(4, INSTANTS * CHANNELS);
        let mut places = Vec::new();
        let mut error = [0.0; CHANNELS];
        for i in 0..INSTANTS {
            for (c, error) in error.iter_mut().enumerate() {
                let part = if i == 0 { 1.0 } else { (1.0 - kept * kept).sqrt() };
                *error = kept * *error + part * random.normal();
                let by = columns(i, c);
                let residual = by[0] - 0.3 * by[1] + effect * by[2] + *error;
                rows.set_column(places.len(), &[by[0], by[1], by[2], residual].into());
                places.push(Place { t_s: i as f64 / 30.0, instant: i, channel: c, pixel: [0.0; 2] });
            }
        }
        Linear { rows, places, tangent: 0, log_variances: 0.0 }
    }

    fn test_of(linear: &Linear) -> ScoreTest {
        tests_of(linear, &[2], CHANNELS).expect("a fit")[0].expect("a column of its own")
    }

    /// Least squares with and without the column: the difference of the sums of squares is the chi-square of
    /// white residuals, and the coefficient the step.
    #[test]
    fn the_score_is_that_of_two_fits() {
        let linear = drawn(0.0, 0.1, &mut Random::new(4, 0));
        let found = test_of(&linear);
        let squares = |columns: &[usize]| {
            let x = linear.rows.select_rows(columns).transpose();
            let y = linear.rows.row(3).transpose();
            let values = x.clone().svd(true, true).solve(&y, 1e-12).expect("a solution");
            ((&y - x * &values).norm_squared(), values[values.len() - 1])
        };
        let ((without, _), (with, value)) = (squares(&[0, 1]), squares(&[0, 1, 2]));
        assert!((found.step - value).abs() < 1e-9, "{found:?} {value}");
        // The Bartlett sum may be larger than what it is for white residuals, by its own chance error.
        let ratio = found.chi_square / (without - with);
        assert!((0.5..1.0 + 1e-9).contains(&ratio), "{ratio}");
    }

    #[test]
    fn chance_passes_as_often_as_the_level_says_also_with_residuals_that_hang_together() {
        let runs: usize = 400;
        for (kept, most) in [(0.0, 0.07), (0.8, 0.12)] {
            let mut random = Random::new(9, 0);
            let passed = (0..runs).filter(|_| test_of(&drawn(kept, 0.0, &mut random)).p_value < 0.05).count();
            let share = passed as f64 / runs as f64;
            assert!((0.01..most).contains(&share), "{share} with {kept}");
        }
    }

    /// An effect that makes most of what hangs together in the residuals does not hide in their spread.
    #[test]
    fn a_strong_effect_is_strongly_seen() {
        let mut random = Random::new(11, 0);
        let found = test_of(&drawn(0.5, 3.0, &mut random));
        assert!(found.chi_square > 1000.0 && (found.step - 3.0).abs() < 0.2, "{found:?}");
    }

    /// A strong slow effect looks like correlated errors as long as it is not free.
    #[test]
    fn an_effect_does_not_hide_in_a_colour_that_was_found_without_it() {
        let linear = drawn(0.0, 1.5, &mut Random::new(12, 0));
        let without = Linear { rows: linear.rows.select_rows(&[0, 1, 3]), ..linear.clone() };
        let colour = Colour::find(&without, CHANNELS).expect("a colour");
        let hidden = test_of(&colour.whitened(&linear));
        let found =
            coloured_test_of(&linear, &[2], 2, CHANNELS).expect("a fit").expect("a column of its own");
        assert!(found.chi_square > 2.0 * hidden.chi_square, "{found:?} {hidden:?}");
        assert!((found.step - 1.5).abs() < 0.2, "{found:?}");
    }

    #[test]
    fn chance_passes_as_often_as_the_level_says_beside_a_colour() {
        let (runs, mut random): (usize, _) = (200, Random::new(13, 0));
        let mut p_value = || {
            let linear = drawn(0.8, 0.0, &mut random);
            coloured_test_of(&linear, &[2], 2, CHANNELS).expect("a fit").expect("a column of its own").p_value
        };
        let share = (0..runs).filter(|_| p_value() < 0.05).count() as f64 / runs as f64;
        assert!((0.005..0.1).contains(&share), "{share}");
    }

    #[test]
    fn a_column_that_is_free_already_is_not_tested() {
        let mut linear = drawn(0.0, 0.0, &mut Random::new(5, 0));
        let combination = linear.rows.row(0) * 2.0 - linear.rows.row(1);
        linear.rows.set_row(2, &combination);
        assert_eq!(tests_of(&linear, &[2], CHANNELS).expect("a fit"), [None]);
    }
}
