//! One marker's path through one camera's images, between its frames.

use mavsight_geometry::{Matrix2, Vector2};
use nalgebra::{Matrix4, Vector4};

/// Times that differ by less are one: what moves at 500 px/s goes a two-hundredth of a pixel in it.
const SAME_S: f64 = 10e-6;

/// Frames on either side that a local cubic goes through. A parabola takes 1.4 % off the speed of a swing of
/// half a hertz at 30 frames a second, which is 0.2 ms of an offset of half a frame.
const SIDE: usize = 3;

/// Observations from which a cubic is determined with little more noise than a parabola.
const CUBIC_SIGHTS: usize = 6;

/// Frames further apart than this many intervals have a gap between them.
const GAP_INTERVALS: f64 = 1.5;

/// Beyond the first or last frame of a run the path is followed this part of an interval and no further.
const BEYOND_INTERVALS: f64 = 0.5;

/// The centres of one marker in one camera, each at its own time.
#[derive(Debug, Clone, Default)]
pub struct PixelPath {
    t_s: Vec<f64>,
    pixels: Vec<Vector2<f64>>,
    covariances_px2: Vec<Matrix2<f64>>,
    interval_s: f64,
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
    /// Its variance over that of a centre.
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
        let is_later = self.t_s.last().is_none_or(|last| t_s > *last);
        let is_number = pixel.iter().chain(covariance_px2.iter()).all(|v| v.is_finite());
        let is_taken = is_later && t_s.is_finite() && is_number;
        if is_taken {
            self.t_s.push(t_s);
            self.pixels.push(pixel);
            self.covariances_px2.push(covariance_px2);
        }
        is_taken
    }

    /// Forgets the observations that no time from `t_s` on needs, and says how many they were: the first
    /// ones.
    pub fn forget_before(&mut self, t_s: f64) -> usize {
        // The nearest observation is at most half a gap off, and the others of its run each a gap further.
        let needed_s = t_s - (SIDE as f64 + 1.0) * GAP_INTERVALS * self.interval_s;
        let gone = self.t_s.partition_point(|t| *t < needed_s);
        self.t_s.drain(..gone);
        self.pixels.drain(..gone);
        self.covariances_px2.drain(..gone);
        gone
    }

    /// Whether no observation is left.
    pub fn is_empty(&self) -> bool {
        self.t_s.is_empty()
    }

    /// Where the marker was at a time; `None` where no observation is near enough.
    ///
    /// The nearest observation is moved along the cubic through it and up to three neighbours on either side
    /// (a parabola where few are), so that its noise remains its own and white from frame to frame; an
    /// observation at this very time is taken as it is. Nothing reaches across a gap, and at the end of a run
    /// no further than half an interval.
    pub fn at(&self, t_s: f64) -> Option<PathPoint> {
        let index = self.nearest(t_s)?;
        let dt_s = t_s - self.t_s[index];
        let (from, to) = self.run_about(index);
        let is_same = dt_s.abs() <= SAME_S;
        let beyond = if dt_s < 0.0 { from == index } else { to == index };
        let reach = if beyond { BEYOND_INTERVALS } else { 0.5 * GAP_INTERVALS };
        if !is_same && dt_s.abs() > reach * self.interval_s * (1.0 + 1e-6) {
            return None;
        }
        let as_it_is = PathPoint {
            index,
            pixel: self.pixels[index],
            covariance_px2: self.covariances_px2[index],
            velocity: None,
        };
        let Some(inverse) = self.inverse_of(index, from, to) else { return is_same.then_some(as_it_is) };
        let x = dt_s / self.interval_s;
        let (mut pixel, mut covariance_px2) = (Vector2::zeros(), Matrix2::zeros());
        let (mut px_s, mut gain_per_s2) = (Vector2::zeros(), 0.0);
        for k in from..=to {
            let at = (self.t_s[k] - self.t_s[index]) / self.interval_s;
            let local = inverse * powers(at);
            let own = if k == index { 1.0 } else { 0.0 };
            let weight = own + x * (local.y + x * (local.z + x * local.w));
            pixel += self.pixels[k] * weight;
            covariance_px2 += self.covariances_px2[k] * (weight * weight);
            let slope = (local.y + x * (2.0 * local.z + 3.0 * x * local.w)) / self.interval_s;
            px_s += self.pixels[k] * slope;
            gain_per_s2 += slope * slope;
        }
        let velocity = Some(PathVelocity { px_s, gain_per_s2 });
        Some(if is_same {
            PathPoint { velocity, ..as_it_is }
        } else {
            PathPoint { index, pixel, covariance_px2, velocity }
        })
    }

    fn nearest(&self, t_s: f64) -> Option<usize> {
        let after = self.t_s.partition_point(|t| *t < t_s);
        match (after.checked_sub(1), self.t_s.get(after)) {
            (Some(before), Some(next)) => {
                Some(if t_s - self.t_s[before] <= next - t_s { before } else { after })
            }
            (Some(before), None) => Some(before),
            (None, Some(_)) => Some(after),
            (None, None) => None,
        }
    }

    /// First and last of the observations around one without a gap between.
    fn run_about(&self, index: usize) -> (usize, usize) {
        let joined = |k: usize| self.t_s[k + 1] - self.t_s[k] <= GAP_INTERVALS * self.interval_s;
        let (mut from, mut to) = (index, index);
        while from > 0 && index - from < SIDE && joined(from - 1) {
            from -= 1;
        }
        while to + 1 < self.t_s.len() && to - index < SIDE && joined(to) {
            to += 1;
        }
        (from, to)
    }

    /// Inverse normal matrix of the cubic, time in intervals from the observation, its last row and column
    /// zero where a parabola does; `None` for fewer than three observations.
    fn inverse_of(&self, index: usize, from: usize, to: usize) -> Option<Matrix4<f64>> {
        let count = to - from + 1;
        if count < 3 {
            return None;
        }
        let mut normal = Matrix4::zeros();
        for k in from..=to {
            let row = powers((self.t_s[k] - self.t_s[index]) / self.interval_s);
            normal += row * row.transpose();
        }
        if count >= CUBIC_SIGHTS {
            return normal.cholesky().map(|c| c.inverse());
        }
        let parabola = normal.fixed_view::<3, 3>(0, 0).into_owned().cholesky()?.inverse();
        let mut inverse = Matrix4::zeros();
        inverse.fixed_view_mut::<3, 3>(0, 0).copy_from(&parabola);
        Some(inverse)
    }
}

fn powers(x: f64) -> Vector4<f64> {
    Vector4::new(1.0, x, x * x, x * x * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal;

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
        let kept = short.t_s.len();
        assert!(kept <= 7, "{kept} kept");
        assert!(short.forget_before(100.0) == kept && short.is_empty() && short.at(2.0).is_none());
    }

    /// The claimed covariance is the scatter, in the middle of a run and at its end.
    #[test]
    fn the_covariance_is_that_of_many_paths() {
        let mut seed = 5;
        for t in [7.5 * H, 19.4 * H] {
            let (mut square, mut claimed, trials) = (0.0, 0.0, 4000);
            for _ in 0..trials {
                let mut noisy = PixelPath::new(H);
                for k in 0..20 {
                    let at = f64::from(k) * H;
                    let noise = Vector2::new(normal(&mut seed), normal(&mut seed)) * 0.1;
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
