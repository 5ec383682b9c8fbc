//! Means and planes that a minority of other values does not pull.

use super::lanes::{GROUP, Lanes, greatest, least, total};
use nalgebra::{Matrix3, Vector3};
use pulp::Simd;

/// Biweight cut-off with 95 % efficiency on Gaussian noise (Beaton & Tukey 1974).
const CUT_OFF: f64 = 4.685;
/// A Gaussian's standard deviation over its median absolute value.
pub(super) const MEDIAN_TO_DEVIATION: f64 = 1.4826;
const ROUNDS: usize = 4;
/// A scale beyond which nothing lies but what fills up the last group.
const ANY: f64 = 1e15;
const FILLING: f32 = 1e30;

/// Tukey's biweight of a residual by its square over its variance.
#[inline]
pub(super) fn biweight(square: f32) -> f32 {
    let left = (1.0 - square * ((CUT_OFF * CUT_OFF).recip() as f32)).max(0.0);
    left * left
}

/// Values at places, in whole groups.
#[derive(Debug, Clone, Default)]
pub(super) struct Scattered {
    x: Vec<f32>,
    y: Vec<f32>,
    values: Vec<f32>,
    count: usize,
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
    pub(super) fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.values.clear();
        self.count = 0;
    }

    pub(super) fn push(&mut self, x: f32, y: f32, value: f32) {
        self.x.push(x);
        self.y.push(y);
        self.values.push(value);
    }

    /// Fills up the last group; to be called once all are there.
    pub(super) fn finish(&mut self) {
        self.count = self.values.len();
        let whole = self.count.next_multiple_of(GROUP);
        self.x.resize(whole, 0.0);
        self.y.resize(whole, 0.0);
        self.values.resize(whole, FILLING);
        self.left.resize(whole, 0.0);
    }

    /// Robust plane, and mean square of what it leaves of all values; None with too few. No scale is taken to be below
    /// the least.
    #[inline(always)]
    pub(super) fn plane<S: Simd>(&mut self, simd: S, least_scale: f64) -> Option<(Plane, f64)> {
        let (mut plane, mut scale) = (Plane::zeros(), ANY);
        for round in 0..ROUNDS {
            let [n, x, y, xx, xy, yy, v, xv, yv] = self.weighted(simd, scale, &plane);
            let information = Matrix3::new(n, x, y, x, xx, xy, y, xy, yy);
            plane = information.cholesky()?.solve(&Vector3::new(v, xv, yv));
            self.subtract(simd, &plane);
            if round + 1 < ROUNDS {
                scale = (MEDIAN_TO_DEVIATION * median(simd, &self.left, self.count)?).max(least_scale);
            }
        }
        let square: f64 = self.left[..self.count].iter().map(|left| f64::from(left * left)).sum();
        Some((plane, square / self.count as f64))
    }

    /// Robust mean and the variance of all values around it; None where there are none.
    #[inline(always)]
    pub(super) fn mean<S: Simd>(&mut self, simd: S, least_scale: f64) -> Option<(f64, f64)> {
        let middle = Plane::new(median(simd, &self.values, self.count)?, 0.0, 0.0);
        self.subtract(simd, &middle);
        let scale = (MEDIAN_TO_DEVIATION * median(simd, &self.left, self.count)?).max(least_scale);
        let [n, .., v, _, _] = self.weighted(simd, scale, &middle);
        let mean = v / n;
        let square: f64 = self.values[..self.count].iter().map(|v| (f64::from(*v) - mean).powi(2)).sum();
        mean.is_finite().then_some((mean, square / self.count as f64))
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
                let load = |from: &[f32]| Lanes::load(simd, &from[first..first + GROUP], part);
                let (x, y, value) = (load(&self.x), load(&self.y), load(&self.values));
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
        out.map(|group| f64::from(total(simd, &group)))
    }

    /// Sets what a plane leaves of the values, without sign.
    #[inline(always)]
    fn subtract<S: Simd>(&mut self, simd: S, plane: &Plane) {
        let [level, by_x, by_y] = [plane.x, plane.y, plane.z].map(|value| Lanes::splat(simd, value));
        for part in 0..self.left.len() / S::F32_LANES {
            let load = |from: &[f32]| Lanes::load(simd, from, part);
            let left = load(&self.values) - (level + by_x * load(&self.x) + by_y * load(&self.y));
            left.abs().store(&mut self.left, part);
        }
    }
}

/// The value that half of the first `count` are below: the range that holds it is cut where it would lie if the values in it were
/// spread evenly and, in turn, in the middle, as they may not be. The values come in whole groups. None without any.
#[inline(always)]
pub(super) fn median<S: Simd>(simd: S, values: &[f32], count: usize) -> Option<f64> {
    let (whole, rest) = values[..count].split_at(count / GROUP * GROUP);
    let mut last = [f32::INFINITY; GROUP];
    last.iter_mut().zip(rest).for_each(|(out, value)| *out = *value);
    let rank = (count / 2) as f32;
    let (mut high, mut low) = (split(simd, whole, &last, f32::MAX).1, split(simd, whole, &last, f32::MIN).2);
    // Values below the range, and up to its end.
    let (mut below, mut within) = (0.0, count as f32);
    let mut evenly = true;
    while low < high {
        let part = if evenly { (rank - below + 0.5) / (within - below) } else { 0.5 };
        let middle = low + part * (high - low);
        // Between neighbouring numbers the middle may round up to the higher one, which would cut nothing.
        let limit = if middle < high { middle } else { low };
        let (number, last_below, first_above) = split(simd, whole, &last, limit);
        if number > rank {
            (high, within) = (last_below, number)
        } else {
            (low, below) = (first_above, number)
        }
        evenly = !evenly;
    }
    (low == high).then_some(f64::from(low))
}

/// Number of values up to a limit, the greatest of them, and the least of the others.
#[inline(always)]
fn split<S: Simd>(simd: S, whole: &[f32], last: &[f32; GROUP], limit: f32) -> (f32, f32, f32) {
    let mut out = [[0.0; GROUP]; 3];
    let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
    let (lowest, highest) = (Lanes::splat(simd, f32::NEG_INFINITY), Lanes::splat(simd, f32::INFINITY));
    let limit = Lanes::splat(simd, limit);
    for part in 0..Lanes::<S>::PARTS {
        let value = Lanes::load(simd, last, part);
        let mut number = limit.where_below(value, zero, one);
        let mut below = limit.where_below(value, lowest, value);
        let mut above = limit.where_below(value, value, highest);
        for group in whole.chunks_exact(GROUP) {
            let value = Lanes::load(simd, group, part);
            number = number + limit.where_below(value, zero, one);
            below = below.max(limit.where_below(value, lowest, value));
            above = above.min(limit.where_below(value, value, highest));
        }
        number.store(&mut out[0], part);
        below.store(&mut out[1], part);
        above.store(&mut out[2], part);
    }
    let [number, below, above] = out;
    (total(simd, &number), greatest(simd, &below), least(simd, &above))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_median_is_that_of_the_sorted(values in prop::collection::vec(-9_i32..9, 1..40)) {
            let values: Vec<f32> = values.iter().map(|v| 0.1 * *v as f32).collect();
            let got = median(pulp::Scalar::new(), &values, values.len());
            let mut sorted = values.clone();
            sorted.sort_by(f32::total_cmp);
            prop_assert_eq!(got, Some(f64::from(sorted[values.len() / 2])));
        }
    }

    #[test]
    fn the_median_of_neighbouring_numbers_ends() {
        for low in [1.0_f32, 1.0_f32.next_up(), -1.0, -(1.0_f32.next_up())] {
            let values = [low, low.next_up()];
            assert_eq!(median(pulp::Scalar::new(), &values, 2), Some(f64::from(values[1])));
            assert_eq!(median(pulp::Scalar::new(), &[low, low, values[1]], 3), Some(f64::from(low)));
        }
    }

    struct Both<'a>(&'a mut Scattered);

    impl pulp::WithSimd for Both<'_> {
        type Output = (Option<(Plane, f64)>, Option<(f64, f64)>);

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            (self.0.plane(simd, 0.1), self.0.mean(simd, 0.1))
        }
    }

    #[test]
    fn outliers_do_not_pull_a_plane() {
        let mut scattered = Scattered::default();
        for k in 0..50_i32 {
            let (x, y) = ((k % 7) as f32, (k / 7) as f32);
            let noise = 0.05 * (k * 37 % 11 - 5) as f32;
            scattered.push(x, y, if k % 9 == 4 { 90.0 } else { 10.0 + 2.0 * x - y + noise });
        }
        scattered.finish();
        let (plane, square) = scattered.plane(pulp::Scalar::new(), 0.1).expect("enough");
        assert!((plane - Plane::new(10.0, 2.0, -1.0)).amax() < 0.1, "{plane}");
        assert!(square > 500.0);
        let (mean, _) = scattered.mean(pulp::Scalar::new(), 0.1).expect("enough");
        assert!((mean - 12.5).abs() < 1.5, "{mean}");
        let again = pulp::Arch::new().dispatch(Both(&mut scattered.clone()));
        assert_eq!(again, pulp::Scalar::new().vectorize(Both(&mut scattered)));
        scattered.clear();
        scattered.finish();
        assert_eq!(pulp::Arch::new().dispatch(Both(&mut scattered)), (None, None));
    }
}
