//! Where the acceleration changed faster than the noise of the flight allows.
//!
//! White jerk of one density is no model of a step of an input. What the smoother takes a step for is beside the truth by more
//! than it claims, for as long as its own response lasts. The steps are found by their auxiliary residuals (Harvey & Koopman
//! 1992; de Jong & Penzer 1998); there the smoother claims what one would that knows of them.

use crate::smoother::density::{Densities, Energy};
use crate::smoother::integrator::{chain_of, white_jerk};
use crate::smoother::passes::{Flown, backward};
use crate::smoother::state::{Adjoint, Joint, MotionNoise};
use mavsight_geometry::Matrix3;
use nalgebra::{Vector3, Vector6};
use statrs::function::erf::erfc;
use std::collections::BTreeMap;

/// Share of false ones among the jumps that are called, as usual (Benjamini & Hochberg 1995).
const FALSE_SHARE: f64 = 0.1;
/// Spectral densities of jerk, of the six coordinates of a pose, beyond those of the noise, by the number of the instant at the
/// end of an interval.
#[derive(Debug, Clone, Default)]
pub(crate) struct Jumps(BTreeMap<usize, Vector6<f64>>);

/// A change of one coordinate's acceleration over an interval between measurements.
#[derive(Debug, Clone, Copy)]
struct Shock {
    /// Number of the interval.
    interval: u32,
    coordinate: u8,
    /// As the measurements on both sides have it.
    size: f32,
    /// Its square over its variance.
    square: f32,
}

/// What the smoothed jerk shows of a flight under its noise: where it jumps, and how its density changes. `None` where the
/// arithmetic fails.
pub(crate) fn disturbances(flown: &Flown<'_>, noise: &MotionNoise) -> Option<(Jumps, Densities)> {
    let measured: Vec<(usize, i64)> = flown.measured().collect();
    let (shocks, energies) = shocks(flown, &measured, noise)?;
    Some((Jumps::of(shocks, &measured), Densities::of(flown, &energies)))
}

impl Jumps {
    /// The jumps among the shocks of intervals between measurements.
    fn of(shocks: Vec<Shock>, measured: &[(usize, i64)]) -> Self {
        let mut jumps = Self::default();
        for shock in clearest(discovered(shocks)) {
            let interval = &measured[shock.interval as usize..];
            let density = f64::from(shock.size).powi(2) / length_s(interval);
            for before in interval[0].0 + 1..=interval[1].0 {
                jumps.0.entry(before).or_default()[usize::from(shock.coordinate)] += density;
            }
        }
        jumps
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Densities over the interval before an instant.
    pub(crate) fn before(&self, instant: usize) -> Option<&Vector6<f64>> {
        self.0.get(&instant)
    }
}

/// What is measured, by numbers of instants and times, says of each coordinate and interval between measurements; and what the
/// smoothed jerk has over the interval before each instant.
fn shocks(
    flown: &Flown<'_>,
    measured: &[(usize, i64)],
    noise: &MotionNoise,
) -> Option<(Vec<Shock>, Vec<Energy>)> {
    let mut intervals = measured.windows(2).enumerate().rev().peekable();
    let mut shocks = Vec::with_capacity(6 * intervals.len());
    let mut energies = vec![Energy::default(); flown.instants.len()];
    let behind = |instant: usize, later: &Adjoint| {
        if let Some(dt_s) = flown.interval_s(instant) {
            energies[instant] = later.energy(dt_s, noise);
        }
        let Some((number, interval)) = intervals.next_if(|i| i.1[1].0 == instant) else { return };
        // A rate at the very time of a pose has no interval before it.
        if interval[1].1 <= interval[0].1 {
            return;
        }
        let of_coordinate = |coordinate: u8| {
            let (size, square) = later.shock(coordinate.into(), length_s(interval))?;
            Some(Shock { interval: number as u32, coordinate, size: size as f32, square: square as f32 })
        };
        shocks.extend((0..6).filter_map(of_coordinate));
    };
    backward(flown, noise, |_, _, _| Some(()), behind)?;
    energies.iter().all(Energy::is_finite).then_some((shocks, energies))
}

fn length_s(interval: &[(usize, i64)]) -> f64 {
    (interval[1].1 - interval[0].1) as f64 * 1e-9
}

/// Those shocks of which no more than a share is expected to be chance (Benjamini & Hochberg 1995).
fn discovered(mut all: Vec<Shock>) -> Vec<Shock> {
    all.sort_by(|a, b| b.square.total_cmp(&a.square));
    let count = all.len() as f64;
    let by_chance = |shock: &Shock| erfc(f64::from(0.5 * shock.square).sqrt());
    let passes = |(k, shock): (usize, &Shock)| by_chance(shock) * count <= FALSE_SHARE * (k + 1) as f64;
    let passed = all.iter().enumerate().rev().find(|at| passes(*at)).map_or(0, |(k, _)| k + 1);
    all.truncate(passed);
    all
}

/// Of neighbouring intervals of a coordinate the one with the clearest shock: a jump shows in those next to it too.
fn clearest(mut called: Vec<Shock>) -> Vec<Shock> {
    called.sort_by_key(|s| (s.coordinate, s.interval));
    let runs = called.chunk_by(|a, b| a.coordinate == b.coordinate && b.interval == a.interval + 1);
    runs.filter_map(|run| run.iter().max_by(|a, b| a.square.total_cmp(&b.square)).copied()).collect()
}

impl Joint {
    /// Adds what white jerk beyond that of the noise makes uncertain over an interval; densities by coordinate.
    pub(crate) fn loosen(&mut self, dt_s: f64, jerk: &Vector6<f64>) {
        for (coordinate, density) in jerk.iter().enumerate().filter(|(_, d)| **d > 0.0) {
            let at = chain_of(coordinate);
            let mut own = self.covariance.view_with_steps_mut((at, at), (3, 3), (2, 2));
            own += white_jerk(dt_s) * *density;
        }
    }
}

impl Adjoint {
    /// The change of a coordinate's acceleration, at an even jerk over an interval before the measurements that this knows of,
    /// and its square over its variance: chi-square with one degree of freedom where there is none.
    fn shock(&self, coordinate: usize, dt_s: f64) -> Option<(f64, f64)> {
        let by = Vector3::new(dt_s * dt_s / 6.0, 0.5 * dt_s, 1.0);
        let (vector, information) = self.of_coordinate(coordinate);
        let (right, weight) = (-by.dot(&vector), (information * by).dot(&by));
        let found = (right / weight, right * right / weight);
        (weight > 0.0 && found.0.is_finite() && found.1.is_finite()).then_some(found)
    }

    /// The part of a coordinate's place, its rate and the rate of that: the adjoint state and its information.
    pub(crate) fn of_coordinate(&self, coordinate: usize) -> (Vector3<f64>, Matrix3<f64>) {
        let at = chain_of(coordinate);
        let vector = Vector3::from_fn(|i, _| self.vector[at + 3 * i]);
        (vector, Matrix3::from_fn(|i, j| self.information[(at + 3 * i, at + 3 * j)]))
    }
}

#[cfg(test)]
mod tests;
