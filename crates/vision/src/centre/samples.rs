//! What a sample of the image is made of, and the noise of the samples of a patch.

use super::robust::{MEDIAN_TO_DEVIATION, median};
use crate::patch::Patch;

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
pub(super) fn grain_variance(patch: &Patch) -> f64 {
    let columns = patch.columns;
    let bend = |i: usize| {
        let from = &patch.bright[i..i + 3];
        from[0] - 2.0 * from[1] + from[2]
    };
    let mut left = Vec::with_capacity(patch.bright.len());
    for row in 0..patch.rows.saturating_sub(2) {
        let first = row * columns;
        left.extend(
            (first..first + columns.saturating_sub(2))
                .map(|i| (bend(i) - 2.0 * bend(i + columns) + bend(i + 2 * columns)).abs()),
        );
    }
    // The operator's coefficients have a square sum of 36.
    median(&mut left).map_or(0.0, |m| (MEDIAN_TO_DEVIATION * m / 6.0).powi(2))
}

/// A pixel's part in a colour sample.
pub(super) struct Part {
    pub(super) pixel: usize,
    pub(super) weight: f32,
    /// The weight's derivative by the siting.
    pub(super) by_siting: f32,
}

/// The pixels that a colour sample averages; None where some lie outside the patch.
///
/// A colour sample is the mean over the two rows of its block and over a box two pixels wide whose middle
/// lies the siting to the right of the block's left pixel: weights of 1/4, 1/2, 1/4 for a siting of 0, of 0,
/// 1/2, 1/2 for one of 1/2.
#[inline(always)]
pub(super) fn parts(patch: &Patch, block: usize, siting_px: f64) -> Option<impl Iterator<Item = Part>> {
    let (first, rows, columns, weights) = if patch.step == 1 {
        (block, 1, 1, [(1.0, 0.0); 3])
    } else {
        let shift = (0.25 * siting_px.clamp(-0.5, 1.0)) as f32;
        (first_averaged(patch, block)?, 2, 3, [(0.125 - shift, -0.25), (0.25, 0.0), (0.125 + shift, 0.25)])
    };
    let stride = patch.columns;
    Some((0..rows * columns).map(move |k| {
        let (weight, by_siting) = weights[k % columns];
        Part { pixel: first + k / columns * stride + k % columns, weight, by_siting }
    }))
}

/// The first pixel that a colour sample of a block averages.
#[inline(always)]
fn first_averaged(patch: &Patch, block: usize) -> Option<usize> {
    let (bx, by) = (
        patch.first_block.0 + block % patch.block_columns,
        patch.first_block.1 + block / patch.block_columns,
    );
    let (left, top) = ((2 * bx).wrapping_sub(1), 2 * by);
    let is_inside = bx > 0
        && left >= patch.first.0
        && left + 2 < patch.first.0 + patch.columns
        && top >= patch.first.1
        && top + 1 < patch.first.1 + patch.rows;
    is_inside.then(|| (top - patch.first.1) * patch.columns + left - patch.first.0)
}

#[cfg(test)]
mod tests {
    use super::*;

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
            assert_eq!(grain_variance(&patch), want, "{columns}x{rows}");
        }
    }
}
