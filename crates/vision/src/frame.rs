//! An image as a camera or decoder hands it over, with colours converted where they are looked at.

mod part;

use crate::VisionError;
use mavsight_geometry::ImageSize;

/// Which luma weights a YUV image was made with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum YuvMatrix {
    /// ITU-R BT.601: standard definition.
    Bt601,
    /// ITU-R BT.709: high definition.
    Bt709,
}

/// The samples of a frame; rows from top to bottom without padding.
#[derive(Debug, Clone, PartialEq)]
pub enum Pixels {
    /// Red, green and blue of each pixel, sRGB-coded.
    Rgb(Vec<u8>),
    /// Luma and, for each 2×2 block (rounded up at odd sizes), two colour differences.
    Yuv420 {
        /// Luma, one a pixel.
        y: Vec<u8>,
        /// Blue difference, one a block.
        u: Vec<u8>,
        /// Red difference, one a block.
        v: Vec<u8>,
        /// Whether luma spans 0-255 rather than 16-235.
        full_range: bool,
        /// The luma weights.
        matrix: YuvMatrix,
    },
}

/// One image of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Columns and rows.
    pub size: ImageSize,
    /// The samples.
    pub pixels: Pixels,
}

/// Colour differences across a row of an image: half the columns, rounded up.
pub(crate) fn chroma_size(size: ImageSize) -> (usize, usize) {
    ((size.width_px as usize).div_ceil(2), (size.height_px as usize).div_ceil(2))
}

impl Frame {
    /// A frame of packed sRGB bytes, three a pixel.
    ///
    /// # Errors
    /// [`VisionError::FrameLength`] when the buffer does not fit the size.
    pub fn from_rgb(size: ImageSize, rgb: Vec<u8>) -> Result<Self, VisionError> {
        check_length("RGB", size, rgb.len(), 3 * size.area_px())?;
        Ok(Self { size, pixels: Pixels::Rgb(rgb) })
    }

    /// A frame of three planes with colour differences at half resolution both ways, as video decoders yield
    /// it.
    ///
    /// # Errors
    /// [`VisionError::FrameLength`] when a plane does not fit the size.
    pub fn from_yuv420(
        size: ImageSize,
        planes: [Vec<u8>; 3],
        full_range: bool,
        matrix: YuvMatrix,
    ) -> Result<Self, VisionError> {
        let [y, u, v] = planes;
        let frame = Self { size, pixels: Pixels::Yuv420 { y, u, v, full_range, matrix } };
        frame.check()?;
        Ok(frame)
    }

    /// The frame turned clockwise by quarters, plane by plane.
    #[must_use]
    pub fn turned(&self, quarters: u8) -> Self {
        let (width, height) = (self.size.width_px as usize, self.size.height_px as usize);
        let chroma = chroma_size(self.size);
        let pixels = match &self.pixels {
            Pixels::Rgb(rgb) => Pixels::Rgb(turned::<3>(rgb, (width, height), quarters)),
            Pixels::Yuv420 { y, u, v, full_range, matrix } => Pixels::Yuv420 {
                y: turned::<1>(y, (width, height), quarters),
                u: turned::<1>(u, chroma, quarters),
                v: turned::<1>(v, chroma, quarters),
                full_range: *full_range,
                matrix: *matrix,
            },
        };
        let size = if quarters.is_multiple_of(2) {
            self.size
        } else {
            ImageSize { width_px: self.size.height_px, height_px: self.size.width_px }
        };
        Self { size, pixels }
    }

    /// The frame with black and white exchanged, and each colour with its complement.
    #[must_use]
    pub fn inverted(&self) -> Self {
        let mut out = self.clone();
        // Limited range is from 16 to 235; a difference of colours is about 128.
        let mirror = |plane: &mut [u8], sum: u16| {
            plane.iter_mut().for_each(|x| *x = sum.saturating_sub(u16::from(*x)).min(255) as u8);
        };
        match &mut out.pixels {
            Pixels::Rgb(rgb) => mirror(rgb, 255),
            Pixels::Yuv420 { y, u, v, full_range, .. } => {
                mirror(y, if *full_range { 255 } else { 16 + 235 });
                mirror(u, 256);
                mirror(v, 256);
            }
        }
        out
    }

    /// One field of an interlaced frame as a frame of full size: its own rows (even ones where `is_top`)
    /// where they are, those between as the mean of their neighbours, and likewise the rows of colour
    /// differences.
    #[must_use]
    pub fn field(&self, is_top: bool) -> Self {
        let chroma = chroma_size(self.size).0;
        let width = self.size.width_px as usize;
        let mut out = self.clone();
        match &mut out.pixels {
            Pixels::Rgb(rgb) => keep_field(rgb, 3 * width, is_top),
            Pixels::Yuv420 { y, u, v, .. } => {
                keep_field(y, width, is_top);
                keep_field(u, chroma, is_top);
                keep_field(v, chroma, is_top);
            }
        }
        out
    }

    /// Verifies that the buffers fit the size; needed only for a frame that was put together by hand.
    ///
    /// # Errors
    /// [`VisionError::FrameLength`] naming the first plane that does not fit.
    pub fn check(&self) -> Result<(), VisionError> {
        let (chroma_width, chroma_height) = chroma_size(self.size);
        match &self.pixels {
            Pixels::Rgb(rgb) => check_length("RGB", self.size, rgb.len(), 3 * self.size.area_px()),
            Pixels::Yuv420 { y, u, v, .. } => {
                check_length("Y", self.size, y.len(), self.size.area_px())?;
                check_length("U", self.size, u.len(), chroma_width * chroma_height)?;
                check_length("V", self.size, v.len(), chroma_width * chroma_height)
            }
        }
    }

    /// Red, green and blue of one pixel; black outside the image.
    pub fn rgb(&self, x: usize, y: usize) -> [u8; 3] {
        let mut pixel = [0; 3];
        if x < self.size.width_px as usize {
            self.rgb_row(y, x, x + 1, &mut pixel);
        }
        pixel
    }

    /// Converts columns `x0` to `x1` (not included) of row `y` into `out`, three bytes a pixel.
    ///
    /// Columns beyond the image or beyond `out` are left alone, as is everything when the row is not in the
    /// image.
    pub fn rgb_row(&self, y: usize, x0: usize, x1: usize, out: &mut [u8]) {
        let width = self.size.width_px as usize;
        let x1 = x1.min(width).min(x0 + out.len() / 3);
        if y >= self.size.height_px as usize || x0 >= x1 {
            return;
        }
        match &self.pixels {
            Pixels::Rgb(rgb) => {
                let from = 3 * (y * width + x0);
                let count = 3 * (x1 - x0);
                if let Some(row) = rgb.get(from..from + count) {
                    out[..count].copy_from_slice(row);
                }
            }
            Pixels::Yuv420 { y: luma, u, v, full_range, matrix } => {
                let table = YuvToRgb::of(*full_range, *matrix);
                let chroma_row = y / 2 * width.div_ceil(2);
                let Some(luma) = luma.get(y * width..(y + 1) * width) else { return };
                let chroma = chroma_row..chroma_row + width.div_ceil(2);
                let (Some(u), Some(v)) = (u.get(chroma.clone()), v.get(chroma)) else { return };
                for (x, pixel) in (x0..x1).zip(out.chunks_exact_mut(3)) {
                    pixel.copy_from_slice(&table.convert(luma[x], u[x / 2], v[x / 2]));
                }
            }
        }
    }

    /// The whole frame as packed sRGB bytes.
    pub fn to_rgb(&self) -> Vec<u8> {
        let width = self.size.width_px as usize;
        let mut rgb = vec![0; 3 * self.size.area_px()];
        if width > 0 {
            for (y, row) in rgb.chunks_exact_mut(3 * width).enumerate() {
                self.rgb_row(y, 0, width, row);
            }
        }
        rgb
    }
}

/// A plane of `N` bytes a pixel, turned clockwise by quarters.
fn turned<const N: usize>(plane: &[u8], (width, height): (usize, usize), quarters: u8) -> Vec<u8> {
    let mut out = Vec::with_capacity(plane.len());
    let (across, down) = if quarters.is_multiple_of(2) { (width, height) } else { (height, width) };
    for row in 0..down {
        for column in 0..across {
            let (x, y) = match quarters % 4 {
                0 => (column, row),
                1 => (row, height - 1 - column),
                2 => (width - 1 - column, height - 1 - row),
                _ => (width - 1 - row, column),
            };
            let from = N * (y * width + x);
            out.extend_from_slice(plane.get(from..from + N).unwrap_or(&[0; N]));
        }
    }
    out
}

/// Replaces the rows of the other field by the mean of their neighbours.
fn keep_field(plane: &mut [u8], row_bytes: usize, is_top: bool) {
    let rows = plane.len().checked_div(row_bytes).unwrap_or(0);
    for row in (usize::from(is_top)..rows).step_by(2).filter(|_| rows > 1) {
        let above = if row > 0 { row - 1 } else { row + 1 };
        let below = if row + 1 < rows { row + 1 } else { row - 1 };
        for k in 0..row_bytes {
            let sum = u16::from(plane[above * row_bytes + k]) + u16::from(plane[below * row_bytes + k]);
            plane[row * row_bytes + k] = sum.div_ceil(2) as u8;
        }
    }
}

fn check_length(
    plane: &'static str,
    size: ImageSize,
    bytes: usize,
    wanted: usize,
) -> Result<(), VisionError> {
    if bytes == wanted {
        return Ok(());
    }
    Err(VisionError::FrameLength { plane, width_px: size.width_px, height_px: size.height_px, bytes, wanted })
}

/// Luma, blue and red difference as combinations of coded red, green and blue, and a constant.
pub(crate) fn rgb_to_yuv(full_range: bool, matrix: YuvMatrix) -> [[f64; 4]; 3] {
    let (red, blue) = matrix.red_and_blue();
    let weights = [red, 1.0 - red - blue, blue];
    let (zero, luma, chroma) =
        if full_range { (0.0, 1.0, 1.0) } else { (16.0, 219.0 / 255.0, 224.0 / 255.0) };
    let difference = |channel: usize| {
        let gain = 0.5 * chroma / (1.0 - weights[channel]);
        let part = |c: usize| gain * (f64::from(u8::from(c == channel)) - weights[c]);
        [part(0), part(1), part(2), 128.0]
    };
    [[luma * weights[0], luma * weights[1], luma * weights[2], zero], difference(2), difference(0)]
}

impl YuvMatrix {
    /// The weights of red and blue in luma.
    const fn red_and_blue(self) -> (f64, f64) {
        match self {
            Self::Bt601 => (0.299, 0.114),
            Self::Bt709 => (0.2126, 0.0722),
        }
    }
}

/// Integer conversion with 16 fractional bits, after the defining equations of BT.601 and BT.709.
#[derive(Debug, Clone, Copy)]
pub(crate) struct YuvToRgb {
    luma_zero: i32,
    luma_gain: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl YuvToRgb {
    const BT601_LIMITED: Self = Self::new(YuvMatrix::Bt601, false);
    const BT601_FULL: Self = Self::new(YuvMatrix::Bt601, true);
    const BT709_LIMITED: Self = Self::new(YuvMatrix::Bt709, false);
    const BT709_FULL: Self = Self::new(YuvMatrix::Bt709, true);

    const fn new(matrix: YuvMatrix, full_range: bool) -> Self {
        let (red_weight, blue_weight) = matrix.red_and_blue();
        let (zero, luma, chroma) =
            if full_range { (0, 1.0, 1.0) } else { (16, 255.0 / 219.0, 255.0 / 224.0) };
        let green_weight = 1.0 - red_weight - blue_weight;
        let red_v = 2.0 * (1.0 - red_weight) * chroma;
        let blue_u = 2.0 * (1.0 - blue_weight) * chroma;
        Self {
            luma_zero: zero,
            luma_gain: fixed(luma),
            red_v: fixed(red_v),
            green_u: fixed(blue_u * blue_weight / green_weight),
            green_v: fixed(red_v * red_weight / green_weight),
            blue_u: fixed(blue_u),
        }
    }

    pub(crate) fn of(full_range: bool, matrix: YuvMatrix) -> &'static Self {
        match (matrix, full_range) {
            (YuvMatrix::Bt601, false) => &Self::BT601_LIMITED,
            (YuvMatrix::Bt601, true) => &Self::BT601_FULL,
            (YuvMatrix::Bt709, false) => &Self::BT709_LIMITED,
            (YuvMatrix::Bt709, true) => &Self::BT709_FULL,
        }
    }

    pub(crate) fn convert(&self, y: u8, u: u8, v: u8) -> [u8; 3] {
        let luma = (i32::from(y) - self.luma_zero) * self.luma_gain + (1 << 15);
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        [
            clamped(luma + self.red_v * v),
            clamped(luma - self.green_u * u - self.green_v * v),
            clamped(luma + self.blue_u * u),
        ]
    }
}

const fn fixed(value: f64) -> i32 {
    (value * 65536.0 + 0.5) as i32
}

fn clamped(value: i32) -> u8 {
    (value >> 16).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(width_px: u32, height_px: u32) -> ImageSize {
        ImageSize { width_px, height_px }
    }

    #[test]
    fn an_inverted_frame_has_black_for_white_and_inverts_back() {
        let rgb = Frame::from_rgb(size(2, 1), vec![0, 10, 255, 128, 1, 2]).unwrap();
        assert_eq!(rgb.inverted().pixels, Pixels::Rgb(vec![255, 245, 0, 127, 254, 253]));
        let planes = [vec![16, 235, 100, 16], vec![100], vec![200]];
        let yuv = Frame::from_yuv420(size(2, 2), planes, false, YuvMatrix::Bt601).unwrap();
        assert_eq!(
            (yuv.inverted().rgb(0, 0), yuv.inverted().inverted()),
            (yuv.inverted().rgb(1, 1), yuv.clone())
        );
        let grey = Frame::from_yuv420(size(1, 1), [vec![16], vec![128], vec![128]], false, YuvMatrix::Bt601);
        assert_eq!(grey.unwrap().inverted().rgb(0, 0), [255, 255, 255]);
    }

    /// 100 % colour bars: the code values printed in ITU-R BT.801 (601) and in SMPTE RP 219 rounded to 8 bits
    /// (709).
    #[test]
    fn colour_bars_decode_to_their_primaries() {
        let bt601 = [
            ([235, 128, 128], [255, 255, 255]),
            ([210, 16, 146], [255, 255, 0]),
            ([170, 166, 16], [0, 255, 255]),
            ([145, 54, 34], [0, 255, 0]),
            ([106, 202, 222], [255, 0, 255]),
            ([81, 90, 240], [255, 0, 0]),
            ([41, 240, 110], [0, 0, 255]),
            ([16, 128, 128], [0, 0, 0]),
        ];
        let bt709 = [
            ([219, 16, 138], [255, 255, 0]),
            ([188, 154, 16], [0, 255, 255]),
            ([173, 42, 26], [0, 255, 0]),
            ([78, 214, 230], [255, 0, 255]),
            ([63, 102, 240], [255, 0, 0]),
            ([32, 240, 118], [0, 0, 255]),
        ];
        for (matrix, bars) in [(YuvMatrix::Bt601, &bt601[..]), (YuvMatrix::Bt709, &bt709[..])] {
            for (code, rgb) in bars {
                let seen = YuvToRgb::of(false, matrix).convert(code[0], code[1], code[2]);
                for (a, b) in seen.iter().zip(rgb) {
                    assert!(a.abs_diff(*b) <= 2, "{matrix:?} {code:?}: {seen:?} instead of {rgb:?}");
                }
            }
        }
    }

    /// JFIF 1.02: R = Y + 1.402 (Cr - 128), G = Y - 0.344136 (Cb - 128) - 0.714136 (Cr - 128), B = Y + 1.772
    /// (Cb - 128).
    #[test]
    fn full_range_follows_jfif() {
        for (y, u, v) in [(0, 128, 128), (255, 128, 128), (100, 90, 160), (200, 140, 100), (29, 255, 107)] {
            let (cb, cr) = (f64::from(u) - 128.0, f64::from(v) - 128.0);
            let luma = f64::from(y);
            let wanted = [luma + 1.402 * cr, luma - 0.344_136 * cb - 0.714_136 * cr, luma + 1.772 * cb];
            let seen = YuvToRgb::of(true, YuvMatrix::Bt601).convert(y, u, v);
            for (a, b) in seen.iter().zip(wanted) {
                assert!((f64::from(*a) - b.clamp(0.0, 255.0)).abs() <= 0.51, "{seen:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn wrong_lengths_are_named() {
        let error = Frame::from_rgb(size(4, 2), vec![0; 23]).unwrap_err();
        assert!(error.to_string().contains("23") && error.to_string().contains("24"), "{error}");
        let error =
            Frame::from_yuv420(size(5, 3), [vec![0; 15], vec![0; 6], vec![0; 4]], false, YuvMatrix::Bt709)
                .unwrap_err();
        assert!(matches!(error, VisionError::FrameLength { plane: "V", bytes: 4, wanted: 6, .. }));
    }

    #[test]
    fn quarters_turn_clockwise() {
        let rgb: Vec<u8> = (0..6).flat_map(|k| [k, 10 + k, 20 + k]).collect();
        // 0 1 2 over 3 4 5.
        let frame = Frame::from_rgb(size(3, 2), rgb).unwrap();
        let red = |f: &Frame| f.to_rgb().chunks(3).map(|p| p[0]).collect::<Vec<_>>();
        assert_eq!(red(&frame.turned(1)), [3, 0, 4, 1, 5, 2]);
        assert_eq!(red(&frame.turned(2)), [5, 4, 3, 2, 1, 0]);
        assert_eq!(red(&frame.turned(3)), [2, 5, 1, 4, 0, 3]);
        assert_eq!(frame.turned(1).size, size(2, 3));
        assert_eq!(frame.turned(1).turned(3), frame);
        let planes = [(0..15).collect(), (0..6).collect(), (6..12).collect()];
        let yuv = Frame::from_yuv420(size(5, 3), planes, false, YuvMatrix::Bt601).unwrap();
        assert!(yuv.turned(1).check().is_ok() && yuv.turned(2).turned(2) == yuv);
    }

    /// A slope of brightness down the image is the same in both fields; a field keeps its own rows.
    #[test]
    fn a_field_fills_the_rows_between() {
        let rgb: Vec<u8> = (0..6).flat_map(|row| [20 * row; 6]).collect();
        let frame = Frame::from_rgb(size(2, 6), rgb).unwrap();
        let red = |f: &Frame| f.to_rgb().chunks(6).map(|p| p[0]).collect::<Vec<_>>();
        assert_eq!(red(&frame.field(true)), [0, 20, 40, 60, 80, 80]);
        assert_eq!(red(&frame.field(false)), [20, 20, 40, 60, 80, 100]);
        let one = Frame::from_rgb(size(1, 1), vec![7; 3]).unwrap();
        assert_eq!(one.field(false), one);
    }

    #[test]
    fn odd_sizes_rows_and_pixels_agree() {
        let y = (0..15).map(|i| 20 + 10 * i as u8).collect::<Vec<_>>();
        let planes = [y, vec![128, 100, 150, 90, 128, 200], vec![128, 90, 60, 170, 128, 200]];
        let frame = Frame::from_yuv420(size(5, 3), planes, false, YuvMatrix::Bt601).unwrap();
        let whole = frame.to_rgb();
        for y in 0..3 {
            for x in 0..5 {
                assert_eq!(frame.rgb(x, y), whole[3 * (5 * y + x)..][..3]);
            }
        }
        assert_eq!(frame.rgb(5, 0), [0; 3]);
        assert_eq!(frame.rgb(0, 3), [0; 3]);
    }
}
