//! The pixels of a fit, with what is behind the ball there.

use super::curve::{decode, encode};
use super::lanes::{GROUP, Lanes};
use crate::patch::Patch;
use pulp::Simd;

/// Pixels with what is behind them: linear light, and the slope of light over code there. In whole groups.
#[derive(Debug, Clone, Default)]
pub(super) struct Places {
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) light: [Vec<f32>; 3],
    pub(super) decoding: [Vec<f32>; 3],
}

impl Places {
    pub(super) fn clear(&mut self) {
        let Self { x, y, light, decoding } = self;
        [x, y].into_iter().chain(light).chain(decoding).for_each(Vec::clear);
    }

    pub(super) fn push(&mut self, (x_px, y_px): (f64, f64)) {
        self.x.push(x_px as f32);
        self.y.push(y_px as f32);
    }

    /// Fills up the last group; to be called once all are there.
    pub(super) fn finish(&mut self) {
        let whole = self.x.len().next_multiple_of(GROUP);
        for values in [&mut self.x, &mut self.y] {
            values.resize(whole, values.last().copied().unwrap_or(0.0));
        }
        for values in self.light.iter_mut().chain(&mut self.decoding) {
            values.resize(whole, 0.0);
        }
    }

    /// Sets the light behind the first pixels, of these brightnesses and of colours that are planes over the
    /// patch by their level at its first pixel and their slopes.
    #[inline(always)]
    pub(super) fn light_up_first<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        brights: &[f32],
        colors: &[[f64; 3]; 2],
    ) {
        let constant = patch.from_coded.map(|row| row[3]);
        for (group, brights) in brights.chunks(GROUP).enumerate() {
            let lanes = GROUP * group..GROUP * (group + 1);
            let mut whole = [0.0; GROUP];
            whole[..brights.len()].copy_from_slice(brights);
            for part in 0..Lanes::<S>::PARTS {
                let x = Lanes::load(simd, &self.x[lanes.clone()], part);
                let y = Lanes::load(simd, &self.y[lanes.clone()], part);
                let mut channels = [Lanes::load(simd, &whole, part) - Lanes::splat(simd, constant[0]); 3];
                for (k, [level, by_x, by_y]) in colors.iter().enumerate() {
                    let on_plane =
                        y.mul_add(Lanes::splat(simd, *by_y), Lanes::splat(simd, level - constant[k + 1]));
                    channels[k + 1] = x.mul_add(Lanes::splat(simd, *by_x), on_plane);
                }
                for (row, light) in patch.to_coded.iter().zip(&mut self.light) {
                    let mut code = channels[0] * Lanes::splat(simd, row[0]);
                    for k in 1..3 {
                        code = channels[k].mul_add(Lanes::splat(simd, row[k]), code);
                    }
                    decode(simd, code).store(&mut light[lanes.clone()], part);
                }
            }
        }
    }

    /// Sets the light behind all pixels from one on.
    pub(super) fn light_up_from(&mut self, first: usize, behind: &[f32; 3]) {
        for (lights, light) in self.light.iter_mut().zip(behind) {
            lights[first..].fill(*light);
        }
    }

    /// Finds the slopes, once the lights are there.
    #[inline(always)]
    pub(super) fn decode<S: Simd>(&mut self, simd: S) {
        for (light, decoding) in self.light.iter().zip(&mut self.decoding) {
            for part in 0..light.len() / S::F32_LANES {
                let (_, slope) = encode(simd, Lanes::load(simd, light, part));
                (Lanes::splat(simd, 1.0) / slope).store(decoding, part);
            }
        }
    }
}
