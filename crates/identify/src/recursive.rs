//! Least squares row by row, for use in flight.

use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};

/// Least squares that takes one row at a time and forgets old ones at a chosen rate.
///
/// Keeps the triangle R of QR, into which each new row is turned (Golub & Van Loan 2013, section 6.5.3), so
/// that after any number of rows it holds what batch least squares would, without the loss of symmetry that
/// updating the covariance suffers.
#[derive(Debug, Clone, PartialEq)]
pub struct RecursiveLeastSquares {
    /// The triangle of all rows, the output their last column.
    triangle: DMatrix<f64>,
    /// Σ of the rows' weights.
    weight: f64,
    forgetting: f64,
}

impl RecursiveLeastSquares {
    /// For `parameters` columns. `forgetting` λ is the weight that a row keeps from one row to the next: 1
    /// forgets nothing, 0.99 about what is older than 100 rows (Goodwin & Sin 1984).
    ///
    /// # Errors
    /// [`IdentifyError::BadSetting`] for no parameters, or a λ outside 0 < λ ≤ 1.
    pub fn new(parameters: usize, forgetting: f64) -> Result<Self, IdentifyError> {
        if parameters == 0 {
            return Err(IdentifyError::BadSetting { what: "parameters", value: 0.0, must: "be one or more" });
        }
        if !(forgetting > 0.0 && forgetting <= 1.0) {
            let (what, must) = ("forgetting", "be above zero and at most one");
            return Err(IdentifyError::BadSetting { what, value: forgetting, must });
        }
        let triangle = DMatrix::zeros(parameters + 1, parameters + 1);
        Ok(Self { triangle, weight: 0.0, forgetting })
    }

    fn parameters(&self) -> usize {
        self.triangle.ncols() - 1
    }

    /// Takes one row.
    ///
    /// # Errors
    /// [`IdentifyError::BadColumn`] for a row of the wrong length or with a number that is not finite, which
    /// is left out: what was known stands.
    pub fn update(&mut self, regressors: &[f64], output: f64) -> Result<(), IdentifyError> {
        let count = self.parameters();
        if regressors.len() != count || !output.is_finite() || !regressors.iter().all(|v| v.is_finite()) {
            return Err(IdentifyError::BadColumn { what: "the new row".to_owned(), rows: count });
        }
        let mut rows = (&self.triangle * self.forgetting.sqrt()).insert_row(count + 1, output);
        rows.view_mut((count + 1, 0), (1, count)).copy_from_slice(regressors);
        self.triangle = rows.qr().r();
        self.weight = self.weight * self.forgetting + 1.0;
        Ok(())
    }

    /// Values and their covariance for white residuals, σ²(RᵀR)⁻¹; none until there are more rows than
    /// parameters and every one was moved.
    ///
    /// With forgetting, σ² is the weighted mean square and a row counts by its weight, as if old rows were
    /// noisier. Where the truth stands still they are not, and the variance is too large by a factor of up to
    /// 1 + λ.
    pub fn estimate(&self) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let count = self.parameters();
        // What is left of a column beside its length, so that units do not matter.
        let rounding = f64::EPSILON * (self.weight + count as f64);
        let singular = |k: usize| self.triangle[(k, k)].abs() <= rounding * self.triangle.column(k).norm();
        if (0..count).any(singular) {
            return None;
        }
        self.estimate_of(&(0..count).collect::<Vec<_>>())
    }

    /// Σ of the rows' weights: with nothing forgotten, how many there were.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// The triangle R of all rows, RᵀR = XᵀX: its columns depend on each other as those of the regressors do.
    pub fn factor(&self) -> DMatrix<f64> {
        self.triangle.view((0, 0), (self.parameters(), self.parameters())).into_owned()
    }

    /// [`Self::estimate`] for some of the parameters, the others taken as zero: what is left when columns
    /// that are combinations of others ([`crate::independent_columns`]) are put aside. Indices beyond the
    /// columns give none.
    pub fn estimate_of(&self, parameters: &[usize]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let count = self.parameters();
        let degrees = self.weight - parameters.len() as f64;
        if parameters.is_empty() || degrees <= 0.0 || parameters.iter().any(|p| *p >= count) {
            return None;
        }
        let columns = self.triangle.select_columns(parameters);
        let norms = DVector::from_iterator(parameters.len(), columns.column_iter().map(|c| c.norm()));
        let unit = DMatrix::from_diagonal(&norms.map(f64::recip));
        let columns = columns * &unit;
        let output = self.triangle.column(count).into_owned();
        let qr = columns.clone().qr();
        let inverse = qr.r().try_inverse()?;
        let scaled = &inverse * qr.q().tr_mul(&output);
        let variance = (output - columns * &scaled).norm_squared() / degrees;
        let root = &unit * inverse;
        let values = unit * scaled;
        values.iter().all(|v| v.is_finite()).then(|| (values, &root * root.transpose() * variance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Correlation, least_squares, weighted_least_squares};
    use mavsight_random::Random;

    fn problem(rows: usize) -> (DMatrix<f64>, DVector<f64>) {
        let mut random = Random::new(7, 0);
        let x =
            DMatrix::from_fn(rows, 3, |i, j| [1.0, (0.1 * i as f64).sin(), 1e3 * (i as f64).powf(0.7)][j]);
        let y = DVector::from_fn(rows, |i, _| 2.0 - x[(i, 1)] + 3e-3 * x[(i, 2)] + 0.2 * random.normal());
        (x, y)
    }

    fn feed(x: &DMatrix<f64>, y: &DVector<f64>, forgetting: f64) -> RecursiveLeastSquares {
        let mut recursive = RecursiveLeastSquares::new(x.ncols(), forgetting).expect("settings");
        for i in 0..x.nrows() {
            let row: Vec<f64> = x.row(i).iter().copied().collect();
            recursive.update(&row, y[i]).expect("a row");
        }
        recursive
    }

    #[test]
    fn it_is_batch_least_squares_at_every_row() {
        let (x, y) = problem(60);
        let mut recursive = RecursiveLeastSquares::new(3, 1.0).expect("settings");
        for i in 0..60 {
            recursive.update(&[x[(i, 0)], x[(i, 1)], x[(i, 2)]], y[i]).expect("a row");
            let Some((values, covariance)) = recursive.estimate() else {
                assert!(i < 3, "no estimate after {} rows", i + 1);
                continue;
            };
            let (x, y) = (x.rows(0, i + 1).into_owned(), y.rows(0, i + 1).into_owned());
            let batch = least_squares(&x, &y, Correlation::White).expect("a fit");
            assert!((values - &batch.values).component_div(&batch.values).amax() < 1e-9);
            let apart = (covariance - &batch.white_covariance).component_div(&batch.white_covariance);
            assert!(apart.amax() < 1e-7, "{apart}");
        }
    }

    #[test]
    fn forgetting_is_batch_with_fading_weights() {
        let (x, y) = problem(80);
        let lambda: f64 = 0.95;
        let recursive = feed(&x, &y, lambda);
        let std: Vec<f64> = (0..80).map(|i| lambda.powi(i - 79).sqrt()).collect();
        let batch = weighted_least_squares(&x, &y, &std, Correlation::White).expect("a fit");
        let (values, covariance) = recursive.estimate().expect("an estimate");
        assert!((values - &batch.values).component_div(&batch.values).amax() < 1e-9);
        // The same but for the degrees of freedom: the sum of weights instead of the number of rows.
        let weight: f64 = std.iter().map(|s| 1.0 / (s * s)).sum();
        let expected = batch.white_covariance * (77.0 / (weight - 3.0));
        assert!((covariance - &expected).component_div(&expected).amax() < 1e-7);
    }

    #[test]
    fn a_column_that_was_not_moved_has_no_estimate() {
        let (x, y) = problem(30);
        let still = DMatrix::from_fn(30, 3, |i, j| if j == 2 { 2.0 * x[(i, 0)] } else { x[(i, j)] });
        assert!(feed(&still, &y, 1.0).estimate().is_none());
        assert!(feed(&x, &y, 1.0).estimate().is_some());
    }

    #[test]
    fn some_parameters_alone_are_batch_least_squares_of_their_columns() {
        let (x, y) = problem(60);
        let recursive = feed(&x, &y, 1.0);
        for some in [vec![0, 2], vec![1], vec![0, 1, 2]] {
            let (values, covariance) = recursive.estimate_of(&some).expect("an estimate");
            let batch = least_squares(&x.select_columns(&some), &y, Correlation::White).expect("a fit");
            assert!((&values - &batch.values).component_div(&batch.values).amax() < 1e-9);
            let apart = (&covariance - &batch.white_covariance).component_div(&batch.white_covariance);
            assert!(apart.amax() < 1e-7, "{apart}");
        }
        let r = recursive.factor();
        assert!((r.transpose() * &r - x.transpose() * &x).amax() < 1e-9 * (x.transpose() * &x).amax());
        assert!(recursive.weight() == 60.0 && recursive.estimate_of(&[3]).is_none());
        assert!(recursive.estimate_of(&[]).is_none());
    }

    #[test]
    fn bad_rows_change_nothing_and_bad_settings_are_refused() {
        let (x, y) = problem(30);
        let mut recursive = feed(&x, &y, 1.0);
        let before = recursive.clone();
        assert!(matches!(recursive.update(&[1.0, f64::NAN, 0.0], 1.0), Err(IdentifyError::BadColumn { .. })));
        assert!(matches!(recursive.update(&[1.0], 1.0), Err(IdentifyError::BadColumn { .. })));
        assert_eq!(recursive, before);
        for (parameters, forgetting) in [(0, 1.0), (2, 0.0), (2, 1.1), (2, f64::NAN)] {
            let refused = RecursiveLeastSquares::new(parameters, forgetting);
            assert!(matches!(refused, Err(IdentifyError::BadSetting { .. })), "{refused:?}");
        }
    }
}
