//! The corners of a chessboard with numbered markers in its light squares (ChArUco), of which any part is in
//! view.

use super::lattice::nearest;
use super::markers::MarkerDictionary;
use super::refine::{Sides, Surroundings, refined};
use super::{BoardCorner, Grey, candidates};
use crate::centre::NOISE_STD;
use crate::{Frame, Vector2};
use std::cmp::Ordering;
use std::collections::HashMap;

/// A chessboard with a marker in each light square, numbered row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct CodedBoard {
    columns: usize,
    rows: usize,
    marker_share: f64,
    dictionary: MarkerDictionary,
}

/// Why a board cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CodedBoardError {
    /// No dictionary has that name.
    #[error(
        "no dictionary is called `{name}`: there are DICT_4X4, DICT_5X5, DICT_6X6 and DICT_7X7 with _50, _100, _250 or _1000, DICT_ARUCO_ORIGINAL, DICT_ARUCO_MIP_36h12, and DICT_APRILTAG with _16h5, _25h9, _36h10 or _36h11"
    )]
    UnknownDictionary {
        /// What it was called.
        name: String,
    },
    /// More squares than markers.
    #[error(
        "the board has {squares} light squares and the dictionary {markers} markers: name the one with which the board was printed"
    )]
    TooFewMarkers {
        /// Squares.
        squares: usize,
        /// Markers.
        markers: usize,
    },
    /// Too few corners, or markers that leave no margin.
    #[error(
        "{columns} by {rows} inner corners with markers of {share:.2} of a square: give 2 by 3 or more, and a marker of 0.4 to 0.9"
    )]
    Shape {
        /// Inner corners along a row.
        columns: usize,
        /// Rows.
        rows: usize,
        /// Side of a marker over that of a square.
        share: f64,
    },
}

/// Fewer corners are no detection of the board: four fix a plane's pose, and two more can contradict.
const LEAST_CORNERS: usize = 6;
/// Corners that may be next to one another on the board, by distance: those of modules lie in between.
const NEIGHBOURS: usize = 40;
/// Grey levels between a marker's border and the margin about it: ten standard deviations of a usual pixel's
/// noise.
const LEAST_CONTRAST: f64 = 10.0 * NOISE_STD;
/// Squares are looked for whose sides, as seen, differ by less than this factor and meet at an angle whose
/// sine is larger: a board that is tilted by up to 60° has such.
const MOST_UNLIKE: f64 = 2.0;
const LEAST_SINE: f64 = 0.4;
/// The fourth corner of a square is where the other three have it to within this part of a side; perspective
/// and lens move it.
const WITHIN: f64 = 0.2;
/// What lies this far beyond a strip about an edge enters it: a pixel's and a lens's blur, and the difference that is the
/// gradient.
const BLUR_PX: f64 = 2.0;
/// The same under two passes of smoothing.
const SMOOTHED_BLUR_PX: f64 = BLUR_PX + 2.0;
/// Half of a strip in which a smoothed edge lies.
const SMOOTHED_EDGE_PX: f64 = 3.0;

impl CodedBoard {
    /// A board of `columns` by `rows` inner corners, with markers of `marker_share` of a square's side.
    ///
    /// # Errors
    /// [`CodedBoardError`].
    pub fn new(
        (columns, rows): (usize, usize),
        marker_share: f64,
        dictionary: &str,
    ) -> Result<Self, CodedBoardError> {
        let is_small = columns < 2 || rows < 2 || columns.saturating_mul(rows) < LEAST_CORNERS;
        if is_small || !(0.4..=0.9).contains(&marker_share) {
            return Err(CodedBoardError::Shape { columns, rows, share: marker_share });
        }
        let name = dictionary;
        let dictionary = MarkerDictionary::named(name)
            .ok_or_else(|| CodedBoardError::UnknownDictionary { name: name.to_owned() })?;
        // Half of all: where their number is odd and the first is dark, the lesser half.
        let squares = columns.saturating_add(1).saturating_mul(rows.saturating_add(1)) / 2;
        let markers = dictionary.count();
        if squares > markers {
            return Err(CodedBoardError::TooFewMarkers { squares, markers });
        }
        let dictionary = dictionary.first(squares);
        Ok(Self { columns, rows, marker_share, dictionary })
    }

    /// Inner corners along a row, and rows of them.
    pub fn corners(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// The light squares (column, row) in the order of their markers; `first` 0 where the first square of the
    /// board is dark, as OpenCV has it since version 4.6, 1 where it is light.
    pub fn squares(&self, first: usize) -> Vec<(usize, usize)> {
        let all = (0..=self.rows).flat_map(|j| (0..=self.columns).map(move |i| (i, j)));
        all.filter(|(i, j)| (i + j + first) % 2 == 1).collect()
    }

    /// Modules along a marker's side, its border included.
    pub fn modules(&self) -> usize {
        self.dictionary.side() + 2
    }

    /// Side of a marker over that of a square.
    pub fn marker_share(&self) -> f64 {
        self.marker_share
    }

    /// Whether a point of the square with a marker is white, coordinates from 0 to 1.
    pub fn is_white(&self, marker: usize, x: f64, y: f64) -> bool {
        let modules = self.modules() as f64;
        let module = |v: f64| (v - 0.5 * (1.0 - self.marker_share)) / self.marker_share * modules;
        let (i, j) = (module(x), module(y));
        let is_marker = (0.0..modules).contains(&i) && (0.0..modules).contains(&j);
        // The border's modules wrap to numbers that no marker has.
        let at = |v: f64| (v as usize).wrapping_sub(1);
        !is_marker || self.dictionary.is_white(marker, at(i), at(j))
    }

    /// Number of an inner corner, row by row; `None` on the rim of the board.
    fn index(&self, i: usize, j: usize) -> Option<usize> {
        let (c, r) = (i.checked_sub(1)?, j.checked_sub(1)?);
        (c < self.columns && r < self.rows).then_some(r * self.columns + c)
    }
}

/// The inner corners of a board with markers that a frame shows, by their numbers (row by row, the board's
/// markers upright), and where they are; empty where fewer than six are found. Any part of the board will do.
///
/// Four corners around a marker that can be read are a square of the board (Garrido-Jurado et al. 2014);
/// further corners are where the lattice has them. Places and covariances are those of [`super::find_board`].
/// Whether the board's first square is dark is seen from how markers of two rows or more lie. Squares should
/// be 25 px across or more, and modules 3 px.
pub fn find_coded_board(frame: &Frame, board: &CodedBoard) -> Vec<(usize, BoardCorner)> {
    let grey = Grey::of(frame);
    let corners = candidates(&grey);
    let squares = markers(&grey, &corners, board);
    let [dark, light] = [0, 1].map(|first| labels(&squares, &board.squares(first), board));
    // A single row of markers does not show of which of the two boards it is.
    let mut places = match dark.len().cmp(&light.len()) {
        Ordering::Greater => dark,
        Ordering::Less => light,
        Ordering::Equal => return Vec::new(),
    };
    grow(&mut places, &corners, board);
    let mut out = refined_places(grey, &places, &corners, board);
    if out.len() < LEAST_CORNERS {
        return Vec::new();
    }
    out.sort_by_key(|c| c.0);
    out
}

/// The named corners to a part of a pixel. Where the margin about a marker is narrow, its border would enter smoothed edges.
fn refined_places(
    grey: Grey,
    places: &HashMap<usize, usize>,
    corners: &[Vector2<f64>],
    board: &CodedBoard,
) -> Vec<(usize, BoardCorner)> {
    let place_of = |other: usize| places.get(&other).map(|at| corners[*at]);
    let sides = |k: usize| Sides::of(k, (board.columns, board.rows), place_of);
    let found: Vec<(usize, Vector2<f64>, Sides)> =
        places.iter().filter_map(|(k, at)| Some((*k, corners[*at], sides(*k)?))).collect();
    let margin = 0.5 * (1.0 - board.marker_share);
    let least_px = margin * found.iter().map(|f| f.2.least_across_px()).fold(f64::INFINITY, f64::min);
    let is_wide = least_px >= SMOOTHED_EDGE_PX + SMOOTHED_BLUR_PX;
    let blur_px = if is_wide { SMOOTHED_BLUR_PX } else { BLUR_PX };
    let grey = if is_wide { grey.smoothed() } else { grey };
    let place = |(k, at, sides): (usize, Vector2<f64>, Sides)| {
        Some((k, refined(&grey, &at, &Surroundings { sides, margin, blur_px })?))
    };
    found.into_iter().filter_map(place).collect()
}

/// A marker that was read, and the corners of its square, clockwise from its own first.
struct Square {
    marker: usize,
    corners: [usize; 4],
}

fn markers(grey: &Grey, corners: &[Vector2<f64>], board: &CodedBoard) -> Vec<Square> {
    let near: Vec<Vec<usize>> = (0..corners.len()).map(|k| nearest(corners, k, NEIGHBOURS)).collect();
    let mut out = Vec::new();
    for p in 0..corners.len() {
        for a in near[p].iter().filter(|a| **a > p) {
            for b in near[p].iter().filter(|b| **b > p) {
                let (along, down) = (corners[*a] - corners[p], corners[*b] - corners[p]);
                let (m, n) = (along.norm(), down.norm());
                // Clockwise as seen; b with a is then anticlockwise.
                if along.perp(&down) < LEAST_SINE * m * n || m > MOST_UNLIKE * n || n > MOST_UNLIKE * m {
                    continue;
                }
                let expected = corners[p] + along + down;
                let off = |d: &&usize| (corners[**d] - expected).norm();
                let fourth = near[*a].iter().filter(|d| **d > p).min_by(|x, y| off(x).total_cmp(&off(y)));
                let Some(d) = fourth.filter(|d| off(d) < WITHIN * m.min(n)) else { continue };
                let around = [p, *a, *d, *b];
                if let Some((marker, quarters)) = read(grey, &around.map(|k| corners[k]), board) {
                    // Modules turned by a quarter clockwise begin at the corner before.
                    let turned = std::array::from_fn(|k| around[(k + 4 - quarters) % 4]);
                    out.push(Square { marker, corners: turned });
                }
            }
        }
    }
    out
}

/// The marker in a square whose corners are given clockwise, and by how many quarters it is turned.
fn read(grey: &Grey, corners: &[Vector2<f64>; 4], board: &CodedBoard) -> Option<(usize, usize)> {
    let image = Projective::of(corners)?;
    let level = |x: f64, y: f64| grey.between(&image.at(x, y));
    let margin = 0.5 * (1.0 - board.marker_share);
    let side = board.dictionary.side();
    let centre = |k: usize| margin + board.marker_share * (k as f64 + 0.5) / (side as f64 + 2.0);
    let last = side + 1;
    let (mut dark, mut light) = (f64::MIN, f64::MAX);
    for k in 0..=last {
        for (i, j) in [(k, 0), (k, last), (0, k), (last, k)] {
            dark = dark.max(level(centre(i), centre(j))?);
        }
        for v in [0.5 * margin, 1.0 - 0.5 * margin] {
            light = light.min(level(centre(k), v)?).min(level(v, centre(k))?);
        }
        if light - dark < LEAST_CONTRAST {
            return None;
        }
    }
    let threshold = 0.5 * (light + dark);
    let mut modules = 0;
    for k in 0..side * side {
        let is_white = level(centre(k % side + 1), centre(k / side + 1))? > threshold;
        modules = (modules << 1) | u64::from(is_white);
    }
    board.dictionary.read(modules)
}

/// The corners that the squares name, each by what most of its squares say.
fn labels(squares: &[Square], order: &[(usize, usize)], board: &CodedBoard) -> HashMap<usize, usize> {
    let mut votes: HashMap<(usize, usize), usize> = HashMap::new();
    for square in squares {
        let Some((i, j)) = order.get(square.marker) else { continue };
        for (corner, (di, dj)) in square.corners.iter().zip([(0, 0), (1, 0), (1, 1), (0, 1)]) {
            // A square at the rim has corners that are no inner ones.
            if let Some(k) = board.index(i + di, j + dj) {
                *votes.entry((*corner, k)).or_default() += 1;
            }
        }
    }
    let mut out = HashMap::new();
    for ((corner, k), n) in &votes {
        let others = votes.iter().filter(|((c, l), _)| (c == corner) != (l == k));
        if others.map(|(_, m)| m).max().is_none_or(|m| m < n) {
            out.insert(*k, *corner);
        }
    }
    out
}

/// Corners beside those that are named.
fn grow(places: &mut HashMap<usize, usize>, corners: &[Vector2<f64>], board: &CodedBoard) {
    let (columns, rows) = (board.columns as isize, board.rows as isize);
    loop {
        let mut new = None;
        'search: for k in (0..board.columns * board.rows).filter(|k| !places.contains_key(k)) {
            let (c, r) = (k as isize % columns, k as isize / columns);
            let at = |c: isize, r: isize| {
                let is_there = (0..columns).contains(&c) && (0..rows).contains(&r);
                places.get(&((r * columns + c) as usize)).filter(|_| is_there).map(|k| corners[*k])
            };
            for (dx, dy) in [(1, 1), (1, -1), (-1, 1), (-1, -1)] {
                let three = (at(c + dx, r), at(c, r + dy), at(c + dx, r + dy));
                let (Some(beside), Some(below), Some(across)) = three else { continue };
                let expected = beside + below - across;
                let within_px = WITHIN * (beside - across).norm().min((below - across).norm());
                let off = |n: &usize| (corners[*n] - expected).norm();
                let found = (0..corners.len()).min_by(|a, b| off(a).total_cmp(&off(b)));
                let is_free = |n: &usize| off(n) < within_px && !places.values().any(|p| p == n);
                if let Some(n) = found.filter(is_free) {
                    new = Some((k, n));
                    break 'search;
                }
            }
        }
        let Some((k, n)) = new else { return };
        places.insert(k, n);
    }
}

/// The unit square onto four corners, (0, 0), (1, 0), (1, 1), (0, 1) (Heckbert 1989, section 2.2.3).
struct Projective {
    columns: [Vector2<f64>; 3],
    last: [f64; 2],
}

impl Projective {
    fn of([p, q, r, s]: &[Vector2<f64>; 4]) -> Option<Self> {
        let (a, b, sum) = (q - r, s - r, p - q + r - s);
        let area = a.perp(&b);
        let (g, h) = (sum.perp(&b) / area, a.perp(&sum) / area);
        let columns = [q - p + q * g, s - p + s * h, *p];
        (g.is_finite() && h.is_finite()).then_some(Self { columns, last: [g, h] })
    }

    fn at(&self, x: f64, y: f64) -> Vector2<f64> {
        let [a, b, c] = self.columns;
        (a * x + b * y + c) / (self.last[0] * x + self.last[1] * y + 1.0)
    }
}

#[cfg(test)]
mod tests;
