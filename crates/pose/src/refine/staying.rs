//! How much of the centres' errors stays, from a flight in which markers and cameras are not known either.

use crate::estimate::HUBER_MEAN;
use crate::moving::Reduced;
use nalgebra::{DMatrix, DVector};

/// Variances of a coordinate of a centre: of what stays all the flight, and of what stays for a second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Stays {
    pub(super) all_the_while_px2: f64,
    pub(super) for_a_second_px2: f64,
}

impl Stays {
    pub(super) fn std_px(&self) -> f64 {
        (self.all_the_while_px2 + self.for_a_second_px2).sqrt()
    }
}

/// Standard deviations that are weighed, in claims: from what changes nothing to more than any camera's light does.
const FROM: f64 = 1.0 / 64.0;
const TO: f64 = 8.0;
/// Steps between them, half an octave each: variances of a dozen degrees of freedom are not known better.
const STEPS: usize = 19;
/// Rounds in which the noise follows; it rests on hundreds of residuals and hardly moves.
const ROUNDS: usize = 2;

/// A fit's equations that hold no error of centres that stays, linearised, second by second.
pub(super) struct Staying<'a> {
    /// Poses eliminated, with gradients from the parameters' zero.
    pub(super) seconds: Vec<Reduced>,
    /// What each direction changes, and where the fit came to rest along them; the centres' coordinates are the last.
    pub(super) directions: &'a DMatrix<f64>,
    pub(super) state: &'a DVector<f64>,
    pub(super) offsets: usize,
    /// Information before the flight, by direction but the centres'.
    pub(super) prior: DVector<f64>,
    /// On claimed covariances.
    pub(super) factor: f64,
    /// What centres claim, of one frame.
    pub(super) claimed_px2: f64,
}

impl Staying<'_> {
    /// Means over the posterior: the likelihood of all residuals with poses, cameras, markers and errors of centres integrated
    /// out (Patterson and Thompson 1971; MacKay 1992), times half-normal priors of both standard deviations (Gelman 2006) as wide
    /// as what centres claim, as that may stay where a flight tells nothing.
    pub(super) fn found(mut self) -> Stays {
        let at_zero = self.count_from_zero();
        let ratio = (TO / FROM).powf(1.0 / (STEPS - 1) as f64);
        let unit_px2 = self.claimed_px2 * self.factor;
        let grid = (0..STEPS).map(|k| FROM * ratio.powi(k as i32));
        // Steps are even in the logarithm, so that each is as wide as its standard deviation.
        let grid: Vec<(f64, f64)> = grid.map(|x| (x * x * unit_px2, x * x - 2.0 * x.ln())).collect();
        let mut stays = Stays::default();
        for _ in 0..ROUNDS {
            let mut weighed = Vec::new();
            for &(for_a_second_px2, of_second) in &grid {
                let Some(seconds) = self.joined(for_a_second_px2) else { continue };
                for &(all_the_while_px2, of_all) in &grid {
                    if let Some((deviance, factor)) = self.deviance(&seconds, at_zero, all_the_while_px2) {
                        let values = [all_the_while_px2, for_a_second_px2, factor];
                        weighed.push((deviance + of_second + of_all, values));
                    }
                }
            }
            let least = weighed.iter().fold(f64::INFINITY, |a, w| a.min(w.0));
            let (mut sums, mut weights) = ([0.0; 3], 0.0);
            for (deviance, values) in weighed {
                let weight = (0.5 * (least - deviance)).exp();
                sums.iter_mut().zip(values).for_each(|(s, v)| *s += weight * v);
                weights += weight;
            }
            if weights > 0.0 {
                let [all_the_while_px2, for_a_second_px2, factor] = sums.map(|s| s / weights);
                stays = Stays { all_the_while_px2, for_a_second_px2 };
                self.factor = factor;
            }
        }
        stays
    }

    /// Counts gradients from the parameters' zero; the sum of squares there.
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

    /// All seconds with what stays for each eliminated: the equations, by how much it lowers the squares, and its part of the deviance.
    fn joined(&self, for_a_second_px2: f64) -> Option<(Reduced, f64, f64)> {
        let rows = self.directions.nrows();
        let weight = self.factor / for_a_second_px2;
        let (mut all, mut gain, mut logarithms) = (Reduced::new(rows), 0.0, 0.0);
        for second in &self.seconds {
            let mut own = second.clone();
            let (lower, log_determinant) = own.eliminate_changes(rows - self.offsets, weight)?;
            gain += lower;
            logarithms += log_determinant - self.offsets as f64 * weight.ln();
            all.join(&own);
        }
        Some((all, gain, logarithms))
    }

    /// Minus twice the logarithm of the likelihood, and the factor on claimed covariances that the residuals then show.
    fn deviance(
        &self,
        (all, gain, of_seconds): &(Reduced, f64, f64),
        at_zero: f64,
        all_the_while_px2: f64,
    ) -> Option<(f64, f64)> {
        let mut prior = self.prior.clone();
        let first = prior.len() - self.offsets;
        prior.rows_mut(first, self.offsets).fill(1.0 / all_the_while_px2);
        let mut information = self.directions.tr_mul(&all.normal) * self.directions / self.factor;
        information.set_diagonal(&(information.diagonal() + &prior));
        let pull = self.directions.tr_mul(&all.gradient) / self.factor;
        let factored = information.cholesky()?;
        let quadratic = (at_zero - gain) / self.factor - pull.dot(&factored.solve(&pull));
        let freedom = (all.coordinates as f64 - 6.0 * all.instants as f64).max(1.0) * HUBER_MEAN;
        let log_determinant = 2.0 * factored.l_dirty().diagonal().map(f64::ln).sum();
        let deviance =
            quadratic + of_seconds + log_determinant - prior.map(f64::ln).sum() + freedom * self.factor.ln();
        Some((deviance, self.factor * quadratic / freedom))
    }
}
