//! All segments as one quadratic of the start, the parameters and the nuisances.

use super::propagate::TANGENT;
use super::shooting::{Evaluation, Segment, Shooting, gap_information};
use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};

/// Added to a unit diagonal, so that a direction that is not determined keeps its value.
const RIDGE: f64 = 1e-13;

/// The quadratic of all segments in [start, parameters, nuisances, -1], and how the later starts follow.
pub(crate) struct Condensed {
    quadratic: DMatrix<f64>,
    /// Per gap: K with the next start = u - K [u, parameters, nuisances, -1].
    gains: Vec<DMatrix<f64>>,
}

/// Tightness of the gaps between segments ([`gap_information`]), and damping of the start and parameters
/// (Marquardt 1963).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Penalty {
    pub(crate) tightness: f64,
    pub(crate) damping: f64,
}

impl Condensed {
    /// Folds the segments into the first from the last on: at each gap the next start is eliminated, with x =
    /// u + c, u what the segment before leads to and c held near zero (Bock 1983; Albersmeyer & Diehl 2010).
    pub(crate) fn new(
        problem: &Shooting<'_>,
        at: &Evaluation,
        nuisances: &DVector<f64>,
        penalty: Penalty,
    ) -> Result<Self, IdentifyError> {
        let n = at.segments[0].quadratic.ncols();
        let m = at.segments[0].end_by.ncols();
        let k = n - 1 - m;
        let damped = |s: usize| {
            let mut q = at.segments[s].quadratic.clone();
            for i in 0..m {
                q[(i, i)] *= 1.0 + penalty.damping;
            }
            q
        };
        let information = gap_information(penalty.tightness);
        let mut gains = Vec::with_capacity(at.segments.len());
        let mut q = damped(at.segments.len() - 1);
        for s in (0..at.segments.len() - 1).rev() {
            let mut block = q.view((0, 0), (TANGENT, TANGENT)).into_owned();
            for i in 0..TANGENT {
                block[(i, i)] += information[i];
            }
            let top = q.rows(0, TANGENT).into_owned();
            let gain = block.cholesky().ok_or(IdentifyError::RankZero)?.solve(&top);
            q -= top.transpose() * &gain;
            // Top rows as W (L + W)⁻¹ L in place of L - L (L + W)⁻¹ L, which cancels where W is small against
            // L.
            for i in 0..TANGENT {
                for j in 0..n {
                    let value = information[i] * gain[(i, j)];
                    q[(i, j)] = value;
                    q[(j, i)] = value;
                }
            }
            for i in 0..TANGENT {
                for j in 0..i {
                    let mean = 0.5 * (information[i] * gain[(i, j)] + information[j] * gain[(j, i)]);
                    q[(i, j)] = mean;
                    q[(j, i)] = mean;
                }
            }
            gains.push(gain);
            q = fold(&q, &at.segments[s], m) + damped(s);
        }
        gains.reverse();
        let last = n - 1;
        for a in 0..k {
            for b in 0..k {
                q[(m + a, m + b)] += problem.nuisance_gram[(a, b)];
            }
            q[(m + a, m + a)] += 1.0;
            // Rows hold no part of this: the gradient counts each row and the prior once.
            q[(m + a, last)] += at.nuisance_gradient[a];
            q[(last, m + a)] += at.nuisance_gradient[a];
        }
        q[(last, last)] += nuisances.norm_squared();
        Ok(Self { quadratic: q, gains })
    }

    /// Information on [start, parameters, nuisances].
    pub(crate) fn information(&self) -> DMatrix<f64> {
        let n = self.quadratic.ncols() - 1;
        self.quadratic.view((0, 0), (n, n)).into_owned()
    }

    /// The step to the minimum in [start, parameters, nuisances], and the squares that remain there.
    pub(crate) fn minimum(&self) -> Option<(DVector<f64>, f64)> {
        let n = self.quadratic.ncols() - 1;
        let b = self.quadratic.view((0, n), (n, 1)).into_owned();
        let a = self.information();
        let scale = DVector::from_fn(n, |i, _| 1.0 / a[(i, i)].max(f64::MIN_POSITIVE).sqrt());
        let mut scaled = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * scale[i] * scale[j]);
        for i in 0..n {
            scaled[(i, i)] += RIDGE;
        }
        let right = DVector::from_fn(n, |i, _| b[i] * scale[i]);
        let step = scaled.cholesky()?.solve(&right).component_mul(&scale);
        let left = self.quadratic[(n, n)] - b.column(0).dot(&step);
        step.iter().all(|v| v.is_finite()).then_some((step, left))
    }

    /// Steps of all segments' starts for a step of [start, parameters, nuisances]; `constant` 1 goes along
    /// with the gaps, 0 asks for the linear part alone.
    pub(crate) fn expand(&self, at: &Evaluation, step: &DVector<f64>, constant: f64) -> Vec<DVector<f64>> {
        let m = at.segments[0].end_by.ncols();
        let mut out = vec![step.rows(0, TANGENT).into_owned()];
        let mut full = DVector::zeros(step.len() + 1);
        full.rows_mut(0, step.len()).copy_from(step);
        full[step.len()] = -constant;
        for (segment, gain) in at.segments.iter().zip(&self.gains) {
            let mut u = &segment.end_by * full.rows(0, m);
            for i in 0..TANGENT {
                u[i] -= constant * segment.gap[i];
            }
            full.rows_mut(0, TANGENT).copy_from(&u);
            u -= gain * &full;
            full.rows_mut(0, TANGENT).copy_from(&u);
            out.push(u);
        }
        out
    }
}

/// Puts what one segment's end leads to in the place of the next one's start.
fn fold(q: &DMatrix<f64>, segment: &Segment, m: usize) -> DMatrix<f64> {
    let n = q.ncols();
    // x_next = [Φ S 0 gap] [x, parameters, nuisances, -1]; the other variables are kept.
    let mut t = DMatrix::zeros(TANGENT, n);
    t.view_mut((0, 0), (TANGENT, m)).copy_from(&segment.end_by);
    for i in 0..TANGENT {
        t[(i, n - 1)] = segment.gap[i];
    }
    let mut rest = q.clone();
    rest.rows_mut(0, TANGENT).fill(0.0);
    let top = q.rows(0, TANGENT).into_owned();
    let mut cross = top.clone();
    cross.columns_mut(0, TANGENT).fill(0.0);
    rest.columns_mut(0, TANGENT).fill(0.0);
    let mixed = t.transpose() * cross;
    let inner = top.columns(0, TANGENT) * &t;
    rest + &mixed + mixed.transpose() + t.transpose() * inner
}
