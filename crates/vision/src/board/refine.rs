//! A corner of squares to a part of a pixel.

use super::{BoardCorner, Grey};
use crate::{Matrix2, Vector2};

/// The window reaches so far along a side, as seen: what lies near the other end of an edge belongs to another corner.
const REACH: f64 = 0.4;
/// Standard deviation of the window's weight, in sides: it has fallen to 3 % at the reach, so pixels that enter and leave as
/// the window moves do not matter. A lens of k1 = -0.3 at half of a focal length from its axis bends an edge of 60 px
/// by 0.1 px at the reach, and moves the corner by a hundredth of a pixel under this weight.
const SPREAD: f64 = 0.15;
/// The same for small squares, in whose few pixels the steps of a sharp edge would show; at most so much of a side, where
/// the next corner's edges have a two-thousandth of the weight.
const LEAST_SPREAD_PX: f64 = 3.5;
const MOST_SPREAD: f64 = 0.25;
/// Edges that pass a corner by more than this are others: those of a hand before the board, of a marker beyond its strip.
/// They lose weight as under the likelihood of Geman & McClure (1987). Blur spreads a corner's own edges by a pixel or two.
const PASSING_PX: f64 = 3.0;
/// Half of the strip about an edge that is always looked at: a gradient's profile is about as wide.
const LEAST_STRIP_PX: f64 = 1.5;
/// A corner nearer to the rim of the image shows too little of one edge.
const RIM_PX: f64 = 3.0;
/// A corner that moves further than this part of a side, or so many pixels, is another.
const MOST_MOVED: f64 = 0.25;
const LEAST_MOVED_PX: f64 = 3.0;
/// Rounds of the refinement; two or three converge.
const ROUNDS: usize = 15;
/// A corner is never better than a hundredth of a pixel in eight-bit levels; steps of a tenth of that end the refinement.
const LEAST_VAR_PX2: f64 = 1e-4;
const CONVERGED_PX: f64 = 1e-3;

/// The edges that meet at a corner, as seen: each as far as the next corner along it.
#[derive(Clone, Copy)]
pub(super) struct Sides {
    along: Vector2<f64>,
    down: Vector2<f64>,
}

impl Sides {
    /// Of a corner of a board of so many columns and rows, by the places of those that are seen; `None` where it has no
    /// neighbour along an edge.
    pub(super) fn of(
        corner: usize,
        (columns, rows): (usize, usize),
        at: impl Fn(usize) -> Option<Vector2<f64>>,
    ) -> Option<Self> {
        let place = |i: isize, j: isize| {
            let c = (corner % columns).checked_add_signed(i)?;
            let r = (corner / columns).checked_add_signed(j)?;
            if c < columns && r < rows { at(r * columns + c) } else { None }
        };
        let here = place(0, 0)?;
        let side = |i: isize, j: isize| match (place(-i, -j), place(i, j)) {
            (Some(before), Some(after)) => Some((after - before) * 0.5),
            (None, Some(after)) => Some(after - here),
            (Some(before), None) => Some(here - before),
            (None, None) => None,
        };
        Some(Self { along: side(1, 0)?, down: side(0, 1)? })
    }

    fn area_px2(&self) -> f64 {
        self.along.perp(&self.down).abs()
    }

    fn least_px(&self) -> f64 {
        self.along.norm().min(self.down.norm())
    }

    /// From one edge to the next one alike: less than a side where the square is seen at a slant.
    pub(super) fn least_across_px(&self) -> f64 {
        self.area_px2() / self.along.norm().max(self.down.norm())
    }
}

/// What is near a corner.
pub(super) struct Surroundings {
    pub(super) sides: Sides,
    /// Half of the width, in sides, of the strips about the edges in which only these edges lie; infinite where squares
    /// are plain.
    pub(super) margin: f64,
    /// By how much less, as what lies beyond is blurred into the strips.
    pub(super) blur_px: f64,
}

/// The window of a corner: weights of pixels by how they lie to it.
struct Window {
    sides_from_pixel: Matrix2<f64>,
    /// Of the weight, in sides.
    spread: f64,
    /// From one edge to the next, and half of the strip about an edge: about edges that go down and along.
    across_px: Vector2<f64>,
    strip_px: Vector2<f64>,
    /// Half of the window, in columns and rows.
    half_px: Vector2<f64>,
}

impl Window {
    fn of(near: &Surroundings) -> Option<Self> {
        let Sides { along, down } = near.sides;
        let area_px2 = near.sides.area_px2();
        let across_px = Vector2::new(area_px2 / down.norm(), area_px2 / along.norm());
        let strip_px = across_px.map(|px| (near.margin * px - near.blur_px).max(LEAST_STRIP_PX));
        let spread = SPREAD.max((LEAST_SPREAD_PX / near.sides.least_px()).min(MOST_SPREAD));
        let half_px = (along.abs() + down.abs()) * (REACH / SPREAD * spread);
        let sides_from_pixel = Matrix2::from_columns(&[along, down]).try_inverse()?;
        let is_finite = half_px.iter().all(|h| h.is_finite());
        is_finite.then_some(Self { sides_from_pixel, spread, across_px, strip_px, half_px })
    }

    /// Weight of a pixel so far from the corner.
    fn weight(&self, away: &Vector2<f64>) -> f64 {
        let at = self.sides_from_pixel * away;
        // Strips end within a pixel, not at once: the sums then follow the corner steadily.
        let inside = |k: usize| (self.strip_px[k] + 0.5 - at[k].abs() * self.across_px[k]).clamp(0.0, 1.0);
        inside(0).max(inside(1)) * (-0.5 * at.norm_squared() / (self.spread * self.spread)).exp()
    }
}

/// The point to which gradients are at right angles to the directions from it (Foerstner & Guelch 1987), with the covariance
/// that the residuals of these equations leave (White 1980). Pixels are taken where they are, without interpolation.
pub(super) fn refined(grey: &Grey, near: &Vector2<f64>, surroundings: &Surroundings) -> Option<BoardCorner> {
    let window = Window::of(surroundings)?;
    let most_moved_px = LEAST_MOVED_PX.max(MOST_MOVED * surroundings.sides.least_px());
    let mut pixel = *near;
    for _ in 0..ROUNDS {
        let sums = Sums::of(grey, &pixel, &window)?;
        let inverse = sums.normal.try_inverse()?;
        let step = inverse * sums.right;
        let covariance_px2 = inverse * sums.spread * inverse + Matrix2::identity() * LEAST_VAR_PX2;
        pixel += step;
        let moved_px = (pixel - near).norm();
        if moved_px.is_nan() || moved_px > most_moved_px {
            return None;
        }
        if step.norm() < CONVERGED_PX {
            let is_finite = covariance_px2.iter().all(|x| x.is_finite());
            return is_finite.then_some(BoardCorner { pixel, covariance_px2 });
        }
    }
    None
}

/// Sums over the window about a place.
struct Sums {
    normal: Matrix2<f64>,
    right: Vector2<f64>,
    /// Of the squares of the right side's terms.
    spread: Matrix2<f64>,
}

impl Sums {
    fn of(grey: &Grey, about: &Vector2<f64>, window: &Window) -> Option<Self> {
        let last = Vector2::new(grey.width as f64 - 1.0, grey.height as f64 - 1.0);
        let is_inside = |k: usize| about[k] >= RIM_PX && about[k] <= last[k] - RIM_PX;
        if !is_inside(0) || !is_inside(1) {
            return None;
        }
        let pixels = |k: usize| {
            let from = (about[k] - window.half_px[k]).ceil().max(1.0) as usize;
            from..=(about[k] + window.half_px[k]).floor().min(last[k] - 1.0) as usize
        };
        let mut out = Self { normal: Matrix2::zeros(), right: Vector2::zeros(), spread: Matrix2::zeros() };
        for y in pixels(1) {
            for x in pixels(0) {
                let away = Vector2::new(x as f64, y as f64) - about;
                let near = window.weight(&away);
                if near <= 0.0 {
                    continue;
                }
                let across = f64::from(grey.at(x + 1, y) - grey.at(x - 1, y));
                let gradient = Vector2::new(across, f64::from(grey.at(x, y + 1) - grey.at(x, y - 1))) * 0.5;
                let (square, off) = (gradient * gradient.transpose(), gradient.dot(&away));
                // Passing by at off over the gradient's length; without a gradient there is nothing to weigh.
                let passing = off * off / (gradient.norm_squared() * PASSING_PX * PASSING_PX).max(1e-12);
                let weight = near / (1.0 + passing).powi(2);
                out.normal += square * weight;
                out.right += gradient * (off * weight);
                out.spread += square * (off * weight).powi(2);
            }
        }
        Some(out)
    }
}
