//! Means and planes that a minority of other values does not pull.

use super::lanes::{GROUP, Lanes, total};
use nalgebra::{Matrix3, Vector3};
use pulp::Simd;

/// Biweight cut-off with 95 % efficiency on Gaussian noise (Beaton & Tukey 1974).
const CUT_OFF: f64 = 4.685;
/// A Gaussian's standard deviation over its median absolute value.
pub(super) const MEDIAN_TO_DEVIATION: f64 = 1.4826;
const ROUNDS: usize = 4;
/// A scale beyond which only filling lies.
const ANY: f64 = 1e15;
const FILLING: f32 = 1e30;

/// Tukey's biweight of a residual by its square over its variance.
#[inline]
pub(super) fn biweight(square: f32) -> f32 {
    let left = (1.0 - square * ((CUT_OFF * CUT_OFF).recip() as f32)).max(0.0);
    left * left
}

/// A robust plane of values, and their mean square around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fitted {
    pub(super) middle: Plane,
    pub(super) square: f64,
}

/// Values at places.
#[derive(Debug, Clone, Default)]
pub(super) struct Scattered {
    x: Vec<f32>,
    y: Vec<f32>,
    values: Vec<f32>,
    left: Vec<f32>,
}

/// A plane's level in the middle and slopes.
pub(super) type Plane = Vector3<f64>;

/// A plane's value.
#[inline(always)]
pub(super) fn on(plane: &Plane, x: f64, y: f64) -> f64 {
    plane.x + plane.y * x + plane.z * y
}

impl Scattered {
    pub(super) fn with_room(count: usize) -> Self {
        let room = || Vec::with_capacity(count + GROUP);
        Self { x: room(), y: room(), values: room(), left: Vec::new() }
    }

    pub(super) fn push(&mut self, (x, y): (f32, f32), value: f32) {
        self.x.push(x);
        self.y.push(y);
        self.values.push(value);
    }

    /// Robust plane; None with too few values. No scale is taken to be below the least.
    #[inline(always)]
    pub(super) fn plane<S: Simd>(mut self, simd: S, least_scale: f64) -> Option<Fitted> {
        let count = self.values.len();
        let whole = count.next_multiple_of(GROUP);
        for (values, filling) in [(&mut self.x, 0.0), (&mut self.y, 0.0), (&mut self.values, FILLING)] {
            values.resize(whole, filling);
        }
        self.left.resize(whole, 0.0);
        let (mut plane, mut scale) = (Plane::zeros(), ANY);
        for round in 0..ROUNDS {
            let [n, x, y, xx, xy, yy, v, xv, yv] = self.weighted(simd, scale, &plane);
            let information = Matrix3::new(n, x, y, x, xx, xy, y, xy, yy);
            plane = information.cholesky()?.solve(&Vector3::new(v, xv, yv));
            self.subtract(simd, &plane);
            if round + 1 < ROUNDS {
                scale = (MEDIAN_TO_DEVIATION * median(&mut self.left[..count])?).max(least_scale);
            }
        }
        let squares: f32 = self.left[..count].iter().map(|left| left * left).sum();
        let square = f64::from(squares) / count as f64;
        Some(Fitted { middle: plane, square })
    }

    /// Sums of weight, weighted x, y, x², xy, y², value, and value times x and y.
    #[inline(always)]
    fn weighted<S: Simd>(&self, simd: S, scale: f64, plane: &Plane) -> [f64; 9] {
        let all = |value: f64| Lanes::splat(simd, value);
        let mut out = [[0.0; GROUP]; 9];
        let (zero, one) = (all(0.0), all(1.0));
        let per_scale = all((scale * CUT_OFF).recip());
        let [level, by_x, by_y] = [plane.x, plane.y, plane.z].map(all);
        for part in 0..Lanes::<S>::PARTS {
            let mut sums = [zero; 9];
            for first in (0..self.values.len()).step_by(GROUP) {
                let group = first..first + GROUP;
                let x = Lanes::load(simd, &self.x[group.clone()], part);
                let y = Lanes::load(simd, &self.y[group.clone()], part);
                let value = Lanes::load(simd, &self.values[group], part);
                let u = ((value - (level + by_x * x + by_y * y)) * per_scale).abs();
                let kept = one - u * u;
                let weight = u.where_below(one, kept * kept, zero);
                let (wx, wy) = (weight * x, weight * y);
                let terms = [weight, wx, wy, wx * x, wx * y, wy * y, weight * value, wx * value, wy * value];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum = *sum + term;
                }
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                sum.store(out, part);
            }
        }
        out.map(|group| f64::from(total(group)))
    }

    /// Sets what a plane leaves of the values, without sign.
    #[inline(always)]
    fn subtract<S: Simd>(&mut self, simd: S, plane: &Plane) {
        let [level, by_x, by_y] = [plane.x, plane.y, plane.z].map(|value| Lanes::splat(simd, value));
        for part in 0..self.left.len() / S::F32_LANES {
            let (x, y) = (Lanes::load(simd, &self.x, part), Lanes::load(simd, &self.y, part));
            let on_plane = level + by_x * x + by_y * y;
            (Lanes::load(simd, &self.values, part) - on_plane).abs().store(&mut self.left, part);
        }
    }
}

/// The value that half of all are below; they are reordered. None without any.
pub(super) fn median(values: &mut [f32]) -> Option<f64> {
    let half = values.len() / 2;
    (!values.is_empty()).then(|| f64::from(*values.select_nth_unstable_by(half, f32::total_cmp).1))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Both(Scattered);

    impl pulp::WithSimd for Both {
        type Output = Option<Fitted>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            self.0.plane(simd, 0.1)
        }
    }

    #[test]
    fn outliers_do_not_pull_a_plane() {
        let mut scattered = Scattered::default();
        for k in 0..50_i32 {
            let (x, y) = ((k % 7) as f32, (k / 7) as f32);
            let noise = 0.05 * (k * 37 % 11 - 5) as f32;
            let value = if k % 9 == 4 { 90.0 } else { 10.0 + 2.0 * x - y + noise };
            scattered.push((x, y), value);
        }
        let plane = scattered.clone().plane(pulp::Scalar::new(), 0.1).expect("enough");
        assert!((plane.middle - Plane::new(10.0, 2.0, -1.0)).amax() < 0.1, "{plane:?}");
        assert!(plane.square > 500.0);
        assert_eq!(pulp::Arch::new().dispatch(Both(scattered)), Some(plane));
        assert_eq!(pulp::Arch::new().dispatch(Both(Scattered::default())), None);
    }
}
