//! How far a blurred edge covers a pixel.

use super::lanes::Lanes;
use pulp::Simd;

/// Edge widths beyond which a pixel is clear of the edge.
const FAR: f64 = 4.5;
/// 1/√(2π).
const DENSITY: f64 = 0.398_942_280_401_432_7;

/// exp(-z²/2) for the square of a distance in standard deviations, and nothing beyond [`FAR`].
#[inline(always)]
pub(super) fn bell<S: Simd>(simd: S, square: Lanes<S>) -> Lanes<S> {
    let all = |value: f64| Lanes::splat(simd, value);
    // e to a 32nd of the exponent, which is above -0.32, by its series; then squared five times.
    let part = square.min(all(FAR * FAR)) * all(-0.5 / 32.0);
    let mut power = all(1.0);
    for k in (1..=7).rev() {
        power = all(1.0) + part * power * all(1.0 / f64::from(k));
    }
    for _ in 0..5 {
        power = power * power;
    }
    square.where_below(all(FAR * FAR), power, all(0.0))
}

/// Coverage of pixels at a distance inside the edge: a Gaussian edge (lens, aperture and pixel together), by
/// the normal distribution function of Abramowitz and Stegun 26.2.17, with an error below 7.5e-8; and its
/// density.
#[inline(always)]
pub(super) fn cover<S: Simd>(simd: S, z: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
    let all = |value: f64| Lanes::splat(simd, value);
    let (away, zero, one) = (z.abs(), all(0.0), all(1.0));
    let density = all(DENSITY) * bell(simd, z * z);
    let t = one / (one + all(0.231_641_9) * away);
    let mut series = all(1.330_274_429);
    for term in [-1.821_255_978, 1.781_477_937, -0.356_563_782, 0.319_381_530] {
        series = all(term) + t * series;
    }
    let tail = density * t * series;
    (z.where_below(zero, tail, one - tail), density)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    /// Tables of the normal distribution (Abramowitz & Stegun, table 26.1).
    #[test]
    fn coverage_is_the_normal_distribution() {
        let simd = Scalar::new();
        for (z, want, density) in [
            (0.0, 0.5, 0.398_942_280_4),
            (1.0, 0.841_344_746_1, 0.241_970_724_5),
            (-2.0, 0.022_750_131_9, 0.053_990_966_5),
            (4.0, 0.999_968_328_8, 0.000_133_830_2),
            (5.0, 1.0, 0.0),
            (-9.0, 0.0, 0.0),
        ] {
            let mut got = [[0.0_f32]; 2];
            let (covered, slope) = cover(simd, Lanes::splat(simd, z));
            covered.store(&mut got[0], 0);
            slope.store(&mut got[1], 0);
            assert!((f64::from(got[0][0]) - want).abs() < 2e-7, "{z}: {got:?}");
            assert!((f64::from(got[1][0]) - density).abs() < 1e-6, "{z}: {got:?}");
        }
    }
}
