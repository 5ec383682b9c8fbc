//! Clutter behind a ball's rim, predicted from the pixels beside it that the ball leaves free.
//!
//! No image is sharper than its blur, so the clutter's correlation is that of blurred white noise,
//! exp(-d²/4w²) with w the width of an edge; in a still, where there is time, it is as long as it is seen to
//! be along a line ([`super::metric`]). Its mean and variance under the ball follow by kriging from the
//! nearest free pixels (Matheron 1963; Rasmussen & Williams 2006, eq. 2.23-2.24); what is left unknown keeps
//! the correlation.

mod systems;

use self::systems::{NEIGHBOURS, Systems, Weights};
use super::cholesky::Banded;
use super::constants::CLEAR;
use super::lanes::{GROUP, Lanes};
use super::metric::{Course, Nearby, REACH};
use super::policy::FitPolicy;
use crate::patch::Patch;
use pulp::Simd;

/// Clutter whose variance is below this part of the noise's does not matter.
pub(super) const LEAST_CLUTTER: f64 = 0.5;
/// Distance in edge widths at which correlation ends.
const FAR_EDGES: f64 = 4.0;
/// Width of a table by the displacement of two neighbours.
const ACROSS: usize = 4 * REACH + 1;
/// Entry of such a table for no displacement.
const HERE: usize = (ACROSS + 1) * 2 * REACH;
/// Room for such a table: a power of two, so that no place needs to be checked.
const TABLE: usize = 512;

/// A displacement by its place in such a table.
fn displacement_px(at: usize) -> (f64, f64) {
    let along = |k: usize| k as f64 - (2 * REACH) as f64;
    (along(at % ACROSS), along(at / ACROSS))
}

/// Clutter's standard deviation, and variance of a pixel's noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    pub(super) clutter: f64,
    pub(super) noise_variance: f64,
}

/// Offsets to look for neighbours at, the nearest first.
static BY_DISTANCE: std::sync::LazyLock<Vec<(i32, i32)>> = std::sync::LazyLock::new(|| {
    let reach = REACH as i32;
    let mut all: Vec<(i32, i32)> =
        (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))).collect();
    all.sort_by_key(|(x, y)| (x * x + y * y, *y, *x));
    all.retain(|(x, y)| x * x + y * y <= reach * reach);
    all
});

/// Working space.
#[derive(Debug, Clone, Default)]
pub(super) struct Kriging {
    /// What the plane leaves of each free pixel, not a number elsewhere; a margin as wide as the reach
    /// around.
    left: Vec<f32>,
    /// Offsets to look for neighbours at in `left`, and in a table by displacement.
    offsets: Vec<(usize, usize)>,
    /// Covariance by displacement.
    kernel: Vec<f32>,
    /// Correlation by squared distance, as it ends.
    tapered: Vec<f32>,
    places: Vec<(i32, i32)>,
    weights: Vec<Weights>,
    /// How far what is predicted at each rim pixel may be off: standard deviations; empty without clutter.
    pub(super) deviation: Vec<f32>,
    course: Course,
    /// Whether lines are looked for.
    along_lines: bool,
}

impl Kriging {
    /// Forgets the clutter of another ball.
    pub(super) fn clear(&mut self, policy: FitPolicy) {
        self.along_lines = policy.clutter_along_lines;
        self.left.clear();
        self.weights.clear();
        self.deviation.clear();
        self.course = Course::default();
    }

    /// Sets from which free pixels and with which weights the clutter at each rim pixel is predicted. `level`
    /// is the plane's value at a place of the patch.
    #[inline(always)]
    pub(super) fn weigh<S: Simd>(
        &mut self,
        simd: S,
        (patch, edge_px, spread): (&Patch, f64, Spread),
        (rim, covered): (&[u32], &[f32]),
        level: impl Fn((f64, f64)) -> f32,
    ) -> Option<()> {
        self.set_kernels(edge_px, spread.clutter);
        let stride = patch.columns + 2 * REACH;
        self.take(patch, covered, level);
        if self.along_lines {
            self.course.take(&self.left[..self.left.len() - 1], stride);
        }
        self.offsets.clear();
        self.offsets.extend(BY_DISTANCE.iter().map(|(x, y)| {
            let at = |stride: usize, middle: usize| (middle as i32 + y * stride as i32 + x) as usize;
            (at(stride, REACH * stride + REACH), at(ACROSS, HERE))
        }));
        self.places.clear();
        self.places.extend(
            rim.iter().map(|i| ((*i as usize % patch.columns) as i32, (*i as usize / patch.columns) as i32)),
        );
        self.weights.clear();
        for places in self.places.chunks(GROUP) {
            let (systems, mut weights) = self.set_up(places, (stride, edge_px, spread));
            systems.solve(simd, &mut weights)?;
            self.weights.push(weights);
        }
        Some(())
    }

    /// Adds the clutter that the nearest free pixels predict to the mean of each rim pixel, and sets how far
    /// it may be off.
    #[inline(always)]
    pub(super) fn predict<S: Simd>(&mut self, simd: S, clutter: f64, mean: &mut [f32]) -> Option<()> {
        let clutter_variance = Lanes::splat(simd, clutter * clutter);
        self.deviation.clear();
        let mut all = 0.0;
        for (weights, mean) in self.weights.iter().zip(mean.chunks_mut(GROUP)) {
            let (predicted, deviation) = weights.predict(simd, &self.left, clutter_variance);
            for ((mean, predicted), deviation) in mean.iter_mut().zip(&predicted).zip(&deviation) {
                *mean += predicted;
                all += *mean + deviation;
            }
            self.deviation.extend_from_slice(&deviation[..mean.len()]);
        }
        all.is_finite().then_some(())
    }

    /// Sets the covariance of what is predicted.
    #[inline(always)]
    pub(super) fn correlate(&self, covariance: &mut Banded) {
        let (places, deviation, tapered) = (&self.places, &self.deviation, &self.tapered);
        covariance.set(places.len(), |i, below| {
            let j = i - below;
            let (x, y) = (places[i].0 - places[j].0, places[i].1 - places[j].1);
            let square = (x * x + y * y) as usize;
            tapered.get(square).map_or(0.0, |correlation| deviation[i] * deviation[j] * correlation)
        });
    }

    /// Takes what the plane leaves of the free pixels.
    #[inline(always)]
    pub(super) fn take(&mut self, patch: &Patch, covered: &[f32], level: impl Fn((f64, f64)) -> f32) {
        let stride = patch.columns + 2 * REACH;
        self.left.clear();
        self.left.resize(stride * (patch.rows + 2 * REACH), f32::NAN);
        // What is missing is looked up here.
        self.left.push(0.0);
        for row in 0..patch.rows {
            let start = row * patch.columns;
            let into = &mut self.left[(row + REACH) * stride + REACH..][..patch.columns];
            for (k, into) in into.iter_mut().enumerate() {
                if covered[start + k] < CLEAR {
                    *into = patch.bright[start + k] - level((k as f64, row as f64));
                }
            }
        }
    }

    /// Sets the equations of up to a group of rim pixels and where their values are, with the covariances of
    /// blurred noise, or as lines near each pixel have them.
    #[inline(always)]
    fn set_up(
        &self,
        places: &[(i32, i32)],
        (stride, edge_px, spread): (usize, f64, Spread),
    ) -> (Systems, Weights) {
        let (clutter, noise) = (spread.clutter * spread.clutter, spread.noise_variance);
        let (mut systems, mut weights) = (Systems::NOTHING, Weights::NOTHING);
        weights.at = [[(self.left.len() - 1) as u32; GROUP]; NEIGHBOURS];
        for (lane, (x, y)) in places.iter().enumerate() {
            // The offsets begin a reach before the pixel.
            let corner = *y as usize * stride + *x as usize;
            let here = &self.left[corner..];
            let (mut found, mut places) = ([HERE; NEIGHBOURS], [0; NEIGHBOURS]);
            let mut count = 0;
            // One that is not free is written over by the next.
            for (offset, displacement) in &self.offsets {
                (found[count], places[count]) = (*displacement, (corner + offset) as u32);
                count += usize::from(!here[*offset].is_nan());
                if count == NEIGHBOURS {
                    break;
                }
            }
            (systems.count[lane], weights.counted[lane]) = (count, (1 + count) as f32);
            for (at, place) in weights.at.iter_mut().zip(places).take(count) {
                at[lane] = place;
            }
            let nearby = self.nearby(corner, edge_px, noise);
            let seen = nearby.map_or(clutter, |nearby| nearby.variance.max(LEAST_CLUTTER * noise));
            systems.own[lane] = (clutter * (1.0 + noise / seen)) as f32;
            let covariance = |displacement: usize| match &nearby {
                None => self.kernel[displacement % TABLE],
                Some(nearby) => (clutter * nearby.correlation(displacement_px(displacement))) as f32,
            };
            for i in 0..count {
                for j in i + 1..count {
                    systems.matrix[i][j][lane] = covariance(HERE + found[i] - found[j]);
                }
                systems.cross[i][lane] = covariance(found[i]);
            }
        }
        (systems, weights)
    }

    /// Clutter around a pixel by the first of its reach in `left`, where lines are followed and it is seen.
    fn nearby(&self, corner: usize, edge_px: f64, noise_variance: f64) -> Option<Nearby> {
        self.along_lines.then(|| self.course.nearby(corner, edge_px, noise_variance)).flatten()
    }

    /// Standard deviation of the clutter near a pixel of the patch, once weighed; likewise.
    pub(super) fn clutter_near(&self, patch: &Patch, pixel: usize, noise_variance: f64) -> Option<f64> {
        let corner = pixel / patch.columns * (patch.columns + 2 * REACH) + pixel % patch.columns;
        self.nearby(corner, 1.0, noise_variance).map(|nearby| nearby.variance.sqrt())
    }

    /// Covariance by displacement; correlation by squared distance in pixels, as it ends.
    fn set_kernels(&mut self, edge_px: f64, clutter: f64) {
        let (far_px, fall) = (FAR_EDGES * edge_px, (4.0 * edge_px * edge_px).recip());
        let along: [f64; ACROSS] = std::array::from_fn(|k| {
            let distance = k as f64 - (2 * REACH) as f64;
            clutter * (-distance * distance * fall).exp()
        });
        let mut kernel = [0.0; TABLE];
        for (row, down) in kernel.chunks_exact_mut(ACROSS).zip(&along) {
            row.iter_mut().zip(&along).for_each(|(value, across)| *value = (down * across) as f32);
        }
        self.kernel.clear();
        self.kernel.extend_from_slice(&kernel);
        let last = (far_px * far_px).floor().min((2 * BAND_REACH * BAND_REACH) as f64) as usize;
        self.tapered.clear();
        self.tapered.extend((0..=last).map(|square| {
            // The taper (Wendland 1995, C²) ends the correlation without making the matrix indefinite.
            let part = (1.0 - (square as f64).sqrt() / far_px).max(0.0);
            ((-(square as f64) * fall).exp() * part.powi(4) * (5.0 - 4.0 * part)) as f32
        }));
    }
}

/// Pixels in each direction beyond which no correlation is kept.
const BAND_REACH: usize = 2 * REACH;
