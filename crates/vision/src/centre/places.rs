//! The pixels of a fit, with what is behind the ball there.

use super::lanes::GROUP;
use crate::color::encode;

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
            self.decoding[c].push(encode(*light).1.recip());
        }
    }

    /// Fills up the last group; to be called once all are there.
    pub(super) fn finish(&mut self) {
        let whole = self.x.len().next_multiple_of(GROUP);
        let all = [&mut self.x, &mut self.y].into_iter().chain(&mut self.light).chain(&mut self.decoding);
        for values in all {
            values.resize(whole, values.last().copied().unwrap_or(0.0));
        }
    }
}
