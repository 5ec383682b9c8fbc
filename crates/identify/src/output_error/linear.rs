//! The whole flight as one linear model about a point.

use super::condense::Condensed;
use super::propagate::TANGENT;
use super::shooting::{Evaluation, Place};
use nalgebra::{DMatrix, DMatrixView, DVector};

/// Rows of all that was measured, closed gaps allowed for, and of what was known before the flight.
#[derive(Debug, Clone)]
pub(crate) struct Linear {
    /// A column for each row, the prior's last: its derivative by start, parameters and nuisances, and what
    /// was measured less what was predicted, in the units of the weights.
    pub(crate) rows: DMatrix<f64>,
    /// Of the measured rows; instants ascend.
    pub(crate) places: Vec<Place>,
}

impl Linear {
    pub(crate) fn new(at: &Evaluation, condensed: &Condensed) -> Self {
        let n = at.prior.nrows();
        let mut rows = DMatrix::zeros(n, at.places.len() + at.prior.ncols());
        let mut first = 0;
        // Gaps answer to every unknown, if by little: the penalty is finite, and an unstable flight
        // determines its starts well.
        for (segment, start) in at.segments.iter().zip(&condensed.starts) {
            let count = segment.rows.ncols();
            let mut out = rows.columns_mut(first, count);
            out.rows_mut(TANGENT, n - TANGENT).copy_from(&segment.rows.rows(TANGENT, n - TANGENT));
            out += start.tr_mul(&segment.rows.rows(0, TANGENT));
            first += count;
        }
        rows.columns_mut(first, at.prior.ncols()).copy_from(&at.prior);
        Self { rows, places: at.places.clone() }
    }

    /// Unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.rows.nrows() - 1
    }

    /// Derivative of the measured rows, unknowns × rows.
    pub(crate) fn by(&self) -> DMatrixView<'_, f64> {
        self.rows.view((0, 0), (self.unknowns(), self.places.len()))
    }

    /// Residuals of the measured rows.
    pub(crate) fn residuals(&self) -> DVector<f64> {
        self.rows.row(self.unknowns()).columns(0, self.places.len()).transpose()
    }

    /// Squares of all rows as a quadratic of the unknowns and -1.
    fn quadratic(&self) -> DMatrix<f64> {
        &self.rows * self.rows.transpose()
    }

    /// Information on all unknowns.
    pub(crate) fn information(&self) -> DMatrix<f64> {
        let n = self.unknowns();
        self.quadratic().view((0, 0), (n, n)).into_owned()
    }

    /// The step of the unknowns to the least squares, with the inverse of the information.
    pub(crate) fn step(&self, covariance: &DMatrix<f64>) -> DVector<f64> {
        let n = self.unknowns();
        covariance * self.quadratic().view((0, n), (n, 1)).column(0)
    }

    /// Squares that a step of the unknowns makes.
    pub(crate) fn change(&self, step: &DVector<f64>) -> f64 {
        self.rows.rows(0, self.unknowns()).tr_mul(step).norm_squared()
    }

    /// Residuals by instant, from the first with a row, and channel; zero where nothing was seen.
    pub(crate) fn table(&self, channels: usize) -> DMatrix<f64> {
        let (first, last) = (self.first_instant(), self.places.last().map_or(0, |p| p.instant));
        let mut table = DMatrix::zeros(last - first + 1, channels);
        for (place, r) in self.places.iter().zip(&self.residuals()) {
            table[(place.instant - first, place.channel)] = *r;
        }
        table
    }

    pub(crate) fn first_instant(&self) -> usize {
        self.places.first().map_or(0, |p| p.instant)
    }
}
