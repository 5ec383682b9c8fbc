//! Which of two readings of one camera's time stamps the other cameras agree with.

use super::equations::{BOUND, MOST_INSTANTS, Problem, View};
use super::search;
use super::types::{CameraClock, CameraStream};
use crate::reprojection::huber;
use crate::{BodyMarker, Rig};
use nalgebra::Vector2;

/// How much what all cameras saw speaks for one of two readings of a camera's time stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampOdds {
    /// Chi-square of what the first leaves, less that of the second.
    pub ahead: f64,
    /// Chi-square of what the better one leaves.
    pub chi_square: f64,
    /// Variance of the difference by chance alone.
    pub by_chance: f64,
    /// Instants that together say what one says.
    pub correlated: f64,
}

impl StampOdds {
    /// Twice the logarithm of the odds of the second reading against the first, where the difference of the chi-squares is known to
    /// within a doubt: no more than the odds of one normal number, the difference beyond the doubt, against zero.
    pub fn lead(&self, doubt: f64) -> f64 {
        let beyond = (self.ahead.abs() - doubt).max(0.0);
        let by_chance = self.by_chance.max(f64::MIN_POSITIVE);
        self.ahead.signum() * beyond.min(beyond * beyond / by_chance) / self.correlated
    }
}

/// How much what all cameras saw speaks for the second of two readings of one camera's time stamps. None where
/// either reading lets two cameras see too little of the flight.
///
/// Each reading is given the clocks, the poses and the systematic errors of the centres that fit it best, over the whole flight.
/// What is compared is the chi-square of the reprojection errors that remain, at instants of the other cameras that both
/// readings explain, in units of what the better one leaves where that is more than is claimed. Two readings bring other
/// frames together, with other noise, so that their chi-squares differ in hover too: a sum of differences d has the variance
/// Σd² by chance. Errors that last say the same many times over, for as many instants as what the better reading leaves is
/// correlated. The speed of a ball in its image is not used: in a slow flight it is lost in noise, and a step that is one of
/// few needs no derivative.
pub fn odds_of_stamps(
    rig: &Rig,
    markers: &[BodyMarker],
    camera: usize,
    [first, second]: [&[CameraStream]; 2],
) -> Option<StampOdds> {
    if first.len() != rig.cameras.len() || second.len() != rig.cameras.len() {
        return None;
    }
    let of = |streams| fitted(rig, markers, camera, streams);
    let ((mut by_first, first_clocks), (mut by_second, second_clocks)) = (of(first)?, of(second)?);
    // What leaps by one of them counts for neither, and both bound their errors alike.
    by_first.leaping.extend(&by_second.leaping);
    by_second.leaping.clone_from(&by_first.leaping);
    let first_clocks = search::refitted(&mut by_first, first_clocks)?;
    let second_clocks = search::refitted(&mut by_second, second_clocks)?;
    let scale = by_first.scale.min(by_second.scale).max(1.0);
    (by_first.scale, by_second.scale) = (scale, scale);
    let (by_first, by_second) = (by_first.remainders(&first_clocks), by_second.remainders(&second_clocks));
    let compared = |(a, b): (&Option<Remainder>, &Option<Remainder>)| {
        a.as_ref().zip(b.as_ref()).map(|(a, b)| Compared::of(a, b, scale))
    };
    let both: Vec<Compared> = std::iter::zip(&by_first, &by_second).filter_map(compared).collect();
    if both.len() < LEAST_INSTANTS {
        return None;
    }
    let (first, second) = both.iter().fold((0.0, 0.0), |sum, c| (sum.0 + c.first, sum.1 + c.second));
    let correlated = correlated_instants(if first < second { &by_first } else { &by_second });
    let by_chance = both.iter().map(Compared::square_by_chance).sum();
    Some(StampOdds { ahead: first - second, chi_square: first.min(second), by_chance, correlated })
}

/// Chi-squares that two readings leave of one instant, in units of what is usual.
struct Compared {
    first: f64,
    second: f64,
    redundancy: f64,
}

impl Compared {
    fn of(first: &Remainder, second: &Remainder, scale: f64) -> Self {
        let redundancy = 0.5 * (first.redundancy + second.redundancy);
        Self { first: first.loss / scale, second: second.loss / scale, redundancy }
    }

    /// Square of the difference, as far as noise explains it: that of two independent chi-squares has four times their degrees
    /// of freedom on average.
    fn square_by_chance(&self) -> f64 {
        (self.first - self.second).powi(2).min(BOUND * BOUND * 4.0 * self.redundancy)
    }
}

/// Instants that together say what one says: 1 + 2Σρ, where ρ is the correlation of what remains of each centre with the same so
/// many instants later, up to the first that is not positive (Geyer 1992, section 3.3).
fn correlated_instants(remainders: &[Option<Remainder>]) -> f64 {
    let mean_product = |apart: usize| {
        let pairs = std::iter::zip(remainders, remainders.get(apart..).unwrap_or_default());
        let (mut sum, mut count) = (0.0, 0_u32);
        for (a, b) in pairs.filter_map(|(a, b)| a.as_ref().zip(b.as_ref())) {
            for (row, left) in &a.whitened {
                let Some((_, later)) = b.whitened.iter().find(|(other, _)| other == row) else { continue };
                sum += left.dot(later);
                count += 1;
            }
        }
        if count > 0 { sum / f64::from(count) } else { 0.0 }
    };
    let variance = mean_product(0);
    let correlations = (1..remainders.len()).map(|apart| mean_product(apart) / variance);
    1.0 + 2.0 * correlations.take_while(|correlation| *correlation > 0.0).sum::<f64>()
}

/// At fewer instants a median says little of the noise.
const LEAST_INSTANTS: usize = 10;

/// A flight by some time stamps at the instants of the other cameras, and the clocks that fit it best.
fn fitted<'a>(
    rig: &Rig,
    markers: &[BodyMarker],
    camera: usize,
    streams: &'a [CameraStream],
) -> Option<(Problem<'a>, Vec<CameraClock>)> {
    let others = streams.iter().enumerate().filter(|(k, _)| *k != camera).map(|(_, stream)| stream);
    let mut problem = Problem::new(rig, markers, streams);
    problem.look_at(others.max_by_key(|stream| stream.observations.len())?);
    let clocks = search::fitted(&mut problem)?;
    Some((problem, clocks))
}

/// What remains of the reprojection errors of an instant beside its pose.
struct Remainder {
    loss: f64,
    redundancy: f64,
    /// By the row of the centre's systematic error: the whitened residual, bounded.
    whitened: Vec<(usize, Vector2<f64>)>,
}

impl Problem<'_> {
    /// What remains of each instant under some clocks; none of one without a pose by two cameras.
    fn remainders(&self, clocks: &[CameraClock]) -> Vec<Option<Remainder>> {
        let (paths, mut views) = (self.paths(clocks), Vec::new());
        let all: Vec<usize> = (0..self.streams.len()).collect();
        let mut of = |k: usize| {
            let fit = self.pose_of(&paths, k, &all, &mut views)?;
            let left = |v: &View| {
                let whitened = self.scene().at(&v.seen, &fit.world_from_body).ok()?.whitened;
                let root = huber(whitened.norm_squared(), self.bound2()).0.sqrt();
                Some((self.row(v.seen.camera, v.seen.point), whitened * root))
            };
            let (loss, redundancy) = (fit.loss, fit.redundancy() as f64);
            Some(Remainder { loss, redundancy, whitened: views.iter().filter_map(left).collect() })
        };
        (0..self.instants.len()).map(&mut of).collect()
    }

    /// Looks at the instants of one camera alone.
    fn look_at(&mut self, stream: &CameraStream) {
        let mut instants: Vec<f64> =
            stream.observations.iter().map(|o| stream.prior.clock.time_s(o.t_ns, 0.0)).collect();
        instants.dedup();
        let stride = instants.len().div_ceil(MOST_INSTANTS).max(1);
        self.instants = instants.into_iter().step_by(stride).collect();
        self.poses = vec![None; self.instants.len()];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    /// Errors that last were counted as often as there were frames. Of a chain in which each error is the part r of that before, as
    /// many say what one does as (1 + r)/(1 - r).
    #[test]
    fn errors_that_last_count_once_for_as_long_as_they_last() {
        let mut random = Random::new(9, 0);
        for r in [0.0, 0.5, 0.9] {
            let mut errors = [Vector2::zeros(); 8];
            let remainders: Vec<Option<Remainder>> = (0..2000)
                .map(|k| {
                    for e in &mut errors {
                        *e = *e * r + Vector2::from(random.normals());
                    }
                    let whitened = errors.iter().copied().enumerate().map(|(m, e)| (2 * m, e)).collect();
                    (k % 7 != 0).then_some(Remainder { loss: 1.0, redundancy: 10.0, whitened })
                })
                .collect();
            let (got, exact) = (correlated_instants(&remainders), (1.0 + r) / (1.0 - r));
            assert!((got / exact - 1.0).abs() < 0.15, "{r}: {got} for {exact}");
        }
        assert_eq!(correlated_instants(&[]), 1.0);
    }
}
