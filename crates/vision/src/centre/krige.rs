//! Clutter behind a ball's rim, predicted from the pixels beside it that the ball leaves free.
//!
//! No image is sharper than its blur, so across any line the clutter's correlation is at least that of blurred white noise,
//! exp(-d²/4w²) with w the width of an edge; along a line it is as long as it is seen to be ([`super::metric`]). Its mean
//! and variance under the ball follow by kriging from the nearest free pixels (Matheron 1963; Rasmussen & Williams 2006,
//! eq. 2.23-2.24); what is left unknown is correlated as blurred white noise.

use super::CLEAR;
use super::cholesky::Banded;
use super::edge::gaussian;
use super::lanes::{GROUP, Lanes};
use super::metric::{Course, Nearby};
use super::surroundings::LEAST_CLUTTER;
use crate::patch::Patch;
use pulp::Simd;

/// Distance in edge widths at which correlation ends.
const FAR_EDGES: f64 = 4.0;
/// Free pixels from which the background of one pixel is predicted: two rows of a neighbourhood of radius two.
const NEIGHBOURS: usize = 8;
/// Pixels to look for them in each direction.
pub(super) const REACH: usize = 4;

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
    /// What the plane leaves of each free pixel, not a number elsewhere; a margin as wide as the reach around.
    left: Vec<f64>,
    course: Course,
    /// Neighbours' displacements, and offsets to look for them at in `left`.
    offsets: Vec<([f64; 2], usize)>,
    /// Correlation by squared distance, as it ends.
    tapered: Vec<f64>,
    places: Vec<(i32, i32)>,
    deviation: Vec<f64>,
}

/// The equations of a group of rim pixels: displacements of the neighbours in lengths of correlation, and their values.
struct Systems {
    apart: [[[f64; GROUP]; 2]; NEIGHBOURS],
    left: [[f64; GROUP]; NEIGHBOURS],
    /// Variance of a neighbour's value over that of the clutter.
    own: [f64; GROUP],
    count: [usize; GROUP],
}

impl Kriging {
    /// Adds the clutter that the nearest free pixels predict to the mean of each rim pixel, and sets the covariance. `level`
    /// is the plane's value at a pixel of the patch.
    #[inline(always)]
    pub(super) fn predict<S: Simd>(
        &mut self,
        simd: S,
        (patch, edge_px, spread): (&Patch, f64, Spread),
        (rim, covered): (&[u32], &[f64]),
        level: impl Fn(usize) -> f64,
        (mean, covariance): (&mut [f64], &mut Banded),
    ) -> Option<()> {
        self.set_taper(edge_px);
        let stride = patch.columns + 2 * REACH;
        self.lay_out(patch, covered, level);
        self.course.take(&self.left, stride);
        self.offsets.clear();
        self.offsets.extend(BY_DISTANCE.iter().map(|(x, y)| {
            let at = (REACH * stride + REACH) as i32 + y * stride as i32 + x;
            ([f64::from(*x), f64::from(*y)], at as usize)
        }));
        self.places.clear();
        self.places.extend(
            rim.iter().map(|i| ((*i as usize % patch.columns) as i32, (*i as usize / patch.columns) as i32)),
        );
        self.deviation.clear();
        let mut systems = Systems::NOTHING;
        for (places, mean) in self.places.chunks(GROUP).zip(mean.chunks_mut(GROUP)) {
            for (lane, (x, y)) in places.iter().enumerate() {
                let corner = *y as usize * stride + *x as usize;
                let nearby = self.course.nearby(corner, edge_px, spread.noise_variance);
                systems.set_up(lane, &self.left[corner..], &self.offsets, &nearby);
                systems.own[lane] =
                    1.0 + spread.noise_variance / nearby.variance.max(LEAST_CLUTTER * spread.noise_variance);
            }
            let (value, square) = systems.solve(simd)?;
            for (lane, mean) in mean.iter_mut().enumerate() {
                *mean += value[lane];
                let variance = spread.clutter * spread.clutter + square[lane];
                self.deviation.push((variance / (1 + systems.count[lane]) as f64).sqrt());
            }
        }
        let (places, deviation, tapered) = (&self.places, &self.deviation, &self.tapered);
        covariance.set(rim.len(), |i, below| {
            let j = i - below;
            let (x, y) = (places[i].0 - places[j].0, places[i].1 - places[j].1);
            let square = (x * x + y * y) as usize;
            tapered.get(square).map_or(0.0, |correlation| deviation[i] * deviation[j] * correlation)
        });
        Some(())
    }

    /// Standard deviation of the clutter near a pixel of the patch, once predicted; None where all is covered.
    pub(super) fn clutter_near(&self, patch: &Patch, pixel: usize, noise_variance: f64) -> Option<f64> {
        let corner = pixel / patch.columns * (patch.columns + 2 * REACH) + pixel % patch.columns;
        self.course.variance(corner, noise_variance).map(f64::sqrt)
    }

    #[inline(always)]
    fn lay_out(&mut self, patch: &Patch, covered: &[f64], level: impl Fn(usize) -> f64) {
        let stride = patch.columns + 2 * REACH;
        self.left.clear();
        self.left.resize(stride * (patch.rows + 2 * REACH), f64::NAN);
        for row in 0..patch.rows {
            let start = row * patch.columns;
            let into = &mut self.left[(row + REACH) * stride + REACH..][..patch.columns];
            for (k, into) in into.iter_mut().enumerate() {
                if covered[start + k] < CLEAR {
                    *into = patch.bright[start + k] - level(start + k);
                }
            }
        }
    }

    /// Correlation by squared distance in pixels, as it ends.
    fn set_taper(&mut self, edge_px: f64) {
        let (far_px, fall) = (FAR_EDGES * edge_px, (4.0 * edge_px * edge_px).recip());
        let last = (far_px * far_px).floor().min((2 * BAND_REACH * BAND_REACH) as f64) as usize;
        self.tapered.clear();
        self.tapered.extend((0..=last).map(|square| {
            // The taper (Wendland 1995, C²) ends the correlation without making the matrix indefinite.
            let part = (1.0 - (square as f64).sqrt() / far_px).max(0.0);
            (-(square as f64) * fall).exp() * part.powi(4) * (5.0 - 4.0 * part)
        }));
    }
}

/// Pixels in each direction beyond which no correlation is kept.
const BAND_REACH: usize = 2 * REACH;
/// Lengths of correlation between what is not related at all.
const UNRELATED: f64 = 1e3;

impl Systems {
    /// Where nothing was found.
    const NOTHING: Self = Self {
        apart: [[[0.0; GROUP]; 2]; NEIGHBOURS],
        left: [[0.0; GROUP]; NEIGHBOURS],
        own: [1.0; GROUP],
        count: [0; GROUP],
    };

    /// Sets the equations of one rim pixel from what is left of the pixels around it.
    #[inline(always)]
    fn set_up(&mut self, lane: usize, around: &[f64], offsets: &[([f64; 2], usize)], nearby: &Nearby) {
        // Cholesky factor of the metric.
        let metric = nearby.metric;
        let down = metric[0].max(f64::MIN_POSITIVE).sqrt();
        let aside = metric[1] / down;
        let rest = (metric[2] - aside * aside).max(0.0).sqrt();
        let mut count = 0;
        for ([x, y], offset) in offsets {
            let left = around[*offset];
            if !left.is_nan() {
                self.left[count][lane] = left;
                (self.apart[count][0][lane], self.apart[count][1][lane]) = (down * x + aside * y, rest * y);
                count += 1;
                if count == NEIGHBOURS {
                    break;
                }
            }
        }
        self.count[lane] = count;
        for i in count..NEIGHBOURS {
            // What was not found predicts nothing.
            self.left[i][lane] = 0.0;
            (self.apart[i][0][lane], self.apart[i][1][lane]) = (UNRELATED * (i + 1) as f64, 0.0);
        }
    }

    /// What is predicted and the sum of the squared values; None where a matrix is not positive definite.
    #[inline(always)]
    fn solve<S: Simd>(&self, simd: S) -> Option<([f64; GROUP], [f64; GROUP])> {
        let (mut predicted, mut squares, mut least) = ([0.0; GROUP], [0.0; GROUP], [0.0; GROUP]);
        for part in 0..Lanes::<S>::PARTS {
            let load = |values: &[f64; GROUP]| Lanes::load(simd, values, part);
            let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
            let own = load(&self.own);
            let (mut rows, mut x) = ([[zero; NEIGHBOURS]; NEIGHBOURS], [zero; NEIGHBOURS]);
            for (i, row) in rows.iter_mut().enumerate() {
                row[i] = own;
                let [across, down] = self.apart[i].each_ref().map(load);
                for (value, from) in row.iter_mut().zip(&self.apart).skip(i + 1) {
                    let (dx, dy) = (across - load(&from[0]), down - load(&from[1]));
                    *value = gaussian(simd, dx * dx + dy * dy);
                }
                x[i] = gaussian(simd, across * across + down * down);
            }
            let mut smallest = rows[0][0];
            let mut inverse = [zero; NEIGHBOURS];
            for k in 0..NEIGHBOURS {
                let pivot = rows[k];
                smallest = pivot[k].min(smallest);
                inverse[k] = one / pivot[k];
                for i in k + 1..NEIGHBOURS {
                    let factor = pivot[i] * inverse[k];
                    // Whole halves of a row: a loop of fixed length.
                    let from = i / GROUP * GROUP;
                    for j in 0..GROUP {
                        rows[i][from + j] = rows[i][from + j] - factor * pivot[from + j];
                    }
                    if from == 0 {
                        for j in GROUP..NEIGHBOURS {
                            rows[i][j] = rows[i][j] - factor * pivot[j];
                        }
                    }
                    x[i] = x[i] - factor * x[k];
                }
            }
            let (mut value, mut square) = (zero, zero);
            for k in (0..NEIGHBOURS).rev() {
                for i in k + 1..NEIGHBOURS {
                    x[k] = x[k] - rows[k][i] * x[i];
                }
                x[k] = x[k] * inverse[k];
                let left = load(&self.left[k]);
                (value, square) = (value + x[k] * left, square + left * left);
            }
            value.store(&mut predicted, part);
            square.store(&mut squares, part);
            smallest.store(&mut least, part);
        }
        let whole = |lane: usize| least[lane] > 0.0 && predicted[lane].is_finite();
        (0..GROUP).all(whole).then_some((predicted, squares))
    }
}
