//! How well parameters are known: Cramér-Rao bounds, and their correction for coloured residuals.

use super::condense::Condensed;
use super::linear::Linear;
use super::propagate::TANGENT;
use super::shooting::Point;
use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};

/// Inverse of a positive definite matrix, scaled to a unit diagonal on the way.
pub(crate) fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let scale = DVector::from_fn(n, |i, _| 1.0 / a[(i, i)].sqrt());
    let scaled = DMatrix::from_fn(n, n, |i, j| 0.5 * (a[(i, j)] + a[(j, i)]) * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    let out = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// How many of the unknowns the measurements decide: all but what the nuisances' priors do.
pub(crate) fn effective_parameters(condensed: &Condensed, point: &Point) -> f64 {
    let decided = TANGENT + point.model.free().len();
    let k = point.nuisances.len();
    let undecided = inverse(&condensed.information())
        .map_or(0.0, |c| (0..k).map(|i| c[(decided + i, decided + i)]).sum::<f64>());
    (decided + k) as f64 - undecided
}

/// Bounds and their correction.
pub(crate) struct Covariance {
    /// Of start and parameters, for white rows.
    pub(crate) bound: DMatrix<f64>,
    /// Of the parameters, for rows of the colour that was found.
    pub(crate) coloured: DMatrix<f64>,
    /// Instants over which rows are correlated.
    pub(crate) lag: usize,
}

impl Covariance {
    pub(crate) fn new(linear: &Linear, parameters: usize, channels: usize) -> Result<Self, IdentifyError> {
        let all = inverse(&linear.information()).ok_or(IdentifyError::RankZero)?;
        let m = TANGENT + parameters;
        let bound = all.view((0, 0), (m, m)).into_owned();
        let lag = correlation_lag(linear, channels);
        let own = bound.view((TANGENT, TANGENT), (parameters, parameters)).into_owned();
        // What a unit of each row's noise does to the parameters: parameters by rows.
        let influence = all.rows(TANGENT, parameters) * &linear.by;
        let coloured = own + colour(linear, &influence, (channels, lag));
        Ok(Self { bound, coloured, lag })
    }
}

/// The lag from which residuals are uncorrelated, by the rule of Politis (2003, section 2): twice the lag after which five
/// autocorrelations in a row stay below 2√(log₁₀ n/n), here of all channels together; 0 for white ones.
pub(crate) fn correlation_lag(linear: &Linear, channels: usize) -> usize {
    let table = linear.table(&linear.residual, channels);
    let instants = table.nrows();
    let longest = instants / 5;
    let n = linear.residual.len() as f64;
    let limit = 2.0 * (n.log10() / n).sqrt();
    let zero = table.norm_squared();
    if zero == 0.0 {
        return 0;
    }
    let correlation = |lag: usize| {
        let product: f64 =
            table.rows(0, instants - lag).component_mul(&table.rows(lag, instants - lag)).sum();
        (product / zero).abs()
    };
    let mut quiet = 0;
    for lag in 1..longest {
        quiet = if correlation(lag) < limit { quiet + 1 } else { 0 };
        if quiet == 5 {
            return (2 * (lag - 5)).min(longest);
        }
    }
    longest
}

/// What the correlation of residuals over instants and channels adds to the covariance of white ones (Morelli & Klein
/// 1997, equation 14): the sum of Gᵢᵀ R(j - i) Gⱼ over all i and j, less that of Gᵢᵀ Gᵢ.
///
/// R by lag is that of the residuals, tapered flat to half of `lag` and to zero at it (Politis & Romano 1995); nothing
/// at lag 0, where residuals are white.
fn colour(linear: &Linear, influence: &DMatrix<f64>, (channels, lag): (usize, usize)) -> DMatrix<f64> {
    let p = influence.nrows();
    let mut out = DMatrix::zeros(p, p);
    if lag == 0 {
        return out;
    }
    let table = linear.table(&linear.residual, channels);
    let instants = table.nrows();
    let first = linear.first_instant();
    // Influence by instant: parameters × channels.
    let mut by_instant = vec![DMatrix::zeros(p, channels); instants];
    for (i, (instant, channel)) in linear.place.iter().enumerate() {
        by_instant[instant - first].column_mut(*channel).copy_from(&influence.column(i));
    }
    let seen = table.iter().filter(|v| **v != 0.0).count().max(1) as f64 / channels as f64;
    for l in 0..=lag {
        let taper = (2.0 * (1.0 - l as f64 / (lag as f64 + 1.0))).min(1.0);
        let pairs = instants.saturating_sub(l);
        let correlation = table.rows(0, pairs).transpose() * table.rows(l, pairs) * (taper / seen);
        let mut sum = DMatrix::zeros(p, p);
        for i in 0..pairs {
            sum += &by_instant[i] * &correlation * by_instant[i + l].transpose();
        }
        out += &sum;
        if l > 0 {
            out += sum.transpose();
        }
    }
    out - influence * influence.transpose()
}
