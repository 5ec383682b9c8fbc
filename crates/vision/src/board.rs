//! The inner corners of a chessboard, to a part of a pixel.

mod coded;
mod lattice;
mod markers;
mod refine;

use crate::{Frame, Matrix2, Vector2};
pub use coded::{CodedBoard, CodedBoardError, find_coded_board};
use lattice::lattice;
pub use markers::MarkerDictionary;
use refine::{Sides, Surroundings, refined};

/// A corner of squares and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardCorner {
    /// Where the squares meet.
    pub pixel: Vector2<f64>,
    /// Covariance of that.
    pub covariance_px2: Matrix2<f64>,
}

/// Sixteen samples on a circle of radius 5 (Bennett & Lasenby 2014, figure 2).
const RING: [(isize, isize); 16] = [
    (0, -5),
    (2, -5),
    (3, -3),
    (5, -2),
    (5, 0),
    (5, 2),
    (3, 3),
    (2, 5),
    (0, 5),
    (-2, 5),
    (-3, 3),
    (-5, 2),
    (-5, 0),
    (-5, -2),
    (-3, -3),
    (-2, -5),
];
/// The same of radius 3 (that of Rosten & Drummond 2006), for small squares and narrow margins about markers.
const SMALL_RING: [(isize, isize); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];
/// Responses below this part of the strongest are no corners of the same board.
const LEAST_SHARE: f32 = 0.15;
/// A corner is the strongest within so many pixels.
const APART_PX: usize = 4;
/// Corners that are looked at: a room has others.
const MOST: usize = 600;

/// Grey levels, row by row.
struct Grey {
    width: usize,
    height: usize,
    level: Vec<f32>,
}

/// All `columns` by `rows` inner corners of a chessboard, row by row; `None` where not all of them are seen.
///
/// Corners are the maxima of the response of Bennett & Lasenby (2014), joined to a lattice from the strongest
/// on, and refined to the point where image gradients are at right angles to the directions towards it
/// (Foerstner & Guelch 1987), with a covariance from the residuals. The first corner is such that x runs
/// along a row and y from row to row, clockwise as seen; where the numbers of columns and rows differ in
/// parity, it is the one whose outer square is dark.
pub fn find_board(frame: &Frame, columns: usize, rows: usize) -> Option<Vec<BoardCorner>> {
    let grey = Grey::of(frame);
    let corners = candidates(&grey);
    if columns < 3 || rows < 3 || corners.len() < columns.saturating_mul(rows) {
        return None;
    }
    let mut found = lattice(&corners, columns, rows)?;
    if (columns + rows) % 2 == 1 && !first_is_dark(&grey, &found, columns) {
        found.reverse();
    }
    let smooth = grey.smoothed();
    let corner = |k: usize| {
        let sides = Sides::of(k, (columns, rows), |other| Some(found[other]))?;
        let surroundings = Surroundings { sides, margin: f64::INFINITY, blur_px: 0.0 };
        refined(&smooth, &found[k], &surroundings)
    };
    (0..found.len()).map(corner).collect()
}

impl Grey {
    fn of(frame: &Frame) -> Self {
        let (width, height) = (frame.size.width_px as usize, frame.size.height_px as usize);
        let mut row = vec![0; 3 * width];
        let mut level = Vec::with_capacity(width * height);
        for y in 0..height {
            frame.rgb_row(y, 0, width, &mut row);
            level.extend(
                row.chunks_exact(3)
                    .map(|p| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2])),
            );
        }
        Self { width, height, level }
    }

    /// Under a blur of about a pixel, which moves no corner and takes the steps out of interpolated edges.
    fn smoothed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let pass = |from: &[f32], step: usize| -> Vec<f32> {
            let n = from.len();
            let at = |k: usize| 0.25 * (from[k - step] + from[k + step]) + 0.5 * from[k];
            (0..n).map(|k| if k < step || k + step >= n { from[k] } else { at(k) }).collect()
        };
        let mut level = self.level.clone();
        for _ in 0..2 {
            level = pass(&pass(&level, 1), w);
        }
        Self { width: w, height: h, level }
    }

    fn at(&self, x: usize, y: usize) -> f32 {
        self.level[y * self.width + x]
    }

    fn beside(&self, x: usize, y: usize, (dx, dy): (isize, isize)) -> f32 {
        self.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy))
    }

    /// Between pixels; `None` outside.
    fn between(&self, p: &Vector2<f64>) -> Option<f64> {
        let (x, y) = (p.x.floor(), p.y.floor());
        if !(x >= 0.0 && y >= 0.0 && x + 1.0 < self.width as f64 && y + 1.0 < self.height as f64) {
            return None;
        }
        let (i, j, a, b) = (x as usize, y as usize, p.x - x, p.y - y);
        let mix = |u: f32, v: f32, share: f64| f64::from(u) * (1.0 - share) + f64::from(v) * share;
        let (top, bottom) =
            (mix(self.at(i, j), self.at(i + 1, j), a), mix(self.at(i, j + 1), self.at(i + 1, j + 1), a));
        Some(top * (1.0 - b) + bottom * b)
    }
}

/// How much a pixel is like a corner of a chessboard: opposite sides alike, quarters apart unlike, and the
/// middle like the ring.
fn response(grey: &Grey, x: usize, y: usize) -> f32 {
    let near = [(0, 0), (-1, 0), (1, 0), (0, 1), (0, -1)].map(|offset| grey.beside(x, y, offset));
    let middle = near.iter().sum::<f32>() / 5.0;
    let of_ring = |offsets: &[(isize, isize); 16]| {
        let ring = offsets.map(|offset| grey.beside(x, y, offset));
        let sum: f32 = (0..4).map(|k| (ring[k] + ring[k + 8] - ring[k + 4] - ring[k + 12]).abs()).sum();
        let difference: f32 = (0..8).map(|k| (ring[k] - ring[k + 8]).abs()).sum();
        sum - difference - 16.0 * (middle - ring.iter().sum::<f32>() / 16.0).abs()
    };
    of_ring(&RING).max(of_ring(&SMALL_RING))
}

/// Corners, strongest first.
fn candidates(grey: &Grey) -> Vec<Vector2<f64>> {
    let (w, h) = (grey.width, grey.height);
    if w < 32 || h < 32 {
        return Vec::new();
    }
    let mut responses = vec![0.0_f32; w * h];
    for y in 5..h - 5 {
        for x in 5..w - 5 {
            responses[y * w + x] = response(grey, x, y).max(0.0);
        }
    }
    let strongest = responses.iter().copied().fold(0.0, f32::max);
    let mut out: Vec<(f32, Vector2<f64>)> = Vec::new();
    for y in 5 + APART_PX..h - 5 - APART_PX {
        for x in 5 + APART_PX..w - 5 - APART_PX {
            let own = responses[y * w + x];
            if own <= LEAST_SHARE * strongest || own <= 0.0 {
                continue;
            }
            let around = |yy: usize| responses[yy * w + x - APART_PX..=yy * w + x + APART_PX].iter();
            let is_peak = (y - APART_PX..=y + APART_PX).all(|yy| {
                around(yy)
                    .enumerate()
                    .all(|(k, r)| *r < own || (*r == own && (yy, x + k) >= (y, x + APART_PX)))
            });
            if is_peak {
                out.push((own, Vector2::new(x as f64, y as f64)));
            }
        }
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out.into_iter().take(MOST).map(|c| c.1).collect()
}

/// Whether the square beyond the first corner, away from the others, is the darker one of its two kinds.
fn first_is_dark(grey: &Grey, found: &[Vector2<f64>], columns: usize) -> bool {
    let (along, down) = (found[1] - found[0], found[columns] - found[0]);
    let level = |a: f64, b: f64| grey.between(&(found[0] + along * a + down * b)).unwrap_or(0.0);
    // The squares that meet at the first corner: outer and inner are of one kind.
    level(-0.5, -0.5) + level(0.5, 0.5) < level(-0.5, 0.5) + level(0.5, -0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::ImageSize;

    /// A board under an affine image, each pixel the mean of 16 by 16 samples.
    fn frame(columns: usize, rows: usize, at: impl Fn(f64, f64) -> Vector2<f64>) -> Frame {
        let size = ImageSize { width_px: 200, height_px: 160 };
        let mut rgb = Vec::new();
        for y in 0..160 {
            for x in 0..200 {
                let mut sum = 0.0;
                for k in 0..256 {
                    let (a, b) = (f64::from(k % 16) + 0.5, f64::from(k / 16) + 0.5);
                    let s = at(f64::from(x) + a / 16.0 - 0.5, f64::from(y) + b / 16.0 - 0.5);
                    let (i, j) = (s.x.floor(), s.y.floor());
                    let inside = i >= -1.0 && j >= -1.0 && i < columns as f64 && j < rows as f64;
                    let is_dark = inside && (i + j).rem_euclid(2.0) == 0.0;
                    sum += if is_dark { 20.0 } else { 220.0 };
                }
                let level = (sum / 256.0_f64).round() as u8;
                rgb.extend([level; 3]);
            }
        }
        Frame::from_rgb(size, rgb).unwrap()
    }

    #[test]
    fn corners_are_found_where_they_are_and_in_their_order() {
        for turn in [0.1_f64, 0.5, 2.9, -1.8] {
            let (s, c) = turn.sin_cos();
            let board_from_pixel = |u: f64, v: f64| {
                let (x, y) = (u - 101.3, v - 79.6);
                Vector2::new((c * x + s * y) / 18.0 + 2.0, (-s * x + c * y) / 15.0 + 1.5)
            };
            let found = find_board(&frame(5, 4, board_from_pixel), 5, 4).unwrap();
            for (k, corner) in found.iter().enumerate() {
                let (i, j) = ((k % 5) as f64, (k / 5) as f64);
                let (x, y) = ((i - 2.0) * 18.0, (j - 1.5) * 15.0);
                let want = Vector2::new(c * x - s * y + 101.3, s * x + c * y + 79.6);
                assert!((corner.pixel - want).norm() < 0.04, "turn {turn}, {k}: {} {want}", corner.pixel);
            }
        }
    }

    #[test]
    fn no_board_is_none() {
        assert_eq!(find_board(&frame(5, 4, |u, v| Vector2::new(u / 18.0 + 8.0, v / 18.0)), 5, 4), None);
        assert_eq!(find_board(&frame(5, 4, |u, v| Vector2::new(u / 20.0 - 2.0, v / 20.0 - 2.0)), 7, 4), None);
        assert_eq!(find_board(&frame(5, 4, Vector2::new), 2, 4), None);
    }
}
