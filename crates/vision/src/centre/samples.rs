//! What a sample of the image is made of, and the noise of the samples of a patch.

use super::lanes::{GROUP, Lanes};
use super::robust::{FILLING, MEDIAN_TO_DEVIATION, median};
use crate::patch::Patch;
use pulp::Simd;

/// Variance of a sample's noise, and what it was taken for before the fit had shown more.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    pub(super) variance: f64,
    pub(super) least: f64,
}

/// A channel of a code.
pub(super) fn combined(row: &[f64; 4], coded: &[f64; 3]) -> f64 {
    (0..3).map(|c| row[c] * coded[c]).sum::<f64>() + row[3]
}

/// Variance of the noise from the second difference of second differences, which passes neither slopes nor
/// most edges (Immerkær 1996, with the median in place of the mean).
#[inline(always)]
pub(super) fn grain_variance<S: Simd>(simd: S, patch: &Patch) -> f64 {
    let (columns, rows) = (patch.columns, patch.rows);
    let count = columns.saturating_sub(2) * rows.saturating_sub(2);
    if count == 0 {
        return 0.0;
    }
    // Pixel after pixel, whatever the row: the last two of each have none, and lie above all as what fills up
    // the last group.
    let all = (rows - 2) * columns - 2;
    let mut values = vec![FILLING; (all + 2).next_multiple_of(GROUP)];
    let whole = all / GROUP * GROUP;
    for (k, into) in values[..whole].chunks_exact_mut(GROUP).enumerate() {
        for part in 0..Lanes::<S>::PARTS {
            let above = bend(simd, patch, k * GROUP, part);
            let here = bend(simd, patch, k * GROUP + columns, part);
            let below = bend(simd, patch, k * GROUP + 2 * columns, part);
            (above - (here + here) + below).abs().store(into, part);
        }
    }
    for (i, into) in values.iter_mut().enumerate().take(all).skip(whole) {
        let mut bends = [0.0; 3];
        for (row, bend) in bends.iter_mut().enumerate() {
            let from = &patch.bright[i + row * columns..][..3];
            *bend = from[0] - 2.0 * from[1] + from[2];
        }
        *into = (bends[0] - 2.0 * bends[1] + bends[2]).abs();
    }
    for row in values.chunks_exact_mut(columns).take(rows - 2) {
        row[columns - 2..].fill(FILLING);
    }
    // The operator's coefficients have a square sum of 36.
    median(simd, &values, count).map_or(0.0, |m| (MEDIAN_TO_DEVIATION * m / 6.0).powi(2))
}

/// Second differences along a row from a pixel on.
#[inline(always)]
fn bend<S: Simd>(simd: S, patch: &Patch, first: usize, part: usize) -> Lanes<S> {
    let row = &patch.bright[first..][..GROUP + 2];
    let left = Lanes::load(simd, &row[..GROUP], part);
    let here = Lanes::load(simd, &row[1..=GROUP], part);
    let right = Lanes::load(simd, &row[2..], part);
    left - (here + here) + right
}

/// The pixels that a colour sample averages: `each` gets pixel, weight and the weight's derivative by the
/// siting. False where some lie outside the patch.
///
/// A colour sample is the mean over the two rows of its block and over a box two pixels wide whose middle
/// lies the siting to the right of the block's left pixel: weights of 1/4, 1/2, 1/4 for a siting of 0, of 0,
/// 1/2, 1/2 for one of 1/2.
#[inline(always)]
pub(super) fn visit(
    patch: &Patch,
    block: usize,
    siting_px: f64,
    mut each: impl FnMut(usize, f32, f32),
) -> bool {
    if patch.step == 1 {
        each(block, 1.0, 0.0);
        return true;
    }
    let (bx, by) = (
        patch.first_block.0 + block % patch.block_columns,
        patch.first_block.1 + block / patch.block_columns,
    );
    let (left, top) = ((2 * bx).wrapping_sub(1), 2 * by);
    let inside = bx > 0
        && left >= patch.first.0
        && left + 2 < patch.first.0 + patch.columns
        && top >= patch.first.1
        && top + 1 < patch.first.1 + patch.rows;
    if !inside {
        return false;
    }
    let shift = (0.25 * siting_px.clamp(-0.5, 1.0)) as f32;
    for row in [top, top + 1] {
        let pixel = (row - patch.first.1) * patch.columns + left - patch.first.0;
        each(pixel, 0.125 - shift, -0.25);
        each(pixel + 1, 0.25, 0.0);
        each(pixel + 2, 0.125 + shift, 0.25);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Grain<'a>(&'a Patch);

    impl pulp::WithSimd for Grain<'_> {
        type Output = f64;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f64 {
            grain_variance(simd, self.0)
        }
    }

    #[test]
    fn grain_is_the_median_of_all_second_differences() {
        for (columns, rows) in [(2, 5), (5, 2), (3, 3), (7, 4), (15, 13), (16, 16)] {
            let bright = (0..columns * rows).map(|i| (i * i * 37 % 101) as f32).collect();
            let patch = Patch { columns, rows, bright, ..Patch::default() };
            let at = |x: usize, y: usize| patch.bright[y * columns + x];
            let mut all = Vec::new();
            for y in 2..rows {
                for x in 2..columns {
                    let bend = |y: usize| at(x - 2, y) - 2.0 * at(x - 1, y) + at(x, y);
                    all.push((bend(y - 2) - 2.0 * bend(y - 1) + bend(y)).abs());
                }
            }
            all.sort_by(f32::total_cmp);
            let want =
                all.get(all.len() / 2).map_or(0.0, |m| (MEDIAN_TO_DEVIATION * f64::from(*m) / 6.0).powi(2));
            assert_eq!(pulp::Scalar::new().vectorize(Grain(&patch)), want, "{columns}x{rows}");
            assert_eq!(pulp::Arch::new().dispatch(Grain(&patch)), want, "{columns}x{rows}");
        }
    }
}
