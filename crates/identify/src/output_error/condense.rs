//! All segments as one quadratic of the start, the parameters and the nuisances, and as one linear model.

use super::propagate::{difference, moved};
use super::shooting::{Evaluation, Place};
use crate::IdentifyError;
use crate::inverse::inverse;
use nalgebra::{DMatrix, DMatrixView, DVector};
use std::ops::Range;

/// Added to a unit diagonal, so that a direction that is not determined keeps its value.
const RIDGE: f64 = 1e-13;

/// The quadratic of all segments in [start, parameters, nuisances, -1].
pub(crate) struct Condensed {
    quadratic: DMatrix<f64>,
    /// Start of each segment by the variables of the quadratic.
    pub(crate) starts: Vec<DMatrix<f64>>,
    /// What each gap is, from the first on.
    gaps: Vec<Gap>,
    tangent: usize,
}

/// The gap behind a segment, once the measurements behind it are known.
struct Gap {
    /// Less the gap, by the variables with the segment's end in the place of its start.
    gain: DMatrix<f64>,
    /// Of the gap about that.
    covariance: DMatrix<f64>,
}

/// What is known of a segment and of the gap behind it from all measurements.
pub(crate) struct SegmentCovariance {
    /// Of the segment's start, the parameters and the nuisances.
    pub(crate) variables: DMatrix<f64>,
    /// Variances of the gap's degrees of freedom; none behind the last segment.
    pub(crate) gap: Option<DVector<f64>>,
}

/// Tightness of the gaps between segments ([`Evaluation::gap_information`]), and damping of the start and parameters
/// (Marquardt 1963).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Penalty {
    pub(crate) tightness: f64,
    pub(crate) damping: f64,
}

impl Condensed {
    /// Folds the segments into the first from the last on: at each gap the next start is eliminated, with x =
    /// u + c, u the end of the segment before and c held near zero (Bock 1983; Albersmeyer & Diehl 2010).
    pub(crate) fn new(at: &Evaluation, penalty: Penalty) -> Result<Self, IdentifyError> {
        let (n, tangent) = (at.prior.nrows(), at.tangent);
        // All but the nuisances and the constant.
        let damped_rows = tangent + at.parameters;
        let quadratic = |s: usize| {
            let rows = &at.segments[s].rows;
            let mut q = rows * rows.transpose();
            if s == 0 {
                q += &at.prior * at.prior.transpose();
            }
            (0..damped_rows).for_each(|i| q[(i, i)] *= 1.0 + penalty.damping);
            q
        };
        let mut gaps = Vec::with_capacity(at.segments.len());
        let mut q = quadratic(at.segments.len() - 1);
        for s in (0..at.segments.len() - 1).rev() {
            let information = DMatrix::from_diagonal(&at.gap_information(s, penalty.tightness));
            let block = q.view((0, 0), (tangent, tangent)) + &information;
            let top = q.rows(0, tangent).into_owned();
            let factor = block.cholesky().ok_or(IdentifyError::RankZero)?;
            let (gain, covariance) = (factor.solve(&top), factor.inverse());
            q -= top.transpose() * &gain;
            // Top rows as W (L + W)⁻¹ L in place of L - L (L + W)⁻¹ L, which cancels where W is small against
            // L.
            let mut top = &information * &gain;
            let corner = top.columns(0, tangent).into_owned();
            top.columns_mut(0, tangent).copy_from(&((&corner + corner.transpose()) * 0.5));
            q.rows_mut(0, tangent).copy_from(&top);
            q.columns_mut(0, tangent).copy_from(&top.transpose());
            gaps.push(Gap { gain, covariance });
            q = fold(q, &at.segments[s].next) + quadratic(s);
        }
        gaps.reverse();
        let mut starts = vec![DMatrix::identity(tangent, n)];
        for (segment, gap) in at.segments.iter().zip(&gaps) {
            let end = carried(&segment.next, &starts[starts.len() - 1]);
            starts.push(&end - carried(&gap.gain, &end));
        }
        Ok(Self { quadratic: q, starts, gaps, tangent })
    }

    /// Where a segment begins after a step, if the one before ends at a state: the process noise that is then
    /// the most likely follows. `start` is where it began.
    pub(crate) fn start_after(
        &self,
        step: &DVector<f64>,
        segment: usize,
        end: &[f64],
        start: &[f64],
    ) -> Vec<f64> {
        let mut to_end = step.clone();
        to_end.rows_mut(0, self.tangent).copy_from_slice(&difference(end, start));
        let gap = &self.gaps[segment - 1].gain * &to_end;
        moved(start, (to_end.rows(0, self.tangent) - gap).as_slice())
    }

    /// What all measurements say of each segment, from the first on: the smoother of Rauch, Tung & Striebel
    /// (1965) with parameters and nuisances as constant states, from the covariance of the first segment's
    /// variables on.
    pub(crate) fn smoothed(&self, at: &Evaluation, first: DMatrix<f64>) -> Vec<SegmentCovariance> {
        let (n, tangent) = (first.nrows(), self.tangent);
        let mut variables = first;
        let mut out = Vec::with_capacity(at.segments.len());
        for (segment, gap) in at.segments.iter().zip(&self.gaps) {
            let end = segment.next.columns(0, n).into_owned();
            let by_gain = carried(&gap.gain.columns(0, n).into_owned(), &end);
            let of_gap = &by_gain * &variables * by_gain.transpose() + &gap.covariance;
            let start = end - by_gain;
            let top = &start * &variables;
            let mut next = variables.clone();
            next.rows_mut(0, tangent).copy_from(&top);
            next.columns_mut(0, tangent).copy_from(&top.transpose());
            next.view_mut((0, 0), (tangent, tangent)).copy_from(&(top * start.transpose() + &gap.covariance));
            out.push(SegmentCovariance { variables, gap: Some(of_gap.diagonal()) });
            variables = next;
        }
        out.push(SegmentCovariance { variables, gap: None });
        out
    }

    pub(crate) fn information(&self) -> DMatrix<f64> {
        let n = self.quadratic.ncols() - 1;
        self.quadratic.view((0, 0), (n, n)).into_owned()
    }

    /// The step of [start, parameters, nuisances, -1] to the minimum, and the squares that remain there,
    /// where the steps of some parameters (by their places) are given.
    pub(crate) fn minimum(&self, given: &[(usize, f64)]) -> Option<(DVector<f64>, f64)> {
        let n = self.quadratic.ncols() - 1;
        let mut a = self.information();
        let mut b = self.quadratic.view((0, n), (n, 1)).column(0).into_owned();
        let (all, right) = (a.clone(), b.clone());
        for (place, step) in given {
            let row = self.tangent + place;
            b -= a.column(row) * *step;
            a.row_mut(row).fill(0.0);
            a.column_mut(row).fill(0.0);
            a[(row, row)] = 1.0;
            b[row] = *step;
        }
        let scale = a.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
        let scaled = a.component_mul(&(&scale * scale.transpose())) + DMatrix::identity(n, n) * RIDGE;
        let step = scaled.cholesky()?.solve(&b.component_mul(&scale)).component_mul(&scale);
        let left = if given.is_empty() {
            self.quadratic[(n, n)] - b.dot(&step)
        } else {
            self.quadratic[(n, n)] - 2.0 * right.dot(&step) + step.dot(&(all * &step))
        };
        step.iter().all(|v| v.is_finite()).then(|| (step.push(-1.0), left))
    }
}

/// A function of a segment's variables as one of the flight's, of which the segment's start is a function.
pub(super) fn carried(function: &DMatrix<f64>, start: &DMatrix<f64>) -> DMatrix<f64> {
    let tangent = function.nrows();
    let mut out = function.columns(0, tangent) * start;
    let rest = function.ncols() - tangent;
    out.columns_mut(tangent, rest).zip_apply(&function.columns(tangent, rest), |o, f| *o += f);
    out
}

/// Puts what one segment leads to in the place of the next one's start.
fn fold(q: DMatrix<f64>, next: &DMatrix<f64>) -> DMatrix<f64> {
    let tangent = next.nrows();
    let mut top = q.rows(0, tangent).into_owned();
    let corner = top.columns(0, tangent).into_owned();
    top.columns_mut(0, tangent).fill(0.0);
    let mut rest = q;
    rest.rows_mut(0, tangent).fill(0.0);
    rest.columns_mut(0, tangent).fill(0.0);
    let mixed = next.transpose() * (top + corner * next * 0.5);
    rest + &mixed + mixed.transpose()
}

/// Rows of all that was measured, closed gaps allowed for, and of what was known before the flight.
#[derive(Debug, Clone)]
pub(crate) struct Linear {
    /// A column for each row, the prior's last: its derivative by start, parameters and nuisances, and what
    /// was measured less what was predicted, in the units of the weights.
    pub(crate) rows: DMatrix<f64>,
    pub(crate) places: Vec<Place>,
    /// Degrees of freedom of the start.
    pub(crate) tangent: usize,
    /// Sum of the logarithms of the variances, in the units of the weights, by which rows were divided to make them white.
    pub(crate) log_variances: f64,
}

impl Linear {
    pub(crate) fn new(at: &Evaluation, condensed: &Condensed) -> Self {
        let (n, tangent) = (at.prior.nrows(), at.tangent);
        let mut rows = DMatrix::zeros(n, at.places.len() + at.prior.ncols());
        let mut first = 0;
        // Gaps answer to every unknown, if by little: the penalty is finite, and an unstable flight
        // determines its starts well.
        for (segment, start) in at.segments.iter().zip(&condensed.starts) {
            let count = segment.rows.ncols();
            let mut out = rows.columns_mut(first, count);
            out.rows_mut(tangent, n - tangent).copy_from(&segment.rows.rows(tangent, n - tangent));
            out += start.transpose() * segment.rows.rows(0, tangent);
            first += count;
        }
        rows.columns_mut(first, at.prior.ncols()).copy_from(&at.prior);
        Self { rows, places: at.places.clone(), tangent, log_variances: 0.0 }
    }

    pub(crate) fn unknowns(&self) -> usize {
        self.rows.nrows() - 1
    }

    /// Derivative of the measured rows, unknowns × rows.
    pub(crate) fn by(&self) -> DMatrixView<'_, f64> {
        self.rows.view((0, 0), (self.unknowns(), self.places.len()))
    }

    pub(crate) fn residuals(&self) -> DVector<f64> {
        self.rows.row(self.unknowns()).columns(0, self.places.len()).transpose()
    }

    pub(crate) fn information(&self) -> DMatrix<f64> {
        let by = self.rows.rows(0, self.unknowns());
        by * by.transpose()
    }

    /// The step of the unknowns to the least squares, with the inverse of the information.
    pub(crate) fn step(&self, covariance: &DMatrix<f64>) -> DVector<f64> {
        let n = self.unknowns();
        covariance * (self.rows.rows(0, n) * self.rows.row(n).transpose())
    }

    /// Squares that a step of the unknowns makes.
    pub(crate) fn change(&self, step: &DVector<f64>) -> f64 {
        self.rows.rows(0, self.unknowns()).tr_mul(step).norm_squared()
    }

    /// Residuals of a series by instant and channel; zero where nothing was seen.
    pub(crate) fn table(&self, series: &Range<usize>) -> DMatrix<f64> {
        let residuals = self.residuals();
        let own = self.places.iter().zip(&residuals).filter(|(place, _)| series.contains(&place.channel));
        let instants = own.clone().map(|(place, _)| place.instant).max().unwrap_or(0) + 1;
        let mut table = DMatrix::zeros(instants, series.len());
        for (place, r) in own {
            table[(place.instant, place.channel - series.start)] = *r;
        }
        table
    }

    /// What is known of so many parameters, were all rows white.
    pub(crate) fn bound(&self, parameters: usize) -> Result<Bound, IdentifyError> {
        let all = inverse(&self.information()).ok_or(IdentifyError::RankZero)?;
        let covariance = all.view((self.tangent, self.tangent), (parameters, parameters)).into_owned();
        let step = self.step(&all).rows(self.tangent, parameters).into_owned();
        Ok(Bound { covariance, influence: all.rows(self.tangent, parameters) * self.by(), step })
    }
}

/// The bound of Cramér and Rao.
pub(crate) struct Bound {
    pub(crate) covariance: DMatrix<f64>,
    /// What a unit of each row's noise does to the parameters: parameters by rows.
    pub(crate) influence: DMatrix<f64>,
    /// What the parameters would still move by, bounds left aside.
    pub(crate) step: DVector<f64>,
}
