//! A part of a frame as a frame of its own.

use super::{Frame, Pixels, chroma_size};
use mavsight_geometry::ImageSize;
use std::ops::Range;

impl Frame {
    /// The samples between columns and between rows, as they are stored, as far as the frame has them, and the column and row at
    /// which they begin: even ones, at or before those asked for, as colour differences are of two by two pixels.
    #[must_use]
    pub fn part(&self, columns: Range<usize>, rows: Range<usize>) -> (Self, [usize; 2]) {
        let (width, height) = (self.size.width_px as usize, self.size.height_px as usize);
        let within = |range: Range<usize>, count: usize| {
            let to = range.end.min(count);
            range.start.min(to) / 2 * 2..to
        };
        let (columns, rows) = (within(columns, width), within(rows, height));
        let half = |range: &Range<usize>| range.start / 2..range.end.div_ceil(2);
        let of_chroma = |plane: &[u8]| cut::<1>(plane, chroma_size(self.size).0, half(&columns), half(&rows));
        let pixels = match &self.pixels {
            Pixels::Rgb(rgb) => Pixels::Rgb(cut::<3>(rgb, width, columns.clone(), rows.clone())),
            Pixels::Yuv420 { y, u, v, full_range, matrix } => Pixels::Yuv420 {
                y: cut::<1>(y, width, columns.clone(), rows.clone()),
                u: of_chroma(u),
                v: of_chroma(v),
                full_range: *full_range,
                matrix: *matrix,
            },
        };
        let size = ImageSize { width_px: columns.len() as u32, height_px: rows.len() as u32 };
        (Self { size, pixels }, [columns.start, rows.start])
    }
}

/// Columns and rows of a plane with so many samples a pixel.
fn cut<const SAMPLES: usize>(
    plane: &[u8],
    across: usize,
    columns: Range<usize>,
    rows: Range<usize>,
) -> Vec<u8> {
    let row = |y: usize| &plane[SAMPLES * (y * across + columns.start)..SAMPLES * (y * across + columns.end)];
    rows.flat_map(row).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::YuvMatrix;

    #[test]
    fn a_part_has_the_pixels_that_the_whole_has_there() {
        let size = ImageSize { width_px: 7, height_px: 5 };
        let samples = |count: usize, from: u8| (0..count).map(|k| from + 3 * k as u8).collect::<Vec<u8>>();
        let planes = [samples(35, 20), samples(12, 90), samples(12, 110)];
        let coded = Frame::from_yuv420(size, planes, true, YuvMatrix::Bt709).unwrap();
        let plain = Frame::from_rgb(size, (0..105).collect()).unwrap();
        for whole in [coded, plain] {
            for (columns, rows, wanted) in
                [(3..6, 1..4, [2, 0, 4, 4]), (5..99, 4..9, [4, 4, 3, 1]), (0..7, 0..5, [0, 0, 7, 5])]
            {
                let (part, [left, top]) = whole.part(columns, rows);
                part.check().unwrap();
                let ImageSize { width_px, height_px } = part.size;
                assert_eq!([left, top, width_px as usize, height_px as usize], wanted);
                for (x, y) in
                    (0..height_px as usize).flat_map(|y| (0..width_px as usize).map(move |x| (x, y)))
                {
                    assert_eq!(part.rgb(x, y), whole.rgb(left + x, top + y), "{x}, {y}");
                }
            }
        }
        let nothing = ImageSize { width_px: 0, height_px: 0 };
        assert_eq!(Frame::from_rgb(nothing, vec![]).unwrap().part(3..9, 0..1).0.size, nothing);
    }
}
