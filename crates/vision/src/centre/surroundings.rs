//! What is behind a ball, from what is seen around it: mean and covariance of the background at each pixel that the
//! ball covers in part.
//!
//! Brightness: a plane, fitted robustly, and on it clutter (an arm, a skid, an edge of the wall) as a random field whose
//! variance is that of what the plane leaves around the ball ([`super::krige`]). Where nothing but noise is left on the
//! plane, the plane is taken as it is.
//!
//! Colour differences: a robust mean each, in a still a plane; clutter is mostly grey, and they are coarse.

use super::CLEAR;
use super::cholesky::Banded;
use super::krige::{Kriging, Spread};
use super::robust::{Plane, Scattered, on};
use crate::patch::Patch;
use pulp::Simd;

/// Width of the ring that is looked at beyond the ball's blurred rim, in edge widths: correlation beyond it is e⁻⁴.
const RING_EDGES: f64 = 4.0;
/// Clutter whose variance is below this part of the noise's does not matter.
pub(super) const LEAST_CLUTTER: f64 = 0.5;
/// Least standard deviation of colours: half a level is what rounding leaves of a uniform wall.
const LEAST_COLOR_STD: f64 = 0.5;

/// A disc with a soft edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) radius_px: f64,
    pub(super) edge_px: f64,
}

/// Whether clutter behind the ball is told from what is beside it, or taken as noise: enough as long as it is not clear
/// where the ball is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clutter {
    Predicted,
    AsNoise,
}

/// Working space and result.
#[derive(Debug, Clone, Default)]
pub(super) struct Surroundings {
    /// Brightness of the pixels near the ball but free of it, by their place from its centre.
    free: Scattered,
    free_colors: Scattered,
    kriging: Kriging,
    /// Brightness expected behind each pixel of the rim.
    pub(super) mean: Vec<f32>,
    /// Covariance of that, in the rim's order; empty without clutter.
    pub(super) covariance: Banded,
    /// Standard deviation of the clutter.
    pub(super) clutter: f64,
    /// That of what is not predicted, where it is taken as noise.
    pub(super) unpredicted: f64,
    /// Brightness in the middle of the plane.
    pub(super) level: f64,
    /// The middle of the planes.
    middle: (f64, f64),
    colors: [Plane; 2],
    pub(super) color_variance: [f64; 2],
}

impl Surroundings {
    /// Estimates the background at the `rim` pixels, which are sorted by their angle around the disc, from how far the
    /// disc covers each pixel and each colour sample of the patch; None with too few free ones.
    #[inline(always)]
    pub(super) fn estimate<S: Simd>(
        &mut self,
        simd: S,
        (patch, disc): (&Patch, &Disc),
        (rim, covered): (&[u32], &[f32]),
        color_covered: &[f32],
        (noise_variance, treated): (f64, Clutter),
    ) -> Option<()> {
        let reach_px = disc.radius_px + (3.0 + RING_EDGES) * disc.edge_px;
        let reach_px2 = (reach_px * reach_px) as f32;
        self.free.clear();
        let rows = patch.bright.chunks_exact(patch.columns).zip(covered.chunks_exact(patch.columns));
        for (row, (brights, covered)) in rows.enumerate() {
            let y = (row as f64 - disc.y_px) as f32;
            for (column, (bright, covered)) in brights.iter().zip(covered).enumerate() {
                let x = (column as f64 - disc.x_px) as f32;
                if *covered < CLEAR && x * x + y * y < reach_px2 {
                    self.free.push(x, y, *bright);
                }
            }
        }
        self.free.finish();
        let (plane, square) = self.free.plane(simd, noise_variance.sqrt())?;
        self.level = plane.x;
        let level = |(x, y): (f64, f64)| on(&plane, x - disc.x_px, y - disc.y_px) as f32;
        self.mean.clear();
        self.mean.extend(rim.iter().map(|i| level(patch.place(*i as usize))));
        let clutter = square - noise_variance;
        self.clutter = clutter.max(0.0).sqrt();
        self.unpredicted = if treated == Clutter::AsNoise { self.clutter } else { 0.0 };
        self.covariance.clear();
        if treated == Clutter::Predicted && clutter > LEAST_CLUTTER * noise_variance {
            let spread = Spread { clutter: self.clutter, noise_variance };
            let into = (&mut self.mean[..], &mut self.covariance);
            self.kriging.predict(simd, (patch, disc.edge_px, spread), (rim, covered), level, into)?;
        }
        self.middle = (disc.x_px, disc.y_px);
        self.color_planes(simd, patch, color_covered, reach_px2)
    }

    /// Whether there is the time that a still leaves: then lines beside the ball are followed behind it.
    pub(super) fn in_still(&self) -> bool {
        self.kriging.along_lines
    }

    /// Takes the time of a still.
    pub(super) fn take_time(&mut self) {
        self.kriging.along_lines = true;
    }

    /// Brightness and colour differences in the middle.
    pub(super) fn around(&self) -> [f64; 3] {
        [self.level, self.colors[0].x, self.colors[1].x]
    }

    /// Standard deviation of the clutter near a pixel; that of all around where it is not predicted or nothing near is free.
    pub(super) fn clutter_near(&self, patch: &Patch, pixel: usize, noise_variance: f64) -> f32 {
        let near = || self.kriging.clutter_near(patch, pixel, noise_variance);
        let is_known = self.in_still() && self.covariance.len() > 0;
        is_known.then(near).flatten().unwrap_or(self.clutter) as f32
    }

    /// Colour differences expected behind the ball at a place.
    #[inline(always)]
    pub(super) fn colors_at(&self, (x_px, y_px): (f64, f64)) -> [f64; 2] {
        let (x, y) = (x_px - self.middle.0, y_px - self.middle.1);
        [on(&self.colors[0], x, y), on(&self.colors[1], x, y)]
    }

    #[inline(always)]
    fn color_planes<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        covered: &[f32],
        reach_px2: f32,
    ) -> Option<()> {
        for channel in 0..2 {
            self.free_colors.clear();
            let rows =
                patch.colors.chunks_exact(patch.block_columns).zip(covered.chunks_exact(patch.block_columns));
            for (row, (values, covered)) in rows.enumerate() {
                let (left, y) = patch.block_place(row * patch.block_columns);
                let (left, y) = ((left - self.middle.0) as f32, (y - self.middle.1) as f32);
                for (column, (value, covered)) in values.iter().zip(covered).enumerate() {
                    let x = left + (column * patch.step) as f32;
                    let is_near = !self.kriging.along_lines || x * x + y * y < reach_px2;
                    if *covered < CLEAR && is_near {
                        self.free_colors.push(x, y, value[channel]);
                    }
                }
            }
            self.free_colors.finish();
            (self.colors[channel], self.color_variance[channel]) = if self.kriging.along_lines {
                self.free_colors.plane(simd, LEAST_COLOR_STD)?
            } else {
                let (mean, variance) = self.free_colors.mean(simd, LEAST_COLOR_STD)?;
                (Plane::new(mean, 0.0, 0.0), variance)
            };
        }
        Some(())
    }
}
