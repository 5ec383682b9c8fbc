//! What is behind a ball, from what is seen around it: mean and covariance of the background at each pixel that the
//! ball covers in part.
//!
//! Brightness: a plane, fitted robustly, and on it clutter (an arm, a skid, an edge of the wall) as a random field whose
//! variance is that of what the plane leaves around the ball. No image is sharper than its blur, so the field's
//! correlation is that of blurred white noise, exp(-d²/4w²) with w the width of an edge. Its mean and covariance under
//! the ball follow by kriging (Matheron 1963; Rasmussen & Williams 2006, eq. 2.23-2.24). Where nothing but noise is left
//! on the plane, the plane is taken as it is.
//!
//! Colour differences: one robust mean; clutter is mostly grey, and they are coarse.

use super::cholesky::{factor, whiten_column};
use crate::patch::Patch;
use nalgebra::{Matrix3, Vector3};

/// Biweight cut-off with 95 % efficiency on Gaussian noise (Beaton & Tukey 1974).
pub(super) const CUT_OFF: f64 = 4.685;
/// A Gaussian's standard deviation over its median absolute value.
pub(super) const MEDIAN_TO_DEVIATION: f64 = 1.4826;
/// Width of the ring that is looked at beyond the ball's blurred rim, in edge widths: correlation beyond it is e⁻².
const RING_EDGES: f64 = 4.0;
/// Length of rim whose pixels are treated together; those of different stretches count as independent. The correlation
/// reaches two or three pixels.
const STRETCH_PX: f64 = 18.0;
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

/// Pixels `from..to` of the rim's list, whose covariance starts at `at`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) at: usize,
}

/// Working space and result.
#[derive(Debug, Clone, Default)]
pub(crate) struct Surroundings {
    /// Pixels clear of the ball, near it.
    clear: Vec<u32>,
    left: Vec<f64>,
    sorted: Vec<f64>,
    near: Vec<u32>,
    kernel: Vec<f64>,
    cross: Vec<f64>,
    solved: Vec<f64>,
    /// Brightness expected behind each pixel of the rim.
    pub(super) mean: Vec<f64>,
    /// Covariances of that, stretch by stretch; empty without clutter.
    pub(super) covariance: Vec<f64>,
    pub(super) stretches: Vec<Stretch>,
    /// Standard deviation of the clutter.
    pub(super) clutter: f64,
    /// Brightness in the middle of the plane.
    pub(super) level: f64,
    pub(super) color: [f64; 2],
    pub(super) color_variance: [f64; 2],
}

impl Surroundings {
    /// Estimates the background at the `rim` pixels, which are sorted by their angle around the disc. `clear` pixels are
    /// those of the patch that the disc leaves free, `free` the same for colour samples; None with too few of them.
    pub(super) fn estimate(
        &mut self,
        patch: &Patch,
        disc: &Disc,
        (rim, covered): (&[u32], &[f64]),
        color_covered: &[f64],
        noise_variance: f64,
    ) -> Option<()> {
        let reach_px = disc.radius_px + (3.0 + RING_EDGES) * disc.edge_px;
        self.clear.clear();
        self.clear.extend((0..patch.bright.len() as u32).filter(|i| {
            let (x, y) = patch.place(*i as usize);
            covered[*i as usize] < super::CLEAR && (x - disc.x_px).hypot(y - disc.y_px) < reach_px
        }));
        let plane = self.plane(patch, disc, noise_variance)?;
        self.level = plane.x;
        let level = |i: u32| {
            let (x, y) = patch.place(i as usize);
            plane.dot(&Vector3::new(1.0, x - disc.x_px, y - disc.y_px))
        };
        self.mean.clear();
        self.mean.extend(rim.iter().map(|i| level(*i)));
        self.left.clear();
        self.left.extend(self.clear.iter().map(|i| patch.bright[*i as usize] - level(*i)));
        let mean_square = self.left.iter().map(|r| r * r).sum::<f64>() / self.left.len() as f64;
        let clutter = mean_square - noise_variance;
        self.covariance.clear();
        self.stretches.clear();
        self.clutter = clutter.max(0.0).sqrt();
        if clutter > LEAST_CLUTTER * noise_variance {
            self.krige(patch, disc, rim, noise_variance)?;
        }
        self.mean_color(patch, color_covered)
    }

    /// Robust plane through the clear pixels: level in the middle and slopes.
    fn plane(&mut self, patch: &Patch, disc: &Disc, noise_variance: f64) -> Option<Vector3<f64>> {
        let mut plane = Vector3::zeros();
        let mut scale = f64::INFINITY;
        for round in 0..ROBUST_ROUNDS {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for i in &self.clear {
                let (x, y) = patch.place(*i as usize);
                let row = Vector3::new(1.0, x - disc.x_px, y - disc.y_px);
                let value = patch.bright[*i as usize];
                let weight = if round == 0 { 1.0 } else { biweight((value - plane.dot(&row)) / scale) };
                normal += row * row.transpose() * weight;
                right += row * (weight * value);
            }
            plane = normal.cholesky()?.solve(&right);
            self.sorted.clear();
            self.sorted.extend(self.clear.iter().map(|i| {
                let (x, y) = patch.place(*i as usize);
                (patch.bright[*i as usize] - plane.dot(&Vector3::new(1.0, x - disc.x_px, y - disc.y_px)))
                    .abs()
            }));
            scale = (MEDIAN_TO_DEVIATION * median(&mut self.sorted)?).max(noise_variance.sqrt());
        }
        Some(plane)
    }

    fn krige(&mut self, patch: &Patch, disc: &Disc, rim: &[u32], noise_variance: f64) -> Option<()> {
        let variance = self.clutter * self.clutter;
        let fall = (4.0 * disc.edge_px * disc.edge_px).recip();
        let correlated = |a: u32, b: u32| {
            let ((ax, ay), (bx, by)) = (patch.place(a as usize), patch.place(b as usize));
            variance * (-((ax - bx).powi(2) + (ay - by).powi(2)) * fall).exp()
        };
        let turn = |i: u32| {
            let (x, y) = patch.place(i as usize);
            (y - disc.y_px).atan2(x - disc.x_px)
        };
        let around_px = std::f64::consts::TAU * disc.radius_px;
        let count = (around_px / STRETCH_PX).round().max(1.0) as usize;
        let reach_rad = RING_EDGES * disc.edge_px / disc.radius_px;
        for k in 0..count {
            let (from, to) = (k * rim.len() / count, (k + 1) * rim.len() / count);
            let pixels = &rim[from..to];
            let (Some(first), Some(last)) = (pixels.first(), pixels.last()) else { continue };
            self.near.clear();
            let (low, high) = (turn(*first) - reach_rad, turn(*last) + reach_rad);
            self.near.extend((0..self.clear.len() as u32).filter(|i| {
                let at = turn(self.clear[*i as usize]);
                count == 1
                    || [-1.0, 0.0, 1.0]
                        .iter()
                        .any(|w| (low..high).contains(&(at + w * std::f64::consts::TAU)))
            }));
            let n = self.near.len();
            self.kernel.clear();
            self.kernel.resize(n * n, 0.0);
            for i in 0..n {
                for j in 0..=i {
                    let (a, b) = (self.clear[self.near[i] as usize], self.clear[self.near[j] as usize]);
                    self.kernel[i * n + j] = correlated(a, b) + if i == j { noise_variance } else { 0.0 };
                }
            }
            if !factor(&mut self.kernel, n) {
                return None;
            }
            self.solved.clear();
            self.solved.extend(self.near.iter().map(|i| self.left[*i as usize]));
            whiten_column(&self.kernel, n, &mut self.solved);
            self.cross.clear();
            for pixel in pixels {
                let start = self.cross.len();
                self.cross.extend(self.near.iter().map(|i| correlated(*pixel, self.clear[*i as usize])));
                whiten_column(&self.kernel, n, &mut self.cross[start..]);
            }
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
            let at = self.covariance.len();
            for (i, a) in pixels.iter().enumerate() {
                let row = &self.cross[i * n..(i + 1) * n];
                self.mean[from + i] += dot(row, &self.solved);
                for (j, b) in pixels.iter().enumerate() {
                    self.covariance.push(correlated(*a, *b) - dot(row, &self.cross[j * n..(j + 1) * n]));
                }
            }
            self.stretches.push(Stretch { from, to, at });
        }
        Some(())
    }

    fn mean_color(&mut self, patch: &Patch, covered: &[f64]) -> Option<()> {
        for channel in 0..2 {
            let free = || {
                patch.colors.iter().zip(covered).filter(|(_, c)| **c < super::CLEAR).map(|(v, _)| v[channel])
            };
            self.sorted.clear();
            self.sorted.extend(free());
            let middle = median(&mut self.sorted)?;
            self.sorted.clear();
            self.sorted.extend(free().map(|v| (v - middle).abs()));
            // Half a level is what rounding leaves of a uniform wall.
            let scale = (MEDIAN_TO_DEVIATION * median(&mut self.sorted)?).max(0.5);
            let (mut sum, mut square, mut total) = (0.0, 0.0, 0.0);
            for value in free() {
                let weight = biweight((value - middle) / scale);
                sum += weight * value;
                square += weight * (value - middle) * (value - middle);
                total += weight;
            }
            if total <= 0.0 {
                return None;
            }
            self.color[channel] = sum / total;
            self.color_variance[channel] = square / total;
        }
        Some(())
    }
}

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
