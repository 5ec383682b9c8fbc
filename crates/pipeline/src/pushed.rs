//! Cameras that were pushed between two frames.
//!
//! A body has no way to be elsewhere at once: through the frames before a time and through those after it, its images lie on
//! two curves that meet. Where they do not in one camera, and do in the others, that camera was pushed. It takes no pose, and
//! finds which of two cameras it was, which what both see together does not show.

use crate::clock_step::{DECISIVE, OUT_OF_BEAT};
use crate::markers::MarkerColors;
use crate::stream::{StoredDetection, Stream};
use crate::{Cause, Finding};
use mavsight_geometry::{Matrix2, Matrix3, Vector2, Vector3};
use mavsight_pose::LONGEST_APART_NS;
use nalgebra::{Matrix3x2, Matrix6, Matrix6x2, Vector6};
use std::collections::VecDeque;

/// Frames on either side through which parabolas are laid: the fewest that show whether one fits, and more, by which less is
/// found where the motion is slow.
const WINDOWS: [usize; 3] = [5, 8, 12];
const LONGEST: usize = WINDOWS[2];

/// Frames of one side in which a ball has to be seen: one more than a parabola has coefficients.
const LEAST_FRAMES: usize = 4;

/// Steps of two cameras are of one time where they are within this many intervals: what happens between frames shows in the next
/// one of each, which are up to one interval apart; half of one is for uneven stamps.
const TOGETHER_INTERVALS: f64 = 1.5;

/// Balls that have to step together.
const LEAST_BALLS: usize = 3;

/// Probability that noise alone steps as clearly anywhere in a recording, in which a camera is then taken for pushed.
const BY_CHANCE: f64 = 1e-3;

/// Two estimates of a step that agree, by chi-square of two degrees of freedom at 99.9 %.
const AGREE: f64 = 13.8;

/// The balls of a frame that are the only ones of their colour, as the only markers of it.
struct LoneBalls {
    stamp_ns: i64,
    /// By colour: place and variance of a coordinate.
    balls: Vec<Option<(Vector2<f64>, f64)>>,
}

/// A step of a camera's images before a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    frame: usize,
    t_ns: i64,
    by_px: f64,
    /// Its square in standard deviations.
    square: f64,
}

/// Leaves out what cameras filmed after they were pushed, and says which.
pub(crate) fn leave_out(streams: &mut [Stream], colors: &MarkerColors) -> Vec<Finding> {
    let stepped = least_square(streams);
    let rival = stepped - DECISIVE;
    let all: Vec<Vec<Step>> = streams.iter().map(|s| steps(s, colors, rival)).collect();
    let mut findings = Vec::new();
    for camera in 0..streams.len() {
        let is_apart = |other: usize, step: &Step, own: &Step| {
            let is_known = [camera, other].iter().all(|k| streams[*k].clock.offset_std_s == 0.0);
            let apart_ns = (TOGETHER_INTERVALS * 1e9 * streams[camera].interval_s()) as i64;
            let near_ns = apart_ns + if is_known { 0 } else { LONGEST_APART_NS };
            (step.t_ns - own.t_ns).abs() > near_ns
        };
        // What steps in two cameras was done to the aircraft, or to both.
        let is_own = |own: &&Step| {
            let is_rival = |step: &Step| step.square > (own.square - DECISIVE).min(stepped);
            (0..streams.len())
                .filter(|other| *other != camera)
                .all(|other| all[other].iter().all(|step| is_apart(other, step, own) || !is_rival(step)))
        };
        let is_clear = |step: &&Step| step.square >= stepped;
        let Some(step) = all[camera].iter().filter(is_clear).find(is_own) else { continue };
        let note = format!(
            "{} was moved at {:.3} s: the aircraft jumps in its image by {:.1} px from one frame to the next, and in that of no \
             other camera. It is left out from then on; fix it and calibrate again to use what it filmed.",
            streams[camera].name,
            step.t_ns as f64 * 1e-9,
            step.by_px
        );
        streams[camera].end_before(step.frame);
        findings.push(Finding::of(Cause::CameraMoved, Some(camera), note));
    }
    findings
}

/// Square of a step, in standard deviations, that is none by chance: the quantile of chi-square of two degrees of freedom,
/// for as many steps as a recording has frames and windows (Bonferroni).
fn least_square(streams: &[Stream]) -> f64 {
    let frames: usize = streams.iter().map(|s| s.stamps_ns.len()).sum();
    2.0 * ((frames.max(1) * WINDOWS.len()) as f64 / BY_CHANCE).ln()
}

/// Steps of a camera's images whose squares are at least so large, each the clearest among its neighbours.
fn steps(stream: &Stream, colors: &MarkerColors, least: f64) -> Vec<Step> {
    let all = all_steps(stream, &colors.counts(), least);
    let mut out: Vec<Step> = Vec::new();
    for (frame, (by_px, square)) in all.iter().enumerate() {
        if f64::from(*square) < least {
            continue;
        }
        let near = &all[frame.saturating_sub(2 * LONGEST)..all.len().min(frame + 2 * LONGEST)];
        let square = f64::from(*square) / usual(near);
        let t_ns = stream.clock.clock.time_ns(stream.stamps_ns[frame]);
        let step = Step { frame, t_ns, by_px: f64::from(*by_px), square };
        match out.last_mut() {
            Some(last) if frame - last.frame <= LONGEST => {
                if square > last.square {
                    *last = step;
                }
            }
            _ => out.push(step),
        }
    }
    out.retain(|step| step.square >= least);
    out
}

/// What the squares of steps are usually, in parts of what noise makes of them: more where the motion is no parabola.
fn usual(near: &[(f32, f32)]) -> f64 {
    let mut squares: Vec<f32> = near.iter().map(|s| s.1).filter(|s| *s > 0.0).collect();
    squares.sort_by(f32::total_cmp);
    // The median of chi-square of two degrees of freedom is 2 ln 2.
    let median = squares.get(squares.len() / 2).copied().unwrap_or_default();
    (f64::from(median) / (2.0 * std::f64::consts::LN_2)).max(1.0)
}

/// The step before each frame, and its square in standard deviations; zero where there is none.
fn all_steps(stream: &Stream, counts: &[usize], least: f64) -> Vec<(f32, f32)> {
    let interval_ns = stream.interval_s() * 1e9;
    let mut near: VecDeque<LoneBalls> = VecDeque::with_capacity(2 * LONGEST + 2);
    let mut out = vec![(0.0, 0.0); stream.stamps_ns.len()];
    let mut add = |near: &VecDeque<LoneBalls>, at: usize, first: usize| {
        if let Some((by_px, square)) = step_before(near, at, interval_ns, least) {
            out[first + at] = (by_px as f32, square as f32);
        }
    };
    // The frame in the middle has as many before it as after it; at the ends there are fewer.
    let middle = LONGEST + 1;
    let mut first = 0;
    for (stamp_ns, seen) in stream.frames() {
        if near.len() == 2 * middle {
            near.pop_front();
            first += 1;
        }
        near.push_back(LoneBalls { stamp_ns, balls: lone(seen, counts) });
        if near.len() == 2 * middle {
            let from = if first == 0 { 1 } else { middle };
            (from..=middle).for_each(|at| add(&near, at, first));
        }
    }
    let from = if near.len() == 2 * middle { middle + 1 } else { 1 };
    (from..near.len()).for_each(|at| add(&near, at, first));
    out
}

fn lone(seen: &[StoredDetection], counts: &[usize]) -> Vec<Option<(Vector2<f64>, f64)>> {
    let of_color = |(color, markers): (usize, &usize)| {
        let mut own = seen.iter().filter(|s| s.color() == color);
        let one = own.next().filter(|_| *markers == 1)?;
        own.next().is_none().then(|| (one.pixel, one.variance_px2()))
    };
    counts.iter().enumerate().map(of_color).collect()
}

/// By how much the images step before a frame, and the square of that in standard deviations. `None` where frames are missing
/// or their clock is out of its beat, and where without the two frames beside it no step is left: tried where the square is at
/// least so large.
fn step_before(frames: &VecDeque<LoneBalls>, at: usize, interval_ns: f64, least: f64) -> Option<(f64, f64)> {
    let beats = (frames[at].stamp_ns - frames[at - 1].stamp_ns) as f64 / interval_ns;
    if (beats - 1.0).abs() > OUT_OF_BEAT {
        return None;
    }
    let between = Between { frames, at, interval_ns };
    let shortest = between.step(WINDOWS[0], 0)?;
    let fits = WINDOWS.iter().filter(|window| **window < at && at + **window < frames.len());
    let all = fits.filter_map(|window| Some((*window, between.step(*window, 0)?)));
    let fitting = all.filter(|(_, step)| step.agrees_with(&shortest));
    let (window, best) = fitting.max_by(|a, b| a.1.square().total_cmp(&b.1.square()))?;
    if best.square() < least {
        return Some((best.by_px.norm(), best.square()));
    }
    // Of two frames that have each other's time stamps nothing is left without them, of a push all: it is nearer to that.
    let without = between.step(window + 1, 1)?;
    let is_left = without.by_px.dot(&best.by_px) > 0.5 * best.by_px.norm_squared();
    let is_bend = between.worse_if_smooth(window)? < DECISIVE * best.scale;
    (is_left && !is_bend).then(|| (best.by_px.norm(), best.square()))
}

/// What lies between two frames.
struct Between<'a> {
    frames: &'a VecDeque<LoneBalls>,
    at: usize,
    interval_ns: f64,
}

/// A step of several balls together.
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
    let differences: Vec<(Vector2<f64>, f64)> = curves
        .iter()
        .map(|[before, after]| {
            let by = (after.coefficients - before.coefficients).transpose() * row;
            (by, row.dot(&((after.covariance + before.covariance) * row)))
        })
        .collect();
    let weight: f64 = differences.iter().map(|(_, variance)| 1.0 / variance).sum();
    let mean = differences.iter().map(|(by, variance)| by / *variance).sum::<Vector2<f64>>() / weight;
    let apart: f64 = differences.iter().map(|(by, variance)| (by - mean).norm_squared() / variance).sum();
    (mean, 1.0 / weight, apart / (2.0 * (differences.len().max(2) - 1) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{rig, stream, with_frames};
    use mavsight_flight::Vehicle;
    use mavsight_pose::CameraClock;

    fn streams(cameras: usize) -> Vec<Stream> {
        (0..cameras).map(|camera| stream(camera, CameraClock::default(), 30.0, 0..120)).collect()
    }

    fn found(streams: &mut [Stream]) -> Vec<(Option<Cause>, Option<usize>)> {
        let findings = leave_out(streams, &MarkerColors::of(&Vehicle::paper()));
        findings.iter().map(|f| (f.cause(), f.camera)).collect()
    }

    fn push(stream: &mut Stream, from: usize, by_px: Vector2<f64>) {
        let markers = Vehicle::paper().marker.len();
        stream.detections.iter_mut().skip(markers * from).for_each(|d| d.pixel += by_px);
    }

    /// Of two cameras what both see together does not show which was pushed: poses after it were centimetres off, or by the wrong
    /// one of them.
    #[test]
    fn which_of_two_cameras_was_pushed_is_found_with_its_frame() {
        for (camera, by_px) in
            [(0, Vector2::new(1.0, 0.0)), (1, Vector2::new(0.0, -1.0)), (1, Vector2::new(25.0, 9.0))]
        {
            for at in [8, 60, 112] {
                let mut pushed = streams(2);
                push(&mut pushed[camera], at, by_px);
                assert_eq!(found(&mut pushed), [(Some(Cause::CameraMoved), Some(camera))], "{by_px} at {at}");
                assert_eq!((pushed[camera].stamps_ns.len(), pushed[1 - camera].stamps_ns.len()), (at, 120));
            }
        }
    }

    /// Where a flight bends, the parabolas on both sides of a frame do not meet: that was said to be a push of 0.1 px.
    #[test]
    fn a_bend_of_the_motion_is_no_push() {
        let markers = Vehicle::paper().marker.len();
        for size_px in [32.0, 128.0] {
            let mut bent = streams(2);
            for (k, detection) in bent[0].detections.iter_mut().enumerate() {
                detection.pixel.x += size_px * (0.25 * ((k / markers) as f64 - 59.5)).tanh();
            }
            assert_eq!(found(&mut bent), vec![], "{size_px}");
        }
    }

    #[test]
    fn what_is_no_push_is_left_as_it_is() {
        let mut sound = streams(3);
        assert_eq!(rig().cameras.len(), sound.len());
        assert_eq!(found(&mut sound), vec![]);
        // The aircraft itself is struck: it jumps in all cameras.
        sound.iter_mut().for_each(|s| push(s, 50, Vector2::new(3.0, 2.0)));
        assert_eq!(found(&mut sound), vec![]);
        // One ball is covered in part, and frames are missing.
        let mut covered = streams(3);
        covered[1].detections.iter_mut().skip(200).step_by(4).for_each(|d| d.pixel.x += 1.5);
        covered[2] = with_frames(&covered[2], 2, |k| !(40..47).contains(&k) && k % 9 != 3);
        assert_eq!(found(&mut covered), vec![]);
        // Two frames have each other's time stamps.
        let mut exchanged = streams(2);
        for k in 0..4 {
            let (a, b) = (4 * 70 + k, 4 * 71 + k);
            exchanged[0].detections.swap(a, b);
        }
        assert_eq!(found(&mut exchanged), vec![]);
    }
}
