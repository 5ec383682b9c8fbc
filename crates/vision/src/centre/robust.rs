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
pub(super) const FILLING: f32 = 1e30;

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
    /// Makes room for as many.
    pub(super) fn begin(&mut self, most: usize) {
        for values in [&mut self.x, &mut self.y, &mut self.values] {
            values.resize(most.next_multiple_of(GROUP), 0.0);
        }
        self.count = 0;
    }

    /// Adds a value, if it counts. It is written in any case, as whether it counts is hard to
    /// predict.
    #[inline(always)]
    pub(super) fn offer(&mut self, (x, y): (f32, f32), value: f32, counts: bool) {
        self.x[self.count] = x;
        self.y[self.count] = y;
        self.values[self.count] = value;
        self.count += usize::from(counts);
    }

    /// Fills up the last group; to be called once all are there.
    pub(super) fn finish(&mut self) {
        let whole = self.count.next_multiple_of(GROUP);
        for (values, filling) in [(&mut self.x, 0.0), (&mut self.y, 0.0), (&mut self.values, FILLING)] {
            values.truncate(self.count);
            values.resize(whole, filling);
        }
        self.left.resize(whole, 0.0);
    }

    /// Robust plane; None with too few values. No scale is taken to be below the least.
    #[inline(always)]
    pub(super) fn plane<S: Simd>(&mut self, simd: S, least_scale: f64) -> Option<Fitted> {
        let (mut plane, mut scale, mut middle) = (Plane::zeros(), ANY, None);
        for round in 0..ROUNDS {
            let [n, x, y, xx, xy, yy, v, xv, yv] = self.weighted(simd, scale, &plane);
            let information = Matrix3::new(n, x, y, x, xx, xy, y, xy, yy);
            plane = information.cholesky()?.solve(&Vector3::new(v, xv, yv));
            self.subtract(simd, &plane);
            if round + 1 < ROUNDS {
                scale = self.scale(simd, &mut middle, least_scale)?;
            }
        }
        let square = square_sum(simd, &self.left, 0.0) / self.count as f64;
        Some(Fitted { middle: plane, square })
    }

    /// Scale of what is left, by its median; after the first time that hardly moves.
    #[inline(always)]
    fn scale<S: Simd>(&self, simd: S, middle: &mut Option<f32>, least_scale: f64) -> Option<f64> {
        if self.count == 0 {
            return None;
        }
        let near = match *middle {
            Some(middle) => (middle, SPREAD_OF_MIDDLE * middle),
            None => typical(simd, &self.left),
        };
        let left = median_near(simd, &self.left, self.count, near)?;
        *middle = Some(left as f32);
        Some((MEDIAN_TO_DEVIATION * left).max(least_scale))
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
        let mut totals = [0.0; 9];
        for (sum, group) in totals.iter_mut().zip(&out) {
            *sum = f64::from(total(simd, group));
        }
        totals
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

/// Sum of squares of what values are away from a level, without what fills up their last group.
#[inline(always)]
fn square_sum<S: Simd>(simd: S, values: &[f32], level: f64) -> f64 {
    let (zero, any, level) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, ANY), Lanes::splat(simd, level));
    let mut out = [0.0; GROUP];
    for part in 0..Lanes::<S>::PARTS {
        let mut sum = zero;
        for group in values.chunks_exact(GROUP) {
            let value = Lanes::load(simd, group, part);
            let away = value - level;
            sum = sum + value.where_below(any, away * away, zero);
        }
        sum.store(&mut out, part);
    }
    f64::from(total(simd, &out))
}

/// The value that half of `count` values are below; the values come in whole groups, filled up with what lies
/// above them all. None without any.
#[inline(always)]
pub(super) fn median<S: Simd>(simd: S, values: &[f32], count: usize) -> Option<f64> {
    if count == 0 {
        return None;
    }
    median_near(simd, values, count, typical(simd, values))
}

/// The same from a number near it and what [`typical`] takes for the spread.
///
/// Counted are the values on either side of a limit, at first that number, then where the median would lie if
/// the values were spread evenly, or in the middle as long as that leaves out too few.
#[inline(always)]
fn median_near<S: Simd>(
    simd: S,
    values: &[f32],
    count: usize,
    (mut limit, spread): (f32, f32),
) -> Option<f64> {
    let (whole, rank) = (values.len() as f32, (count / 2) as f32);
    let mut per_rank = SPREADS_OF_ALL * spread / count as f32;
    // Least and greatest that it may be, and numbers of values below them and up to them.
    let (mut low, mut high) = ((f32::NEG_INFINITY, 0.0), (f32::INFINITY, count as f32));
    let mut evenly = true;
    loop {
        let within = high.1 - low.1;
        let ([below, above], [last_below, first_above]) = split(simd, values, limit);
        let up_to = whole - above;
        let (found, is_found) = if rank < below {
            high = (last_below, below);
            (last_below, rank + 1.0 == below)
        } else if rank >= up_to {
            low = (first_above, up_to);
            (first_above, rank == up_to)
        } else {
            (limit, true)
        };
        if is_found || low.0 == high.0 {
            return found.is_finite().then_some(f64::from(found));
        }
        // As long as there is but one end, the steps away from it grow.
        limit = if low.0 == f32::NEG_INFINITY {
            high.0 - per_rank * (high.1 - rank)
        } else if high.0 == f32::INFINITY {
            low.0 + per_rank * (rank - low.1)
        } else {
            evenly = !evenly || 2.0 * (high.1 - low.1) < within;
            let part = if evenly { (rank - low.1 + 0.5) / (high.1 - low.1) } else { 0.5 };
            low.0 + part * (high.0 - low.0)
        };
        per_rank *= 4.0;
        limit = limit.max(low.0).min(high.0);
    }
}

/// Width in which a Gaussian's middle would hold all values if it were as dense all over, by the range of a
/// group of medians as [`typical`] takes them.
const SPREADS_OF_ALL: f32 = 3.0;
/// That range by the median of a Gaussian's absolute values.
const SPREAD_OF_MIDDLE: f32 = 0.8;

/// One of the values that is likely to be near the median, and the range of such: medians of three of medians
/// of three.
#[inline(always)]
fn typical<S: Simd>(simd: S, values: &[f32]) -> (f32, f32) {
    let groups = values.len() / GROUP;
    let mut out = [0.0; GROUP];
    for part in 0..Lanes::<S>::PARTS {
        let mut middles = [Lanes::splat(simd, 0.0); 3];
        for (k, middle) in middles.iter_mut().enumerate() {
            let mut three = [Lanes::splat(simd, 0.0); 3];
            for (i, one) in three.iter_mut().enumerate() {
                let first = (3 * k + i) * groups / 9 * GROUP;
                *one = Lanes::load(simd, &values[first..first + GROUP], part);
            }
            *middle = middle_of(three);
        }
        middle_of(middles).store(&mut out, part);
    }
    let of = |a: usize, b: usize, c: usize| out[a].min(out[b]).max(out[a].max(out[b]).min(out[c]));
    let (a, b, c) = (of(0, 1, 2), of(3, 4, 5), of(5, 6, 7));
    (a.min(b).max(a.max(b).min(c)), greatest(simd, &out) - least(simd, &out))
}

#[inline(always)]
fn middle_of<S: Simd>([a, b, c]: [Lanes<S>; 3]) -> Lanes<S> {
    a.min(b).max(a.max(b).min(c))
}

/// Numbers of values below and above a limit, the greatest of those and the least of these.
#[inline(always)]
fn split<S: Simd>(simd: S, values: &[f32], limit: f32) -> ([f32; 2], [f32; 2]) {
    let mut out = [[0.0; GROUP]; 4];
    let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
    let (lowest, highest) = (Lanes::splat(simd, f32::NEG_INFINITY), Lanes::splat(simd, f32::INFINITY));
    let limit = Lanes::splat(simd, limit);
    for part in 0..Lanes::<S>::PARTS {
        let (mut below, mut above, mut last_below, mut first_above) = (zero, zero, lowest, highest);
        for group in values.chunks_exact(GROUP) {
            let value = Lanes::load(simd, group, part);
            below = below + value.where_below(limit, one, zero);
            above = above + limit.where_below(value, one, zero);
            last_below = last_below.max(value.where_below(limit, value, lowest));
            first_above = first_above.min(limit.where_below(value, value, highest));
        }
        for (out, lanes) in out.iter_mut().zip([below, above, last_below, first_above]) {
            lanes.store(out, part);
        }
    }
    let [below, above, last_below, first_above] = out;
    ([total(simd, &below), total(simd, &above)], [greatest(simd, &last_below), least(simd, &first_above)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Median<'a>(&'a [f32]);

    impl pulp::WithSimd for Median<'_> {
        type Output = Option<f64>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let mut values = self.0.to_vec();
            values.resize(self.0.len().next_multiple_of(GROUP), FILLING);
            median(simd, &values, self.0.len())
        }
    }

    /// The same of the plain and of this processor's vector unit.
    fn median_of(values: &[f32]) -> Option<f64> {
        let got = pulp::Scalar::new().vectorize(Median(values));
        assert_eq!(got, pulp::Arch::new().dispatch(Median(values)));
        got
    }

    fn of_sorted(values: &[f32]) -> Option<f64> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f32::total_cmp);
        sorted.get(values.len() / 2).map(|middle| f64::from(*middle))
    }

    proptest! {
        #[test]
        fn the_median_is_that_of_the_sorted(values in prop::collection::vec(-9_i32..9, 0..400)) {
            let values: Vec<f32> = values.iter().map(|v| 0.1 * *v as f32).collect();
            prop_assert_eq!(median_of(&values), of_sorted(&values));
        }

        #[test]
        fn the_median_of_numbers_of_any_size_is_that_of_the_sorted(
            values in prop::collection::vec((-1.0_f32..1.0, -30_i32..30), 0..400)
        ) {
            let values: Vec<f32> = values.iter().map(|(v, power)| v * (*power as f32).exp2()).collect();
            prop_assert_eq!(median_of(&values), of_sorted(&values));
        }
    }

    #[test]
    fn the_median_of_neighbouring_numbers_ends() {
        for low in [1.0_f32, 1.0_f32.next_up(), -1.0, -(1.0_f32.next_up())] {
            let values = [low, low.next_up()];
            assert_eq!(median_of(&values), Some(f64::from(values[1])));
            assert_eq!(median_of(&[low, low, values[1]]), Some(f64::from(low)));
        }
    }

    struct Both<'a>(&'a mut Scattered);

    impl pulp::WithSimd for Both<'_> {
        type Output = Option<Fitted>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            self.0.plane(simd, 0.1)
        }
    }

    #[test]
    fn outliers_do_not_pull_a_plane() {
        let mut scattered = Scattered::default();
        scattered.begin(51);
        for k in 0..50_i32 {
            let (x, y) = ((k % 7) as f32, (k / 7) as f32);
            let noise = 0.05 * (k * 37 % 11 - 5) as f32;
            let value = if k % 9 == 4 { 90.0 } else { 10.0 + 2.0 * x - y + noise };
            scattered.offer((x, y), value, true);
            scattered.offer((x, y), -7.0, false);
        }
        scattered.finish();
        let plane = scattered.plane(pulp::Scalar::new(), 0.1).expect("enough");
        assert!((plane.middle - Plane::new(10.0, 2.0, -1.0)).amax() < 0.1, "{plane:?}");
        assert!(plane.square > 500.0);
        let again = pulp::Arch::new().dispatch(Both(&mut scattered.clone()));
        assert_eq!(again, pulp::Scalar::new().vectorize(Both(&mut scattered)));
        scattered.begin(0);
        scattered.finish();
        assert_eq!(pulp::Arch::new().dispatch(Both(&mut scattered)), None);
    }
}
