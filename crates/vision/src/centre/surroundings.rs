//! What is behind a ball, from what is seen around it: mean and covariance of the background at each pixel that the
//! ball covers in part.
//!
//! Brightness: a plane, fitted robustly, and on it clutter (an arm, a skid, an edge of the wall) as a random field whose
//! variance is that of what the plane leaves around the ball. No image is sharper than its blur, so the field's
//! correlation is that of blurred white noise, exp(-d²/4w²) with w the width of an edge. Its mean and variance under
//! the ball follow by kriging from the nearest pixels that the ball leaves free (Matheron 1963; Rasmussen & Williams
//! 2006, eq. 2.23-2.24); what is left unknown keeps the field's correlation. Where nothing but noise is left on the
//! plane, the plane is taken as it is.
//!
//! Colour differences: one robust mean; clutter is mostly grey, and they are coarse.

use super::CLEAR;
use super::cholesky::Skyline;
use crate::patch::Patch;
use nalgebra::{Matrix3, Vector3};

/// Biweight cut-off with 95 % efficiency on Gaussian noise (Beaton & Tukey 1974).
const CUT_OFF: f64 = 4.685;
/// A Gaussian's standard deviation over its median absolute value.
pub(super) const MEDIAN_TO_DEVIATION: f64 = 1.4826;
/// Width of the ring that is looked at beyond the ball's blurred rim, in edge widths: correlation beyond it is e⁻⁴.
const RING_EDGES: f64 = 4.0;
/// Distance in edge widths at which correlation ends.
const FAR_EDGES: f64 = 4.0;
/// Free pixels from which the background of one pixel is predicted: two rows of a neighbourhood of radius two.
const NEIGHBOURS: usize = 8;
/// Pixels to look for them in each direction.
const REACH: i32 = 4;
/// Clutter whose variance is below this part of the noise's does not matter.
const LEAST_CLUTTER: f64 = 0.5;
const ROBUST_ROUNDS: usize = 4;

/// A disc with a soft edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) radius_px: f64,
    pub(super) edge_px: f64,
}

/// A pixel near the ball but free of it: place from the ball's centre and brightness.
#[derive(Debug, Clone, Copy)]
struct Free {
    x: f64,
    y: f64,
    bright: f64,
}

/// A plane's value.
#[inline(always)]
fn on(plane: &Vector3<f64>, x: f64, y: f64) -> f64 {
    plane.x + plane.y * x + plane.z * y
}

/// Squared distance of two pixels.
#[inline(always)]
fn apart(a: (i32, i32), b: (i32, i32)) -> usize {
    ((a.0 - b.0) * (a.0 - b.0) + (a.1 - b.1) * (a.1 - b.1)) as usize
}

/// Solves a symmetric positive definite system in place; None where it is not.
#[inline(always)]
fn solve(matrix: &mut [[f64; NEIGHBOURS]; NEIGHBOURS], x: &mut [f64; NEIGHBOURS]) -> Option<()> {
    for k in 0..NEIGHBOURS {
        let pivot_row = matrix[k];
        if pivot_row[k].is_nan() || pivot_row[k] <= 0.0 {
            return None;
        }
        let inverse = pivot_row[k].recip();
        for i in k + 1..NEIGHBOURS {
            let factor = pivot_row[i] * inverse;
            for j in 0..NEIGHBOURS {
                matrix[i][j] -= factor * pivot_row[j];
            }
            x[i] -= factor * x[k];
        }
    }
    for k in (0..NEIGHBOURS).rev() {
        let known: f64 = (k + 1..NEIGHBOURS).map(|j| matrix[k][j] * x[j]).sum();
        x[k] = (x[k] - known) / matrix[k][k];
    }
    Some(())
}

/// Working space and result.
#[derive(Debug, Clone, Default)]
pub(super) struct Surroundings {
    free: Vec<Free>,
    sorted: Vec<f64>,
    kernel: Vec<f64>,
    tapered: Vec<f64>,
    deviation: Vec<f64>,
    /// Brightness expected behind each pixel of the rim.
    pub(super) mean: Vec<f64>,
    /// Covariance of that, in the rim's order; empty without clutter.
    pub(super) covariance: Skyline,
    /// Standard deviation of the clutter.
    pub(super) clutter: f64,
    /// Brightness in the middle of the plane.
    pub(super) level: f64,
    pub(super) color: [f64; 2],
    pub(super) color_variance: [f64; 2],
}

impl Surroundings {
    /// Estimates the background at the `rim` pixels, which are sorted by their angle around the disc, from how far the
    /// disc covers each pixel and each colour sample of the patch; None with too few free ones.
    #[inline(always)]
    pub(super) fn estimate(
        &mut self,
        patch: &Patch,
        disc: &Disc,
        (rim, covered): (&[u32], &[f64]),
        color_covered: &[f64],
        noise_variance: f64,
    ) -> Option<()> {
        let reach_px = disc.radius_px + (3.0 + RING_EDGES) * disc.edge_px;
        self.free.clear();
        for (i, bright) in patch.bright.iter().enumerate() {
            if covered[i] >= CLEAR {
                continue;
            }
            let (x, y) = patch.place(i);
            let (x, y) = (x - disc.x_px, y - disc.y_px);
            if x * x + y * y < reach_px * reach_px {
                self.free.push(Free { x, y, bright: *bright });
            }
        }
        let plane = self.plane(noise_variance)?;
        self.level = plane.x;
        let level = |i: usize| {
            let (x, y) = patch.place(i);
            on(&plane, x - disc.x_px, y - disc.y_px)
        };
        self.mean.clear();
        self.mean.extend(rim.iter().map(|i| level(*i as usize)));
        let square: f64 = self.free.iter().map(|f| (f.bright - on(&plane, f.x, f.y)).powi(2)).sum();
        let clutter = square / self.free.len() as f64 - noise_variance;
        self.clutter = clutter.max(0.0).sqrt();
        self.covariance.clear();
        if clutter > LEAST_CLUTTER * noise_variance {
            self.krige(patch, disc, (rim, covered), noise_variance, level)?;
        }
        self.mean_color(patch, color_covered)
    }

    /// Robust plane through the free pixels: level in the middle and slopes.
    #[inline(always)]
    fn plane(&mut self, noise_variance: f64) -> Option<Vector3<f64>> {
        let mut plane = Vector3::zeros();
        let mut scale = f64::INFINITY;
        for _ in 0..ROBUST_ROUNDS {
            let (mut normal, mut right) = ([0.0; 6], [0.0; 3]);
            for Free { x, y, bright } in &self.free {
                let weight = biweight((bright - on(&plane, *x, *y)) / scale);
                let (wx, wy) = (weight * x, weight * y);
                for (sum, term) in normal.iter_mut().zip([weight, wx, wy, wx * x, wx * y, wy * y]) {
                    *sum += term;
                }
                for (sum, term) in right.iter_mut().zip([weight, wx, wy]) {
                    *sum += term * bright;
                }
            }
            let [n, x, y, xx, xy, yy] = normal;
            plane = Matrix3::new(n, x, y, x, xx, xy, y, xy, yy).cholesky()?.solve(&Vector3::from(right));
            self.sorted.clear();
            self.sorted.extend(self.free.iter().map(|f| (f.bright - on(&plane, f.x, f.y)).abs()));
            scale = (MEDIAN_TO_DEVIATION * median(&mut self.sorted)?).max(noise_variance.sqrt());
        }
        Some(plane)
    }

    /// Adds the clutter that the nearest free pixels predict to the mean of each rim pixel, and sets the covariance.
    #[inline(always)]
    fn krige(
        &mut self,
        patch: &Patch,
        disc: &Disc,
        (rim, covered): (&[u32], &[f64]),
        noise_variance: f64,
        level: impl Fn(usize) -> f64,
    ) -> Option<()> {
        self.set_kernels(disc.edge_px);
        let variance = self.clutter * self.clutter;
        let columns = patch.columns as i32;
        let place = |pixel: u32| (pixel as i32 % columns, pixel as i32 / columns);
        self.deviation.clear();
        for (mean, pixel) in self.mean.iter_mut().zip(rim) {
            let here = place(*pixel);
            let mut near = [(0, 0); NEIGHBOURS];
            let mut left = [0.0; NEIGHBOURS];
            let mut count = 0;
            for (dx, dy) in &*BY_DISTANCE {
                let (x, y) = (here.0 + dx, here.1 + dy);
                if !(0..columns).contains(&x) || !(0..patch.rows as i32).contains(&y) {
                    continue;
                }
                let index = (y * columns + x) as usize;
                if covered[index] >= CLEAR {
                    continue;
                }
                near[count] = (x, y);
                left[count] = patch.bright[index] - level(index);
                count += 1;
                if count == NEIGHBOURS {
                    break;
                }
            }
            let mut kernel = [[0.0; NEIGHBOURS]; NEIGHBOURS];
            let mut cross = [0.0; NEIGHBOURS];
            for i in 0..NEIGHBOURS {
                // What was not found predicts nothing.
                kernel[i][i] = variance + noise_variance;
                for j in 0..i.min(count) {
                    let value = if i < count { variance * self.kernel[apart(near[i], near[j])] } else { 0.0 };
                    (kernel[i][j], kernel[j][i]) = (value, value);
                }
                if i < count {
                    cross[i] = variance * self.kernel[apart(near[i], here)];
                }
            }
            solve(&mut kernel, &mut cross)?;
            let (mut predicted, mut square) = (0.0, 0.0);
            for (weight, left) in cross.iter().zip(&left) {
                predicted += weight * left;
                square += left * left;
            }
            *mean += predicted;
            self.deviation.push(((variance + square) / (1 + count) as f64).sqrt());
        }
        for (i, pixel) in rim.iter().enumerate() {
            let here = place(*pixel);
            // Neighbours around the disc are near in the list, save across its ends.
            let first = i.saturating_sub(MOST_BAND);
            let (deviation, tapered) = (&self.deviation, &self.tapered);
            let entries = (first..=i).map(|j| {
                let correlation = tapered.get(apart(place(rim[j]), here)).copied().unwrap_or(0.0);
                deviation[i] * deviation[j] * correlation
            });
            self.covariance.push(first, entries);
        }
        Some(())
    }

    /// Correlation by squared distance in pixels, as it is and as it ends.
    fn set_kernels(&mut self, edge_px: f64) {
        let (far_px, fall) = (FAR_EDGES * edge_px, (4.0 * edge_px * edge_px).recip());
        let most = 2 * (2 * REACH) * (2 * REACH) + 1;
        self.kernel.clear();
        self.kernel.extend((0..most).map(|square| (-f64::from(square) * fall).exp()));
        self.tapered.clear();
        self.tapered.extend(self.kernel.iter().enumerate().map(|(square, kernel)| {
            // The taper (Wendland 1995, C²) ends the correlation without making the matrix indefinite.
            let part = (1.0 - (square as f64).sqrt() / far_px).max(0.0);
            kernel * part.powi(4) * (5.0 - 4.0 * part)
        }));
    }

    fn mean_color(&mut self, patch: &Patch, covered: &[f64]) -> Option<()> {
        for channel in 0..2 {
            let free =
                || patch.colors.iter().zip(covered).filter(|(_, c)| **c < CLEAR).map(|(v, _)| v[channel]);
            self.sorted.clear();
            self.sorted.extend(free());
            let middle = median(&mut self.sorted)?;
            self.sorted.clear();
            self.sorted.extend(free().map(|v| (v - middle).abs()));
            // Half a level is what rounding leaves of a uniform wall.
            let scale = (MEDIAN_TO_DEVIATION * median(&mut self.sorted)?).max(0.5);
            let (mut sum, mut total) = (0.0, 0.0);
            for value in free() {
                let weight = biweight((value - middle) / scale);
                sum += weight * value;
                total += weight;
            }
            if total <= 0.0 {
                return None;
            }
            let mean = sum / total;
            self.color[channel] = mean;
            let (square, count) = free().fold((0.0, 0.0), |(s, n), v| (s + (v - mean).powi(2), n + 1.0));
            self.color_variance[channel] = square / count;
        }
        Some(())
    }
}

/// Rim pixels that one is set against; a rim is about four pixels wide, and correlation reaches two or three.
const MOST_BAND: usize = 16;

/// Offsets to look for neighbours at, the nearest first.
static BY_DISTANCE: std::sync::LazyLock<Vec<(i32, i32)>> = std::sync::LazyLock::new(|| {
    let mut all: Vec<(i32, i32)> =
        (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| (x, y))).collect();
    all.sort_by_key(|(x, y)| (x * x + y * y, *y, *x));
    all.retain(|(x, y)| x * x + y * y <= REACH * REACH);
    all
});

/// Tukey's biweight of a residual in standard deviations.
pub(super) fn biweight(deviations: f64) -> f64 {
    let u = deviations / CUT_OFF;
    if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 }
}

pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
