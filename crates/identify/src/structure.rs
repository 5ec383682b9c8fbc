//! Which regressors a model needs, when nobody has said.

use crate::dependence::independent_columns;
use crate::diagnostics::press;
use crate::{CoefficientTable, IdentifyError};
use nalgebra::{DMatrix, DVector};

/// Changes at most, counted per candidate: they cannot cycle, since each lowers PRESS.
const STEPS_PER_CANDIDATE: usize = 4;

/// The regressors that were chosen, and how the choice went.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Columns, in their order.
    pub chosen: Vec<usize>,
    /// Each change.
    pub steps: Vec<StructureStep>,
    /// Predicted R²: one less PRESS over the sum of squares about the mean (Morelli & Klein 2016, section
    /// 5.4).
    pub predicted_r2: f64,
}

/// One addition or removal of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StructureStep {
    /// The column.
    pub column: usize,
    /// Whether it was added.
    pub is_addition: bool,
    /// PRESS behind the change.
    pub press: f64,
}

/// Chooses regressors step by step: the addition or removal that lowers [`press()`] most, until none does.
///
/// Columns in `always` are kept. Candidates that are combinations of the chosen are passed over. `block` is
/// the number of consecutive rows left out together: about the length of the residuals' correlation (one for
/// white ones), since otherwise too much is chosen. Valid as a search, not as a test: intervals after a
/// choice are a little too narrow.
///
/// # Errors
/// The errors of [`crate::least_squares`]; [`IdentifyError::RankZero`] where `always` names dependent columns
/// or nothing predicts better than zero.
pub fn stepwise(
    candidates: &DMatrix<f64>,
    output: &DVector<f64>,
    always: &[usize],
    block: usize,
) -> Result<Structure, IdentifyError> {
    let count = candidates.ncols();
    let rank = |columns: &[usize]| {
        independent_columns(&candidates.select_columns(columns), &vec![0.0; columns.len()]).independent.len()
    };
    let mut chosen: Vec<usize> = always.to_vec();
    chosen.sort_unstable();
    chosen.dedup();
    if chosen.iter().any(|j| *j >= count) || rank(&chosen) < chosen.len() {
        return Err(IdentifyError::RankZero);
    }
    let left = |columns: &[usize]| {
        if columns.is_empty() {
            Ok(output.norm_squared())
        } else {
            press(&candidates.select_columns(columns), output, block)
        }
    };
    let mut best = left(&chosen)?;
    let mut steps = Vec::new();
    for _ in 0..STEPS_PER_CANDIDATE * count {
        let mut change: Option<(StructureStep, Vec<usize>)> = None;
        for column in (0..count).filter(|j| !always.contains(j)) {
            let mut columns = chosen.clone();
            match columns.binary_search(&column) {
                Ok(at) => drop(columns.remove(at)),
                Err(at) => columns.insert(at, column),
            }
            let is_addition = columns.len() > chosen.len();
            if is_addition && rank(&columns) < columns.len() {
                continue;
            }
            let press = left(&columns)?;
            if press < change.as_ref().map_or(best, |(step, _)| step.press) {
                change = Some((StructureStep { column, is_addition, press }, columns));
            }
        }
        let Some((step, columns)) = change else { break };
        (chosen, best) = (columns, step.press);
        steps.push(step);
    }
    if chosen.is_empty() {
        return Err(IdentifyError::RankZero);
    }
    let spread = output.add_scalar(-output.mean()).norm_squared();
    let predicted_r2 = if spread > 0.0 { 1.0 - best / spread } else { 0.0 };
    Ok(Structure { chosen, steps, predicted_r2 })
}

/// A table with the regressors that [`stepwise`] chooses for each output inside the window; the constant is
/// always kept.
///
/// Blocks are one period of the low-pass of the output long, over which what it leaves is correlated.
///
/// # Errors
/// The errors of [`stepwise`].
pub fn choose_structure(
    table: &CoefficientTable,
) -> Result<(CoefficientTable, Vec<Structure>), IdentifyError> {
    let rows = table.rows_in_window();
    let mut out = table.clone();
    let mut structures = Vec::with_capacity(table.outputs.len());
    for output in &mut out.outputs {
        let is_constant = |j: &usize| output.columns[*j].name == "0";
        let always: Vec<usize> = (0..output.columns.len()).filter(is_constant).collect();
        let block = table.correlated_rows(output.bandwidth_hz, rows.len());
        let structure = stepwise(&output.regressors_at(&rows), &output.values_at(&rows), &always, block)?;
        *output = output.with_columns(&structure.chosen);
        structures.push(structure);
    }
    Ok((out, structures))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    #[test]
    fn finds_what_made_the_output() {
        let (rows, mut random) = (200, Random::new(7, 0));
        let x = DMatrix::from_fn(rows, 8, |i, j| {
            if j == 0 { 1.0 } else { (0.03 * (j * j + 2) as f64 * i as f64).sin() + 0.2 * random.normal() }
        });
        let y =
            DVector::from_fn(rows, |i, _| 3.0 + 1.5 * x[(i, 2)] - 0.7 * x[(i, 5)] + 0.1 * random.normal());
        let found = stepwise(&x, &y, &[0], 1).expect("a structure");
        for j in [0, 2, 5] {
            assert!(found.chosen.contains(&j), "{:?}", found.chosen);
        }
        assert!(found.chosen.len() <= 5, "{:?}", found.chosen);
        assert!(found.predicted_r2 > 0.98 && found.predicted_r2 < 1.0, "{}", found.predicted_r2);
        assert!(found.steps.windows(2).all(|s| s[1].press < s[0].press), "each step lowers PRESS");
        assert_eq!((found.steps[0].column, found.steps[1].column), (2, 5));
    }

    #[test]
    fn a_first_choice_that_others_replace_is_taken_back() {
        // The sum of two regressors, noisy, is the best single one and idle beside both.
        let (rows, mut random) = (300, Random::new(8, 0));
        let mut x = DMatrix::from_fn(rows, 3, |_, _| random.normal());
        for i in 0..rows {
            x[(i, 2)] = x[(i, 0)] + x[(i, 1)] + 0.5 * random.normal();
        }
        let y = DVector::from_fn(rows, |i, _| x[(i, 0)] + x[(i, 1)] + 0.01 * random.normal());
        let found = stepwise(&x, &y, &[], 1).expect("a structure");
        assert_eq!(found.steps[0].column, 2);
        assert!(!found.chosen.contains(&2));
    }

    #[test]
    fn combinations_and_empty_candidates_are_handled() {
        let x = DMatrix::from_fn(50, 3, |i, j| [1.0, (i as f64).sin(), 2.0 * (i as f64).sin()][j]);
        let y = DVector::from_fn(50, |i, _| 1.0 + (i as f64).sin() + 0.01 * (i as f64 * 7.0).cos());
        assert_eq!(stepwise(&x, &y, &[0], 1).expect("a structure").chosen.len(), 2);
        assert_eq!(stepwise(&x, &y, &[1, 2], 1), Err(IdentifyError::RankZero));
        assert_eq!(stepwise(&x, &y, &[9], 1), Err(IdentifyError::RankZero));
        let idle = DMatrix::from_fn(50, 1, |i, _| if i % 2 == 0 { 1.0 } else { -1.0 });
        assert_eq!(stepwise(&idle, &DVector::from_element(50, 1.0), &[], 1), Err(IdentifyError::RankZero));
    }
}
