//! How well the centre of a ball's image can be measured.

use mavsight_geometry::Vector3;
use serde::{Deserialize, Serialize};

/// What a picture of a ball looks like.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CentreNoise {
    /// Standard deviation of one sample's noise, grey levels of 255.
    pub grey_noise: f64,
    /// Ball against what is behind it, grey levels; of three channels the root of the sum of squares.
    pub contrast: f64,
    /// Standard deviation of the lens's blur.
    pub blur_px: f64,
    /// Achieved over possible standard deviation: what texture behind, shading and codecs cost.
    #[serde(default = "excess_in_the_virtual_room")]
    pub excess: f64,
}

/// The most that `centre_bound` measures for the detector over the bound with all else known, for four colours and balls of 5 to 30 px.
fn excess_in_the_virtual_room() -> f64 {
    1.5
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
    /// The light falls off at the edge as the integral of a Gaussian of width s, blur and pixel together. Moving the disc by
    /// du changes a sample at the edge by C g(r - R) cos φ du; the Fisher information is the sum of the squares over n²,
    /// that is (C/n)² π R ∫g² dr = (C/n)² √π R/(2 s). Its inverse root is Cramér and Rao's bound, valid for R above
    /// about 2 s; smaller images are spots, for which the bound of R = 2 s is kept and scaled by their loss of light,
    /// (2 s/R)².
    pub fn std_px(&self, diameter_px: f64) -> f64 {
        let s = (self.blur_px * self.blur_px + PIXEL_VAR_PX2).sqrt();
        let radius = diameter_px / 2.0;
        let edge = radius.max(2.0 * s);
        let bound = self.grey_noise / self.contrast * (2.0 * s / (std::f64::consts::PI.sqrt() * edge)).sqrt();
        self.excess * bound * (edge / radius).powi(2)
    }
}

/// A standard normal number that belongs to a place, a camera and a marker: the same whenever it is asked for.
///
/// Bits mixed by Steele, Lea & Flood (2014) and turned by Box & Muller (1958).
pub(crate) fn normal_at(place_m: &Vector3<f64>, (camera, marker): (usize, usize)) -> f64 {
    let words = place_m.iter().map(|x| x.to_bits()).chain([camera as u64, marker as u64]);
    let seed = words.fold(0, |seed, word| mixed(seed ^ word));
    let uniform = |bits: u64| ((bits >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
    let (radius, turn) = (uniform(mixed(seed)), uniform(mixed(mixed(seed))));
    (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * turn).cos()
}

fn mixed(word: u64) -> u64 {
    let z = word.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_places_are_standard_normal_and_differ_by_camera_and_marker() {
        let place = |k: i32| Vector3::new(0.01 * f64::from(k), -0.3, 1.5);
        let of = |camera, marker| -> Vec<f64> {
            (0..4000).map(|k| normal_at(&place(k), (camera, marker))).collect()
        };
        let (first, second, third) = (of(0, 0), of(0, 1), of(1, 0));
        let mean = |v: &[f64], w: &[f64]| v.iter().zip(w).map(|(a, b)| a * b).sum::<f64>() / 4000.0;
        // Five standard deviations of 4000 normal numbers' mean, of their mean square, and of a product of two.
        assert!(mean(&first, &[1.0; 4000]).abs() < 0.08);
        assert!((mean(&first, &first) - 1.0).abs() < 0.12);
        assert!(mean(&first, &second).abs() < 0.08 && mean(&first, &third).abs() < 0.08);
        let beyond = first.iter().filter(|z| z.abs() > 1.96).count() as f64 / 4000.0;
        assert!((0.033..0.067).contains(&beyond), "{beyond}");
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
