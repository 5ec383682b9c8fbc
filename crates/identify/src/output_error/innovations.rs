//! The flight about a point as the innovations of a Kalman filter.

use super::condense::{Linear, carried};
use super::shooting::{Evaluation, Segment};
use nalgebra::{DMatrix, DVector};

/// What the filter expects of a segment's start: a linear function of the flight's unknowns, and a root of the
/// covariance, S of S Sᵀ.
struct Expected {
    mean: DMatrix<f64>,
    root: DMatrix<f64>,
}

impl Expected {
    /// Takes in a row, which becomes its innovation in units of the standard deviation (Potter's form of the
    /// update; Bierman 1977, section II.8); the innovation's variance.
    fn update(&mut self, row: &mut DVector<f64>) -> f64 {
        let by = row.rows(0, self.root.nrows()).into_owned();
        row.rows_mut(0, by.len()).fill(0.0);
        row.gemv_tr(1.0, &self.mean, &by, 1.0);
        let seen = self.root.tr_mul(&by);
        let variance = 1.0 + seen.norm_squared();
        let gain = &self.root * &seen / variance;
        self.mean.ger(-1.0, &gain, row, 1.0);
        self.root.ger(-1.0 / (1.0 + variance.sqrt().recip()), &gain, &seen, 1.0);
        *row /= variance.sqrt();
        variance
    }

    /// Moves on to the next segment, whose start differs from this one's end by noise.
    fn next(&self, segment: &Segment, noise_std: &DVector<f64>) -> Self {
        let tangent = noise_std.len();
        let mut both = DMatrix::zeros(2 * tangent, tangent);
        both.rows_mut(0, tangent).copy_from(&(segment.next.columns(0, tangent) * &self.root).transpose());
        both.rows_mut(tangent, tangent).copy_from(&DMatrix::from_diagonal(noise_std));
        Self { mean: carried(&segment.next, &self.mean), root: both.qr().r().transpose() }
    }
}

/// Rows of innovations: each measurement less what the model and all earlier ones expect of it, linear in the
/// flight's unknowns, over its standard deviation (Kalman 1960; the prediction errors of Ljung 1999, section
/// 7.2). With noise as modelled they are independent and of unit variance.
pub(super) fn innovations(at: &Evaluation, tightness: f64) -> Linear {
    let (n, tangent) = (at.prior.nrows(), at.tangent);
    let mut expected =
        Expected { mean: DMatrix::identity(tangent, n), root: DMatrix::zeros(tangent, tangent) };
    let mut log_variances = 0.0;
    let mut columns = Vec::with_capacity(at.places.len() + at.prior.ncols());
    for (s, segment) in at.segments.iter().enumerate() {
        for row in segment.rows.column_iter() {
            let mut row = row.into_owned();
            log_variances += expected.update(&mut row).ln();
            columns.push(row);
        }
        expected = expected.next(segment, &at.gap_information(s, tightness).map(|i| i.sqrt().recip()));
    }
    columns.extend(at.prior.column_iter().map(|c| c.into_owned()));
    Linear { rows: DMatrix::from_columns(&columns), places: at.places.clone(), tangent, log_variances }
}
