//! The pixels of a fit, with what is behind the ball there.

use super::curve::encode;
use super::lanes::{GROUP, Lanes};
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
        self.x.clear();
        self.y.clear();
        self.light.iter_mut().chain(&mut self.decoding).for_each(Vec::clear);
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

    /// Sets the light behind a pixel.
    pub(super) fn light_up(&mut self, index: usize, behind: &[f32; 3]) {
        for (lights, light) in self.light.iter_mut().zip(behind) {
            lights[index] = *light;
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
