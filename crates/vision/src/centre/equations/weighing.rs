//! How far samples are believed, and what they say of the fit as a whole.

use super::{Equations, LEAST_TRUST};
use crate::centre::curve::encode_one;
use crate::centre::lanes::{GROUP, Lanes, total};
use crate::centre::model::{Parameters, Row, WIDTH};
use crate::centre::normal::Normal;
use crate::centre::robust::biweight;
use crate::centre::samples::combined;
use crate::centre::{LIGHT_STD, NOISE_WEIGHT, ROUNDING_VARIANCE};
use crate::patch::Patch;
use pulp::Simd;

/// What samples that have been weighed anew ask for.
pub(in crate::centre) struct Asked {
    /// Their gradient behind the step.
    pub(in crate::centre) pull: Parameters,
    /// How far they are believed on average, over how far they were in the equations.
    pub(in crate::centre) believed: f64,
    /// Whether some are not believed at all.
    pub(in crate::centre) is_spoiled: bool,
}

/// Sum of rows times numbers; as many of its parts are in use as make up a row. Every other row is added to the one that waits less.
pub(super) struct Pull<S: Simd>([[Lanes<S>; WIDTH]; 2]);

impl<S: Simd> Pull<S> {
    const PARTS: usize = WIDTH / S::F32_LANES;

    #[inline(always)]
    pub(super) fn nothing(simd: S) -> Self {
        Self([[Lanes::splat(simd, 0.0); WIDTH]; 2])
    }

    #[inline(always)]
    pub(super) fn add(&mut self, simd: S, row: &Row, factor: f32) {
        let factor = Lanes::splat(simd, factor);
        let Self([sums, others]) = self;
        for part in 0..Self::PARTS {
            let sum = factor.mul_add(Lanes::load(simd, row, part), others[part]);
            (sums[part], others[part]) = (sum, sums[part]);
        }
    }

    #[inline(always)]
    pub(super) fn sums(self) -> Parameters {
        let mut row = [0.0; WIDTH];
        let Self([sums, others]) = self;
        (0..Self::PARTS).for_each(|part| (sums[part] + others[part]).store(&mut row, part));
        Parameters::from_fn(|i, _| row[i].into())
    }
}

/// Parameters that the samples determine in the main: place, radius, colour and shading's slopes.
const DETERMINED: f64 = 8.0;

impl Equations {
    /// Sets the trust in each sample from what a step from the last equations leaves of its residual and, once a first fit
    /// stands, the noise from all of them.
    ///
    /// Whether something is before the ball is decided once, from a fit that allowed for it everywhere: decided again from a fit that
    /// trusts what it found, it would bear itself out.
    ///
    /// What is in front of the ball is no sharper than its blur, so neighbours of a sample that is not believed at all
    /// are not believed either.
    #[inline(always)]
    pub(in crate::centre) fn reweigh<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        step: &Parameters,
        with_noise: bool,
    ) -> Asked {
        self.leave(simd, step);
        self.spoiled.clear();
        self.trust_pixels();
        self.trust_blocks(patch);
        self.spoil_neighbours(patch);
        // In a film clutter is not told apart by place, so that there is nothing to look for.
        if self.in_still() && !std::mem::replace(&mut self.has_looked_in_front, true) {
            self.look_in_front(patch);
        }
        self.ask(simd, with_noise)
    }

    /// Sets what a step leaves of all residuals.
    #[inline(always)]
    pub(in crate::centre) fn leave<S: Simd>(&mut self, simd: S, step: &Parameters) {
        let step = &filled(step);
        self.left.clone_from(&self.whitened_residuals);
        for ((left, row), shrunk) in self.left.iter_mut().zip(&self.whitened).zip(&self.shrunk) {
            *left -= along(simd, row, step) * shrunk;
        }
        self.bright_left.clone_from(&self.residuals);
        for (left, shown) in self.bright_left.iter_mut().zip(&self.shown) {
            *left -= along(simd, &shown[0], step);
        }
    }

    #[inline(always)]
    fn trust_pixels(&mut self) {
        let (stretched, deviation) = (self.surroundings.covariance.len(), self.surroundings.deviation());
        for (place, used) in self.used.iter().enumerate() {
            let index = *used as usize;
            if self.glare.reaches(index) {
                continue;
            }
            let own = self.variance[place] * self.believed[place];
            let behind = if place < stretched { self.values.open[place] * deviation[place] } else { 0.0 };
            let variance = own + behind * behind;
            let trust = biweight(self.bright_left[place].powi(2) / variance);
            self.trust[index] = trust;
            if trust == 0.0 {
                self.spoiled.push(*used);
            }
        }
    }

    #[inline(always)]
    fn trust_blocks(&mut self, patch: &Patch) {
        let residuals = self.left[self.used.len()..].chunks_exact(2);
        let believed = &self.believed[self.used.len()..];
        for ((block, residuals), believed) in self.blocks.iter().zip(residuals).zip(believed) {
            if self.glare.reaches_block(patch, *block as usize) {
                continue;
            }
            let worst = residuals[0].abs().max(residuals[1].abs());
            let trust = biweight(worst * worst / believed);
            self.color_trust[*block as usize] = trust;
            if trust == 0.0 && patch.step == 1 {
                self.spoiled.push(*block);
            }
        }
    }

    /// What the samples ask for by their weights, in the equations that there are; with the noise, if that is to be set.
    #[inline(always)]
    fn ask<S: Simd>(&mut self, simd: S, with_noise: bool) -> Asked {
        let (mut chi_square, mut count, mut formed) = (0.0, 0.0, 0.0);
        let mut pull = Pull::nothing(simd);
        let (bright, colors) = self.whitened.split_at(self.used.len());
        let (left, colors_left) = self.left.split_at(self.used.len());
        let (shrunk, colors_shrunk) = self.shrunk.split_at(self.used.len());
        let (believed, blocks_believed) = self.believed.split_at(self.used.len());
        for (place, used) in self.used.iter().enumerate() {
            let weight = self.weight[*used as usize];
            let part = weight / believed[place];
            chi_square += left[place] * left[place] * part;
            (count, formed) = (count + weight, formed + believed[place]);
            pull.add(simd, &bright[place], left[place] * part * shrunk[place]);
        }
        for (place, block) in self.blocks.iter().enumerate() {
            let weight = self.color_weight[*block as usize];
            let part = weight / blocks_believed[place];
            (count, formed) = (count + 2.0 * weight, formed + 2.0 * blocks_believed[place]);
            for sample in 2 * place..2 * place + 2 {
                chi_square += colors_left[sample] * colors_left[sample] * part;
                pull.add(simd, &colors[sample], colors_left[sample] * part * colors_shrunk[sample]);
            }
        }
        if with_noise {
            let guess = NOISE_WEIGHT * self.least_noise;
            let free = (f64::from(count) - DETERMINED).max(0.0);
            let seen = (guess + f64::from(chi_square) * self.noise_variance) / (NOISE_WEIGHT + free);
            self.noise_variance = seen.max(ROUNDING_VARIANCE);
        }
        let is_spoiled = !self.spoiled.is_empty();
        Asked { pull: pull.sums(), believed: f64::from(count / formed), is_spoiled }
    }

    /// Forms the equations of the last step anew with the weights that samples have now and so many times the noise, by which they ask
    /// for what is told.
    #[inline(always)]
    pub(in crate::centre) fn form_again<S: Simd>(
        &mut self,
        simd: S,
        (noise, pull): (f64, &Parameters),
        normal: &mut Normal,
    ) {
        let (pixels, quieter) = (self.used.len(), noise.recip() as f32);
        for place in 0..pixels {
            let weight = self.weight[self.used[place] as usize].max(LEAST_TRUST);
            let part = quieter * weight / self.believed[place];
            self.variance[place] /= part;
            self.believed[place] = weight;
            self.shrink(place, part.sqrt());
        }
        for place in 0..self.blocks.len() {
            let weight = self.color_weight[self.blocks[place] as usize].max(LEAST_TRUST);
            let part = (quieter * weight / self.believed[pixels + place]).sqrt();
            self.believed[pixels + place] = weight;
            for sample in pixels + 2 * place..pixels + 2 * place + 2 {
                self.shrink(sample, part);
            }
        }
        normal.set(simd, &self.whitened, &self.shrunk);
        normal.set_pull(pull);
    }

    #[inline(always)]
    fn shrink(&mut self, sample: usize, factor: f32) {
        self.shrunk[sample] *= factor;
        self.left[sample] *= factor;
        self.whitened_residuals[sample] *= factor;
    }

    /// Takes the weight of the samples beside those that are not believed.
    fn spoil_neighbours(&mut self, patch: &Patch) {
        self.weight.clone_from(&self.trust);
        self.color_weight.clone_from(&self.color_trust);
        for index in &self.spoiled {
            let (x, y) = (*index as usize % patch.columns, *index as usize / patch.columns);
            for (column, row) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                if column >= patch.columns || row >= patch.rows {
                    continue;
                }
                let neighbour = row * patch.columns + column;
                self.weight[neighbour] = 0.0;
                if patch.step == 1 {
                    self.color_weight[neighbour] = 0.0;
                }
            }
        }
        self.forget_dazzled(patch);
    }

    /// Takes the weight of the samples that the brightest light reaches.
    pub(super) fn forget_dazzled(&mut self, patch: &Patch) {
        if self.glare.is_none() {
            return;
        }
        for pixel in (0..self.weight.len()).filter(|i| self.glare.reaches(*i)) {
            self.weight[pixel] = 0.0;
        }
        for block in (0..self.color_weight.len()).filter(|b| self.glare.reaches_block(patch, *b)) {
            self.color_weight[block] = 0.0;
        }
    }

    /// Whether there is the time that a still leaves.
    pub(in crate::centre) fn in_still(&self) -> bool {
        self.surroundings.in_still()
    }

    /// Variance of one sample's noise.
    pub(in crate::centre) fn noise_variance(&self) -> f64 {
        self.noise_variance
    }

    /// Part of the covered samples that is believed.
    pub(in crate::centre) fn trusted(&self) -> f64 {
        let (mut covered, mut believed) = (0.0, 0.0);
        for (used, part) in self.used.iter().zip(&self.values.covered) {
            covered += part;
            believed += part * self.trust[*used as usize];
        }
        f64::from(believed / covered)
    }

    /// Standard deviation of what the face shows beyond the model and the noise of a pixel (a shadow, a highlight, light of higher
    /// order), as a part of its difference from the surroundings, by what the last step has left. A sample counts by the probability
    /// that it is the face that is seen: what is before it is in the samples' own variance.
    #[inline(always)]
    pub(in crate::centre) fn texture(&self, patch: &Patch, linear: &[f64; 3]) -> f64 {
        let encoded = linear.map(encoded);
        let coded = encoded.map(|(code, _)| code);
        let around = self.surroundings.around();
        let contrast: f64 = std::iter::zip(&patch.from_coded, around)
            .map(|(row, around)| (combined(row, &coded) - around).powi(2))
            .sum();
        let by_light = |row: &[f64; 4]| -> f64 { (0..3).map(|c| row[c] * encoded[c].1 * linear[c]).sum() };
        let light: f64 = patch.from_coded.iter().map(|row| (LIGHT_STD * by_light(row)).powi(2)).sum();
        let (mut square, mut count) = (0.0, 0.0);
        let pixels = self.used.iter().zip(&self.values.covered).zip(&self.bright_left);
        for ((used, covered), left) in pixels {
            let index = *used as usize;
            let weight = f64::from(covered * self.weight[index] * (1.0 - self.front[index]));
            square += weight * (f64::from(left.powi(2)) - self.least_noise);
            count += weight;
        }
        let bright = square / f64::max(count, 1.0);
        (square, count) = (0.0, 0.0);
        let first = self.used.len();
        let scales = self.color_scale.iter().zip(self.shrunk[first..].chunks_exact(2));
        let left = self.left[first..].chunks_exact(2).zip(scales);
        for (block, (left, (scale, shrunk))) in self.blocks.iter().zip(left) {
            let block = *block as usize;
            let seen = 1.0 - self.front_of_block(patch, block);
            let weight = f64::from(self.color_covered[block] * self.color_weight[block] * seen);
            let squares: f32 = (0..2).map(|k| (left[k] / (scale[k] * shrunk[k])).powi(2)).sum();
            square += weight * (f64::from(squares) - 2.0 * self.least_noise);
            count += weight;
        }
        let colors = square / f64::max(count, 1.0);
        (((bright + colors).max(0.0) + light) / contrast.max(self.noise_variance)).sqrt()
    }

    /// Greatest difference between a light and the surroundings in any channel, in standard deviations of the noise.
    pub(in crate::centre) fn contrast(&self, patch: &Patch, linear: &[f64; 3]) -> f64 {
        let coded = linear.map(|light| encoded(light).0);
        let around = self.surroundings.around();
        let differs =
            patch.from_coded.iter().zip(around).map(|(row, around)| (combined(row, &coded) - around).abs());
        differs.fold(0.0, f64::max) / self.noise_variance.sqrt()
    }
}

/// Code of a light and its derivative.
fn encoded(light: f64) -> (f64, f64) {
    let (code, gain) = encode_one(light as f32);
    (code.into(), gain.into())
}

/// A step filled up with zeros.
fn filled(step: &Parameters) -> Row {
    let mut filled = [0.0; WIDTH];
    filled.iter_mut().zip(step).for_each(|(out, change)| *out = *change as f32);
    filled
}

/// By how much a step changes a sample; the step is filled up with zeros.
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
    total(simd, &sums)
}
