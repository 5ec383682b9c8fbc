//! Which pixels of a frame show a colour at all: the first look at every pixel, so it decides how long a
//! whole frame takes.
//!
//! In a 4:2:0 frame, a pair of colour differences decides between which lumas a pixel is coloured, usually
//! none: that is worked out once for each pair that occurs, and most blocks of four pixels are passed by with
//! one look at a table.

use crate::color::{Seen, colored_hue, least_colored_code, to_linear};
use crate::frame::YuvToRgb;
use crate::segment::Window;
use crate::{Frame, Pixels, YuvMatrix};
use std::ops::Range;

/// A coloured pixel; small, as a frame may be full of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chromatic {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) hue: [f32; 2],
}

impl Chromatic {
    pub(crate) fn seen(&self) -> Seen {
        Seen::pure(self.hue)
    }
}

/// Pixels of a row that are looked at together: most have nothing coloured among them.
const AT_ONCE: usize = u32::BITS as usize;

/// The collecting of coloured pixels of rows of red, green and blue, compiled for each vector unit that a
/// processor may have.
struct CollectRgb<'a> {
    rgb: &'a [u8],
    width: usize,
    window: &'a Window,
    found: &'a mut Vec<Chromatic>,
}

impl pulp::WithSimd for CollectRgb<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        let (least_code, columns, end) = (least_colored_code(), &self.window.columns, self.window.rows.end);
        if columns.is_empty() {
            return;
        }
        // Many pieces are looked at before any is gone through: what memory has to send is then awaited
        // together.
        let mut colored = [[false; AT_ONCE]; PIECES];
        let (mut x, mut y) = (columns.start, self.window.rows.start);
        while y < end {
            let (mut count, from) = (0, (x, y));
            while count < PIECES && y < end {
                colored[count] = self.may_be_colored(x, y, least_code);
                count += 1;
                (x, y) = next(x, y, columns);
            }
            (x, y) = from;
            for colored in &colored[..count] {
                if *colored != [false; AT_ONCE] {
                    self.add_those(x, y, colored);
                }
                (x, y) = next(x, y, columns);
            }
        }
    }
}

/// Pieces of rows that are looked at together.
const PIECES: usize = 32;

/// Where the next piece begins.
#[inline(always)]
fn next(x: usize, y: usize, columns: &Range<usize>) -> (usize, usize) {
    if x + AT_ONCE < columns.end { (x + AT_ONCE, y) } else { (columns.start, y + 1) }
}

impl CollectRgb<'_> {
    #[inline(always)]
    fn row(&self, y: usize) -> &[u8] {
        self.rgb.get(3 * y * self.width..3 * (y + 1) * self.width).unwrap_or(&[])
    }

    /// The first pixel of the piece that holds `x`: at the end of a row some are looked at again.
    #[inline(always)]
    fn first(&self, x: usize) -> usize {
        x.min(self.width.saturating_sub(AT_ONCE))
    }

    /// Which pixels of a piece may be coloured; in a narrow image all are taken to be.
    #[inline(always)]
    fn may_be_colored(&self, x: usize, y: usize, least_code: u8) -> [bool; AT_ONCE] {
        let many = self.row(y).get(3 * self.first(x)..).and_then(|left| left.first_chunk());
        match many {
            Some(many) => are_colored(many, least_code),
            None => [true; AT_ONCE],
        }
    }

    /// Adds the coloured ones of a piece.
    #[inline(always)]
    fn add_those(&mut self, x: usize, y: usize, colored: &[bool; AT_ONCE]) {
        let first = self.first(x);
        let end = self.window.columns.end.min(self.row(y).len() / 3);
        // One bit a pixel, those before this piece and behind the window left out.
        let bits = colored.iter().rev().fold(0, |bits, colored| bits << 1 | u32::from(*colored));
        let mut left = bits >> (x - first);
        while left != 0 {
            let x = x + left.trailing_zeros() as usize;
            if x >= end {
                break;
            }
            let code = &self.row(y)[3 * x..];
            let rgb = [code[0], code[1], code[2]];
            add(self.found, x, y, rgb);
            left &= left - 1;
        }
    }
}

/// Which of some pixels may be coloured.
#[inline(always)]
fn are_colored(pixels: &[u8; 3 * AT_ONCE], least_code: u8) -> [bool; AT_ONCE] {
    let mut colored = [false; AT_ONCE];
    for (k, colored) in colored.iter_mut().enumerate() {
        *colored = may_be_colored([pixels[3 * k], pixels[3 * k + 1], pixels[3 * k + 2]], least_code);
    }
    colored
}

/// Lowest and highest luma at which a pair of colour differences is coloured.
type LumaRange = (u8, u8);
const NEVER: LumaRange = (255, 0);
const UNKNOWN: LumaRange = (255, 1);

/// Collects coloured pixels; its tables are reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct Collector {
    /// Coloured pixels of the window, by row and column.
    pub(crate) found: Vec<Chromatic>,
    below: Vec<Chromatic>,
    ranges: Vec<LumaRange>,
    coding: Option<(bool, YuvMatrix)>,
}

impl Collector {
    /// Collects the coloured pixels of a window.
    pub(crate) fn collect(&mut self, frame: &Frame, window: &Window) {
        self.found.clear();
        match &frame.pixels {
            Pixels::Rgb(rgb) => {
                let (width, found) = (frame.size.width_px as usize, &mut self.found);
                pulp::Arch::new().dispatch(CollectRgb { rgb, width, window, found });
            }
            Pixels::Yuv420 { y, u, v, full_range, matrix } => {
                if self.coding != Some((*full_range, *matrix)) {
                    self.coding = Some((*full_range, *matrix));
                    self.ranges.clear();
                    self.ranges.resize(1 << 16, UNKNOWN);
                }
                self.collect_yuv(frame, [y, u, v], YuvToRgb::of(*full_range, *matrix), window);
            }
        }
    }

    fn collect_yuv(
        &mut self,
        frame: &Frame,
        [luma, blue, red]: [&[u8]; 3],
        convert: &YuvToRgb,
        window: &Window,
    ) {
        let (width, across) = (frame.size.width_px as usize, frame.size.width_px.div_ceil(2) as usize);
        let columns = &window.columns;
        let blocks = columns.start / 2..columns.end.div_ceil(2);
        let pixels = 2 * blocks.start..(2 * blocks.end).min(width);
        let mut top = window.rows.start;
        while top < window.rows.end {
            let bottom = (top / 2 * 2 + 2).min(window.rows.end) - 1;
            let samples = top / 2 * across + blocks.start..top / 2 * across + blocks.end;
            let row = |y: usize| luma.get(y * width + pixels.start..y * width + pixels.end);
            let (Some(blue), Some(red)) = (blue.get(samples.clone()), red.get(samples)) else { return };
            let (Some(above), Some(below)) = (row(top), row(bottom)) else { return };
            self.below.clear();
            let codes = above.chunks(2).zip(below.chunks(2)).zip(blue.iter().zip(red)).zip(blocks.clone());
            for (((above, below), (u, v)), block) in codes {
                let pair = usize::from(*u) << 8 | usize::from(*v);
                let mut range = self.ranges[pair];
                if range.0 > range.1 {
                    if range == NEVER {
                        continue;
                    }
                    range = luma_range(convert, *u, *v);
                    self.ranges[pair] = range;
                }
                let colored = |code: &u8| code.wrapping_sub(range.0) <= range.1.wrapping_sub(range.0);
                if range == NEVER || !(above.iter().any(colored) || below.iter().any(colored)) {
                    continue;
                }
                for (codes, y) in [(above, top), (below, bottom)].into_iter().take(1 + bottom - top) {
                    let into = if y == top { &mut self.found } else { &mut self.below };
                    for (code, x) in codes.iter().zip(2 * block..) {
                        if colored(code) && columns.contains(&x) {
                            add(into, x, y, convert.convert(*code, *u, *v));
                        }
                    }
                }
            }
            self.found.append(&mut self.below);
            top = bottom + 1;
        }
    }
}

#[inline(always)]
fn add(into: &mut Vec<Chromatic>, x: usize, y: usize, rgb: [u8; 3]) {
    if let Some(hue) = colored_hue(to_linear(rgb)) {
        into.push(Chromatic { x: x as u32, y: y as u32, hue });
    }
}

/// Lumas between which a pair of colour differences may be coloured.
fn luma_range(convert: &YuvToRgb, u: u8, v: u8) -> LumaRange {
    let colored = |y: &u8| colored_hue(to_linear(convert.convert(*y, u, v))).is_some();
    match ((0..=u8::MAX).find(colored), (0..=u8::MAX).rev().find(colored)) {
        (Some(least), Some(most)) => (least, most),
        _ => NEVER,
    }
}

/// A quick test on coded values that only removes what the tests of chroma and purity would remove: on the
/// sRGB curve half the linear light is at least 0.68 of the code.
#[inline(always)]
fn may_be_colored(rgb: [u8; 3], least_code: u8) -> bool {
    let most = rgb[0].max(rgb[1]).max(rgb[2]);
    let least = rgb[0].min(rgb[1]).min(rgb[2]);
    // 3/4 of the code, rounded up, is at most half the light only above the linear toe; below it there is no
    // chroma either.
    (most >= least_code) & (least <= most - most / 4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ImageSize;

    /// Every pixel by itself, as the definition says.
    fn one_by_one(frame: &Frame, window: &Window) -> Vec<(u32, u32)> {
        let mut found = Vec::new();
        for y in window.rows.clone() {
            for x in window.columns.clone() {
                if Seen::of(to_linear(frame.rgb(x, y))).is_colored() {
                    found.push((x as u32, y as u32));
                }
            }
        }
        found
    }

    #[test]
    fn all_coloured_pixels_are_found_in_their_order() {
        let size = ImageSize { width_px: 61, height_px: 47 };
        let mut state = 7u32;
        let mut random = |count: usize| -> Vec<u8> {
            (0..count)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 24) as u8
                })
                .collect()
        };
        let rgb = Frame::from_rgb(size, random(61 * 47 * 3)).expect("a frame");
        let narrow = ImageSize { width_px: 20, height_px: 47 };
        let mut frames = vec![rgb, Frame::from_rgb(narrow, random(20 * 47 * 3)).expect("a frame")];
        for (full, matrix) in [(false, YuvMatrix::Bt709), (true, YuvMatrix::Bt601)] {
            let planes = [random(61 * 47), random(31 * 24), random(31 * 24)];
            frames.push(Frame::from_yuv420(size, planes, full, matrix).expect("a frame"));
        }
        let mut collector = Collector::default();
        for frame in &frames {
            for window in [Window::whole(frame), Window { columns: 3..19, rows: 5..43 }] {
                collector.collect(frame, &window);
                let found: Vec<(u32, u32)> = collector.found.iter().map(|p| (p.x, p.y)).collect();
                assert_eq!(found, one_by_one(frame, &window));
            }
        }
    }
}
