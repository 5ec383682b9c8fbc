//! The equations of a ball's fit: residuals, weights and derivatives of every sample that the ball touches.

use super::cholesky::Skyline;
use super::model::{Behind, Model, Parameters, RESIDUAL, Row, SITING, Shown, WIDTH, add_scaled};
use super::normal::Normal;
use super::samples::{combined, grain_variance, visit};
use super::surroundings::{Surroundings, biweight};
use super::{CLEAR, NOISE_STD, NOISE_WEIGHT, ROUNDING_VARIANCE, disc};
use crate::color::decode;
use crate::patch::Patch;

/// Samples well inside a large ball that are used: enough to know its colour and shading as well as the rim needs.
const MOST_INSIDE: usize = 400;
/// Depth inside the outline, in edge widths, from which samples say nothing of it: the shading near the rim is then told
/// from what lies around it there, whatever lamps and gloss do in the middle.
const DEEPEST: f64 = 6.0;
/// Parameters that the samples determine in the main: place, radius, colour and shading's slopes.
const DETERMINED: f64 = 8.0;
/// Clutter may reach over the ball's face as well as behind it: standard deviation there as a part of the one around,
/// for one clutter in four in front.
const IN_FRONT: f64 = 0.5;
/// Clutter is taken to have half the brightness of the wall, so that one of a given variance hides this many times its
/// relative strength of the ball.
const HIDES: f64 = 2.0;

/// Light behind a pixel that is wholly covered: any.
const NOTHING: [f64; 3] = [0.5; 3];
/// Weight at which a sample no longer counts.
const LEAST_TRUST: f64 = 1e-3;

/// Whether the samples' covariance follows the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Covariance {
    Anew,
    Kept,
}

/// A pixel in use: its place in the patch and the light behind the ball there.
#[derive(Debug, Clone, Copy)]
struct Used {
    index: u32,
    behind: Behind,
}

/// Working space.
#[derive(Debug, Clone, Default)]
pub(super) struct Equations {
    covered: Vec<f64>,
    color_covered: Vec<f64>,
    by_angle: Vec<(f64, u32)>,
    rim: Vec<u32>,
    used: Vec<Used>,
    /// For each pixel of the patch one more than its place in `used`, or 0.
    slot: Vec<u32>,
    blocks: Vec<u32>,
    trust: Vec<f64>,
    color_trust: Vec<f64>,
    /// Trust, less what its neighbours spoil.
    weight: Vec<f64>,
    color_weight: Vec<f64>,
    /// Each pixel in use: derivatives, behind those of the brightness its residual.
    shown: Vec<Shown>,
    whitened: Vec<Row>,
    variance: Vec<f64>,
    color_rows: Vec<[Row; 2]>,
    color_variance: Vec<[f64; 2]>,
    factor: Skyline,
    /// Pixels that are not believed at all.
    spoiled: Vec<u32>,
    surroundings: Surroundings,
    noise_variance: f64,
    /// The noise before the fit has shown more.
    least_noise: f64,
    grain: Vec<f64>,
}

impl Equations {
    /// Trusts every sample of a new patch.
    pub(super) fn begin(&mut self, patch: &Patch, noise_variance: Option<f64>) {
        self.least_noise = grain_variance(patch, &mut self.grain).max(NOISE_STD * NOISE_STD);
        self.noise_variance = noise_variance.unwrap_or(self.least_noise);
        self.trust.clear();
        self.trust.resize(patch.bright.len(), 1.0);
        self.color_trust.clear();
        self.color_trust.resize(patch.colors.len(), 1.0);
        self.weight.clone_from(&self.trust);
        self.color_weight.clone_from(&self.color_trust);
    }

    /// Decides which samples the ball touches and what is behind it there.
    #[inline(always)]
    pub(super) fn look_around(&mut self, patch: &Patch, model: &Model) -> Option<()> {
        let p = &model.p;
        self.covered.clear();
        self.covered.extend((0..patch.bright.len()).map(|i| {
            let (x, y) = patch.place(i);
            model.coverage(x, y)
        }));
        self.by_angle.clear();
        for (i, covered) in self.covered.iter().enumerate() {
            if (CLEAR..=1.0 - CLEAR).contains(covered) {
                let (x, y) = patch.place(i);
                self.by_angle.push(((y - p[1]).atan2(x - p[0]), i as u32));
            }
        }
        self.by_angle.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        self.rim.clear();
        self.rim.extend(self.by_angle.iter().map(|(_, i)| *i));
        self.cover_blocks(patch, model);
        let around = (&self.rim[..], &self.covered[..]);
        self.surroundings.estimate(patch, &disc(model), around, &self.color_covered, self.noise_variance)?;
        self.use_pixels(patch, model);
        Some(())
    }

    /// How far each block is covered, and which blocks count.
    #[inline(always)]
    fn cover_blocks(&mut self, patch: &Patch, model: &Model) {
        let siting_px = model.p[SITING];
        self.color_covered.clear();
        self.blocks.clear();
        for block in 0..patch.colors.len() {
            let mut sum = 0.0;
            let whole =
                visit(patch, block, siting_px, |pixel, weight, _| sum += weight * self.covered[pixel]);
            // A block at the border of the patch serves neither as ball nor as background.
            self.color_covered.push(if whole { sum } else { 0.5 });
            let (x, y) = patch.block_place(block);
            if whole && sum >= CLEAR && model.depth_edges(x, y) < DEEPEST {
                self.blocks.push(block as u32);
            }
        }
        let stride = self.blocks.len().div_ceil(2 * MOST_INSIDE).max(1);
        if stride > 1 {
            let covered = &self.color_covered;
            let mut seen = 0;
            self.blocks.retain(|b| {
                let deep = covered[*b as usize] > 1.0 - CLEAR;
                seen += usize::from(deep);
                !deep || seen.is_multiple_of(stride)
            });
        }
    }

    #[inline(always)]
    fn use_pixels(&mut self, patch: &Patch, model: &Model) {
        let color = self.surroundings.color;
        self.used.clear();
        for (index, bright) in self.rim.iter().zip(&self.surroundings.mean) {
            let channels = [
                *bright - patch.from_coded[0][3],
                color[0] - patch.from_coded[1][3],
                color[1] - patch.from_coded[2][3],
            ];
            let behind = patch.to_coded.map(|row| decode((0..3).map(|k| row[k] * channels[k]).sum::<f64>()));
            self.used.push(Used { index: *index, behind: Behind::of(behind) });
        }
        let deep = |(i, covered): &(usize, &f64)| {
            let (x, y) = patch.place(*i);
            **covered > 1.0 - CLEAR && model.depth_edges(x, y) < DEEPEST
        };
        let inside = || self.covered.iter().enumerate().filter(deep);
        let stride = inside().count().div_ceil(MOST_INSIDE).max(1);
        let behind = Behind::of(NOTHING);
        self.used.extend(inside().step_by(stride).map(|(i, _)| Used { index: i as u32, behind }));
        self.slot.clear();
        self.slot.resize(patch.bright.len(), 0);
        for (place, used) in self.used.iter().enumerate() {
            self.slot[used.index as usize] = place as u32 + 1;
        }
    }

    /// Adds the samples to the normal equations; their covariance is set anew from the model or, within a round,
    /// kept.
    #[inline(always)]
    pub(super) fn add_to(
        &mut self,
        patch: &Patch,
        model: &Model,
        covariance: Covariance,
        normal: &mut Normal,
    ) -> Option<()> {
        self.evaluate(patch, model);
        let stretched = self.surroundings.covariance.len();
        if covariance == Covariance::Anew {
            self.set_variances(patch);
            let (shown, variance) = (&self.shown, &self.variance);
            self.factor.copy(&self.surroundings.covariance, |i, j, value| {
                shown[i].open * shown[j].open * value + if i == j { variance[i] } else { 0.0 }
            });
            if !self.factor.factor() {
                return None;
            }
        }
        self.whitened.clear();
        self.whitened.extend(self.shown.iter().map(|shown| shown.channels[0]));
        self.factor.whiten(&mut self.whitened[..stretched]);
        for (row, variance) in self.whitened.iter_mut().zip(&self.variance).skip(stretched) {
            let scale = variance.sqrt().recip();
            row.iter_mut().for_each(|x| *x *= scale);
        }
        for row in &self.whitened {
            normal.add(row, 1.0);
        }
        for (rows, variances) in self.color_rows.iter().zip(&self.color_variance) {
            for (row, variance) in rows.iter().zip(variances) {
                normal.add(row, variance.recip());
            }
        }
        Some(())
    }

    /// Residuals and derivatives of all samples in use.
    #[inline(always)]
    fn evaluate(&mut self, patch: &Patch, model: &Model) {
        self.shown.resize(self.used.len(), Shown::NOTHING);
        for (used, shown) in self.used.iter().zip(&mut self.shown) {
            let index = used.index as usize;
            model.show(patch.place(index), &used.behind, &patch.from_coded, shown);
            let residual = &mut shown.channels[0][RESIDUAL];
            *residual = patch.bright[index] - *residual - patch.from_coded[0][3];
        }
        self.color_rows.clear();
        for block in &self.blocks {
            let rows = self.color_row(patch, model, *block as usize);
            self.color_rows.push(rows);
        }
    }

    /// Variances of all samples in use as far as they are independent of each other.
    #[inline(always)]
    fn set_variances(&mut self, patch: &Patch) {
        let over_face = IN_FRONT * self.surroundings.clutter;
        self.variance.clear();
        for (used, shown) in self.used.iter().zip(&self.shown) {
            let front = over_face * shown.covered;
            let trust = self.weight[used.index as usize].max(LEAST_TRUST);
            self.variance.push((self.noise_variance + front * front) / trust);
        }
        let hidden = HIDES * self.surroundings.clutter
            / (self.surroundings.level - patch.from_coded[0][3]).abs().max(self.noise_variance.sqrt());
        self.color_variance.clear();
        for (block, rows) in self.blocks.iter().zip(&self.color_rows) {
            let block = *block as usize;
            let covered = self.color_covered[block];
            let trust = self.color_weight[block].max(LEAST_TRUST);
            self.color_variance.push([0, 1].map(|k| {
                let value = patch.colors[block][k] - rows[k][RESIDUAL] - patch.from_coded[k + 1][3];
                let behind = (1.0 - covered).powi(2) * self.surroundings.color_variance[k];
                (self.noise_variance + behind + (covered * hidden.min(1.0) * value).powi(2)) / trust
            }));
        }
    }

    /// Both colour differences of a block: the mean over its pixels.
    #[inline(always)]
    fn color_row(&self, patch: &Patch, model: &Model, block: usize) -> [Row; 2] {
        let mut rows = [[0.0; WIDTH]; 2];
        let free = [0, 1].map(|k| self.surroundings.color[k] - patch.from_coded[k + 1][3]);
        let behind = Behind::of(NOTHING);
        visit(patch, block, model.p[SITING], |pixel, weight, by_siting| {
            let mut add_shown = |shown: &Shown| {
                for (row, channel) in rows.iter_mut().zip(&shown.channels[1..]) {
                    add_scaled(row, channel, weight);
                    row[SITING] += by_siting * channel[RESIDUAL];
                }
            };
            match self.slot[pixel] {
                0 if self.covered[pixel] < 0.5 => {
                    for (row, value) in rows.iter_mut().zip(free) {
                        row[RESIDUAL] += weight * value;
                        row[SITING] += by_siting * value;
                    }
                }
                0 => {
                    let mut shown = Shown::NOTHING;
                    model.show(patch.place(pixel), &behind, &patch.from_coded, &mut shown);
                    add_shown(&shown);
                }
                place => add_shown(&self.shown[place as usize - 1]),
            }
        });
        for (k, row) in rows.iter_mut().enumerate() {
            row[RESIDUAL] = patch.colors[block][k] - row[RESIDUAL] - patch.from_coded[k + 1][3];
        }
        rows
    }

    /// Sets the trust in each sample from what a step from the last equations leaves of its residual and, once a first fit stands, the noise from
    /// all of them.
    ///
    /// What is in front of the ball is no sharper than its blur, so neighbours of a sample that is not believed at all
    /// are not believed either.
    pub(super) fn reweigh(&mut self, patch: &Patch, step: &Parameters, with_noise: bool) {
        let (mut chi_square, mut count) = (0.0, -DETERMINED);
        self.spoiled.clear();
        for (place, used) in self.used.iter().enumerate() {
            let index = used.index as usize;
            chi_square += left(&self.whitened[place], step).powi(2);
            count += self.weight[index];
            let open = self.shown[place].open;
            let own = self.variance[place] * self.weight[index].max(LEAST_TRUST);
            let covariance = &self.surroundings.covariance;
            let behind =
                if place < covariance.len() { covariance.row(place).1.last().copied() } else { None };
            let variance = own + open * open * behind.unwrap_or(0.0);
            self.trust[index] = biweight(left(&self.shown[place].channels[0], step) / variance.sqrt());
            if self.trust[index] == 0.0 {
                self.spoiled.push(used.index);
            }
        }
        for (place, block) in self.blocks.iter().enumerate() {
            let weight = self.color_weight[*block as usize];
            let mut worst = 0.0_f64;
            for k in 0..2 {
                let square = left(&self.color_rows[place][k], step).powi(2) / self.color_variance[place][k];
                chi_square += square;
                worst = worst.max(square / weight.max(LEAST_TRUST));
            }
            count += 2.0 * weight;
            let trust = biweight(worst.sqrt());
            self.color_trust[*block as usize] = trust;
            if trust == 0.0 && patch.step == 1 {
                self.spoiled.push(*block);
            }
        }
        self.spoil_neighbours(patch);
        if with_noise {
            let guess = NOISE_WEIGHT * self.least_noise;
            let seen = (guess + chi_square * self.noise_variance) / (NOISE_WEIGHT + count.max(0.0));
            self.noise_variance = seen.max(ROUNDING_VARIANCE);
        }
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
    }

    /// Variance of one sample's noise.
    pub(super) fn noise_variance(&self) -> f64 {
        self.noise_variance
    }

    /// Part of the covered samples that is believed.
    pub(super) fn trusted(&self) -> f64 {
        let (mut covered, mut believed) = (0.0, 0.0);
        for (used, shown) in self.used.iter().zip(&self.shown) {
            covered += shown.covered;
            believed += shown.covered * self.trust[used.index as usize];
        }
        believed / covered
    }

    /// Standard deviation of what the face shows beyond the model and the noise of a pixel (a shadow, a highlight), as a
    /// part of its difference from the surroundings.
    pub(super) fn texture(&self, patch: &Patch, linear: &[f64; 3]) -> f64 {
        let coded = linear.map(|l| crate::color::encode(l).0);
        let around = [self.surroundings.level, self.surroundings.color[0], self.surroundings.color[1]];
        let contrast: f64 = std::iter::zip(&patch.from_coded, around)
            .map(|(row, around)| (combined(row, &coded) - around).powi(2))
            .sum();
        let (mut square, mut count) = (0.0, 0.0);
        for (used, shown) in self.used.iter().zip(&self.shown) {
            let weight = shown.covered * self.weight[used.index as usize];
            square += weight * (shown.channels[0][RESIDUAL].powi(2) - self.least_noise);
            count += weight;
        }
        let bright = square / f64::max(count, 1.0);
        (square, count) = (0.0, 0.0);
        for (block, rows) in self.blocks.iter().zip(&self.color_rows) {
            let block = *block as usize;
            let weight = self.color_covered[block] * self.color_weight[block];
            square += weight * rows.iter().map(|row| row[RESIDUAL].powi(2) - self.least_noise).sum::<f64>();
            count += weight;
        }
        let colors = square / f64::max(count, 1.0);
        ((bright + colors).max(0.0) / contrast.max(self.noise_variance)).sqrt()
    }

    /// Greatest difference between a light and the surroundings in any channel, in standard deviations of the noise.
    pub(super) fn contrast(&self, patch: &Patch, linear: &[f64; 3]) -> f64 {
        let coded = linear.map(|l| crate::color::encode(l).0);
        let around = [self.surroundings.level, self.surroundings.color[0], self.surroundings.color[1]];
        let differs =
            patch.from_coded.iter().zip(around).map(|(row, around)| (combined(row, &coded) - around).abs());
        differs.fold(0.0, f64::max) / self.noise_variance.sqrt()
    }
}

/// What a step leaves of a residual.
fn left(row: &Row, step: &Parameters) -> f64 {
    row[RESIDUAL] - step.iter().zip(row).map(|(change, by)| change * by).sum::<f64>()
}
