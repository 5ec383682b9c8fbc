//! Second stage of a fit: what is behind a ball, from what is seen around it: mean and covariance of the
//! background at each pixel that the ball covers in part.
//!
//! Brightness: a plane, fitted robustly, and on it clutter (an arm, a skid, an edge of the wall) as a random
//! field whose variance is that of what the plane leaves around the ball ([`super::krige`]). Where nothing
//! but noise is left on the plane, the plane is taken as it is.
//!
//! Colour differences: a robust plane each; clutter is mostly grey, and they are coarse.

use super::cholesky::Banded;
use super::constants::CLEAR;
use super::curve::decode_one;
use super::krige::{Kriging, LEAST_CLUTTER, Spread};
use super::layout::Layout;
use super::model::{EDGE, Parameters, RADIUS};
use super::places::Places;
use super::policy::FitPolicy;
use super::robust::{Plane, Scattered, on};
use crate::patch::Patch;
use pulp::Simd;

/// Width of the ring that is looked at beyond the ball's blurred rim, in edge widths: correlation beyond it
/// is e⁻⁴.
const RING_EDGES: f64 = 4.0;
/// Least standard deviation of colours: half a level is what rounding leaves of a uniform wall.
const LEAST_COLOR_STD: f64 = 0.5;

/// Robust planes of brightness and colours around a ball, over the patch from a middle.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Planes {
    bright: Plane,
    colors: [Plane; 2],
    middle: (f64, f64),
    /// Mean squares of what the planes leave.
    variance: f64,
    color_variance: [f64; 2],
}

impl Planes {
    /// Planes through what the disc leaves free; None with too few free pixels.
    #[inline(always)]
    pub(super) fn new<S: Simd>(
        simd: S,
        patch: &Patch,
        (layout, p): (&Layout, &Parameters),
        noise_variance: f64,
    ) -> Option<Self> {
        let reach_px = p[RADIUS] + (3.0 + RING_EDGES) * p[EDGE];
        let free = Free { middle: (p[0], p[1]), reach_px2: (reach_px * reach_px) as f32 };
        let pixels = (patch.columns, (0.0, 0.0), 1);
        let bright = free
            .scattered(pixels, &layout.covered, |pixel| patch.bright[pixel])
            .plane(simd, noise_variance.sqrt())?;
        let mut planes =
            Self { bright: bright.middle, variance: bright.square, middle: free.middle, ..Self::default() };
        let blocks = (patch.block_columns, patch.block_place(0), patch.step);
        for channel in 0..2 {
            let color = free
                .scattered(blocks, &layout.color_covered, |block| patch.colors[block][channel])
                .plane(simd, LEAST_COLOR_STD)?;
            (planes.colors[channel], planes.color_variance[channel]) = (color.middle, color.square);
        }
        Some(planes)
    }

    /// Brightness expected at a place.
    #[inline(always)]
    fn level(&self, (x_px, y_px): (f64, f64)) -> f32 {
        on(&self.bright, x_px - self.middle.0, y_px - self.middle.1) as f32
    }
}

/// Area over which clutter is alike, in squared edge widths: the integral of the correlation of blurred white
/// noise. What is taken as independent from pixel to pixel but is not has its variance times the area.
const ALIKE: f64 = 4.0 * std::f64::consts::PI;

/// The background of one ball.
#[derive(Debug, Clone, Default)]
pub(super) struct Background {
    pub(super) kriging: Kriging,
    planes: Planes,
    /// Covariance of the brightness expected behind the rim, in the rim's order; empty without clutter.
    pub(super) covariance: Banded,
    /// Standard deviation of the clutter near each pixel and each block in use.
    pub(super) near: Vec<f32>,
    pub(super) color_near: Vec<f32>,
    /// Area over which clutter before the ball is taken to be alike.
    pub(super) alike_px2: f32,
    /// Pixels in use and shared ones, with the light behind the ball there.
    pub(super) places: Places,
}

impl Background {
    /// Forms what is expected behind the disc, on these planes, in the buffers of an earlier one; None where
    /// the clutter's covariance is none.
    #[inline(always)]
    pub(super) fn form<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        (layout, planes, edge_px): (&Layout, Planes, f64),
        (noise_variance, policy): (f64, FitPolicy),
    ) -> Option<()> {
        let clutter_variance = planes.variance - noise_variance;
        let clutter = clutter_variance.max(0.0).sqrt();
        self.planes = planes;
        self.alike_px2 = if policy.clutter_along_lines { (ALIKE * edge_px * edge_px) as f32 } else { 1.0 };
        let mut mean: Vec<f32> = layout.rim.iter().map(|i| planes.level(patch.place(*i as usize))).collect();
        self.kriging.clear(policy);
        self.covariance.clear();
        if clutter_variance > LEAST_CLUTTER * noise_variance {
            let spread = Spread { clutter, noise_variance };
            let around = (&layout.rim[..], &layout.covered[..]);
            let level = |place| planes.level(place);
            self.kriging.weigh(simd, (patch, edge_px, spread), around, level)?;
            self.kriging.predict(simd, clutter, &mut mean)?;
            self.kriging.correlate(&mut self.covariance);
        }
        let Self { kriging, near, color_near, .. } = self;
        let near_pixel =
            |pixel: usize| kriging.clutter_near(patch, pixel, noise_variance).unwrap_or(clutter) as f32;
        near.clear();
        near.extend(layout.used.iter().map(|pixel| near_pixel(*pixel as usize)));
        color_near.clear();
        color_near.extend(layout.blocks.iter().map(|block| near_pixel(patch.first_pixel(*block as usize))));
        self.light_up(simd, patch, layout, &mean);
        Some(())
    }

    /// Sets the light behind the ball, of this mean brightness behind its rim.
    #[inline(always)]
    fn light_up<S: Simd>(&mut self, simd: S, patch: &Patch, layout: &Layout, mean: &[f32]) {
        self.places.clear();
        for index in layout.used.iter().chain(&layout.shared) {
            self.places.push(patch.place(*index as usize));
        }
        self.places.finish();
        let (x, y) = self.planes.middle;
        let colors = self.planes.colors.map(|plane| [on(&plane, -x, -y), plane.y, plane.z]);
        self.places.light_up_first(simd, patch, mean, &colors);
        // So little of it is seen there that it may be taken as it is on average, but not as any.
        let around = patch.coded(self.around().map(|value| value as f32)).map(decode_one);
        self.places.light_up_from(mean.len(), &around);
        self.places.decode(simd);
    }

    /// Brightness and colour differences in the middle.
    pub(super) fn around(&self) -> [f64; 3] {
        [self.planes.bright.x, self.planes.colors[0].x, self.planes.colors[1].x]
    }

    /// Mean squares of the colour differences around their planes.
    pub(super) fn color_variance(&self) -> [f64; 2] {
        self.planes.color_variance
    }

    /// Colour differences expected behind the ball at a place.
    #[inline(always)]
    pub(super) fn colors_at(&self, (x_px, y_px): (f64, f64)) -> [f64; 2] {
        let (x, y) = self.planes.middle;
        self.planes.colors.map(|plane| on(&plane, x_px - x, y_px - y))
    }
}

/// The samples near a disc but free of it.
struct Free {
    middle: (f64, f64),
    reach_px2: f32,
}

impl Free {
    /// Samples of a grid whose first lies at `origin` of the patch, `step` pixels apart.
    #[inline(always)]
    fn scattered(
        &self,
        (columns, origin, step): (usize, (f64, f64), usize),
        covered: &[f32],
        value: impl Fn(usize) -> f32,
    ) -> Scattered {
        let (left, top) = ((origin.0 - self.middle.0) as f32, (origin.1 - self.middle.1) as f32);
        let mut out = Scattered::with_room(covered.len());
        for (row, covered) in covered.chunks_exact(columns).enumerate() {
            let y = top + (row * step) as f32;
            for (column, covered) in covered.iter().enumerate() {
                let x = left + (column * step) as f32;
                if *covered < CLEAR && x * x + y * y < self.reach_px2 {
                    out.push((x, y), value(row * columns + column));
                }
            }
        }
        out
    }
}
