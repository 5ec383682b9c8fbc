//! The curve by which light is coded (sRGB, IEC 61966-2-1).

use super::lanes::Lanes;
use pulp::{Scalar, Simd};

/// Light up to which the curve is straight, and its slope there.
const STRAIGHT: f64 = 0.003_130_8;
const SLOPE: f64 = 255.0 * 12.92;
/// What the rest of the curve is lowered by.
const LOWERED: f64 = 255.0 * 0.055;
/// 255 × 1.055 s^(5/3) by powers of s, the fourth root of light between [`STRAIGHT`] and 1, interpolated at
/// Chebyshev's places: to 6e-4 levels.
const POWER: [f64; 7] =
    [-1.208_448, 36.199_357, 345.416_025, -210.446_404, 158.355_582, -75.033_147, 15.742_248];

/// Codes, 0 to 255, of linear light, and their derivatives; beyond the range the curve goes on straight.
#[inline(always)]
pub(super) fn encode<S: Simd>(simd: S, light: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
    let all = |value: f64| Lanes::splat(simd, value);
    let within = light.max(all(STRAIGHT)).min(all(1.0));
    let root = within.sqrt().sqrt();
    let mut power = all(POWER[6]);
    for term in POWER[..6].iter().rev() {
        power = power.mul_add(root, all(*term));
    }
    let slope = power * all(5.0 / 12.0) / within;
    let code = slope.mul_add(light - within, power - all(LOWERED));
    let limit = all(STRAIGHT);
    (light.where_below(limit, light * all(SLOPE), code), light.where_below(limit, all(SLOPE), slope))
}

/// Code up to which the curve is straight.
const STRAIGHT_CODE: f64 = 255.0 * 0.040_45;
/// s^(4/5) by powers of s, the square root of the curve's base between the end of its straight part and 1,
/// interpolated at Chebyshev's places: to 5e-4 levels of the code.
const ROOT_POWER: [f64; 6] = [0.037_27, 1.322_429, -0.753_603, 0.678_427, -0.372_494, 0.087_975];

/// Linear light of codes; beyond the range the curve goes on straight.
#[inline(always)]
pub(super) fn decode<S: Simd>(simd: S, code: Lanes<S>) -> Lanes<S> {
    let all = |value: f64| Lanes::splat(simd, value);
    let (straight, per_code) = (all(STRAIGHT_CODE), (255.0_f64 * 1.055).recip());
    let within = code.max(straight).min(all(255.0));
    let base = within.mul_add(all(per_code), all(0.055 / 1.055));
    let root = base.sqrt();
    let mut power = all(ROOT_POWER[5]);
    for term in ROOT_POWER[..5].iter().rev() {
        power = power.mul_add(root, all(*term));
    }
    let slope = power * base * all(2.4 * per_code);
    let light = slope.mul_add(code - within, power * base * base);
    code.where_below(straight, code * all(SLOPE.recip()), light)
}

/// The same as [`encode`] of one.
pub(crate) fn encode_one(light: f32) -> (f32, f32) {
    let simd = Scalar::new();
    let (mut code, mut slope) = ([0.0], [0.0]);
    let encoded = encode(simd, Lanes::splat(simd, light));
    encoded.0.store(&mut code, 0);
    encoded.1.store(&mut slope, 0);
    (code[0], slope[0])
}

/// The same as [`decode`] of one.
pub(super) fn decode_one(code: f32) -> f32 {
    let (simd, mut light) = (Scalar::new(), [0.0]);
    decode(simd, Lanes::splat(simd, code)).store(&mut light, 0);
    light[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the standard has it.
    fn standard(light: f64) -> f64 {
        let code = if light <= STRAIGHT { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
        255.0 * code
    }

    #[test]
    fn codes_are_those_of_the_standard() {
        for k in 0..=1000 {
            let light = f64::from(k) / 1000.0;
            let (code, slope) = encode_one(light as f32);
            assert!((f64::from(code) - standard(light)).abs() < 1e-3, "{light}: {code}");
            let step = 1e-6 * light.max(1e-3);
            let want = (standard(light + step) - standard(light - step)) / (2.0 * step);
            // The standard's own pieces meet at slopes that differ by 2 %.
            assert!((f64::from(slope) / want - 1.0).abs() < 1e-3, "{light}: {slope} for {want}");
        }
    }

    #[test]
    fn codes_are_turned_back_to_their_light() {
        for k in -100..=1100 {
            let light = f64::from(k) / 1000.0;
            let (code, slope) = encode_one(light as f32);
            let back = f64::from(decode_one(code));
            assert!((back - light).abs() * f64::from(slope) < 4e-3, "{light}: {back}");
        }
    }

    #[test]
    fn beyond_the_range_it_goes_on_straight() {
        for (end, away) in [(0.0_f32, -0.2_f32), (1.0, 0.5)] {
            let (code, slope) = encode_one(end);
            let (beyond, same) = encode_one(end + away);
            assert!((beyond - code - slope * away).abs() < 1e-3 && (same - slope).abs() < 1e-3);
        }
    }
}
