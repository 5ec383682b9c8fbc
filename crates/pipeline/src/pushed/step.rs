//! The step of a camera's images before a frame.

use crate::clock_step::{DECISIVE, OUT_OF_BEAT};
use mavsight_geometry::{Matrix2, Matrix3, Vector2, Vector3};
use nalgebra::{Matrix3x2, Matrix6, Matrix6x2, Vector6};
use std::collections::VecDeque;

/// Frames on either side through which parabolas are laid: the fewest that show whether one fits, and more, by which less is
/// found where the motion is slow.
pub(super) const WINDOWS: [usize; 3] = [5, 8, 12];
pub(super) const LONGEST: usize = WINDOWS[2];

/// Frames of one side in which a ball has to be seen: one more than a parabola has coefficients.
const LEAST_FRAMES: usize = 4;

/// Balls that have to step together.
const LEAST_BALLS: usize = 3;

/// Two estimates of a step that agree, by chi-square of two degrees of freedom at 99.9 %.
const AGREE: f64 = 13.8;

/// The balls of a frame that are the only ones of their colour, as the only markers of it.
#[derive(Debug, Default)]
pub(super) struct LoneBalls {
    pub(super) stamp_ns: i64,
    /// By colour: place and variance of a coordinate.
    balls: Vec<Option<(Vector2<f64>, f64)>>,
}

impl LoneBalls {
    /// Takes the balls of a frame, each with its colour, place and variance of a coordinate; colours have so many markers.
    pub(super) fn take(
        &mut self,
        stamp_ns: i64,
        seen: impl Iterator<Item = (usize, Vector2<f64>, f64)> + Clone,
        counts: &[usize],
    ) {
        let of_color = |(color, markers): (usize, &usize)| {
            let mut own = seen.clone().filter(|s| s.0 == color);
            let (_, pixel, variance_px2) = own.next().filter(|_| *markers == 1)?;
            own.next().is_none().then_some((pixel, variance_px2))
        };
        self.stamp_ns = stamp_ns;
        self.balls.clear();
        self.balls.extend(counts.iter().enumerate().map(of_color));
    }
}

/// By how much the images of several balls together step between two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct ImageStep {
    pub(super) by_px: Vector2<f64>,
    /// Its square in standard deviations.
    pub(super) square: f64,
}

/// By how much the images step before a frame. `None` where frames are missing or their clock is out of its beat, and where
/// without the two frames beside it no step is left: tried where the square is at least so large.
pub(super) fn step_before(
    frames: &VecDeque<LoneBalls>,
    at: usize,
    interval_ns: f64,
    least: f64,
) -> Option<ImageStep> {
    let beats = (frames[at].stamp_ns - frames[at - 1].stamp_ns) as f64 / interval_ns;
    if (beats - 1.0).abs() > OUT_OF_BEAT {
        return None;
    }
    let between = Between { frames, at, interval_ns };
    let shortest = between.step(WINDOWS[0], 0)?;
    let longer = WINDOWS[1..].iter().filter(|window| **window < at && at + **window < frames.len());
    let all = longer.filter_map(|window| Some((*window, between.step(*window, 0)?)));
    let fitting = all.filter(|(_, step)| step.agrees_with(&shortest));
    let (window, best) =
        fitting.chain([(WINDOWS[0], shortest)]).max_by(|a, b| a.1.square().total_cmp(&b.1.square()))?;
    let found = ImageStep { by_px: best.by_px, square: best.square() };
    if found.square < least {
        return Some(found);
    }
    // Of two frames that have each other's time stamps nothing is left without them, of a push all: it is nearer to that.
    let without = between.step(window + 1, 1)?;
    let is_left = without.by_px.dot(&best.by_px) > 0.5 * best.by_px.norm_squared();
    let is_bend = between.worse_if_smooth(window)? < DECISIVE * best.scale;
    (is_left && !is_bend).then_some(found)
}

/// What lies between two frames.
struct Between<'a> {
    frames: &'a VecDeque<LoneBalls>,
    at: usize,
    interval_ns: f64,
}

/// A step of several balls together.
#[derive(Clone, Copy)]
struct CommonStep {
    by_px: Vector2<f64>,
    variance_px2: f64,
    /// By how much the parabolas, or what the balls have in common, fit worse than noise explains.
    scale: f64,
}

impl CommonStep {
    fn square(&self) -> f64 {
        self.by_px.norm_squared() / (self.variance_px2 * self.scale)
    }

    /// Whether an estimate of less precision is the same.
    fn agrees_with(&self, other: &Self) -> bool {
        (self.by_px - other.by_px).norm_squared() <= AGREE * other.variance_px2 * other.scale
    }
}

/// A parabola through a ball's places, over times in frames.
struct Curve {
    /// By power.
    coefficients: Matrix3x2<f64>,
    covariance: Matrix3<f64>,
    /// Residuals, whitened.
    squares: Matrix2<f64>,
    /// Of each coordinate.
    degrees: f64,
}

impl Between<'_> {
    /// The step by so many frames on either side, less the nearest ones; each ball is weighted by what its curves determine.
    fn step(&self, window: usize, skipped: usize) -> Option<CommonStep> {
        if self.at < window || self.at + window > self.frames.len() {
            return None;
        }
        let curves: Vec<[Curve; 2]> = (0..self.frames[self.at].balls.len())
            .filter_map(|color| {
                let before = self.curve(color, self.at - window..self.at - skipped)?;
                Some([before, self.curve(color, self.at + skipped..self.at + window)?])
            })
            .collect();
        if curves.len() < LEAST_BALLS {
            return None;
        }
        // What is struck turns off between the frames, somewhere.
        let (by_px, _, _) = common(&curves, Vector3::x());
        let (turn_px, _, _) = common(&curves, Vector3::y());
        let struck = -by_px.dot(&turn_px) / turn_px.norm_squared().max(f64::MIN_POSITIVE);
        let at = struck.clamp(-0.5, 0.5);
        let (by_px, variance_px2, apart) = common(&curves, Vector3::new(1.0, at, at * at));
        let along = by_px.normalize();
        let own = || curves.iter().flatten();
        let squares: f64 = own().map(|c| along.dot(&(c.squares * along))).sum();
        let degrees: f64 = own().map(|c| c.degrees).sum();
        let scale = (squares / degrees).max(apart).max(1.0);
        Some(CommonStep { by_px, variance_px2, scale })
    }

    /// By how much more polynomials of as many coefficients as two parabolas, each through a ball's places on both sides, leave of
    /// them: little where the motion bends and no camera was pushed.
    fn worse_if_smooth(&self, window: usize) -> Option<f64> {
        let frames = self.at - window..self.at + window;
        let mut worse = 0.0;
        for color in 0..self.frames[self.at].balls.len() {
            let parabolas = [frames.start..self.at, self.at..frames.end].map(|side| self.curve(color, side));
            if let [Some(before), Some(after)] = parabolas {
                let smooth = self.smooth_squares(color, frames.clone(), window as f64)?;
                worse += smooth - (before.squares + after.squares).trace();
            }
        }
        Some(worse)
    }

    /// Whitened squares of what a polynomial of the fifth degree leaves of a ball's places, over times in parts of so many frames.
    fn smooth_squares(&self, color: usize, frames: std::ops::Range<usize>, span: f64) -> Option<f64> {
        let (mut normal, mut right, mut squares) = (Matrix6::zeros(), Matrix6x2::zeros(), 0.0);
        let mut origin_px = None;
        for frame in frames.map(|k| &self.frames[k]) {
            let Some((pixel, variance_px2)) = frame.balls[color] else { continue };
            let time = (frame.stamp_ns - self.frames[self.at].stamp_ns) as f64 / (self.interval_ns * span);
            let powers = Vector6::from_fn(|k, _| time.powi(k as i32));
            let by_px = pixel - *origin_px.get_or_insert(pixel);
            normal += powers * powers.transpose() / variance_px2;
            right += powers * by_px.transpose() / variance_px2;
            squares += by_px.norm_squared() / variance_px2;
        }
        Some(squares - (normal.cholesky()?.solve(&right)).dot(&right))
    }

    /// The parabola through a ball's places in some frames, by weighted least squares, over times from the middle of the two.
    fn curve(&self, color: usize, frames: std::ops::Range<usize>) -> Option<Curve> {
        let (before_ns, after_ns) = (self.frames[self.at - 1].stamp_ns, self.frames[self.at].stamp_ns);
        let middle_ns = before_ns + (after_ns - before_ns) / 2;
        let seen = || {
            let own = frames.clone().map(|k| &self.frames[k]);
            own.filter_map(|f| {
                let beats = (f.stamp_ns - middle_ns) as f64 / self.interval_ns;
                f.balls[color].map(|(pixel, variance_px2)| (beats, pixel, variance_px2))
            })
        };
        let (_, origin_px, _) = seen().next()?;
        let (mut normal, mut right) = (Matrix3::zeros(), Matrix3x2::zeros());
        let (mut squares, mut count) = (Matrix2::zeros(), 0);
        for (beats, pixel, variance_px2) in seen() {
            let (powers, by_px) = (Vector3::new(1.0, beats, beats * beats), pixel - origin_px);
            normal += powers * powers.transpose() / variance_px2;
            right += powers * by_px.transpose() / variance_px2;
            squares += by_px * by_px.transpose() / variance_px2;
            count += 1;
        }
        if count < LEAST_FRAMES {
            return None;
        }
        let covariance = normal.cholesky()?.inverse();
        let mut coefficients = covariance * right;
        let squares = squares - coefficients.transpose() * right;
        coefficients.set_row(0, &(coefficients.row(0) + origin_px.transpose()));
        Some(Curve { coefficients, covariance, squares, degrees: (count + 1 - LEAST_FRAMES) as f64 })
    }
}

/// The common difference of curves behind and before, of the value that a row makes of their coefficients: its weighted mean,
/// the variance of that, and the mean square of the balls about it in parts of what noise explains.
fn common(curves: &[[Curve; 2]], row: Vector3<f64>) -> (Vector2<f64>, f64, f64) {
    let differences = || {
        curves.iter().map(|[before, after]| {
            let by = (after.coefficients - before.coefficients).transpose() * row;
            (by, row.dot(&((after.covariance + before.covariance) * row)))
        })
    };
    let weight: f64 = differences().map(|(_, variance)| 1.0 / variance).sum();
    let mean = differences().map(|(by, variance)| by / variance).sum::<Vector2<f64>>() / weight;
    let apart: f64 = differences().map(|(by, variance)| (by - mean).norm_squared() / variance).sum();
    (mean, 1.0 / weight, apart / (2.0 * (curves.len().max(2) - 1) as f64))
}
