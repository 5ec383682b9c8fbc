//! Which pixels of a frame show a colour at all: the first look at every pixel, so it decides how long a
//! whole frame takes.
//!
//! In a 4:2:0 frame, a pair of colour differences decides between which lumas a pixel is coloured, usually
//! none: that is worked out once for each pair that occurs, and most blocks of four pixels are passed by with
//! one look at a table.

use crate::color::{Seen, colored_hue, least_colored_code, to_linear};
use crate::frame::YuvToRgb;
use crate::window::Window;
use crate::{Frame, Pixels, YuvMatrix};

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
            Pixels::Rgb(rgb) => self.collect_rgb(rgb, frame.size.width_px as usize, window),
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

    fn collect_rgb(&mut self, rgb: &[u8], width: usize, window: &Window) {
        let (least_code, columns) = (least_colored_code(), &window.columns);
        for y in window.rows.clone() {
            let Some(row) = rgb.get(3 * (y * width + columns.start)..3 * (y * width + columns.end)) else {
                return;
            };
            for (code, x) in row.chunks_exact(3).zip(columns.clone()) {
                let rgb = [code[0], code[1], code[2]];
                if may_be_colored(rgb, least_code) {
                    add(&mut self.found, x, y, rgb);
                }
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
