//! The light that a ball mirrors, of the lamps' own colour, besides what its colour throws back.
//!
//! Lamps hang above. Where it is known where above is, their image lies on the ball where its normal is
//! half-way between there and the camera, by the law of reflection; what else is mirrored from above or below
//! falls off evenly. Where it is not, the light falls off evenly across and down.

use super::edge::bell;
use super::lanes::Lanes;
use crate::Vector3;
use pulp::Simd;

/// Standard deviation of the directions from which a place of the ball mirrors light: the roughness of
/// plastic spreads what comes from one by 0.21 rad (Cook & Torrance 1982: slopes of 0.15, over √2 along each
/// axis, twice in what is mirrored), and a lamp a metre long 1.5 m above takes up 0.19.
const LOBE_RAD: f64 = 0.3;
/// Least cosine of the angle at which light is mirrored to the camera: beyond, the lamps' image is drawn out
/// along the rim.
const LEAST_COSINE: f64 = 0.3;
/// Least 1 - bend r: it is not below half on the ball.
const LEAST_COMPRESSION: f64 = 0.2;
/// Standard deviation of the lamps' image, as a part of a white ball's light: a dielectric mirrors 4 % of
/// what falls on it (Fresnel, index 1.5), here from a cone of 2π LOBE_RAD², out of which a quarter may come
/// of what makes a surface bright from all π.
const IMAGE_STD: f64 = 0.04 * 0.25 / (2.0 * LOBE_RAD * LOBE_RAD);
/// Standard deviation of the slope of all light that is mirrored: of the same 4 % a quarter may come from one
/// side.
const SLOPE_STD: f64 = 0.04 * 0.25;
/// Part of the light that comes from all around besides lamps: half as much as from them, as the ball's
/// shading takes it.
const AROUND: f64 = 1.0 / 3.0;

/// Normal of the surface at pixels: x, y and z, and z squared.
pub(super) struct Normals<S: Simd> {
    pub(super) x: Lanes<S>,
    pub(super) y: Lanes<S>,
    pub(super) z: Lanes<S>,
    pub(super) z2: Lanes<S>,
}

/// Patterns of mirrored light.
pub(super) const GLOSSES: usize = 3;

/// Where mirrored light falls on a ball.
#[derive(Debug, Clone, Copy)]
pub(super) enum Gloss {
    /// Slopes to the right and down, and nothing.
    Anyhow,
    /// Slopes to the right and down, and an image of the lamps.
    Above(Image),
}

/// The image of lamps on a ball, in units of its radius: exp(-½ (r'² + t²)) with r and t away from its peak,
/// outwards and across, in standard deviations, and r' bent as far as the ball's curvature does.
#[derive(Debug, Clone, Copy)]
pub(super) struct Image {
    /// Distance of the peak from the middle of the ball.
    peak: f64,
    /// Unit vector from the middle of the ball to the peak, right and down.
    outwards: [f64; 2],
    /// Inverse variances along r and t.
    sharpness: [f64; 2],
    /// Coefficients of r² and t² in r'.
    bend: [f64; 2],
    /// What blur leaves of the peak's height.
    height: f64,
}

impl Gloss {
    /// For a ball whose image is blurred by a part of its radius; `up` is a unit vector in the directions
    /// right, down and towards the camera, as the ball is seen.
    pub(super) fn new(up: Option<Vector3<f64>>, soft: f64) -> Self {
        up.and_then(|up| Image::new(&up, soft)).map_or(Self::Anyhow, Self::Above)
    }

    /// Standard deviations of these patterns, as parts of a white ball's light.
    pub(super) fn std(&self) -> [f64; GLOSSES] {
        match self {
            Self::Anyhow => [SLOPE_STD, SLOPE_STD, IMAGE_STD],
            Self::Above(_) => [AROUND * SLOPE_STD, AROUND * SLOPE_STD, IMAGE_STD],
        }
    }

    /// These patterns, and their slopes across and down, in units of the radius.
    #[inline(always)]
    pub(super) fn terms<S: Simd>(&self, simd: S, normal: &Normals<S>) -> [[Lanes<S>; GLOSSES]; 3] {
        let (one, zero) = (Lanes::splat(simd, 1.0), Lanes::splat(simd, 0.0));
        let [light, across, down] = match self {
            Self::Anyhow => [zero; 3],
            Self::Above(image) => image.light(simd, normal),
        };
        [[normal.x, normal.y, light], [one, zero, across], [zero, one, down]]
    }
}

impl Image {
    /// None where it is drawn out along the rim.
    fn new(up: &Vector3<f64>, soft: f64) -> Option<Self> {
        let half = (up + Vector3::z()).try_normalize(1e-6)?;
        let (cosine, sine) = (half.z, half.xy().norm());
        if cosine < LEAST_COSINE {
            return None;
        }
        let outwards = half.xy().try_normalize(1e-6).unwrap_or(-nalgebra::Vector2::y());
        // What is mirrored turns twice as far as the normal that tilts outwards, and by twice the cosine of
        // one that tilts across; the former is foreshortened.
        let sharp = [(0.5 * LOBE_RAD * cosine).powi(2), (0.5 * LOBE_RAD / cosine).powi(2)];
        let bend = [0.5 * sine / (cosine * cosine), sine * (cosine * cosine + 0.5)];
        // Blur leaves the mean and the third cumulants as they are.
        let blurred = sharp.map(|variance| variance + soft * soft);
        let left = [0, 1].map(|k| sharp[k] / blurred[k]);
        let inwards = 3.0 * bend[0] * sharp[0] * (1.0 - left[0]) + bend[1] * sharp[1] * (1.0 - left[1]);
        Some(Self {
            peak: sine - inwards,
            outwards: [outwards.x, outwards.y],
            sharpness: blurred.map(f64::recip),
            bend: [0, 1].map(|k| bend[k] * left[k] * left[k]),
            height: (left[0] * left[1]).sqrt(),
        })
    }

    #[inline(always)]
    fn light<S: Simd>(&self, simd: S, normal: &Normals<S>) -> [Lanes<S>; 3] {
        let all = |value: f64| Lanes::splat(simd, value);
        let ([x, y], [sharp_r, sharp_t]) = (self.outwards.map(all), self.sharpness.map(all));
        let (r, t) = (x * normal.x + y * normal.y - all(self.peak), x * normal.y - y * normal.x);
        // r + bend r², without a second peak.
        let stretch = all(1.0) / (all(1.0) - all(self.bend[0]) * r).max(all(LEAST_COMPRESSION));
        let bent = r * stretch + all(self.bend[1]) * t * t;
        let light = all(self.height) * bell(simd, sharp_r * bent * bent + sharp_t * t * t);
        let by_bent = sharp_r * bent * light;
        let by_r = all(0.0) - by_bent * stretch * stretch;
        let by_t = all(0.0) - by_bent * all(2.0 * self.bend[1]) * t - sharp_t * t * light;
        [light, by_r * x - by_t * y, by_r * y + by_t * x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centre::model::{EDGE, Model, Parameters, RADIUS};
    use crate::outline::Outline;
    use pulp::Scalar;

    /// What is mirrored at a place of the ball from lamps around a direction, by the law of reflection.
    fn mirrored(up: &Vector3<f64>, x: f64, y: f64) -> f64 {
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        let from = Vector3::new(2.0 * z * x, 2.0 * z * y, 2.0 * z * z - 1.0);
        ((from.dot(up) - 1.0) / (LOBE_RAD * LOBE_RAD)).exp()
    }

    /// The image and its slopes at a place.
    fn light(up: Vector3<f64>, soft: f64, x: f64, y: f64) -> [f64; 3] {
        let mut p = Parameters::zeros();
        (p[RADIUS], p[EDGE]) = (1.0, soft);
        let model = Model::new(p, Outline::ROUND, Some(up));
        let simd = Scalar::new();
        let normal = model.normal_at(simd, (Lanes::splat(simd, x), Lanes::splat(simd, y)));
        model.gloss.terms(simd, &normal).map(|terms| {
            let mut value = [0.0_f32];
            terms[2].store(&mut value, 0);
            f64::from(value[0])
        })
    }

    /// Up as seen by a camera that looks down by an angle on a ball, at another to the vertical of the image.
    fn up_at(down_deg: f64, roll_deg: f64) -> Vector3<f64> {
        let (down, roll) = (down_deg.to_radians(), roll_deg.to_radians());
        Vector3::new(down.cos() * roll.sin(), -down.cos() * roll.cos(), down.sin())
    }

    #[test]
    fn the_image_of_lamps_is_where_the_law_of_reflection_puts_it() {
        for (up, soft) in [(-10.0, 0.0), (0.0, 30.0), (25.0, -10.0), (80.0, 5.0)]
            .into_iter()
            .flat_map(|(down, roll)| [0.03, 0.1, 0.2].map(|soft| (up_at(down, roll), soft)))
        {
            let blurred = |x: f64, y: f64| {
                let step = 0.25 * soft;
                let (mut sum, mut weights) = (0.0, 0.0);
                for k in 0..25 * 25 {
                    let [dx, dy] = [k % 25, k / 25].map(|n| step * (f64::from(n) - 12.0));
                    let weight = (-0.5 * (dx * dx + dy * dy) / (soft * soft)).exp();
                    (sum, weights) = (sum + weight * mirrored(&up, x + dx, y + dy), weights + weight);
                }
                sum / weights
            };
            let (mut sums, mut worst) = ([[0.0; 3]; 2], 0.0_f64);
            for k in 0..41 * 41 {
                let [x, y] = [k % 41, k / 41].map(|n| 0.05 * (f64::from(n) - 20.0));
                if x * x + y * y > 0.95 {
                    continue;
                }
                let both = [light(up, soft, x, y)[0], blurred(x, y)];
                worst = worst.max((both[0] - both[1]).abs());
                for (sums, value) in sums.iter_mut().zip(both) {
                    sums.iter_mut().zip([value, value * x, value * y]).for_each(|(sum, v)| *sum += v);
                }
            }
            let [got, want] = sums.map(|[all, x, y]| [all, x / all, y / all]);
            let away = (got[1] - want[1]).hypot(got[2] - want[2]);
            assert!(away < 0.035 && worst < 0.1, "{up:?} {soft}: {away} {worst}");
            assert!((got[0] / want[0] - 1.0).abs() < 0.1, "{up:?} {soft}: {got:?} for {want:?}");
        }
    }

    #[test]
    fn slopes_are_the_numeric_ones() {
        const STEP: f64 = 2e-3;
        let up = up_at(15.0, 20.0);
        for (x, y) in [(0.2, -0.6), (-0.1, -0.8), (0.3, 0.3)] {
            let [_, across, down] = light(up, 0.1, x, y);
            let value = |dx: f64, dy: f64| light(up, 0.1, x + dx, y + dy)[0];
            let want = [value(STEP, 0.0) - value(-STEP, 0.0), value(0.0, STEP) - value(0.0, -STEP)];
            for (got, want) in [across, down].into_iter().zip(want.map(|d| d / (2.0 * STEP))) {
                assert!((got - want).abs() < 1e-3 * want.abs() + 1e-3, "{got} for {want}");
            }
        }
    }

    #[test]
    fn a_camera_straight_below_sees_no_image_of_lamps() {
        assert!(matches!(Gloss::new(Some(up_at(-80.0, 0.0)), 0.1), Gloss::Anyhow));
        assert!(matches!(Gloss::new(Some(-Vector3::z()), 0.1), Gloss::Anyhow));
        assert!(matches!(Gloss::new(Some(Vector3::z()), 0.1), Gloss::Above(_)));
    }
}
