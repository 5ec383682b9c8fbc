//! Frames as encoders of video want them.

use crate::frame::{chroma_size, rgb_to_yuv};
use crate::{Frame, Pixels, YuvMatrix};

impl Frame {
    /// This frame as YUV 4:2:0 of limited range (16 to 235), each colour difference of the mean of its 2×2 block, or of the
    /// part of it within the frame. The frame's own size must be that of its pixels ([`Frame::check`]).
    #[must_use]
    pub fn to_yuv420(&self, matrix: YuvMatrix) -> Self {
        let rgb = self.to_rgb();
        let (width, height) = (self.size.width_px as usize, self.size.height_px as usize);
        let [luma, blue, red] =
            rgb_to_yuv(false, matrix).map(|row| row.map(|weight| (weight * 65536.0).round() as i32));
        let coded = |weights: &[i32; 4], rgb: [i32; 3]| {
            let sum: i32 = weights.iter().zip(rgb).map(|(weight, value)| weight * value).sum();
            ((sum + weights[3] + (1 << 15)) >> 16).clamp(0, 255) as u8
        };
        let pixel = |at: usize| [0, 1, 2].map(|c| i32::from(rgb[3 * at + c]));
        let y = (0..width * height).map(|at| coded(&luma, pixel(at))).collect();
        let (columns, rows) = chroma_size(self.size);
        let (mut u, mut v) = (Vec::with_capacity(columns * rows), Vec::with_capacity(columns * rows));
        for row in 0..rows {
            let (top, bottom) = (2 * row * width, (2 * row + 1).min(height - 1) * width);
            for column in 0..columns {
                let (left, right) = (2 * column, (2 * column + 1).min(width - 1));
                let block = [top + left, top + right, bottom + left, bottom + right].map(pixel);
                let mean = [0, 1, 2].map(|c| (block.iter().map(|p| p[c]).sum::<i32>() + 2) / 4);
                u.push(coded(&blue, mean));
                v.push(coded(&red, mean));
            }
        }
        Self { size: self.size, pixels: Pixels::Yuv420 { y, u, v, full_range: false, matrix } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::ImageSize;

    #[test]
    fn colours_come_back_and_odd_sizes_have_their_last_block() {
        for (width_px, height_px) in [(4, 4), (5, 3), (1, 1)] {
            let size = ImageSize { width_px, height_px };
            for rgb in [[255, 255, 255], [0, 0, 0], [255, 0, 0], [0, 255, 0], [0, 0, 255], [90, 160, 30]] {
                let frame = Frame::from_rgb(size, rgb.repeat(size.area_px())).expect("a frame");
                for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
                    let coded = frame.to_yuv420(matrix);
                    coded.check().expect("planes of the right size");
                    let last = coded.rgb(width_px as usize - 1, height_px as usize - 1);
                    let error = |c: usize| (i32::from(last[c]) - i32::from(rgb[c])).abs();
                    assert!((0..3).all(|c| error(c) <= 3), "{rgb:?} came back as {last:?}");
                }
            }
        }
    }
}
