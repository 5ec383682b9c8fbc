//! First stage of a fit: the samples that a ball touches where the model has it.

use super::constants::CLEAR;
use super::lanes::GROUP;
use super::model::{Model, SITING};
use super::samples::parts;
use crate::patch::Patch;
use pulp::Simd;

/// Samples well inside a large ball that are used: enough to know its colour and shading as well as the rim
/// needs.
const MOST_INSIDE: usize = 400;
/// Depth inside the outline, in edge widths, from which samples say nothing of it: the shading near the rim
/// then follows from what lies around it there, whatever lamps and gloss do in the middle.
const DEEPEST: f32 = 6.0;

/// Which samples of a patch are used.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    /// Fraction of each pixel that the ball covers, and the pixel's depth inside the edge in edge widths.
    pub(super) covered: Vec<f32>,
    pub(super) depth: Vec<f32>,
    /// Fraction of each colour sample's block that the ball covers.
    pub(super) color_covered: Vec<f32>,
    /// Pixels that the ball covers in part, by their angle around it.
    pub(super) rim: Vec<u32>,
    /// Pixels in use: the rim, then those inside.
    pub(super) used: Vec<u32>,
    /// Pixels that are not in use themselves, but belong to a block that is.
    pub(super) shared: Vec<u32>,
    /// For each pixel of the patch one more than its place in `used` or, behind these, in `shared`; or 0.
    pub(super) slot: Vec<u32>,
    /// Blocks in use.
    pub(super) blocks: Vec<u32>,
}

impl Layout {
    /// Forms it in the buffers of an earlier one.
    #[inline(always)]
    pub(super) fn form<S: Simd>(&mut self, simd: S, patch: &Patch, model: &Model) {
        let Self { covered, depth, color_covered, rim, used, shared, slot, blocks } = self;
        [covered, depth, color_covered].into_iter().for_each(Vec::clear);
        [rim, used, shared, slot, blocks].into_iter().for_each(Vec::clear);
        self.cover(simd, patch, model);
        self.find_rim(patch, model);
        self.choose_blocks(patch, model);
        self.choose_pixels(patch, model);
    }

    /// The place of a pixel's values, if it has any.
    #[inline(always)]
    pub(super) fn place(&self, pixel: usize) -> Option<usize> {
        (self.slot[pixel] as usize).checked_sub(1)
    }

    #[inline(always)]
    fn cover<S: Simd>(&mut self, simd: S, patch: &Patch, model: &Model) {
        self.covered.reserve(patch.bright.len());
        self.depth.reserve(patch.bright.len());
        for row in 0..patch.rows {
            for first in (0..patch.columns).step_by(GROUP) {
                let mut places = [[first as f32; GROUP], [row as f32; GROUP]];
                for (lane, x) in places[0].iter_mut().enumerate() {
                    *x += lane as f32;
                }
                let (covered, depth) = model.coverage(simd, &places);
                let count = GROUP.min(patch.columns - first);
                self.covered.extend_from_slice(&covered[..count]);
                self.depth.extend_from_slice(&depth[..count]);
            }
        }
    }

    #[inline(always)]
    fn find_rim(&mut self, patch: &Patch, model: &Model) {
        // Angle in the upper half of a number, pixel in the lower: whole numbers are sorted fast.
        let mut by_angle: Vec<u64> = Vec::with_capacity(256);
        for (i, covered) in self.covered.iter().enumerate() {
            if (CLEAR..=1.0 - CLEAR).contains(covered) {
                let (x, y) = patch.place(i);
                let turn = (2.0 + turn(x - model.p[0], y - model.p[1])) * f64::from(1 << 29);
                by_angle.push((turn as u64) << 32 | i as u64);
            }
        }
        by_angle.sort_unstable();
        self.rim.extend(by_angle.iter().map(|key| *key as u32));
    }

    #[inline(always)]
    fn choose_blocks(&mut self, patch: &Patch, model: &Model) {
        for block in 0..patch.colors.len() {
            let parts = parts(patch, block, model.p[SITING]);
            let covered = parts.map(|parts| parts.map(|part| part.weight * self.covered[part.pixel]).sum());
            // A block at the border of the patch serves neither as ball nor as background.
            self.color_covered.push(covered.unwrap_or(0.5));
            let depth = || match patch.step {
                1 => self.depth[block],
                _ => model.depth_edges(patch.block_place(block)),
            };
            if covered.is_some_and(|covered| covered >= CLEAR) && depth() < DEEPEST {
                self.blocks.push(block as u32);
            }
        }
        let stride = self.blocks.len().div_ceil(2 * MOST_INSIDE).max(1);
        if stride > 1 {
            let mut seen = 0;
            self.blocks.retain(|b| {
                let is_inside = self.color_covered[*b as usize] > 1.0 - CLEAR;
                seen += usize::from(is_inside);
                !is_inside || seen.is_multiple_of(stride)
            });
        }
    }

    #[inline(always)]
    fn choose_pixels(&mut self, patch: &Patch, model: &Model) {
        self.used.extend_from_slice(&self.rim);
        let both = || self.covered.iter().zip(&self.depth).enumerate();
        let inside = || both().filter(|(_, (covered, depth))| **covered > 1.0 - CLEAR && **depth < DEEPEST);
        let stride = inside().count().div_ceil(MOST_INSIDE).max(1);
        self.used.extend(inside().step_by(stride).map(|(i, _)| i as u32));
        self.slot.resize(patch.bright.len(), 0);
        for (place, used) in self.used.iter().enumerate() {
            self.slot[*used as usize] = place as u32 + 1;
        }
        for block in &self.blocks {
            for part in parts(patch, *block as usize, model.p[SITING]).into_iter().flatten() {
                if self.slot[part.pixel] == 0 && self.covered[part.pixel] >= 0.5 {
                    self.shared.push(part.pixel as u32);
                    self.slot[part.pixel] = (self.used.len() + self.shared.len()) as u32;
                }
            }
        }
    }
}

/// A number that grows with the angle of a direction, over one turn from -2 to 2.
fn turn(x: f64, y: f64) -> f64 {
    let across = x / (x.abs() + y.abs()).max(f64::MIN_POSITIVE);
    if y < 0.0 { across - 1.0 } else { 1.0 - across }
}
