//! The whole flight as one linear model about a point.

use super::condense::Condensed;
use super::fitter::Fitter;
use super::propagate::{TANGENT, difference};
use super::shooting::Record;
use nalgebra::{DMatrix, DVector};

/// Residuals of all rows, closed gaps allowed for, and their derivative by start, parameters and nuisances.
#[derive(Debug, Clone)]
pub(crate) struct Linear {
    /// Unknowns × rows.
    pub(crate) by: DMatrix<f64>,
    /// What was measured less what was predicted, in the units of the weights.
    pub(crate) residual: DVector<f64>,
    /// Instant and channel of each row; instants ascend.
    pub(crate) place: Vec<(usize, usize)>,
    /// Where each row was predicted in the image; the origin for what is no image.
    pub(crate) pixel: Vec<[f64; 2]>,
    /// Inverse variances of the unknowns before the flight.
    prior: DVector<f64>,
    /// How far the point is from their means.
    off: DVector<f64>,
}

impl Linear {
    pub(crate) fn new(fitter: &Fitter<'_>, condensed: &Condensed, records: &[Record]) -> Self {
        let (problem, point) = (&fitter.problem, &fitter.point);
        let (m, k) = (TANGENT + fitter.free().len(), point.nuisances.len());
        let none = DVector::zeros(m + k);
        let closing = condensed.expand(&fitter.at, &none, 1.0);
        // Gaps answer to every unknown, if by little: the penalty is finite, and an unstable flight
        // determines its starts well.
        let starts: Vec<Vec<DVector<f64>>> = (0..m + k)
            .map(|j| {
                let mut unit = none.clone();
                unit[j] = 1.0;
                condensed.expand(&fitter.at, &unit, 0.0)
            })
            .collect();
        let mut by = DMatrix::zeros(m + k, records.len());
        let mut residual = DVector::zeros(records.len());
        for (i, record) in records.iter().enumerate() {
            let seen =
                |start: &DVector<f64>| -> f64 { start.iter().zip(&record.by).map(|(x, b)| x * b).sum() };
            residual[i] = record.row.residual - seen(&closing[record.segment]);
            for (j, start) in starts.iter().enumerate() {
                by[(j, i)] = seen(&start[record.segment]);
            }
            for j in TANGENT..m {
                by[(j, i)] += record.by[j];
            }
            let weight = problem.weights[record.row.channel];
            for (j, d) in problem.measurements.nuisance_row(record.row.nuisance).iter().enumerate() {
                by[(m + j, i)] += weight * d;
            }
        }
        let mut prior = DVector::zeros(m + k);
        let mut off = DVector::zeros(m + k);
        let from_mean = difference(&point.starts[0], &problem.prior_start);
        for j in 0..TANGENT {
            prior[j] = problem.prior_information[j];
            off[j] = from_mean[j];
        }
        prior.rows_mut(m, k).fill(1.0);
        off.rows_mut(m, k).copy_from(&point.nuisances);
        let place = records.iter().map(|r| (r.instant, r.row.channel)).collect();
        let pixel = records.iter().map(|r| r.row.pixel).collect();
        Self { by, residual, place, pixel, prior, off }
    }

    /// Information on all unknowns.
    pub(crate) fn information(&self) -> DMatrix<f64> {
        let mut out = &self.by * self.by.transpose();
        for (j, w) in self.prior.iter().enumerate() {
            out[(j, j)] += w;
        }
        out
    }

    /// The step to the least squares, with the inverse of the information.
    pub(crate) fn step(&self, covariance: &DMatrix<f64>) -> DVector<f64> {
        covariance * (&self.by * &self.residual - self.prior.component_mul(&self.off))
    }

    /// Residuals after a step.
    pub(crate) fn residual_after(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.residual - self.by.tr_mul(step)
    }

    /// Residuals by instant and channel; zero where nothing was seen.
    pub(crate) fn table(&self, residual: &DVector<f64>, channels: usize) -> DMatrix<f64> {
        let first = self.first_instant();
        let last = self.place.last().map_or(first, |p| p.0);
        let mut table = DMatrix::zeros(last - first + 1, channels);
        for ((instant, channel), r) in self.place.iter().zip(residual.iter()) {
            table[(instant - first, *channel)] = *r;
        }
        table
    }

    pub(crate) fn first_instant(&self) -> usize {
        self.place.first().map_or(0, |p| p.0)
    }
}
