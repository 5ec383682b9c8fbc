//! Which samples a ball touches, and the light behind them.

use super::Equations;
use crate::centre::CLEAR;
use crate::centre::curve::decode_one;
use crate::centre::lanes::GROUP;
use crate::centre::model::{EDGE, Model, RADIUS, SITING};
use crate::centre::samples::visit;
use crate::centre::surroundings::turn;
use crate::patch::Patch;
use pulp::Simd;

/// Samples well inside a large ball that are used: enough to know its colour and shading as well as the rim needs.
const MOST_INSIDE: usize = 400;
/// Depth inside the outline, in edge widths, from which samples say nothing of it: the shading near the rim is then told
/// from what lies around it there, whatever lamps and gloss do in the middle.
const DEEPEST: f32 = 6.0;

impl Equations {
    /// Decides which samples the ball touches, wherever it lies within a margin.
    #[inline(always)]
    pub(super) fn lay_out<S: Simd>(&mut self, simd: S, (patch, model): (&Patch, &Model), margin_px: f64) {
        let p = &model.p;
        self.edge_px = p[EDGE];
        if margin_px > 0.0 {
            let mut larger = *model;
            larger.p[RADIUS] += margin_px;
            self.cover(simd, patch, &larger);
            std::mem::swap(&mut self.covered, &mut self.touched);
        }
        self.cover(simd, patch, model);
        if margin_px <= 0.0 {
            self.touched.clone_from(&self.covered);
        }
        self.by_angle.clear();
        for (i, (covered, touched)) in self.covered.iter().zip(&self.touched).enumerate() {
            if *touched >= CLEAR && *covered <= 1.0 - CLEAR {
                let (x, y) = patch.place(i);
                self.by_angle.push((turn(x - p[0], y - p[1]), i as u32));
            }
        }
        self.by_angle.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        self.rim.clear();
        self.rim.extend(self.by_angle.iter().map(|(_, i)| *i));
        self.cover_blocks(patch, model);
    }

    /// Standard deviation of the clutter near each pixel and each block in use.
    #[inline(always)]
    fn find_near(&mut self, patch: &Patch) {
        self.near.clear();
        for pixel in &self.used {
            self.near.push(self.surroundings.clutter_near(patch, *pixel as usize, self.noise_variance));
        }
        self.color_near.clear();
        for block in &self.blocks {
            let first = patch.first_pixel(*block as usize);
            let known = (self.slot[first] as usize).checked_sub(1).and_then(|place| self.near.get(place));
            let near = || self.surroundings.clutter_near(patch, first, self.noise_variance);
            self.color_near.push(known.copied().unwrap_or_else(near));
        }
    }

    /// How far each pixel is covered, and how deep inside the edge it is.
    #[inline(always)]
    fn cover<S: Simd>(&mut self, simd: S, patch: &Patch, model: &Model) {
        self.covered.clear();
        self.depth.clear();
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

    /// How far each block is covered, and which blocks count.
    #[inline(always)]
    fn cover_blocks(&mut self, patch: &Patch, model: &Model) {
        let siting_px = model.p[SITING];
        self.color_covered.clear();
        self.color_touched.clear();
        self.blocks.clear();
        for block in 0..patch.colors.len() {
            let (mut sum, mut touched) = (0.0, 0.0);
            let whole = visit(patch, block, siting_px, |pixel, weight, _| {
                sum += weight * self.covered[pixel];
                touched += weight * self.touched[pixel];
            });
            // A block at the border of the patch serves neither as ball nor as background.
            self.color_covered.push(if whole { sum } else { 0.5 });
            self.color_touched.push(if whole { touched } else { 0.5 });
            let depth = || match patch.step {
                1 => self.depth[block],
                _ => model.depth_edges(patch.block_place(block)),
            };
            if whole && touched >= CLEAR && depth() < DEEPEST {
                self.blocks.push(block as u32);
            }
        }
        let stride = self.blocks.len().div_ceil(2 * MOST_INSIDE).max(1);
        if stride > 1 {
            let covered = &self.color_covered;
            let mut seen = 0;
            self.blocks.retain(|b| {
                let deep = covered[*b as usize] > 1.0 - CLEAR;
                seen += usize::from(deep);
                !deep || seen.is_multiple_of(stride)
            });
        }
    }

    #[inline(always)]
    pub(super) fn use_pixels<S: Simd>(&mut self, simd: S, patch: &Patch, model: &Model) {
        self.used.clear();
        self.used.extend_from_slice(&self.rim);
        let both = || self.covered.iter().zip(&self.depth).enumerate();
        let inside = || both().filter(|(_, (covered, depth))| **covered > 1.0 - CLEAR && **depth < DEEPEST);
        let stride = inside().count().div_ceil(MOST_INSIDE).max(1);
        self.used.extend(inside().step_by(stride).map(|(i, _)| i as u32));
        self.slot.clear();
        self.slot.resize(patch.bright.len(), 0);
        for (place, used) in self.used.iter().enumerate() {
            self.slot[*used as usize] = place as u32 + 1;
        }
        self.shared.clear();
        for block in &self.blocks {
            visit(patch, *block as usize, model.p[SITING], |pixel, _, _| {
                if self.slot[pixel] == 0 && self.covered[pixel] >= 0.5 {
                    self.shared.push(pixel as u32);
                    self.slot[pixel] = (self.used.len() + self.shared.len()) as u32;
                }
            });
        }
        self.places.clear();
        for index in self.used.iter().chain(&self.shared) {
            self.places.push(patch.place(*index as usize));
        }
        self.places.finish();
        self.light_up(simd, patch);
        self.places.decode(simd);
        self.find_near(patch);
    }

    /// Sets the light behind the ball.
    #[inline(always)]
    pub(super) fn light_up<S: Simd>(&mut self, simd: S, patch: &Patch) {
        let colors = self.surroundings.colors_from_corner();
        self.places.light_up_first(simd, patch, &self.surroundings.mean, &colors);
        // So little of it is seen there that it may be taken as it is on average, but not as any.
        let around = patch.coded(self.surroundings.around().map(|value| value as f32)).map(decode_one);
        self.places.light_up_from(self.rim.len(), &around);
    }
}
