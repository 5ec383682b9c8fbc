//! What a sample of the image is made of, and the noise of the samples of a patch.

use super::robust::{MEDIAN_TO_DEVIATION, median};
use crate::patch::Patch;
use pulp::Simd;

/// A channel of a code.
pub(super) fn combined(row: &[f64; 4], coded: &[f64; 3]) -> f64 {
    (0..3).map(|c| row[c] * coded[c]).sum::<f64>() + row[3]
}

/// Variance of the noise from the second difference of second differences, which passes neither slopes nor most edges
/// (Immerkær 1996, with the median in place of the mean).
#[inline(always)]
pub(super) fn grain_variance<S: Simd>(simd: S, patch: &Patch, values: &mut Vec<f32>) -> f64 {
    values.clear();
    let columns = patch.columns;
    for from in (0..patch.rows.saturating_sub(2)).map(|y| y * columns) {
        let row = |k: usize| &patch.bright[from + k * columns..from + (k + 1) * columns];
        let rows = row(0).windows(3).zip(row(1).windows(3)).zip(row(2).windows(3));
        values.extend(rows.map(|((above, here), below)| {
            let bend = |r: &[f32]| r[0] - 2.0 * r[1] + r[2];
            (bend(above) - 2.0 * bend(here) + bend(below)).abs()
        }));
    }
    // The operator's coefficients have a square sum of 36.
    median(simd, values, values.len()).map_or(0.0, |m| (MEDIAN_TO_DEVIATION * m / 6.0).powi(2))
}

/// The pixels that a colour sample averages: `each` gets pixel, weight and the weight's derivative by the siting. False
/// where some lie outside the patch.
///
/// A colour sample is the mean over the two rows of its block and over a box two pixels wide whose middle lies the siting
/// to the right of the block's left pixel: weights of 1/4, 1/2, 1/4 for a siting of 0, of 0, 1/2, 1/2 for one of 1/2.
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
