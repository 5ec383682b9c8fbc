//! The samples around a ball in one form, whatever the layout of the frame: a brightness at each pixel and
//! two colour differences at each pixel or at each block of 2×2. Places are counted from the first pixel.

use crate::frame::{chroma_size, rgb_to_yuv};
use crate::{Frame, Pixels, Vector2};
use nalgebra::Matrix3;

/// A rectangle of samples. Reused from ball to ball, so that nothing is allocated once it has grown.
#[derive(Debug, Clone)]
pub(crate) struct Patch {
    /// Column and row of the first pixel.
    pub(crate) first: (usize, usize),
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Brightness code of each pixel, row by row.
    pub(crate) bright: Vec<f32>,
    /// Pixels that a colour sample spans each way: 1 or 2.
    pub(crate) step: usize,
    /// Block column and row of the first colour sample, whose block lies wholly in the patch.
    pub(crate) first_block: (usize, usize),
    pub(crate) block_columns: usize,
    /// Colour differences of each block, row by row.
    pub(crate) colors: Vec<[f32; 2]>,
    /// Each channel as a combination of coded red, green and blue, and a constant.
    pub(crate) from_coded: [[f64; 4]; 3],
    /// Coded red, green and blue from the channels less their constants.
    pub(crate) to_coded: [[f32; 3]; 3],
}

impl Default for Patch {
    fn default() -> Self {
        Self {
            first: (0, 0),
            columns: 0,
            rows: 0,
            bright: Vec::new(),
            step: 1,
            first_block: (0, 0),
            block_columns: 0,
            colors: Vec::new(),
            from_coded: OPPONENTS,
            to_coded: [[0.0; 3]; 3],
        }
    }
}

const GREY: f64 = 0.577_350_269_189_625_8;
const ACROSS: f64 = 0.707_106_781_186_547_5;
const ALONG: f64 = 0.408_248_290_463_863_1;
/// An orthonormal basis of RGB with grey first: white noise remains white, and grey clutter leaves two
/// channels alone.
const OPPONENTS: [[f64; 4]; 3] =
    [[GREY, GREY, GREY, 0.0], [ACROSS, 0.0, -ACROSS, 0.0], [-ALONG, 2.0 * ALONG, -ALONG, 0.0]];

impl Patch {
    /// The first pixel's column and row in the image.
    pub(crate) fn corner(&self) -> Vector2<f64> {
        Vector2::new(self.first.0 as f64, self.first.1 as f64)
    }

    /// Fills the patch with what the frame holds within `reach_px` of `middle` in each direction.
    pub(crate) fn fill(&mut self, frame: &Frame, middle: Vector2<f64>, reach_px: f64) {
        let span = |centre: f64, count: u32| {
            let from = (centre - reach_px).ceil().clamp(0.0, f64::from(count)) as usize;
            let to = ((centre + reach_px).floor() + 1.0).clamp(0.0, f64::from(count)) as usize;
            (from, to.max(from))
        };
        let ((left, right), (top, bottom)) =
            (span(middle.x, frame.size.width_px), span(middle.y, frame.size.height_px));
        self.first = (left, top);
        (self.columns, self.rows) = (right - left, bottom - top);
        self.bright.clear();
        self.colors.clear();
        let width = frame.size.width_px as usize;
        match &frame.pixels {
            Pixels::Rgb(rgb) => {
                self.step = 1;
                self.first_block = self.first;
                self.block_columns = self.columns;
                self.set_matrix(OPPONENTS);
                for y in top..bottom {
                    let row = rgb.get(3 * (y * width + left)..3 * (y * width + right)).unwrap_or(&[]);
                    for code in row.chunks_exact(3) {
                        // Whole numbers up to here.
                        let (red, green, blue) = (i32::from(code[0]), i32::from(code[1]), i32::from(code[2]));
                        self.bright.push(GREY as f32 * (red + green + blue) as f32);
                        let across = ACROSS as f32 * (red - blue) as f32;
                        self.colors.push([across, ALONG as f32 * (2 * green - red - blue) as f32]);
                    }
                }
            }
            Pixels::Yuv420 { y: luma, u, v, full_range, matrix } => {
                self.step = 2;
                self.set_matrix(rgb_to_yuv(*full_range, *matrix));
                for y in top..bottom {
                    let row = luma.get(y * width + left..y * width + right).unwrap_or(&[]);
                    self.bright.extend(row.iter().map(|v| f32::from(*v)));
                }
                let across = chroma_size(frame.size).0;
                let blocks = |from: usize, to: usize| (from.div_ceil(2), (to / 2).max(from.div_ceil(2)));
                let ((x0, x1), (y0, y1)) = (blocks(left, right), blocks(top, bottom));
                self.first_block = (x0, y0);
                self.block_columns = x1 - x0;
                for y in y0..y1 {
                    let row = y * across + x0..y * across + x1;
                    let (Some(u), Some(v)) = (u.get(row.clone()), v.get(row)) else { continue };
                    self.colors.extend(u.iter().zip(v).map(|(u, v)| [f32::from(*u), f32::from(*v)]));
                }
            }
        }
    }

    fn set_matrix(&mut self, rows: [[f64; 4]; 3]) {
        if rows == self.from_coded && self.to_coded[0][0] != 0.0 {
            return;
        }
        self.from_coded = rows;
        let inverse = Matrix3::from_fn(|i, j| rows[i][j]).try_inverse().unwrap_or_else(Matrix3::identity);
        self.to_coded = std::array::from_fn(|i| std::array::from_fn(|j| inverse[(i, j)] as f32));
    }

    /// Coded red, green and blue of the values of all three channels.
    #[inline(always)]
    pub(crate) fn coded(&self, channels: [f32; 3]) -> [f32; 3] {
        let mut coded = [0.0; 3];
        for (code, row) in coded.iter_mut().zip(&self.to_coded) {
            for k in 0..3 {
                *code += row[k] * (channels[k] - self.from_coded[k][3] as f32);
            }
        }
        coded
    }

    /// Whether the buffers hold what the size says.
    pub(crate) fn is_whole(&self) -> bool {
        !self.bright.is_empty()
            && self.bright.len() == self.columns * self.rows
            && self.block_columns > 0
            && !self.colors.is_empty()
            && self.colors.len().is_multiple_of(self.block_columns)
    }

    /// Place of the first pixel of a colour sample's block.
    pub(crate) fn first_pixel(&self, block: usize) -> usize {
        if self.step == 1 {
            return block;
        }
        let (x, y) = (
            self.first_block.0 + block % self.block_columns,
            self.first_block.1 + block / self.block_columns,
        );
        (y * self.step - self.first.1) * self.columns + x * self.step - self.first.0
    }

    /// Column and row of the middle of a colour sample's block.
    #[inline]
    pub(crate) fn block_place(&self, block: usize) -> (f64, f64) {
        let middle = 0.5 * (self.step - 1) as f64;
        let at = |k: usize, from: usize| (k * self.step - from) as f64 + middle;
        (
            at(self.first_block.0 + block % self.block_columns, self.first.0),
            at(self.first_block.1 + block / self.block_columns, self.first.1),
        )
    }

    /// Column and row of a pixel.
    #[inline]
    pub(crate) fn place(&self, index: usize) -> (f64, f64) {
        ((index % self.columns) as f64, (index / self.columns) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ImageSize;

    #[test]
    fn channels_are_turned_back_to_codes() {
        let size = ImageSize { width_px: 30, height_px: 20 };
        let rgb: Vec<u8> = (0..30 * 20 * 3_u32).map(|i| (i * i % 251) as u8).collect();
        let frame = Frame::from_rgb(size, rgb).expect("a frame");
        let mut patch = Patch::default();
        for middle in [Vector2::new(15.0, 10.0), Vector2::new(1.0, 18.5), Vector2::new(29.0, 0.0)] {
            patch.fill(&frame, middle, 7.3);
            assert!(patch.is_whole());
            for i in 0..patch.bright.len() {
                let coded = patch.coded([patch.bright[i], patch.colors[i][0], patch.colors[i][1]]);
                let want = frame.rgb(patch.first.0 + i % patch.columns, patch.first.1 + i / patch.columns);
                assert!(coded.iter().zip(want).all(|(code, want)| (code - f32::from(want)).abs() < 1e-3));
            }
        }
    }
}
