//! Lamps, and the light that falls on a surface.

use nalgebra::Vector3;

type V = Vector3<f64>;

/// A panel in the ceiling that shines down.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lamp {
    pub centre: V,
    pub size: (f64, f64),
    /// Radiance, in units in which a white surface under an irradiance of π has radiance one.
    pub radiance: f64,
}

impl Lamp {
    /// A point of the panel for two numbers in 0..1.
    pub(crate) fn point(&self, a: f64, b: f64) -> V {
        self.centre + V::new((a - 0.5) * self.size.0, (b - 0.5) * self.size.1, 0.0)
    }

    /// Irradiance from the whole panel without shadow, by Gauss's rule of two points each way: with the share
    /// of the panel that is seen as a factor, chance plays a part in half-shadows alone (ratio estimator;
    /// Heitz, Hill & McGuire 2018).
    pub(crate) fn unhidden_irradiance(&self, at: &V, normal: &V) -> f64 {
        const PLACES: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
        let points = PLACES.iter().flat_map(|a| PLACES.iter().map(|b| self.point(*a, *b)));
        points.map(|point| self.irradiance(at, normal, &point)).sum::<f64>() / 4.0
    }

    /// Irradiance from the whole panel as if it were at one of its points, without shadow.
    pub(crate) fn irradiance(&self, at: &V, normal: &V, point: &V) -> f64 {
        let to = point - at;
        let r2 = to.norm_squared().max(1e-4);
        let direction = to / r2.sqrt();
        let (cos_here, cos_there) = (normal.dot(&direction), direction.z);
        if cos_here <= 0.0 || cos_there <= 0.0 {
            return 0.0;
        }
        self.radiance * self.size.0 * self.size.1 * cos_here * cos_there / r2
    }
}

/// Light thrown back from all sides: more from the bright ceiling and walls than from the floor.
pub(crate) fn ambient_irradiance(normal: &V) -> f64 {
    0.95 + 0.22 * normal.z
}

/// Irradiance at a place as a function of the normal: a constant, a linear and a quadratic part, which hold
/// 99 % of it for any lamps (Ramamoorthi & Hanrahan 2001).
#[derive(Debug, Clone, Copy)]
pub(crate) struct IrradianceMap([f64; 9]);

impl IrradianceMap {
    pub(crate) fn at(place: &V, lamps: &[Lamp]) -> Self {
        let mut c = [0.0; 9];
        for lamp in lamps {
            for k in 0..4 {
                let point = lamp.point(0.25 + 0.5 * f64::from(k & 1), 0.25 + 0.5 * f64::from(k >> 1));
                let to = point - place;
                let r2 = to.norm_squared().max(1e-4);
                let d = to / r2.sqrt();
                let power = lamp.radiance * lamp.size.0 * lamp.size.1 * d.z.max(0.0) / r2 / 4.0;
                for (c, basis) in c.iter_mut().zip(basis(&d)) {
                    *c += power * basis;
                }
            }
        }
        Self(c)
    }

    pub(crate) fn of(&self, normal: &V) -> f64 {
        // Bands of the clamped cosine: π, 2π/3, π/4, over the bands' own normalisation.
        const BANDS: [f64; 9] = [0.25, 0.5, 0.5, 0.5, 0.3125, 0.3125, 0.3125, 0.3125, 0.3125];
        let sum: f64 = self.0.iter().zip(basis(normal)).zip(BANDS).map(|((c, b), w)| c * b * w).sum();
        sum.max(0.0) + ambient_irradiance(normal)
    }
}

/// Real harmonics up to the second order, scaled so that each band's products sum to the Legendre polynomial.
fn basis(d: &V) -> [f64; 9] {
    let s3 = 3.0_f64.sqrt();
    [
        1.0,
        d.x,
        d.y,
        d.z,
        s3 * d.x * d.y,
        s3 * d.y * d.z,
        s3 * d.z * d.x,
        0.5 * (3.0 * d.z * d.z - 1.0),
        0.5 * s3 * (d.x * d.x - d.y * d.y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_points_of_a_panel_stand_for_all_of_it() {
        let lamp = Lamp { centre: V::new(0.5, 0.3, 3.0), size: (1.2, 0.4), radiance: 10.0 };
        for (at, normal) in [(V::zeros(), V::z()), (V::new(1.5, 0.0, 1.5), V::new(-0.8, 0.0, 0.6))] {
            let part = |k: i32| (f64::from(k) + 0.5) / 40.0;
            let points = (0..1600).map(|k| lamp.point(part(k % 40), part(k / 40)));
            let all = points.map(|point| lamp.irradiance(&at, &normal, &point)).sum::<f64>() / 1600.0;
            let got = lamp.unhidden_irradiance(&at, &normal);
            assert!((got / all - 1.0).abs() < 0.005, "{got} is not {all}");
        }
    }

    #[test]
    fn the_map_is_the_clamped_cosine_to_a_few_per_cent() {
        let lamp = Lamp { centre: V::new(0.5, 0.3, 3.0), size: (0.1, 0.1), radiance: 50.0 };
        let place = V::new(0.0, 0.0, 1.5);
        let map = IrradianceMap::at(&place, &[lamp]);
        let peak = lamp.irradiance(&place, &(lamp.centre - place).normalize(), &lamp.centre);
        for normal in [V::z(), V::x(), -V::z(), V::new(0.6, 0.0, 0.8), V::new(0.0, -0.8, 0.6)] {
            let exact = lamp.irradiance(&place, &normal, &lamp.centre);
            let got = map.of(&normal) - ambient_irradiance(&normal);
            assert!((got - exact).abs() < 0.07 * peak, "{normal}: {got} is not {exact} of {peak}");
        }
    }
}
