//! Means and planes of values at places that are known beforehand, near what they last were: without a median.

use super::{CUT_OFF, FILLING, Plane, Scattered, square_sum};
use crate::centre::lanes::{GROUP, Lanes, total};
use nalgebra::{Matrix3, Vector3};
use pulp::Simd;

/// Cut-off of the biweight whose mean loss over a Gaussian is half of its greatest: the scale at which that is the mean over the
/// values has a breakdown point of one half (Rousseeuw & Yohai 1984).
const SCALE_CUT_OFF: f64 = 1.547_6;
/// Times that weights are set: what was known is off by little.
const ROUNDS: usize = 2;

/// A robust mean or plane of values, their mean square around it, and their robust scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::centre) struct Fitted<T> {
    pub(in crate::centre) middle: T,
    pub(in crate::centre) square: f64,
    pub(in crate::centre) scale: f64,
}

impl Scattered {
    /// Takes the values at the same places from another image.
    pub(in crate::centre) fn take(&mut self, from: &[f32]) {
        for (value, at) in self.values.iter_mut().zip(&self.at[..self.count]) {
            *value = from[*at as usize];
        }
    }

    /// Robust plane from one that is near, with the scale that was known then; that of the values is one step of its iteration
    /// (Maronna, Martin & Yohai 2006, sect. 2.7.2). None where they determine no plane.
    #[inline(always)]
    pub(in crate::centre) fn refine<S: Simd>(
        &mut self,
        simd: S,
        (near, scale): (&Plane, f64),
        least_scale: f64,
    ) -> Option<Fitted<Plane>> {
        let (mut middle, scale) = (*near, scale.max(least_scale));
        for _ in 0..ROUNDS {
            let [n, x, y, xx, xy, yy, v, xv, yv] = self.weighted(simd, scale, &middle);
            let information = Matrix3::new(n, x, y, x, xx, xy, y, xy, yy);
            middle = information.cholesky()?.solve(&Vector3::new(v, xv, yv));
        }
        self.subtract(simd, &middle);
        let square = square_sum(simd, &self.left, 0.0) / self.count as f64;
        let scale = next_scale(simd, (&self.left, self.count), 0.0, scale).max(least_scale);
        Some(Fitted { middle, square, scale })
    }

    /// Decides which pairs of numbers count: those that `weigh` less than a limit.
    pub(in crate::centre) fn choose(&mut self, weigh: &[f32], limit: f32) {
        self.at.clear();
        self.at.extend((0_u32..).zip(weigh).filter(|(_, weighs)| **weighs < limit).map(|(at, _)| at));
        self.count = self.at.len();
        let whole = self.count.next_multiple_of(GROUP);
        for buffer in [&mut self.x, &mut self.y] {
            buffer.clear();
            buffer.resize(whole, FILLING);
        }
    }

    /// Robust mean of each of two numbers, of the pairs that were chosen, likewise. None where there are none.
    #[inline(always)]
    pub(in crate::centre) fn refine_means<S: Simd>(
        &mut self,
        simd: S,
        pairs: &[[f32; 2]],
        near: [(f64, f64); 2],
        least_scale: f64,
    ) -> Option<[Fitted<f64>; 2]> {
        for ((first, second), at) in self.x.iter_mut().zip(&mut self.y).zip(&self.at) {
            [*first, *second] = pairs[*at as usize];
        }
        let of = |values: &[f32], near| mean(simd, (values, self.count), near, least_scale);
        Some([of(&self.x, near[0])?, of(&self.y, near[1])?])
    }
}

/// Robust mean from one that is near with its scale; None without any value.
#[inline(always)]
fn mean<S: Simd>(
    simd: S,
    (values, count): (&[f32], usize),
    (mut middle, scale): (f64, f64),
    least_scale: f64,
) -> Option<Fitted<f64>> {
    let scale = scale.max(least_scale);
    for _ in 0..ROUNDS {
        middle = weighted_mean(simd, values, middle, (scale * CUT_OFF).recip());
    }
    let square = square_sum(simd, values, middle) / count as f64;
    let scale = next_scale(simd, (values, count), middle, scale).max(least_scale);
    middle.is_finite().then_some(Fitted { middle, square, scale })
}

#[inline(always)]
fn weighted_mean<S: Simd>(simd: S, values: &[f32], middle: f64, per_cut_off: f64) -> f64 {
    let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
    let (near, per_cut_off) = (Lanes::splat(simd, middle), Lanes::splat(simd, per_cut_off));
    let mut out = [[0.0; GROUP]; 2];
    for part in 0..Lanes::<S>::PARTS {
        let (mut weights, mut sum) = (zero, zero);
        for group in values.chunks_exact(GROUP) {
            let away = Lanes::load(simd, group, part) - near;
            let u = away * per_cut_off;
            let square = u * u;
            let kept = one - square;
            let weight = square.where_below(one, kept * kept, zero);
            weights = weights + weight;
            sum = sum + square.where_below(one, weight * away, zero);
        }
        weights.store(&mut out[0], part);
        sum.store(&mut out[1], part);
    }
    middle + f64::from(total(simd, &out[1])) / f64::from(total(simd, &out[0]))
}

/// A step from a scale towards that at which the values' mean loss is half of the greatest.
#[inline(always)]
fn next_scale<S: Simd>(simd: S, (values, count): (&[f32], usize), level: f64, scale: f64) -> f64 {
    let one = Lanes::splat(simd, 1.0);
    let (level, per_cut_off) =
        (Lanes::splat(simd, level), Lanes::splat(simd, (scale * SCALE_CUT_OFF).recip()));
    let mut out = [0.0; GROUP];
    for part in 0..Lanes::<S>::PARTS {
        let mut kept_sum = Lanes::splat(simd, 0.0);
        for group in values.chunks_exact(GROUP) {
            let u = (Lanes::load(simd, group, part) - level) * per_cut_off;
            let kept = (one - u * u).max(Lanes::splat(simd, 0.0));
            kept_sum = kept_sum + kept * kept * kept;
        }
        kept_sum.store(&mut out, part);
    }
    let lost = 1.0 - f64::from(total(simd, &out)) / count as f64;
    scale * (2.0 * lost).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    /// Numbers of about a Gaussian: sums of twelve of Numerical Recipes' linear congruential generator.
    fn noise() -> impl FnMut() -> f64 {
        let mut state = 7_u32;
        let mut one = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX)
        };
        move || (0..12).map(|_| one()).sum::<f64>() - 6.0
    }

    const NOISE_STD: f64 = 2.0;
    const COUNT: usize = 180;
    const TRUE: [f64; 3] = [90.0, 0.4, -0.3];

    /// A plane with noise, of which a part is something else.
    fn image(noise: &mut impl FnMut() -> f64, spoiled: usize) -> Vec<f32> {
        let value = |k: usize, noise: f64| {
            let (x, y) = place(k);
            let level = if k < spoiled { 150.0 } else { TRUE[0] + TRUE[1] * x + TRUE[2] * y };
            (level + NOISE_STD * noise) as f32
        };
        (0..COUNT).map(|k| value(k, noise())).collect()
    }

    fn place(k: usize) -> (f64, f64) {
        ((k * 7 % 15) as f64 - 7.0, (k * 7 / 15 % 12) as f64 - 6.0)
    }

    struct Refined<'a>(&'a mut Scattered, &'a mut Scattered, [&'a Fitted<Plane>; 2], &'a [f32]);

    impl pulp::WithSimd for Refined<'_> {
        type Output = Option<(Fitted<Plane>, [Fitted<f64>; 2])>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let Self(places, pairs, [last, means], values) = self;
            places.take(values);
            let both: Vec<[f32; 2]> = values.iter().map(|v| [*v, -*v]).collect();
            let near = [(means.middle.x, means.scale), (-means.middle.x, means.scale)];
            Some((
                places.refine(simd, (&last.middle, last.scale), 0.1)?,
                pairs.refine_means(simd, &both, near, 0.1)?,
            ))
        }
    }

    /// From frame to frame they stay with what most values show, and where there is nothing else are what medians find.
    #[test]
    fn planes_means_and_scales_are_those_of_most_values() {
        for spoiled in [0, 40] {
            let (mut noise, mut places, mut pairs) = (noise(), Scattered::default(), Scattered::default());
            places.begin(COUNT);
            (0..COUNT).for_each(|k| places.offer((place(k).0 as f32, place(k).1 as f32), k, 0.0, true));
            places.finish();
            pairs.choose(&[0.0; COUNT], 0.5);
            let first = Fitted { middle: Plane::new(TRUE[0], 0.0, 0.0), square: 0.0, scale: 3.0 };
            let (mut last, mut means, mut scales) = (first, first, 0.0);
            for frame in 0..60 {
                let values = image(&mut noise, spoiled);
                let refined = Refined(&mut places, &mut pairs, [&last, &means], &values);
                let (plane, [mean, opposite]) = pulp::Arch::new().dispatch(refined).expect("enough");
                let anew = places.plane(Scalar::new(), 0.1).expect("enough");
                // Three standard deviations of a mean over those that are left.
                assert!((plane.middle - Plane::from(TRUE)).amax() < 3.0 * NOISE_STD / 12.0, "{plane:?}");
                if spoiled == 0 {
                    assert!((plane.middle - anew.middle).amax() < 0.05 * NOISE_STD, "{plane:?} {anew:?}");
                    assert!((plane.square / anew.square - 1.0).abs() < 0.01);
                }
                assert!((opposite.middle + mean.middle).abs() < 1e-3 && opposite.scale > 0.99 * mean.scale);
                means.middle.x = mean.middle;
                (last, means.scale) = (plane, mean.scale);
                scales += if frame < 10 { 0.0 } else { plane.scale / 50.0 };
            }
            // A fifth of others widens it as it widens a median.
            let expected = if spoiled == 0 { 0.93..1.05 } else { 1.0..1.5 };
            assert!(expected.contains(&(scales / NOISE_STD)), "{scales}");
        }
    }

    #[test]
    fn of_nothing_there_is_no_plane_and_no_mean() {
        let mut scattered = Scattered::default();
        scattered.begin(0);
        scattered.finish();
        assert!(scattered.refine(Scalar::new(), (&Plane::zeros(), 1.0), 1.0).is_none());
        scattered.choose(&[1.0; 9], 0.5);
        assert!(scattered.refine_means(Scalar::new(), &[[1.0; 2]; 9], [(1.0, 1.0); 2], 1.0).is_none());
    }
}
