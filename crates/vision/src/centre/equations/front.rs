//! Whether what is seen around a ball lies before its face, too: an arm or a rod that passes in front, or one that only ends there.
//!
//! Two hypotheses at each pixel. Nothing is there: a mean of what the fit leaves over the neighbourhood has the variance of the
//! noise in it and of what is not known behind the rim. Clutter is there: it has that of the clutter besides. The mean is
//! weighed by the clutter's correlation, the filter that is matched to it, so that it stands for one sample of it; which of the
//! two holds follows by Bayes' rule (Jaynes 2003, chapter 4).

use super::{Equations, IN_FRONT};
use crate::patch::Patch;

/// Pixels in each direction over which clutter is alike: at a blur of half a pixel, correlation beyond is below e⁻⁴.
const ALIKE_PX: usize = 2;
const ACROSS: usize = 2 * ALIKE_PX + 1;

/// What one pixel tells of the neighbourhood.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Look {
    /// What the fit leaves.
    left: f32,
    covered: f32,
    /// Standard deviations of what is behind, as far as it is seen there, and of the clutter around.
    behind: f32,
    clutter: f32,
}

impl Equations {
    /// Sets the probability that clutter lies before the ball at each pixel in use, from what a step from the last equations has
    /// left. Where no clutter is predicted nothing is changed.
    #[inline(always)]
    pub(super) fn look_in_front(&mut self, patch: &Patch) {
        let behind = &self.surroundings.covariance;
        if behind.len() == 0 {
            return;
        }
        self.looks.clear();
        let open = |place: usize| self.values.open[place];
        self.looks.extend(self.bright_left.iter().zip(&self.near).enumerate().map(
            |(place, (left, near))| {
                let covered = self.values.covered[place];
                let behind =
                    if place < behind.len() { open(place) * behind.diagonal(place).sqrt() } else { 0.0 };
                Look { left: *left, covered, behind, clutter: near * covered }
            },
        ));
        let alike = self.alike();
        for index in self.used.iter().map(|used| *used as usize) {
            self.front[index] = self.probability(patch, index, &alike);
        }
    }

    /// The same for a colour sample: the mean over its block.
    #[inline(always)]
    pub(super) fn front_of_block(&self, patch: &Patch, block: usize) -> f32 {
        if patch.step == 1 {
            return self.front[block];
        }
        let first = patch.first_pixel(block);
        let of_pixel = |k: usize| self.front[first + k / patch.step * patch.columns + k % patch.step];
        let count = patch.step * patch.step;
        (0..count).map(of_pixel).sum::<f32>() / count as f32
    }

    /// Correlation of clutter by displacement.
    fn alike(&self) -> [[f32; ACROSS]; ACROSS] {
        let fall = (4.0 * self.edge_px * self.edge_px).recip() as f32;
        let along: [f32; ACROSS] =
            std::array::from_fn(|k| (-(k as f32 - ALIKE_PX as f32).powi(2) * fall).exp());
        along.map(|down| along.map(|across| down * across))
    }

    #[inline(always)]
    fn probability(&self, patch: &Patch, index: usize, alike: &[[f32; ACROSS]; ACROSS]) -> f32 {
        let (x, y) = (index % patch.columns, index / patch.columns);
        let (mut sum, mut square, mut mean) = (0.0, 0.0, Look::default());
        for (row, weights) in (y.saturating_sub(ALIKE_PX)..).zip(&alike[ALIKE_PX.saturating_sub(y)..]) {
            if row >= patch.rows {
                break;
            }
            let (first, from) = (x.saturating_sub(ALIKE_PX), ALIKE_PX.saturating_sub(x));
            let slots = &self.slot[row * patch.columns..(row + 1) * patch.columns][first..];
            for (slot, weight) in slots.iter().zip(&weights[from..]) {
                // Pixels that are shared alone have no residual of their own.
                let Some(look) = (*slot as usize).checked_sub(1).and_then(|k| self.looks.get(k)) else {
                    continue;
                };
                let weight = weight * look.covered;
                sum += weight;
                square += weight * weight;
                mean.left += weight * look.left;
                mean.behind += weight * look.behind;
                mean.clutter += weight * look.clutter;
            }
        }
        // The pixel itself is covered in part, so that the sum is positive.
        let part = sum.recip();
        let none = self.noise_variance as f32 * square * part * part + (part * mean.behind).powi(2);
        let there = none + (part * mean.clutter).powi(2);
        let likelier = 0.5 * (part * mean.left).powi(2) * (none.recip() - there.recip());
        let against = (1.0 - IN_FRONT) / IN_FRONT * (there / none).sqrt() * (-likelier).exp();
        (1.0 + against).recip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centre::model::Values;

    const SIDE: usize = 9;

    /// The probability in the middle of a face that leaves this at each pixel, clutter around of standard deviation 10 and noise of
    /// 2 levels.
    fn in_front(left: f32) -> f32 {
        let patch = Patch { columns: SIDE, rows: SIDE, ..Patch::default() };
        let count = SIDE * SIDE;
        let mut equations = Equations {
            used: (0..count as u32).collect(),
            slot: (1..=count as u32).collect(),
            bright_left: vec![left; count],
            values: Values { covered: vec![1.0; count], open: vec![0.0; count], ..Values::default() },
            near: vec![10.0; count],
            front: vec![IN_FRONT; count],
            noise_variance: 4.0,
            edge_px: 0.5,
            ..Equations::default()
        };
        let middle = count / 2;
        equations.look_in_front(&patch);
        assert_eq!(equations.front[middle], IN_FRONT, "without clutter nothing is told");
        equations.surroundings.covariance.set(1, |_, _| 1.0);
        equations.look_in_front(&patch);
        equations.front[middle]
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
            let got = f64::from(in_front(left as f32));
            assert!((got - want).abs() < 1e-5, "{left}: {got} for {want}");
        }
        assert!(in_front(0.0) < 0.05 && in_front(10.0) > 0.99 && in_front(1e4) == 1.0);
    }
}
