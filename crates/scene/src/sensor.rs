//! From light on the sensor to 8-bit sRGB.
//!
//! The noise is a function of seed, frame and pixel, not a sequence from `mavsight_random`: pixels are coded
//! in any order and in parallel, and films remain identical to the bit from version to version, so that
//! figures measured on them can be compared.

use smart_default::SmartDefault;
use statrs::distribution::{ContinuousCDF, Normal};

/// The camera's sensor and lens; by default those of a consumer camera.
#[derive(Debug, Clone, Copy, PartialEq, SmartDefault)]
pub struct Sensor {
    /// Electrons of a saturated pixel.
    #[default(8000.0)]
    pub full_well_e: f64,
    /// Read noise, standard deviation.
    #[default(12.0)]
    pub read_noise_e: f64,
    /// Share of the frame interval for which the shutter is open.
    #[default(0.25)]
    pub exposure_fraction: f64,
    /// Standard deviation of the lens's Gaussian blur.
    #[default(0.5)]
    pub lens_blur_px: f64,
    /// Whether shot and read noise are added.
    #[default(true)]
    pub noise: bool,
    /// Seed of the noise.
    #[default(1)]
    pub seed: u64,
}

/// Entries of the table from linear light to sRGB: finer than a quarter of a grey level at the darkest.
const CODES: usize = 1 << 14;
const QUANTILES: usize = 1 << 12;

/// Tables that turn linear light into noisy 8-bit sRGB.
pub(crate) struct Coder {
    sensor: Sensor,
    codes: Vec<u8>,
    quantiles: Vec<f32>,
}

impl Coder {
    pub(crate) fn new(sensor: Sensor) -> Self {
        let codes = (0..=CODES).map(|k| srgb(k as f64 / CODES as f64)).collect();
        let normal = Normal::standard();
        let quantile = |k: usize| normal.inverse_cdf((k as f64 + 0.5) / QUANTILES as f64) as f32;
        let quantiles = (0..QUANTILES).map(quantile).collect();
        Self { sensor, codes, quantiles }
    }

    /// Codes a frame of linear light, 0 to 1 of full well; the noise depends on seed, frame and pixel alone.
    pub(crate) fn code(&self, linear: &[[f32; 3]], frame: u64) -> Vec<u8> {
        let mut out = vec![0; linear.len() * 3];
        self.code_into(linear, 0, frame, &mut out);
        out
    }

    /// Codes the pixels from number `first` on.
    pub(crate) fn code_into(&self, linear: &[[f32; 3]], first: usize, frame: u64, out: &mut [u8]) {
        let well = self.sensor.full_well_e as f32;
        let read2 = (self.sensor.read_noise_e * self.sensor.read_noise_e) as f32;
        let stream = mix(self.sensor.seed ^ mix(frame.wrapping_add(0x51_7c_c1_b7)));
        for ((k, pixel), coded) in (first..).zip(linear).zip(out.chunks_exact_mut(3)) {
            let mut bits = if self.sensor.noise { mix(stream.wrapping_add(k as u64)) } else { 0 };
            for (light, coded) in pixel.iter().zip(coded) {
                let mut value = *light;
                if self.sensor.noise {
                    let electrons = (light * well).max(0.0);
                    let sigma = (electrons + read2).sqrt();
                    let normal = self.quantiles[(bits & (QUANTILES as u64 - 1)) as usize];
                    value = (electrons + sigma * normal) / well;
                    bits >>= 12;
                }
                let index = (value.clamp(0.0, 1.0) * CODES as f32 + 0.5) as usize;
                *coded = self.codes[index];
            }
        }
    }
}

/// A counter turned into 64 well-mixed bits (SplitMix64; Steele, Lea & Flood 2014).
pub(crate) fn mix(counter: u64) -> u64 {
    let mut z = counter.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number in 0..1 from a counter.
pub(crate) fn unit(counter: u64) -> f64 {
    (mix(counter) >> 11) as f64 / (1_u64 << 53) as f64
}

/// sRGB code of linear light (IEC 61966-2-1).
fn srgb(linear: f64) -> u8 {
    let coded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (coded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_variance_of_the_sensor_and_a_seed_repeats_it() {
        let coder = Coder::new(Sensor::default());
        let light = 0.5_f32;
        let codes = coder.code(&vec![[light; 3]; 40_000], 3);
        assert_eq!(codes, coder.code(&vec![[light; 3]; 40_000], 3));
        assert_ne!(codes, coder.code(&vec![[light; 3]; 40_000], 4));
        let mean = codes.iter().map(|c| f64::from(*c)).sum::<f64>() / codes.len() as f64;
        let variance = codes.iter().map(|c| (f64::from(*c) - mean).powi(2)).sum::<f64>() / codes.len() as f64;
        // d(code)/d(linear) at one half, and rounding to whole codes.
        let slope = 255.0 * 1.055 / 2.4 * 0.5_f64.powf(1.0 / 2.4 - 1.0);
        let expected = slope * slope * (0.5 * 8000.0 + 144.0) / 8000.0_f64.powi(2) + 1.0 / 12.0;
        assert!((mean - 187.5).abs() < 0.3, "{mean}");
        assert!((variance / expected - 1.0).abs() < 0.05, "{variance} is not {expected}");
    }
    #[test]
    fn quantiles_are_normal() {
        let quantiles = Coder::new(Sensor::default()).quantiles;
        for (p, z) in [(0.5, 0.0), (0.975, 1.959_964_f32), (0.001, -3.090_232)] {
            let near = quantiles[(p * QUANTILES as f64) as usize];
            assert!((near - z).abs() < 0.05, "{p}: {near}");
        }
    }
}
