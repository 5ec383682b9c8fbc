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

    pub(super) fn push(&mut self, (x_px, y_px): (f64, f64), behind: &[f32; 3]) {
        self.x.push(x_px as f32);
        self.y.push(y_px as f32);
        for (c, light) in behind.iter().enumerate() {
            self.light[c].push(*light);
        }
    }

    /// Fills up the last group and finds the slopes; to be called once all are there.
    #[inline(always)]
    pub(super) fn finish<S: Simd>(&mut self, simd: S) {
        let whole = self.x.len().next_multiple_of(GROUP);
        for values in [&mut self.x, &mut self.y].into_iter().chain(&mut self.light) {
            values.resize(whole, values.last().copied().unwrap_or(0.0));
        }
        for (light, decoding) in self.light.iter().zip(&mut self.decoding) {
            decoding.resize(whole, 0.0);
            for part in 0..whole / S::F32_LANES {
                let (_, slope) = encode(simd, Lanes::load(simd, light, part));
                (Lanes::splat(simd, 1.0) / slope).store(decoding, part);
            }
        }
    }
}
