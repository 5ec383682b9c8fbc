//! One marker's path through one camera's images, between its frames.

use mavsight_geometry::{Matrix2, Vector2};
use nalgebra::{Matrix4, Vector4};
use std::ops::Range;

/// Times that differ by less are one: what moves at 500 px/s goes a two-hundredth of a pixel in it.
const SAME_S: f64 = 10e-6;

/// Frames on either side that a local cubic goes through. A parabola takes 1.4 % off the speed of a swing of
/// half a hertz at 30 frames a second, which is 0.2 ms of an offset of half a frame.
const SIDE: usize = 3;

/// Observations from which a cubic is determined with little more noise than a parabola.
const CUBIC_OBSERVATIONS: usize = 6;

/// Frames of a camera that are further apart than this many of its intervals have others missing between them.
pub const GAP_INTERVALS: f64 = 1.5;

/// Beyond the first or last frame of a run the path is followed this part of an interval and no further.
const BEYOND_INTERVALS: f64 = 0.5;

/// The centres of one marker in one camera, each at its own time.
#[derive(Debug, Clone, Default)]
pub struct PixelPath {
    centres: Vec<Centre>,
    interval_s: f64,
}

#[derive(Debug, Clone, Copy)]
struct Centre {
    t_s: f64,
    pixel: Vector2<f64>,
    covariance_px2: Matrix2<f64>,
}

/// A path at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Index of the observation that was brought to this time.
    pub index: usize,
    /// Where the marker was seen then.
    pub pixel: Vector2<f64>,
    /// Covariance of that: of the observation and of the way it was brought.
    pub covariance_px2: Matrix2<f64>,
    /// How fast it moved; none where fewer than three observations are there.
    pub velocity: Option<PathVelocity>,
}

/// Velocity of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathVelocity {
    /// The velocity.
    pub px_s: Vector2<f64>,
    /// Variance of the velocity over that of a centre.
    pub gain_per_s2: f64,
}

impl PixelPath {
    /// A path of a camera whose frames are `interval_s` apart; observations come by [`PixelPath::push`].
    pub fn new(interval_s: f64) -> Self {
        Self { interval_s, ..Self::default() }
    }

    /// Adds an observation and says whether it was taken; one that is not later than the last, or not finite,
    /// is passed over.
    pub fn push(&mut self, t_s: f64, pixel: Vector2<f64>, covariance_px2: Matrix2<f64>) -> bool {
        let is_later = self.centres.last().is_none_or(|last| t_s > last.t_s);
        let is_number = pixel.iter().chain(covariance_px2.iter()).all(|v| v.is_finite());
        let is_taken = is_later && t_s.is_finite() && is_number;
        self.centres.extend(is_taken.then_some(Centre { t_s, pixel, covariance_px2 }));
        is_taken
    }

    /// Forgets the observations that no time from `t_s` on needs, and says how many they were: the first
    /// ones.
    pub fn forget_before(&mut self, t_s: f64) -> usize {
        // The nearest observation is at most half a gap off, and the others of its run each a gap further.
        let needed_s = t_s - (SIDE as f64 + 1.0) * GAP_INTERVALS * self.interval_s;
        self.centres.drain(..self.centres.partition_point(|c| c.t_s < needed_s)).count()
    }

    /// Whether no observation is left.
    pub fn is_empty(&self) -> bool {
        self.centres.is_empty()
    }

    /// Where the marker was at a time; `None` where no observation is near enough.
    ///
    /// The nearest observation is moved along the cubic through it and up to three neighbours on either side
    /// (a parabola where few are), so that its noise remains its own and white from frame to frame; an
    /// observation at this very time is taken as it is. Nothing reaches across a gap, and at the end of a run
    /// no further than half an interval.
    pub fn at(&self, t_s: f64) -> Option<PathPoint> {
        let distance = |k: &usize| (self.centres[*k].t_s - t_s).abs();
        let after = self.centres.partition_point(|c| c.t_s < t_s);
        let near = after.saturating_sub(1)..(after + 1).min(self.centres.len());
        let index = near.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let Centre { t_s: own_s, pixel, covariance_px2 } = self.centres[index];
        let dt_s = t_s - own_s;
        let run = self.run_about(index);
        let is_same = dt_s.abs() <= SAME_S;
        let is_beyond = if dt_s < 0.0 { run.start == index } else { run.end == index + 1 };
        let reach = if is_beyond { BEYOND_INTERVALS } else { 0.5 * GAP_INTERVALS };
        if !is_same && dt_s.abs() > reach * self.interval_s * (1.0 + 1e-6) {
            return None;
        }
        let as_it_is = PathPoint { index, pixel, covariance_px2, velocity: None };
        let is_cubic = run.len() >= CUBIC_OBSERVATIONS;
        let powers = |k: usize| {
            let x = (self.centres[k].t_s - own_s) / self.interval_s;
            Vector4::new(1.0, x, x * x, if is_cubic { x * x * x } else { 0.0 })
        };
        let mut normal: Matrix4<f64> = run.clone().map(|k| powers(k) * powers(k).transpose()).sum();
        if !is_cubic {
            normal[(3, 3)] = 1.0;
        }
        let Some(factor) = normal.cholesky().filter(|_| run.len() > 2) else {
            return is_same.then_some(as_it_is);
        };
        let x = dt_s / self.interval_s;
        let moved = factor.solve(&Vector4::new(0.0, x, x * x, x * x * x));
        let sloped = factor.solve(&Vector4::new(0.0, 1.0, 2.0 * x, 3.0 * x * x)) / self.interval_s;
        let (mut pixel, mut covariance_px2) = (Vector2::zeros(), Matrix2::zeros());
        let (mut px_s, mut gain_per_s2) = (Vector2::zeros(), 0.0);
        for k in run {
            let own = if k == index { 1.0 } else { 0.0 };
            let (weight, slope) = (own + powers(k).dot(&moved), powers(k).dot(&sloped));
            pixel += self.centres[k].pixel * weight;
            covariance_px2 += self.centres[k].covariance_px2 * (weight * weight);
            px_s += self.centres[k].pixel * slope;
            gain_per_s2 += slope * slope;
        }
        let velocity = Some(PathVelocity { px_s, gain_per_s2 });
        let brought = PathPoint { index, pixel, covariance_px2, velocity };
        Some(if is_same { PathPoint { velocity, ..as_it_is } } else { brought })
    }

    /// The observations around one without a gap between.
    fn run_about(&self, index: usize) -> Range<usize> {
        let is_joined =
            |k: usize| self.centres[k].t_s - self.centres[k - 1].t_s <= GAP_INTERVALS * self.interval_s;
        let before = (index.saturating_sub(SIDE)..index).rev().take_while(|k| is_joined(k + 1)).count();
        let last = (index + SIDE + 1).min(self.centres.len());
        let after = (index + 1..last).take_while(|k| is_joined(*k)).count();
        index - before..index + after + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    const H: f64 = 1.0 / 30.0;

    fn curve(t: f64) -> Vector2<f64> {
        Vector2::new(100.0 + t * (80.0 - t * (300.0 - 500.0 * t)), 50.0 - 40.0 * t + 90.0 * t * t)
    }

    fn path(times: impl Iterator<Item = f64>, at: impl Fn(f64) -> Vector2<f64>) -> PixelPath {
        let mut path = PixelPath::new(H);
        times.for_each(|t| assert!(path.push(t, at(t), Matrix2::identity() * 0.01)));
        path
    }

    #[test]
    fn a_cubic_is_followed_exactly_within_a_run_and_a_parabola_half_an_interval_beyond() {
        let path = path((0..20).map(|k| f64::from(k) * H), curve);
        for t in [-0.49 * H, 0.0, 2.3 * H, 7.5 * H, 16.9 * H, 19.49 * H] {
            let got = path.at(t).unwrap();
            // Four observations at an end follow v; u, a cubic of 0.0185 px over one interval, they miss by a
            // few times that.
            let (off, end) = (got.pixel - curve(t), !(2.0 * H..17.0 * H).contains(&t));
            assert!(off.y.abs() < 1e-9 && off.x.abs() < if end { 0.07 } else { 1e-9 }, "{t}: {off}");
            let slope = (curve(t + 1e-6) - curve(t - 1e-6)) / 2e-6;
            let off = got.velocity.unwrap().px_s - slope;
            assert!(off.y.abs() < 1e-5 && (end || off.x.abs() < 1e-5), "{t}: {off}");
        }
        assert_eq!(path.at(-0.51 * H), None);
        assert_eq!(path.at(19.51 * H), None);
        let same = path.at(7.0 * H + 5e-6).unwrap();
        assert_eq!((same.pixel, same.covariance_px2), (curve(7.0 * H), Matrix2::identity() * 0.01));
    }

    #[test]
    fn nothing_reaches_across_a_gap() {
        let path = path((0..20).filter(|k| *k != 10).map(|k| f64::from(k) * H), curve);
        assert_eq!(path.at(10.0 * H), None);
        assert!(path.at(9.4 * H).is_some() && path.at(10.6 * H).is_some());
        // Two observations alone show no curvature: they hold at their own times only.
        let two = self::path([0.0, H].into_iter(), curve);
        assert!(two.at(0.3 * H).is_none() && two.at(H).is_some_and(|p| p.velocity.is_none()));
        assert_eq!(PixelPath::new(H).at(0.0), None);
        let mut spoilt = PixelPath::new(H);
        assert!(!spoilt.push(f64::NAN, Vector2::zeros(), Matrix2::identity()));
        assert!(!spoilt.push(0.0, Vector2::new(f64::NAN, 0.0), Matrix2::identity()));
        assert_eq!(spoilt.at(0.0), None);
    }

    #[test]
    fn what_is_forgotten_is_not_missed() {
        let whole = path((0..60).filter(|k| k % 17 != 3).map(|k| f64::from(k) * H), curve);
        let mut short = whole.clone();
        for k in 0..240 {
            let t = f64::from(k) * 0.25 * H + 0.1 * H;
            short.forget_before(t);
            let (a, b) = (whole.at(t), short.at(t));
            assert_eq!(a.map(|p| (p.pixel, p.covariance_px2)), b.map(|p| (p.pixel, p.covariance_px2)), "{t}");
        }
        let kept = short.centres.len();
        assert!(kept <= 7, "{kept} kept");
        assert!(short.forget_before(100.0) == kept && short.is_empty() && short.at(2.0).is_none());
    }

    /// The claimed covariance is the scatter, in the middle of a run and at its end.
    #[test]
    fn the_covariance_is_that_of_many_paths() {
        let mut random = Random::new(5, 0);
        for t in [7.5 * H, 19.4 * H] {
            let (mut square, mut claimed, trials) = (0.0, 0.0, 4000);
            for _ in 0..trials {
                let mut noisy = PixelPath::new(H);
                for k in 0..20 {
                    let at = f64::from(k) * H;
                    let noise = Vector2::from(random.normals()) * 0.1;
                    noisy.push(at, curve(at) + noise, Matrix2::identity() * 0.01);
                }
                let got = noisy.at(t).unwrap();
                square += (got.pixel - curve(t)).norm_squared();
                claimed += got.covariance_px2.trace();
            }
            assert!(
                (square / claimed - 1.0).abs() < 0.08,
                "{t}: {} of {}",
                square,
                claimed / f64::from(trials)
            );
        }
    }
}
