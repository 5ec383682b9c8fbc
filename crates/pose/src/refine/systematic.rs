//! Variance of the systematic errors of centres, from a flight whose markers and cameras are uncertain too.

use crate::moving::Reduced;
use crate::reprojection::HUBER_MEAN;
use nalgebra::{DMatrix, DVector, Vector3};

/// Variances of a centre's coordinate: of its constant error, and of the one that lasts a second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct SystematicVariance {
    pub(super) constant_px2: f64,
    pub(super) for_a_second_px2: f64,
}

impl SystematicVariance {
    pub(super) fn std_px(&self) -> f64 {
        (self.constant_px2 + self.for_a_second_px2).sqrt()
    }
}

/// Standard deviations that are weighed, over the stated one: from no effect to more than any light causes.
const FROM: f64 = 1.0 / 64.0;
const TO: f64 = 8.0;
/// Steps between them, half an octave each: variances of a dozen degrees of freedom are not known better.
const STEPS: usize = 19;
/// Rounds in which the noise is adapted; it rests on hundreds of residuals and hardly changes.
const ROUNDS: usize = 2;

/// The linearised equations of a fit without systematic errors of centres, second by second.
pub(super) struct LinearFit<'a> {
    /// Poses eliminated, with gradients at the minimum.
    pub(super) seconds: Vec<Reduced>,
    /// The change along each direction, and the minimum along them; the centres' coordinates are the last.
    pub(super) directions: &'a DMatrix<f64>,
    pub(super) state: &'a DVector<f64>,
    pub(super) offsets: usize,
    /// Information before the flight, by direction but the centres'.
    pub(super) prior: DVector<f64>,
    /// On stated covariances.
    pub(super) factor: f64,
    /// Stated variance of a centre in one frame.
    pub(super) stated_px2: f64,
}

impl LinearFit<'_> {
    /// Means over the posterior: the likelihood of all residuals with poses, cameras, markers and errors of
    /// centres integrated out (Patterson & Thompson 1971; MacKay 1992), times half-normal priors of both
    /// standard deviations (Gelman 2006) as wide as the stated ones, as all of those may be systematic.
    pub(super) fn systematic_variance(mut self) -> SystematicVariance {
        let at_zero = self.count_from_zero();
        let ratio = (TO / FROM).powf(1.0 / (STEPS - 1) as f64);
        let unit_px2 = self.stated_px2 * self.factor;
        let grid = (0..STEPS).map(|k| FROM * ratio.powi(k as i32));
        // Steps are even in the logarithm, so that each is as wide as its standard deviation.
        let grid: Vec<(f64, f64)> = grid.map(|x| (x * x * unit_px2, x * x - 2.0 * x.ln())).collect();
        let mut out = SystematicVariance::default();
        for _ in 0..ROUNDS {
            // Deviance, and what is averaged: the variances and the factor.
            let mut weighed: Vec<(f64, Vector3<f64>)> = Vec::new();
            for &(for_a_second_px2, of_second) in &grid {
                let Some(seconds) = self.joined(for_a_second_px2) else { continue };
                for &(constant_px2, of_all) in &grid {
                    if let Some((deviance, factor)) = self.deviance(&seconds, at_zero, constant_px2) {
                        let of_both = Vector3::new(constant_px2, for_a_second_px2, factor);
                        weighed.push((deviance + of_second + of_all, of_both));
                    }
                }
            }
            let least = weighed.iter().fold(f64::INFINITY, |a, w| a.min(w.0));
            let weight = |deviance: f64| (0.5 * (least - deviance)).exp();
            let total: f64 = weighed.iter().map(|w| weight(w.0)).sum();
            if total > 0.0 {
                let mean = weighed.iter().map(|w| w.1 * weight(w.0)).sum::<Vector3<f64>>() / total;
                out = SystematicVariance { constant_px2: mean.x, for_a_second_px2: mean.y };
                self.factor = mean.z;
            }
        }
        out
    }

    /// Moves gradients to the parameters' zero; the sum of squares there.
    fn count_from_zero(&mut self) -> f64 {
        let moved = self.directions * self.state;
        let mut squares = 0.0;
        for second in &mut self.seconds {
            let pull = &second.normal * &moved;
            squares += second.weighted + 2.0 * second.gradient.dot(&moved) + pull.dot(&moved);
            second.gradient += pull;
        }
        squares
    }

    /// All seconds with the errors that last a second eliminated.
    fn joined(&self, for_a_second_px2: f64) -> Option<Reduced> {
        let rows = self.directions.nrows();
        let mut out = Reduced::new(rows);
        for second in &self.seconds {
            let mut own = second.clone();
            own.eliminate_changes(rows - self.offsets, self.factor / for_a_second_px2)?;
            out.join(&own);
        }
        Some(out)
    }

    /// Minus twice the log likelihood, and the factor on stated covariances that the residuals then show.
    fn deviance(&self, all: &Reduced, at_zero: f64, constant_px2: f64) -> Option<(f64, f64)> {
        let mut prior = self.prior.clone();
        let first = prior.len() - self.offsets;
        prior.rows_mut(first, self.offsets).fill(1.0 / constant_px2);
        let mut information = self.directions.tr_mul(&all.normal) * self.directions / self.factor;
        information.set_diagonal(&(information.diagonal() + &prior));
        let pull = self.directions.tr_mul(&all.gradient) / self.factor;
        let factored = information.cholesky()?;
        let quadratic = (at_zero - all.gain) / self.factor - pull.dot(&factored.solve(&pull));
        let freedom = (all.coordinates as f64 - 6.0 * all.instants as f64).max(1.0) * HUBER_MEAN;
        let deviance = quadratic + all.log_determinant + factored.ln_determinant() - prior.map(f64::ln).sum()
            + freedom * self.factor.ln();
        Some((deviance, self.factor * quadratic / freedom))
    }
}
