//! How a matt ball is lit, by the spherical harmonics of its surface's normal.
//!
//! Under any lamps the first and the second order hold what is to be seen of the light to about 2 % (Basri &
//! Jacobs 2003; Ramamoorthi & Hanrahan 2001). Of the rest, the third order is nil and the fourth matters
//! where one lamp outshines the others: its clamped cosine t is 1/4 + t/2 + 5/16 P₂(t) - 3/32 P₄(t), with no
//! other direction than that of the first order.

use super::gloss::{Gloss, Normals};
use super::lanes::Lanes;
use super::model::{EDGE, Model, Parameters, RADIUS, SHADE, SHADES};
use crate::Vector3;
use crate::outline::Outline;
use pulp::Simd;

/// Shading of first order below which no direction stands out: the fourth would be below a hundredth of the
/// ball's light.
const LEAST_SLOPE: f64 = 0.05;

/// The direction from which most light comes, by the shading of first order; from above where none stands
/// out.
fn lamp(p: &Parameters) -> [f64; 3] {
    let slope = p.fixed_rows::<3>(SHADE);
    let norm = slope.norm();
    if norm < LEAST_SLOPE { [0.0, -1.0, 0.0] } else { [0, 1, 2].map(|k| slope[k] / norm) }
}

impl Model {
    /// One whose shading has the coordinates of the ball itself.
    pub(super) fn new(p: Parameters, outline: Outline, up: Option<Vector3<f64>>) -> Self {
        let (origin, lamp, gloss) = ((0.0, 0.0), lamp(&p), Gloss::Anyhow);
        let mut model = Self { p, origin, unit_px: 1.0, soft: 0.0, outline, lamp, up, gloss };
        model.shade_here();
        model
    }

    /// Sets the coordinates of the shading where the ball is now.
    pub(super) fn shade_here(&mut self) {
        (self.origin, self.unit_px) = ((self.p[0], self.p[1]), self.p[RADIUS]);
        self.soft = self.p[EDGE] / self.p[RADIUS];
        self.lamp = lamp(&self.p);
        self.gloss = Gloss::new(self.up, self.soft);
    }

    #[inline(always)]
    pub(super) fn normal_at<S: Simd>(&self, simd: S, (x_px, y_px): (Lanes<S>, Lanes<S>)) -> Normals<S> {
        let all = |value: f64| Lanes::splat(simd, value);
        let per_px = all(self.unit_px.recip());
        let (x, y) = ((x_px - all(self.origin.0)) * per_px, (y_px - all(self.origin.1)) * per_px);
        let left = all(1.0) - self.measure(simd, x, y).0;
        // The blur rounds off the normal's steep fall at the rim.
        let z2 = all(0.5) * (left + (left * left + all(self.soft * self.soft)).sqrt());
        Normals { x, y, z: z2.sqrt(), z2 }
    }

    /// First and second harmonics less their means over the disc, so that the colour remains that of the
    /// whole ball; and what the slope of each along two axes is, per pixel, as far as it matters to the
    /// centre.
    #[inline(always)]
    pub(super) fn harmonics_of<S: Simd>(&self, simd: S, normal: &Normals<S>) -> [[Lanes<S>; SHADES]; 3] {
        let all = |value: f64| Lanes::splat(simd, value);
        let (per_px, zero) = (all(self.unit_px.recip()), all(0.0));
        let Normals { x, y, z, z2 } = *normal;
        let (xp, yp, zp) = (x * per_px, y * per_px, z * per_px);
        let two = all(2.0);
        [
            [x, y, z - all(2.0 / 3.0), x * y, x * z, y * z, x * x - y * y, z2 - all(0.5)],
            [per_px, zero, zero, yp, zp, zero, two * xp, zero],
            [zero, per_px, zero, xp, zero, zp, zero - two * yp, zero],
        ]
    }

    /// The fourth harmonic about the lamp's direction, as a lamp has it, -P₄; and its slopes likewise.
    #[inline(always)]
    pub(super) fn fourth_of<S: Simd>(&self, simd: S, normal: &Normals<S>) -> [Lanes<S>; 3] {
        let all = |value: f64| Lanes::splat(simd, value);
        let [x, y, z] = self.lamp.map(all);
        let t = x * normal.x + y * normal.y + z * normal.z;
        let t2 = t * t;
        let slope = (all(7.5) - all(17.5) * t2) * t * all(self.unit_px.recip());
        [(all(3.75) - all(4.375) * t2) * t2 - all(0.375), slope * x, slope * y]
    }
}

#[cfg(test)]
mod tests {
    use crate::centre::constants::{FOURTH_STD, LIGHT_STD, SHADE_STD};
    use crate::centre::lanes::Lanes;
    use crate::centre::model::{EDGE, Model, Parameters};
    use crate::outline::Outline;
    use pulp::Scalar;

    fn p4(t: f64) -> f64 {
        (35.0 * t.powi(4) - 30.0 * t * t + 3.0) / 8.0
    }

    /// By projection of the clamped cosine: 2l + 1 times the mean of its product with Legendre's polynomial.
    #[test]
    fn orders_of_one_lamp_are_their_parts_of_the_first() {
        const COUNT: i32 = 20_000;
        let mean = |of: &dyn Fn(f64) -> f64| {
            let places = (0..COUNT).map(|k| (f64::from(k) + 0.5) / f64::from(COUNT) * 2.0 - 1.0);
            places.map(of).sum::<f64>() / f64::from(COUNT)
        };
        let first = 3.0 * mean(&|t| t.max(0.0) * t);
        let fourth = 9.0 * mean(&|t| t.max(0.0) * p4(t));
        assert!((first - 0.5).abs() < 1e-6, "{first}");
        assert!((fourth / first + FOURTH_STD / SHADE_STD[0]).abs() < 1e-6, "{fourth}");
        let p6 = |t: f64| (231.0 * t.powi(6) - 315.0 * t.powi(4) + 105.0 * t * t - 5.0) / 16.0;
        let sixth = 13.0 * mean(&|t| t.max(0.0) * p6(t)) * mean(&|t| p6(t).powi(2)).sqrt();
        assert!((sixth / first - LIGHT_STD / SHADE_STD[0]).abs() < 1e-4, "{sixth}");
    }

    #[test]
    fn it_is_legendres_polynomial_about_the_lamp() {
        let lamp = [0.36, -0.8, 0.48];
        let mut p = Parameters::zeros();
        p.as_mut_slice()[..=EDGE].copy_from_slice(&[10.0, 9.0, 5.0, 0.5]);
        let model = Model { lamp, ..Model::new(p, Outline::ROUND, None) };
        let simd = Scalar::new();
        for (x, y) in [(0.0_f64, 0.0_f64), (0.3, -0.2), (-0.5, 0.4)] {
            let at = [10.0 + 5.0 * x, 9.0 + 5.0 * y].map(|place| Lanes::splat(simd, place));
            let mut got = [0.0_f32];
            model.fourth_of(simd, &model.normal_at(simd, (at[0], at[1])))[0].store(&mut got, 0);
            let z = (1.0 - x * x - y * y).sqrt();
            let want = -p4(x * lamp[0] + y * lamp[1] + z * lamp[2]);
            // The normal is rounded off by a hundredth.
            assert!((f64::from(got[0]) - want).abs() < 0.05, "{x} {y}: {} for {want}", got[0]);
        }
    }
}
