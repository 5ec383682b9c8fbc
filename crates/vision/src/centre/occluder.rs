//! Whether what is seen around a ball lies before its face, too: an arm or a rod that occludes it, or one
//! that only ends there.
//!
//! Two hypotheses at each pixel. Nothing is there: a mean of what the fit leaves over the neighbourhood has
//! the variance of the noise in it and of what is not known behind the rim. Clutter is there: it has that of
//! the clutter besides. The mean is weighed by the clutter's correlation, the filter that is matched to it,
//! so that it stands for one sample of it; which of the two holds follows by Bayes' rule (Jaynes 2003,
//! chapter 4).

use super::stages::Stages;
use crate::patch::Patch;

/// Clutter may reach over the ball's face as well as behind it: probability of that before anything is seen
/// there. As much of it is taken to be the room behind as what the ball is fixed to, and of the latter as
/// much on its near side as on its far one.
pub(super) const OCCLUDED: f32 = 0.25;
/// Pixels in each direction over which clutter is alike: at a blur of half a pixel, correlation beyond is
/// below e⁻⁴.
const ALIKE_PX: usize = 2;
const ACROSS: usize = 2 * ALIKE_PX + 1;

/// One pixel's share in the mean of a neighbourhood.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    /// What the fit leaves.
    left: f32,
    covered: f32,
    /// Standard deviations of what is behind, as far as it is seen there, and of the clutter around.
    behind: f32,
    clutter: f32,
}

/// Sets the probability that clutter lies before the ball at each pixel in use, from what a step has left of
/// its brightness. Where no clutter is predicted nothing is changed.
#[inline(always)]
pub(super) fn probabilities(stages: &Stages<'_>, left: &[f32], noise_variance: f64, out: &mut [f32]) {
    let behind = &stages.background.covariance;
    if behind.len() == 0 {
        return;
    }
    let values = &stages.linearized.values;
    let share = |(place, (left, near)): (usize, (&f32, &f32))| {
        let covered = values.covered[place];
        let behind =
            if place < behind.len() { values.open[place] * behind.diagonal(place).sqrt() } else { 0.0 };
        Share { left: *left, covered, behind, clutter: near * covered }
    };
    let shares: Vec<Share> = left.iter().zip(&stages.background.near).enumerate().map(share).collect();
    let field = Field {
        patch: stages.patch,
        slot: &stages.layout.slot,
        shares: &shares,
        alike: alike(stages.linearized.edge_px),
        noise_variance: noise_variance as f32,
    };
    for (_, pixel) in stages.pixels() {
        out[pixel] = field.probability(pixel);
    }
}

/// Correlation of clutter by displacement.
fn alike(edge_px: f64) -> [[f32; ACROSS]; ACROSS] {
    let fall = (4.0 * edge_px * edge_px).recip() as f32;
    let along: [f32; ACROSS] = std::array::from_fn(|k| (-(k as f32 - ALIKE_PX as f32).powi(2) * fall).exp());
    along.map(|down| along.map(|across| down * across))
}

struct Field<'a> {
    patch: &'a Patch,
    slot: &'a [u32],
    shares: &'a [Share],
    alike: [[f32; ACROSS]; ACROSS],
    noise_variance: f32,
}

impl Field<'_> {
    #[inline(always)]
    fn probability(&self, pixel: usize) -> f32 {
        let Self { patch, slot, shares, alike, noise_variance } = self;
        let (x, y) = (pixel % patch.columns, pixel / patch.columns);
        let (mut sum, mut square, mut mean) = (0.0, 0.0, Share::default());
        for (row, weights) in (y.saturating_sub(ALIKE_PX)..).zip(&alike[ALIKE_PX.saturating_sub(y)..]) {
            if row >= patch.rows {
                break;
            }
            let (first, from) = (x.saturating_sub(ALIKE_PX), ALIKE_PX.saturating_sub(x));
            let slots = &slot[row * patch.columns..(row + 1) * patch.columns][first..];
            for (slot, weight) in slots.iter().zip(&weights[from..]) {
                // Pixels that are shared alone have no residual of their own.
                let Some(share) = (*slot as usize).checked_sub(1).and_then(|k| shares.get(k)) else {
                    continue;
                };
                let weight = weight * share.covered;
                sum += weight;
                square += weight * weight;
                mean.left += weight * share.left;
                mean.behind += weight * share.behind;
                mean.clutter += weight * share.clutter;
            }
        }
        // The pixel itself is covered in part, so that the sum is positive.
        let part = sum.recip();
        let none = noise_variance * square * part * part + (part * mean.behind).powi(2);
        let there = none + (part * mean.clutter).powi(2);
        let likelier = 0.5 * (part * mean.left).powi(2) * (none.recip() - there.recip());
        let against = (1.0 - OCCLUDED) / OCCLUDED * (there / none).sqrt() * (-likelier).exp();
        (1.0 + against).recip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centre::background::Background;
    use crate::centre::layout::Layout;
    use crate::centre::linearized::Linearized;
    use crate::centre::model::Values;

    const SIDE: usize = 9;

    /// The probability in the middle of a face that leaves this at each pixel, clutter around of standard
    /// deviation 10 and noise of 2 levels.
    fn probability_at(left: f32) -> f32 {
        let patch = Patch { columns: SIDE, rows: SIDE, ..Patch::default() };
        let count = SIDE * SIDE;
        let layout = Layout {
            used: (0..count as u32).collect(),
            slot: (1..=count as u32).collect(),
            ..Layout::default()
        };
        let values = Values { covered: vec![1.0; count], open: vec![0.0; count], ..Values::default() };
        let linearized = Linearized { values, edge_px: 0.5, ..Linearized::default() };
        let mut background = Background::default();
        background.near = vec![10.0; count];
        let mut out = vec![OCCLUDED; count];
        let mut middle = |background: &Background| {
            let stages = Stages { patch: &patch, layout: &layout, background, linearized: &linearized };
            probabilities(&stages, &vec![left; count], 4.0, &mut out);
            out[count / 2]
        };
        assert_eq!(middle(&background), OCCLUDED, "without clutter nothing is decided");
        background.covariance.set(1, |_, _| 1.0);
        middle(&background)
    }

    /// Gaussians of the two hypotheses, for the mean weighed by exp(-d²), at a blur of half a pixel.
    #[test]
    fn the_probability_is_that_of_bayes() {
        let weights = (-2..=2).flat_map(|y| (-2..=2).map(move |x| (-f64::from(x * x + y * y)).exp()));
        let (sum, square) = weights.fold((0.0, 0.0), |(sum, square), w: f64| (sum + w, square + w * w));
        let density = |value: f64, variance: f64| (-0.5 * value * value / variance).exp() / variance.sqrt();
        let noise = 4.0 * square / (sum * sum);
        for left in [0.0, 2.0, -3.0, 10.0] {
            let there = 0.25 * density(left, noise + 100.0);
            let want = there / (there + 0.75 * density(left, noise));
            let got = f64::from(probability_at(left as f32));
            assert!((got - want).abs() < 1e-5, "{left}: {got} for {want}");
        }
        assert!(probability_at(0.0) < 0.05 && probability_at(10.0) > 0.99 && probability_at(1e4) == 1.0);
    }
}
