//! Which columns say something that the others have not said.

use crate::orthogonal::Factored;
use nalgebra::{DMatrix, DVector};

/// Columns split into independent ones and those that are combinations of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Dependence {
    /// Indices of independent columns, in order.
    pub independent: Vec<usize>,
    /// Dependent columns.
    pub dependent: Vec<DependentColumn>,
}

/// A column that is a combination of independent ones.
#[derive(Debug, Clone, PartialEq)]
pub struct DependentColumn {
    /// Index.
    pub column: usize,
    /// The factor of each independent column, in their order.
    pub factors: Vec<f64>,
}

impl Dependence {
    /// Whether an independent column's coefficient is determined by itself, that is, carries no dependent
    /// column.
    pub fn stands_alone(&self, position: usize) -> bool {
        self.dependent.iter().all(|d| d.factors[position] == 0.0)
    }
}

/// Part of a column's length below which what is left of it says nothing: no record of rotor speeds or
/// swash-plate angles is good to a millionth.
const LEAST_PART: f64 = 1e-6;

/// Goes through the columns from left to right and keeps each that is not a combination of those kept before.
///
/// A column is a combination when what the kept ones leave of it is below `noise_std`·3·√rows (its own error,
/// were it all noise) or below a millionth of its length. Kept columns without which as little would be left
/// have the factor zero: the combination is of the fewest.
pub fn independent_columns(columns: &DMatrix<f64>, noise_std: &[f64]) -> Dependence {
    let (rows, count) = columns.shape();
    let mut out = Dependence { independent: Vec::new(), dependent: Vec::new() };
    for j in 0..count {
        let column = columns.column(j).into_owned();
        let length = column.norm();
        let noise = 3.0 * noise_std.get(j).copied().unwrap_or(0.0) * (rows as f64).sqrt();
        let (factors, left) = project(columns, &out.independent, &column);
        if length > 0.0 && left > noise.max(LEAST_PART * length) && out.independent.len() < rows {
            out.independent.push(j);
            out.dependent.iter_mut().for_each(|d| d.factors.push(0.0));
        } else {
            let factors = fewest(columns, &out.independent, &column, factors, left.max(LEAST_PART * length));
            out.dependent.push(DependentColumn { column: j, factors });
        }
    }
    out
}

/// Factors of a combination with a zero for each column, from the one that adds least, without which no more
/// than `bound` is left.
fn fewest(
    columns: &DMatrix<f64>,
    kept: &[usize],
    column: &DVector<f64>,
    all: Vec<f64>,
    bound: f64,
) -> Vec<f64> {
    let mut order: Vec<usize> = (0..kept.len()).collect();
    let added = |i: &usize| (all[*i] * columns.column(kept[*i]).norm()).abs();
    order.sort_by(|a, b| added(a).total_cmp(&added(b)));
    let mut needed = vec![true; kept.len()];
    let mut factors = all.clone();
    for i in order {
        needed[i] = false;
        let places: Vec<usize> = (0..kept.len()).filter(|k| needed[*k]).collect();
        let (fewer, left) = project(columns, &places.iter().map(|k| kept[*k]).collect::<Vec<_>>(), column);
        if left > bound {
            needed[i] = true;
            continue;
        }
        factors.fill(0.0);
        places.iter().zip(fewer).for_each(|(k, factor)| factors[*k] = factor);
    }
    factors
}

/// Factors of the kept columns that come nearest to a column, and the length of what is left.
fn project(columns: &DMatrix<f64>, kept: &[usize], column: &DVector<f64>) -> (Vec<f64>, f64) {
    let nothing = (vec![0.0; kept.len()], column.norm());
    if kept.is_empty() {
        return nothing;
    }
    let nearest = Factored::new(&columns.select_columns(kept)).and_then(|f| f.solve(column));
    nearest.map_or(nothing, |(factors, left)| (factors.as_slice().to_vec(), left.norm()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_lean_on_the_intercept() {
        let columns = DMatrix::from_fn(50, 4, |i, j| match j {
            0 => 1.0,
            1 => (i as f64).sin(),
            2 => 4.631,
            _ => 2.0 * (i as f64).sin() + 1.0,
        });
        let d = independent_columns(&columns, &[0.0; 4]);
        assert_eq!(d.independent, [0, 1]);
        assert_eq!(d.dependent.len(), 2);
        assert!((d.dependent[0].factors[0] - 4.631).abs() < 1e-12 && d.dependent[0].factors[1] == 0.0);
        assert!(
            (d.dependent[1].factors[0] - 1.0).abs() < 1e-12
                && (d.dependent[1].factors[1] - 2.0).abs() < 1e-12
        );
        assert!(!d.stands_alone(0) && !d.stands_alone(1));
    }

    /// Rotors moved by one and the same part of their speeds, recorded with eight digits, had coefficients of
    /// 7 ± 22 each, one without any interval.
    #[test]
    fn columns_that_differ_by_the_rounding_of_a_record_alone_are_dependent() {
        let columns = DMatrix::from_fn(600, 3, |i, j| {
            let part = 1.0 + 0.05 * (0.1 * i as f64).sin();
            [1.0, 4.0 * part, (3.0 * part * 1e7).round() * 1e-7][j]
        });
        let d = independent_columns(&columns, &[0.0; 3]);
        assert_eq!(d.independent, [0, 1]);
        assert_eq!(d.dependent[0].factors[0], 0.0);
        assert!((d.dependent[0].factors[1] - 0.75).abs() < 1e-7);
        assert!(d.stands_alone(0) && !d.stands_alone(1));
    }

    #[test]
    fn a_column_lost_in_its_own_noise_is_dependent() {
        let columns = DMatrix::from_fn(100, 2, |i, j| {
            if j == 0 { 1.0 } else { 2.0 + 1e-3 * ((i * 7 % 11) as f64 - 5.0) / 5.0 }
        });
        assert_eq!(independent_columns(&columns, &[0.0, 0.0]).independent, [0, 1]);
        assert_eq!(independent_columns(&columns, &[0.0, 1e-3]).independent, [0]);
    }
}
