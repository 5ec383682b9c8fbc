//! How the density of the jerk changes over a flight.
//!
//! The smoother has one density for the whole flight and all axes. A flight hovers and manoeuvres, about one axis more than about
//! others: what the smoother cuts off of the motion is less than that density says in the one, and more in the other.

use crate::smoother::integrator::{chain_of, white_jerk};
use crate::smoother::passes::{Flown, Instant};
use crate::smoother::state::{Adjoint, Joint, MotionNoise};
use std::ops::Range;

/// Share of the variance of a place, its rate and the rate of that which is motion that the smoother cuts off; the rest is noise
/// that it passes. By H = 1/(1 + (f/fc)⁶) it is (2k + 1)/6 of the k-th derivative's: ∫ f²ᵏ H (1 - H) df over ∫ f²ᵏ H df.
const CUT_OFF: [f64; 3] = [1.0 / 6.0, 3.0 / 6.0, 5.0 / 6.0];
/// Share of a change of the density that the energy of the smoothed jerk shows: ∫ H² df over ∫ H df.
const SHOWN: f64 = 5.0 / 6.0;
/// Relative variances of a density from its own window among which a flight chooses: long windows know it better, and lag behind it.
const WINDOW_VARIANCES: [f64; 5] = [1.0, 0.5, 0.25, 0.125, 0.0625];

/// What the smoothed jerk has over an interval, of the six coordinates of a pose.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Energy {
    /// Its square over the density.
    found: [f64; 6],
    /// What is expected of that at this density.
    expected: [f64; 6],
}

impl Energy {
    pub(crate) fn is_finite(&self) -> bool {
        self.found.iter().chain(&self.expected).all(|x| x.is_finite())
    }
}

/// Densities of the jerk over that of the whole flight, of the six coordinates of each pose.
#[derive(Debug, Clone)]
pub(crate) struct Densities(Vec<[f64; 6]>);

impl Densities {
    /// From what the interval before each instant has.
    ///
    /// At ρ times the density the energy is expected to be (1 + (ρ - 1)·`SHOWN`) of that at one, with a relative variance of
    /// 2·`SHOWN` over the latter. Each coordinate's ρ of a window is drawn towards one by the scatter that windows have beyond
    /// chance (James & Stein 1961), and the windows are those of which most scatter is left. Beside measured rates the smoother
    /// has another response for attitudes, and one holds.
    pub(crate) fn of(flown: &Flown<'_>, energies: &[Energy]) -> Self {
        let mut of_instants = vec![[1.0; 6]; energies.len()];
        let chains = if flown.has_rates() { 0..1 } else { 0..2 };
        for coordinates in chains.map(|chain| 3 * chain..3 * chain + 3) {
            let sums: Vec<Sums> = coordinates.clone().map(|c| Sums::of(energies, c)).collect();
            let windows = WINDOW_VARIANCES.map(|variance| Windows::of(&sums, variance));
            let left = |w: &Windows| w.scatter.powi(2) / (w.scatter + w.variance);
            let Some(best) = windows.into_iter().max_by(|a, b| left(a).total_cmp(&left(b))) else { continue };
            for (coordinate, sums) in coordinates.zip(&sums) {
                for (k, own) in of_instants.iter_mut().enumerate() {
                    own[coordinate] = best.density(sums, k);
                }
            }
        }
        let of_pose =
            |(instant, own): (&Instant, &[f64; 6])| matches!(instant, Instant::Pose(_)).then_some(*own);
        Self(flown.instants.iter().zip(&of_instants).filter_map(of_pose).collect())
    }

    /// At a pose.
    pub(crate) fn at(&self, pose: usize) -> &[f64; 6] {
        &self.0[pose]
    }
}

/// Energies of one coordinate, found and expected, up to each interval.
struct Sums(Vec<(f64, f64)>);

impl Sums {
    fn of(energies: &[Energy], coordinate: usize) -> Self {
        let (mut found, mut expected) = (0.0, 0.0);
        let mut sums = vec![(0.0, 0.0)];
        sums.extend(energies.iter().map(|energy| {
            found += energy.found[coordinate];
            expected += energy.expected[coordinate];
            (found, expected)
        }));
        Self(sums)
    }

    /// Number of intervals.
    fn count(&self) -> usize {
        self.0.len() - 1
    }

    /// Found and expected over some intervals.
    fn over(&self, intervals: Range<usize>) -> (f64, f64) {
        let (before, until) = (self.0[intervals.start], self.0[intervals.end]);
        (until.0 - before.0, until.1 - before.1)
    }

    /// The density about an interval and its variance, from as few intervals as give a variance, or from all.
    fn density(&self, k: usize, variance: f64) -> (f64, f64) {
        let about = |reach: usize| k.saturating_sub(reach)..(k + reach + 1).min(self.count());
        let (mut low, mut high) = (0, self.count());
        while low < high {
            let middle = low.midpoint(high);
            let is_short = variance_of(self.over(about(middle)).1) > variance;
            (low, high) = if is_short { (middle + 1, high) } else { (low, middle) };
        }
        let (found, expected) = self.over(about(low));
        let density = if expected > 0.0 { 1.0 + (found / expected - 1.0) / SHOWN } else { 1.0 };
        (density, variance_of(expected))
    }
}

/// The variance of a density from energy of which this is expected.
fn variance_of(expected: f64) -> f64 {
    2.0 / (SHOWN * expected.max(f64::MIN_POSITIVE))
}

/// Windows over which densities have a variance by chance.
struct Windows {
    variance: f64,
    /// The variance that they have beyond chance.
    scatter: f64,
}

impl Windows {
    fn of(coordinates: &[Sums], variance: f64) -> Self {
        let (mut sum, mut weights) = (0.0, 0.0);
        for sums in coordinates {
            for k in 0..sums.count() {
                let (density, by_chance) = sums.density(k, variance);
                let weight = sums.over(k..k + 1).1;
                sum += weight * ((density - 1.0).powi(2) - density.powi(2) * by_chance / (1.0 + by_chance));
                weights += weight;
            }
        }
        Self { variance, scatter: if weights > 0.0 { (sum / weights).max(0.0) } else { 0.0 } }
    }

    /// The density about an interval of a coordinate.
    fn density(&self, sums: &Sums, k: usize) -> f64 {
        let (density, by_chance) = sums.density(k, self.variance);
        (1.0 + (density - 1.0) * self.scatter / (self.scatter + by_chance)).max(0.0)
    }
}

impl Adjoint {
    /// What the jerk has over an interval before the measurements that this knows of (the score of the density: Koopman &
    /// Shephard 1992).
    pub(crate) fn energy(&self, dt_s: f64, noise: &MotionNoise) -> Energy {
        let mut energy = Energy::default();
        for coordinate in 0..6 {
            let density = [noise.translation.intensity, noise.rotation.intensity][coordinate / 3];
            let (jerk, (vector, information)) = (white_jerk(dt_s) * density, self.of_coordinate(coordinate));
            energy.found[coordinate] = (jerk * vector).dot(&vector);
            energy.expected[coordinate] = (jerk * information).trace();
        }
        energy
    }
}

impl Joint {
    /// Scales what the smoother cuts off of the motion by densities over that of the flight.
    pub(crate) fn scale_cut_off(&mut self, densities: &[f64; 6]) {
        for (coordinate, density) in densities.iter().enumerate() {
            for (k, share) in CUT_OFF.into_iter().enumerate() {
                let factor = (1.0 + share * (density - 1.0)).sqrt();
                let at = chain_of(coordinate) + 3 * k;
                self.covariance.row_mut(at).scale_mut(factor);
                self.covariance.column_mut(at).scale_mut(factor);
            }
        }
    }
}

#[cfg(test)]
mod tests;
