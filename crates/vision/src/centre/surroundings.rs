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
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

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
    place: Vector3<f64>,
    bright: f64,
}

/// Working space and result.
#[derive(Debug, Clone, Default)]
pub(super) struct Surroundings {
    free: Vec<Free>,
    sorted: Vec<f64>,
    kernel: Vec<f64>,
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
            let (x, y) = patch.place(i);
            let place = Vector3::new(1.0, x - disc.x_px, y - disc.y_px);
            if covered[i] < CLEAR && place.y * place.y + place.z * place.z < reach_px * reach_px {
                self.free.push(Free { place, bright: *bright });
            }
        }
        let plane = self.plane(noise_variance)?;
        self.level = plane.x;
        let level = |i: usize| {
            let (x, y) = patch.place(i);
            plane.dot(&Vector3::new(1.0, x - disc.x_px, y - disc.y_px))
        };
        self.mean.clear();
        self.mean.extend(rim.iter().map(|i| level(*i as usize)));
        let square: f64 = self.free.iter().map(|f| (f.bright - plane.dot(&f.place)).powi(2)).sum();
        let clutter = square / self.free.len() as f64 - noise_variance;
        self.clutter = clutter.max(0.0).sqrt();
        self.covariance.clear();
        if clutter > LEAST_CLUTTER * noise_variance {
            self.krige(patch, disc, (rim, covered), noise_variance, level)?;
        }
        self.mean_color(patch, color_covered)
    }

    /// Robust plane through the free pixels: level in the middle and slopes.
    fn plane(&mut self, noise_variance: f64) -> Option<Vector3<f64>> {
        let mut plane = Vector3::zeros();
        let mut scale = f64::INFINITY;
        for _ in 0..ROBUST_ROUNDS {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for Free { place, bright } in &self.free {
                let weight = biweight((bright - plane.dot(place)) / scale);
                normal += place * place.transpose() * weight;
                right += place * (weight * bright);
            }
            plane = normal.cholesky()?.solve(&right);
            self.sorted.clear();
            self.sorted.extend(self.free.iter().map(|f| (f.bright - plane.dot(&f.place)).abs()));
            scale = (MEDIAN_TO_DEVIATION * median(&mut self.sorted)?).max(noise_variance.sqrt());
        }
        Some(plane)
    }

    /// Adds the clutter that the nearest free pixels predict to the mean of each rim pixel, and sets the covariance.
    fn krige(
        &mut self,
        patch: &Patch,
        disc: &Disc,
        (rim, covered): (&[u32], &[f64]),
        noise_variance: f64,
        level: impl Fn(usize) -> f64,
    ) -> Option<()> {
        let variance = self.clutter * self.clutter;
        let far_px = FAR_EDGES * disc.edge_px;
        let fall = (4.0 * disc.edge_px * disc.edge_px).recip();
        self.kernel.clear();
        let most = 2 * (2 * REACH) * (2 * REACH) + 1;
        self.kernel.extend((0..most).map(|square| (-f64::from(square) * fall).exp()));
        let correlated = |(ax, ay): (i32, i32), (bx, by): (i32, i32)| {
            let square = (ax - bx).pow(2) + (ay - by).pow(2);
            self.kernel.get(square as usize).copied().unwrap_or(0.0)
        };
        self.deviation.clear();
        let columns = patch.columns as i32;
        for (mean, pixel) in self.mean.iter_mut().zip(rim) {
            let here = (*pixel as i32 % columns, *pixel as i32 / columns);
            let mut near = [(0, 0); NEIGHBOURS];
            let (mut kernel, mut cross, mut left) =
                (SMatrix::<f64, NEIGHBOURS, NEIGHBOURS>::identity(), SVector::zeros(), SVector::zeros());
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
                for (k, other) in near[..count].iter().enumerate() {
                    kernel[(count, k)] = variance * correlated((x, y), *other);
                    kernel[(k, count)] = kernel[(count, k)];
                }
                kernel[(count, count)] = variance + noise_variance;
                cross[count] = variance * correlated((x, y), here);
                left[count] = patch.bright[index] - level(index);
                count += 1;
                if count == NEIGHBOURS {
                    break;
                }
            }
            let weights: SVector<f64, NEIGHBOURS> = kernel.cholesky()?.solve(&cross);
            *mean += weights.dot(&left);
            let local = (variance + left.norm_squared()) / (1 + count) as f64;
            self.deviation.push(local.sqrt());
        }
        for (i, pixel) in rim.iter().enumerate() {
            let here = (*pixel as i32 % columns, *pixel as i32 / columns);
            let at = |j: usize| (rim[j] as i32 % columns, rim[j] as i32 / columns);
            // Neighbours around the disc are near in the list, save across its ends.
            let mut first = i;
            while first > 0 && i - first < MOST_BAND {
                first -= 1;
            }
            let deviation = &self.deviation;
            let entries = (first..=i).map(|j| {
                let ((ax, ay), (bx, by)) = (at(j), here);
                let apart_px = f64::from((ax - bx).pow(2) + (ay - by).pow(2)).sqrt();
                // The taper (Wendland 1995, C²) ends the correlation without making the matrix indefinite.
                let part = (1.0 - apart_px / far_px).max(0.0);
                let taper = part.powi(4) * (5.0 - 4.0 * part);
                deviation[i] * deviation[j] * correlated(at(j), here) * taper
            });
            self.covariance.push(first, entries);
        }
        Some(())
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
