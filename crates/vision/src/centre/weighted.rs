//! Fourth stage of a fit: samples with unit variance, from which the step follows.

use super::cholesky::{BAND, Banded};
use super::lanes::{GROUP, Lanes, total};
use super::linearized::Linearized;
use super::model::{COUNT, EDGE, Model, Parameters, RESIDUAL, Row, WIDTH};
use super::normal::{Normal, Solved};
use super::robust::biweight;
use super::samples::Noise;
use super::stages::Stages;
use super::trust::Trust;
use crate::optics::Known;
use pulp::Simd;

/// Weight at which a sample no longer counts.
const LEAST_TRUST: f32 = 1e-3;
/// Probability that clutter near a ball reaches over its face as well as behind it: as much of it is taken to
/// be the room behind as what the ball is fixed to, and of the latter as much on its near side as on its far.
const OCCLUDED: f32 = 0.25;
/// Clutter is taken to have half the brightness of the wall, so that one of a given variance hides this many
/// times its relative strength of the ball's colour, as long as nothing is seen before the ball.
const HIDES: f32 = 2.0;
/// Number of samples that the guess of the noise counts for.
const NOISE_WEIGHT: f64 = 20.0;
/// Least variance of a code: rounding to whole levels.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;
/// Parameters that the samples determine in the main: place, radius, colour and shading's slopes.
const DETERMINED: f64 = 8.0;

/// What each sample counts for.
#[derive(Debug, Clone, Default)]
pub(super) struct Weighted {
    /// Variance of each pixel in use as far as it is independent of the others.
    variance: Vec<f32>,
    /// Weight of each pixel in use and, behind these, of each block.
    believed: Vec<f32>,
    /// One over the variance of each block's colours.
    color_information: Vec<[f32; 2]>,
    factor: Banded,
    /// Derivatives and residuals of the rim's brightness, whitened; none without clutter.
    rim: Vec<Row>,
}

/// What a step leaves of the brightness of each pixel in use, of both colours of each block, and of the
/// rim's whitened brightness.
#[derive(Debug, Clone, Default)]
pub(super) struct Left {
    pub(super) bright: Vec<f32>,
    pub(super) colors: Vec<[f32; 2]>,
    rim: Vec<f32>,
}

impl Weighted {
    /// Forms them in the buffers of an earlier one; None where what is behind the ball has no covariance.
    #[inline(always)]
    pub(super) fn form<S: Simd>(
        mut self,
        simd: S,
        stages: &Stages<'_>,
        trust: &Trust,
        noise: &Noise,
    ) -> Option<Self> {
        self.weigh_pixels(stages, trust, noise);
        self.weigh_blocks(stages, trust, noise);
        let covariance = &stages.background.covariance;
        let stretched = covariance.len();
        let mut open = stages.linearized.values.open[..stretched].to_vec();
        open.resize(stretched + BAND, 0.0);
        self.factor.copy(covariance, &open, &self.variance);
        self.factor.factor(simd).then_some(())?;
        self.rim.clear();
        self.rim.extend(stages.linearized.shown[..stretched].iter().map(|shown| shown[0]));
        self.factor.whiten(simd, &mut self.rim);
        Some(self)
    }

    #[inline(always)]
    fn weigh_pixels(&mut self, stages: &Stages<'_>, trust: &Trust, noise: &Noise) {
        let noise = noise.variance as f32;
        self.variance.clear();
        self.believed.clear();
        for ((place, pixel), near) in stages.pixels().zip(&stages.background.near) {
            let covered = stages.linearized.values.covered[place];
            let believed = trust.weight[pixel].max(LEAST_TRUST);
            let clutter = stages.background.alike_px2 * OCCLUDED * (near * covered).powi(2);
            self.variance.push((noise + clutter) / believed);
            self.believed.push(believed);
        }
    }

    #[inline(always)]
    fn weigh_blocks(&mut self, stages: &Stages<'_>, trust: &Trust, noise: &Noise) {
        let Stages { patch, layout, background, linearized } = stages;
        let noise = noise.variance as f32;
        let level = (background.around()[0] - patch.from_coded[0][3]) as f32;
        let level = level.abs().max(noise.sqrt());
        // Noise there is no clutter.
        let clutter = background.color_variance().map(|all| (all as f32 - noise).max(0.0));
        let alike = (background.alike_px2 / (patch.step * patch.step) as f32).max(1.0);
        self.color_information.clear();
        for (place, block) in stages.blocks() {
            let covered = layout.color_covered[block];
            let hidden = (HIDES * background.color_near[place] / level).powi(2).min(1.0);
            let believed = trust.block_weight[block].max(LEAST_TRUST);
            self.believed.push(believed);
            self.color_information.push([0, 1].map(|k| {
                let residual = linearized.color_rows[place][k][RESIDUAL];
                let value = patch.colors[block][k] - residual - patch.from_coded[k + 1][3] as f32;
                let behind = (1.0 - covered).powi(2) * clutter[k];
                let variance = noise + alike * (hidden * (covered * value).powi(2) + behind);
                believed / variance
            }));
        }
    }

    /// Fifth stage: the step by these samples and by what is known beforehand; None where the information is
    /// not positive definite.
    #[inline(always)]
    pub(super) fn solve<S: Simd>(
        &self,
        simd: S,
        stages: &Stages<'_>,
        model: &Model,
        prior: &[Known; COUNT],
    ) -> Option<Solved> {
        let mut normal = Normal::new();
        let Linearized { shown, color_rows, .. } = stages.linearized;
        let rim = self.rim.len();
        normal.add(simd, self.rim.iter().map(|row| (row, 1.0)));
        let inside = shown[rim..].iter().zip(&self.variance[rim..]);
        normal.add(simd, inside.map(|(shown, variance)| (&shown[0], variance.recip())));
        let colors = color_rows.as_flattened().iter().zip(self.color_information.as_flattened());
        normal.add(simd, colors.map(|(row, information)| (row, *information)));
        for (i, known) in prior.iter().enumerate() {
            normal.add_known(i, known.variance.recip(), known.mean - model.p[i]);
        }
        if model.is_sharpest() && normal.pull(EDGE) < 0.0 {
            normal.hold(EDGE);
        }
        normal.solve()
    }

    /// What a step leaves of all residuals.
    #[inline(always)]
    pub(super) fn left<S: Simd>(&self, simd: S, stages: &Stages<'_>, step: &Parameters) -> Left {
        let mut filled: Row = [0.0; WIDTH];
        filled.iter_mut().zip(step).for_each(|(out, change)| *out = *change as f32);
        let left = |row: &Row| row[RESIDUAL] - along(simd, row, &filled);
        let Linearized { shown, color_rows, .. } = stages.linearized;
        let mut out = Left {
            bright: Vec::with_capacity(self.variance.len()),
            colors: Vec::with_capacity(color_rows.len()),
            rim: Vec::with_capacity(self.rim.len()),
        };
        for shown in &shown[..self.variance.len()] {
            out.bright.push(left(&shown[0]));
        }
        for [first, second] in color_rows {
            out.colors.push([left(first), left(second)]);
        }
        for row in &self.rim {
            out.rim.push(left(row));
        }
        out
    }

    /// Square of what a step leaves of the brightness of a pixel in use, whitened.
    fn square(&self, left: &Left, place: usize) -> f32 {
        let independent = || left.bright[place].powi(2) / self.variance[place];
        left.rim.get(place).map_or_else(independent, |whitened| whitened * whitened)
    }

    /// Sets the trust in each sample from what a step leaves of its residual.
    #[inline(always)]
    pub(super) fn set_trust(&self, stages: &Stages<'_>, left: &Left, trust: &mut Trust) {
        let mut spoiled = Vec::new();
        let deviation = &stages.background.kriging.deviation;
        for (place, pixel) in stages.pixels() {
            if trust.glare.reaches(pixel) {
                continue;
            }
            let own = self.variance[place] * self.believed[place];
            let behind = deviation.get(place).map_or(0.0, |std| stages.linearized.values.open[place] * std);
            trust.pixels[pixel] = biweight(left.bright[place].powi(2) / (own + behind * behind));
            if trust.pixels[pixel] == 0.0 {
                spoiled.push(pixel as u32);
            }
        }
        let pixels = stages.layout.used.len();
        for (place, block) in stages.blocks() {
            if trust.glare.reaches_block(stages.patch, block) {
                continue;
            }
            let worst = [0, 1].map(|k| left.colors[place][k].powi(2) * self.color_information[place][k]);
            trust.blocks[block] = biweight(worst[0].max(worst[1]) / self.believed[pixels + place]);
            if trust.blocks[block] == 0.0 && stages.patch.step == 1 {
                spoiled.push(block as u32);
            }
        }
        trust.weigh(stages.patch, &spoiled);
    }

    /// Variance of a sample's noise, from what is left of all by their weights.
    #[inline(always)]
    pub(super) fn noise_variance(
        &self,
        stages: &Stages<'_>,
        left: &Left,
        trust: &Trust,
        noise: &Noise,
    ) -> f64 {
        let (mut chi_square, mut count) = (0.0, 0.0);
        let pixels = stages.layout.used.len();
        for (place, pixel) in stages.pixels() {
            let weight = trust.weight[pixel];
            chi_square += self.square(left, place) * weight / self.believed[place];
            count += weight;
        }
        for (place, block) in stages.blocks() {
            let weight = trust.block_weight[block];
            let both = left.colors[place].iter().zip(&self.color_information[place]);
            let squares: f32 = both.map(|(left, information)| left * left * information).sum();
            chi_square += squares * weight / self.believed[pixels + place];
            count += 2.0 * weight;
        }
        let free = (f64::from(count) - DETERMINED).max(0.0);
        let seen = NOISE_WEIGHT * noise.least + f64::from(chi_square) * noise.variance;
        (seen / (NOISE_WEIGHT + free)).max(ROUNDING_VARIANCE)
    }
}

/// The amount by which a step changes a sample; the step is filled up with zeros.
#[inline(always)]
fn along<S: Simd>(simd: S, row: &Row, step: &Row) -> f32 {
    let mut sums = [0.0; GROUP];
    for part in 0..Lanes::<S>::PARTS {
        let of = |values: &Row, group: usize| Lanes::load(simd, values, group * Lanes::<S>::PARTS + part);
        let mut sum = of(row, 0) * of(step, 0);
        for group in 1..WIDTH / GROUP {
            sum = of(row, group).mul_add(of(step, group), sum);
        }
        sum.store(&mut sums, part);
    }
    total(sums)
}
