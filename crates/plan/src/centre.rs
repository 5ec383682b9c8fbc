//! How well the centre of a ball's image can be measured.

use mavsight_geometry::Vector3;
use mavsight_random::Random;
use serde::{Deserialize, Serialize};

/// Appearance of a ball in an image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CentreNoise {
    /// Standard deviation of one sample's noise, grey levels of 255.
    pub grey_noise: f64,
    /// Contrast of the ball to its background in grey levels; of three channels the root of the sum of
    /// squares.
    pub contrast: f64,
    /// Standard deviation of the lens's blur.
    pub blur_px: f64,
    /// Ratio of the achieved to the least possible standard deviation: the cost of background texture,
    /// shading and codecs.
    #[serde(default = "excess_in_the_virtual_room")]
    pub excess: f64,
}

/// The most that `centre_bound` measures for the detector over the bound with all else known, for four
/// colours and balls of 5 to 30 px.
fn excess_in_the_virtual_room() -> f64 {
    1.3
}

/// Variance of a coordinate within a square pixel.
const PIXEL_VAR_PX2: f64 = 1.0 / 12.0;

impl Default for CentreNoise {
    /// An ordinary camera in ordinary light.
    fn default() -> Self {
        Self { grey_noise: 2.0, contrast: 150.0, blur_px: 0.5, excess: excess_in_the_virtual_room() }
    }
}

impl CentreNoise {
    /// Standard deviation of one coordinate of the centre of a disc's image.
    ///
    /// The light falls off at the edge as the integral of a Gaussian of width s, blur and pixel together.
    /// Moving the disc by du changes a sample at the edge by C g(r - R) cos φ du; the Fisher information is
    /// the sum of the squares over n², that is (C/n)² π R ∫g² dr = (C/n)² √π R/(2 s). Its inverse root is
    /// Cramér and Rao's bound, valid for R above about 2 s; smaller images are spots, for which the bound of
    /// R = 2 s is kept and scaled by their loss of light, (2 s/R)².
    pub fn std_px(&self, diameter_px: f64) -> f64 {
        let s = (self.blur_px * self.blur_px + PIXEL_VAR_PX2).sqrt();
        let radius = diameter_px / 2.0;
        let edge = radius.max(2.0 * s);
        let bound = self.grey_noise / self.contrast * (2.0 * s / (std::f64::consts::PI.sqrt() * edge)).sqrt();
        self.excess * bound * (edge / radius).powi(2)
    }
}

/// Standard deviations of a coordinate of the centres of balls' images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum CentreStd {
    /// One value for all.
    Alike(f64),
    /// Equally likely values, as found in a session: they depend on the background of a ball.
    Drawn(Vec<f64>),
}

impl CentreStd {
    /// All values.
    pub fn values_px(&self) -> &[f64] {
        match self {
            Self::Alike(std_px) => std::slice::from_ref(std_px),
            Self::Drawn(all) => all,
        }
    }

    /// Geometric mean.
    pub fn typical_px(&self) -> f64 {
        let all = self.values_px();
        (all.iter().map(|v| v.ln()).sum::<f64>() / all.len() as f64).exp()
    }

    /// The value for a marker at a place in view of a camera: drawn, but the same in each call.
    pub(crate) fn at_px(&self, place_m: &Vector3<f64>, camera: usize, marker: usize) -> f64 {
        let all = self.values_px();
        let drawn = (uniform_at(place_m, camera, marker) * all.len() as f64) as usize;
        all[drawn.min(all.len() - 1)]
    }
}

/// A number between 0 and 1 that belongs to a place, a camera and a marker.
fn uniform_at(place_m: &Vector3<f64>, camera: usize, marker: usize) -> f64 {
    let seed = place_m.iter().fold(0_u64, |seed, x| seed.rotate_left(21) ^ x.to_bits());
    Random::new(seed, ((camera as u64) << 32) | marker as u64).uniform()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_places_are_uniform_and_differ_by_camera_and_marker() {
        let place = |k: i32| Vector3::new(0.01 * f64::from(k), -0.3, 1.5);
        let of = |camera, marker| -> Vec<f64> {
            (0..4000).map(|k| uniform_at(&place(k), camera, marker) - 0.5).collect()
        };
        let (first, second, third) = (of(0, 0), of(0, 1), of(1, 0));
        let mean = |v: &[f64], w: &[f64]| v.iter().zip(w).map(|(a, b)| a * b).sum::<f64>() / 4000.0;
        // Five standard deviations: of the mean 0.29/√4000, of its square 0.075/√4000, of a product of two
        // 0.083/√4000.
        assert!(mean(&first, &[1.0; 4000]).abs() < 0.023);
        assert!((mean(&first, &first) - 1.0 / 12.0).abs() < 0.006);
        assert!(mean(&first, &second).abs() < 0.0066 && mean(&first, &third).abs() < 0.0066);
        let all = CentreStd::Drawn(vec![0.01, 0.02, 0.04]);
        let drawn: Vec<f64> = (0..4000).map(|k| all.at_px(&place(k), 0, 0)).collect();
        for value in all.values_px() {
            let share = drawn.iter().filter(|d| *d == value).count() as f64 / 4000.0;
            assert!((share - 1.0 / 3.0).abs() < 0.037, "{value}: {share}");
        }
        assert!((all.typical_px() / 0.02 - 1.0).abs() < 1e-12);
    }

    /// The information of a blurred disc, added up over fine samples, in place of the integral.
    #[test]
    fn the_bound_is_that_of_a_disc_drawn_pixel_by_pixel() {
        let noise = CentreNoise { grey_noise: 2.0, contrast: 120.0, blur_px: 0.6, excess: 1.0 };
        let s = (0.36_f64 + PIXEL_VAR_PX2).sqrt();
        for diameter in [5.0, 10.0, 30.0] {
            let (mut information, steps) = (0.0, 8);
            let half = (diameter / 2.0 + 6.0 * s) as i32 * steps;
            for i in -half..=half {
                for j in -half..=half {
                    let (x, y) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                    let r = x.hypot(y).max(1e-9);
                    let z = (r - diameter / 2.0) / s;
                    let slope = (-0.5 * z * z).exp() / (s * (2.0 * std::f64::consts::PI).sqrt());
                    let by_u = noise.contrast * slope * x / r;
                    information += (by_u / noise.grey_noise).powi(2) / f64::from(steps * steps);
                }
            }
            let ratio = noise.std_px(diameter) * information.sqrt();
            assert!((ratio - 1.0).abs() < 0.01, "{diameter} px: {ratio}");
        }
    }

    #[test]
    fn smaller_balls_are_worse_without_a_step() {
        let noise = CentreNoise::default();
        let all: Vec<f64> = (1..60).map(|k| noise.std_px(0.25 * f64::from(k))).collect();
        assert!(all.windows(2).all(|p| p[1] < p[0]));
    }
}
