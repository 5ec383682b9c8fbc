//! The equations of a ball's fit: residuals, weights and derivatives of every sample that the ball touches.

mod foreseen;
mod front;
mod layout;
mod weighing;

pub(super) use foreseen::Seen;
pub(super) use weighing::Asked;

use super::cholesky::{BAND, Banded};
use super::glare::Glare;
use super::lanes::GROUP;
use super::model::{
    EDGE, Model, NO_COLUMNS, NOTHING, RESIDUAL, Row, SITING, Shown, Values, WIDTH, add_scaled,
};
use super::normal::Normal;
use super::places::Places;
use super::samples::{grain_variance, visit};
use super::surroundings::{Clutter, Surroundings};
use super::{NOISE_STD, disc};
use crate::patch::Patch;
use pulp::Simd;

/// Clutter may reach over the ball's face as well as behind it: probability of that before anything is seen there. As much of it is
/// taken to be the room behind as what the ball is fixed to, and of the latter as much on its near side as on its far one.
const IN_FRONT: f32 = 0.25;
/// Area over which clutter is alike, in squared edge widths: the integral of the correlation of blurred white noise. What is
/// taken as independent from pixel to pixel but is not has its variance times the area, so that a mean over many is right.
const ALIKE: f64 = 4.0 * std::f64::consts::PI;
/// Clutter is taken to have half the brightness of the wall, so that one of a given variance hides this many times its
/// relative strength of the ball's colour, as long as nothing is seen before the ball.
const HIDES: f32 = 2.0;

/// Weight at which a sample no longer counts.
const LEAST_TRUST: f32 = 1e-3;

/// Whether the samples' covariance follows the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Covariance {
    Anew,
    Kept,
}

/// Working space.
#[derive(Debug, Clone, Default)]
pub(super) struct Equations {
    covered: Vec<f32>,
    /// Distance inside the edge, in edge widths.
    depth: Vec<f32>,
    color_covered: Vec<f32>,
    /// How far pixels, and blocks, would be covered by a ball that is larger by as much as this one may lie elsewhere.
    touched: Vec<f32>,
    color_touched: Vec<f32>,
    by_angle: Vec<(f64, u32)>,
    rim: Vec<u32>,
    /// Pixels in use.
    used: Vec<u32>,
    /// Pixels that are not, but belong to a block in use.
    shared: Vec<u32>,
    /// All these, with the light behind the ball there.
    places: Places,
    /// For each pixel of the patch one more than its place in `used` or, behind these, in `shared`; or 0.
    slot: Vec<u32>,
    blocks: Vec<u32>,
    trust: Vec<f32>,
    color_trust: Vec<f32>,
    /// Trust, less what its neighbours spoil.
    weight: Vec<f32>,
    color_weight: Vec<f32>,
    /// Weight in the equations of each pixel in use and, behind these, of each block.
    believed: Vec<f32>,
    /// By what each sample counts for less or more since the equations were formed: factors of its row, and of its residual, in which
    /// they are.
    shrunk: Vec<f32>,
    /// What a step leaves of each sample's residual in the equations, and of the brightness of each pixel in use.
    left: Vec<f32>,
    bright_left: Vec<f32>,
    /// Probability that clutter lies before the ball, at each pixel of the patch.
    front: Vec<f32>,
    looks: Vec<front::Look>,
    has_looked_in_front: bool,
    /// What each pixel in use and each that is shared shows, and its derivatives.
    values: Values,
    shown: Vec<Shown>,
    /// Residuals of the brightness of each pixel in use, and of both colours of each block.
    residuals: Vec<f32>,
    color_residuals: Vec<[f32; 2]>,
    /// Derivatives of all samples with unit variance: brightness of the pixels in use, then both colours of each block. Behind them
    /// their residuals when the equations were formed, and those that they have now.
    whitened: Vec<Row>,
    whitened_residuals: Vec<f32>,
    variance: Vec<f32>,
    /// One over the standard deviation.
    scale: Vec<f32>,
    color_rows: Vec<[Row; 2]>,
    color_variance: Vec<[f32; 2]>,
    /// Standard deviation of the clutter near each pixel and each block in use.
    near: Vec<f32>,
    color_near: Vec<f32>,
    color_scale: Vec<[f32; 2]>,
    /// Derivative by what is behind of each pixel of the rim, and nothing for a band more.
    open: Vec<f32>,
    factor: Banded,
    /// Variance of each pixel of a rim that was foreseen, with what is behind as it was expected.
    expected_variance: Vec<f32>,
    /// Pixels that are not believed at all.
    spoiled: Vec<u32>,
    surroundings: Surroundings,
    glare: Glare,
    /// Width of the edge where the surroundings were looked at.
    edge_px: f64,
    noise_variance: f64,
    /// The noise before the fit has shown more.
    least_noise: f64,
    grain: Vec<f32>,
}

impl Equations {
    /// Takes the time of a still.
    pub(super) fn take_time(&mut self) {
        self.surroundings.take_time();
    }

    /// Trusts every sample of a new patch.
    #[inline(always)]
    pub(super) fn begin<S: Simd>(&mut self, simd: S, patch: &Patch, noise_variance: Option<f64>) {
        self.least_noise = grain_variance(simd, patch, &mut self.grain).max(NOISE_STD * NOISE_STD);
        self.noise_variance = noise_variance.unwrap_or(self.least_noise);
        self.trust_all(patch);
    }

    #[inline(always)]
    fn trust_all(&mut self, patch: &Patch) {
        self.glare.find(patch);
        self.trust.clear();
        self.trust.resize(patch.bright.len(), 1.0);
        self.color_trust.clear();
        self.color_trust.resize(patch.colors.len(), 1.0);
        self.weight.clone_from(&self.trust);
        self.color_weight.clone_from(&self.color_trust);
        self.front.clear();
        self.has_looked_in_front = false;
        self.front.resize(patch.bright.len(), IN_FRONT);
    }

    /// Decides which samples the ball touches and what is behind it there.
    #[inline(always)]
    pub(super) fn look_around<S: Simd>(
        &mut self,
        simd: S,
        (patch, model): (&Patch, &Model),
        clutter: Clutter,
    ) -> Option<()> {
        self.lay_out(simd, (patch, model), 0.0);
        self.glare.reach(patch, &disc(model), (&self.covered, &self.depth));
        self.forget_dazzled(patch);
        let around = (&self.rim[..], &self.touched[..]);
        let place = (patch, &disc(model));
        let colors = &self.color_touched;
        self.surroundings.estimate(simd, place, around, colors, (self.noise_variance, clutter))?;
        self.use_pixels(simd, patch, model);
        Some(())
    }

    /// Adds the samples to the normal equations; their covariance is set anew from the model or, within a round,
    /// kept.
    #[inline(always)]
    pub(super) fn add_to<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        model: &Model,
        covariance: Covariance,
        normal: &mut Normal,
    ) -> Option<()> {
        self.evaluate(simd, patch, model);
        self.form(simd, (patch, model), covariance, normal)
    }

    /// The same with the derivatives that there are.
    #[inline(always)]
    pub(super) fn form<S: Simd>(
        &mut self,
        simd: S,
        (patch, model): (&Patch, &Model),
        covariance: Covariance,
        normal: &mut Normal,
    ) -> Option<()> {
        let stretched = self.surroundings.covariance.len();
        if covariance == Covariance::Anew {
            self.set_variances(patch, model.p[EDGE]);
            self.open.clear();
            self.open.extend_from_slice(&self.values.open[..stretched]);
            self.open.resize(stretched + BAND, 0.0);
            self.factor.copy(simd, &self.surroundings.covariance, &self.open, &self.variance);
            if !self.factor.factor(simd) {
                return None;
            }
        }
        let samples = self.used.len() + 2 * self.color_rows.len();
        self.shrunk.clear();
        self.shrunk.resize(samples, 1.0);
        self.whitened.resize(samples, [0.0; WIDTH]);
        let (bright, colors) = self.whitened.split_at_mut(self.used.len());
        let (rim, inside) = bright.split_at_mut(stretched);
        for (out, shown) in rim.iter_mut().zip(&self.shown) {
            *out = shown[0];
        }
        self.factor.whiten(simd, rim);
        for ((out, shown), scale) in
            inside.iter_mut().zip(&self.shown[stretched..]).zip(&self.scale[stretched..])
        {
            set_scaled(out, &shown[0], *scale);
        }
        let rows = self.color_rows.as_flattened().iter().zip(self.color_scale.as_flattened());
        for (out, (row, scale)) in colors.iter_mut().zip(rows) {
            set_scaled(out, row, *scale);
        }
        self.whiten_residuals();
        for (row, residual) in self.whitened.iter_mut().zip(&self.whitened_residuals) {
            row[RESIDUAL] = *residual;
        }
        normal.set(simd, &self.whitened, &self.shrunk);
        Some(())
    }

    /// Sets the residuals of all samples with unit variance.
    #[inline(always)]
    fn whiten_residuals(&mut self) {
        let (pixels, stretched) = (self.used.len(), self.surroundings.covariance.len());
        let out = &mut self.whitened_residuals;
        out.clear();
        out.extend_from_slice(&self.residuals);
        let colors = self.color_residuals.as_flattened().iter().zip(self.color_scale.as_flattened());
        out.extend(colors.map(|(residual, scale)| residual * scale));
        let samples = out.len();
        // Behind the rim there is room for a band, in which nothing changes.
        out.resize(samples.max(stretched + BAND), 0.0);
        self.factor.whiten_one(out);
        out.truncate(samples);
        for (out, scale) in out[stretched..pixels].iter_mut().zip(&self.scale[stretched..]) {
            *out *= scale;
        }
        for (out, shrunk) in out.iter_mut().zip(&self.shrunk) {
            *out *= shrunk;
        }
    }

    /// Residuals and derivatives of all samples in use.
    #[inline(always)]
    fn evaluate<S: Simd>(&mut self, simd: S, patch: &Patch, model: &Model) {
        let pixels = self.used.len() + self.shared.len();
        self.shown.resize(pixels, NOTHING);
        self.values.make_room(pixels);
        let mut columns = NO_COLUMNS;
        for (group, shown) in self.shown.chunks_mut(GROUP).enumerate() {
            let (places, out) = ((&self.places, GROUP * group), (shown, &mut self.values));
            model.show(simd, places, &patch.from_coded, &mut columns, out);
        }
        let mut color_rows = std::mem::take(&mut self.color_rows);
        color_rows.resize(self.blocks.len(), [[0.0; WIDTH]; 2]);
        for (rows, block) in color_rows.iter_mut().zip(&self.blocks) {
            self.color_row(patch, model, *block as usize, rows);
        }
        self.color_rows = color_rows;
        self.find_residuals(patch, model);
    }

    /// Residuals of all samples in use from what their pixels show.
    #[inline(always)]
    fn find_residuals(&mut self, patch: &Patch, model: &Model) {
        let constant = patch.from_coded.map(|row| row[3] as f32);
        self.residuals.clear();
        let both = self.used.iter().zip(&self.values.channels[0]);
        self.residuals.extend(both.map(|(used, value)| patch.bright[*used as usize] - value - constant[0]));
        let mut residuals = std::mem::take(&mut self.color_residuals);
        residuals.clear();
        for block in &self.blocks {
            let (block, mut values) = (*block as usize, [0.0; 2]);
            if patch.step == 1 {
                values = self.colors_shown(patch, block);
            } else {
                visit(patch, block, model.p[SITING], |pixel, weight, _| {
                    for (value, shown) in values.iter_mut().zip(self.colors_shown(patch, pixel)) {
                        *value += weight * shown;
                    }
                });
            }
            residuals.push([0, 1].map(|k| patch.colors[block][k] - values[k] - constant[k + 1]));
        }
        self.color_residuals = residuals;
    }

    /// Colour differences that a pixel shows, less their constants.
    #[inline(always)]
    fn colors_shown(&self, patch: &Patch, pixel: usize) -> [f32; 2] {
        match self.slot[pixel] {
            0 => {
                let free = self.surroundings.colors_at(patch.place(pixel));
                [0, 1].map(|k| (free[k] - patch.from_coded[k + 1][3]) as f32)
            }
            place => [1, 2].map(|channel| self.values.channels[channel][place as usize - 1]),
        }
    }

    /// Variances of all samples in use as far as they are independent of each other.
    #[inline(always)]
    fn set_variances(&mut self, patch: &Patch, edge_px: f64) {
        let in_still = self.surroundings.in_still();
        let alike_px = if in_still { (ALIKE * edge_px * edge_px) as f32 } else { 1.0 };
        let alike = (alike_px / (patch.step * patch.step) as f32).max(1.0);
        let (noise, unpredicted) = (self.noise_variance as f32, self.surroundings.unpredicted as f32);
        self.variance.clear();
        self.believed.clear();
        for (place, (used, near)) in self.used.iter().zip(&self.near).enumerate() {
            let index = *used as usize;
            let front = self.front[index] * (near * self.values.covered[place]).powi(2);
            let behind = unpredicted * self.values.open[place];
            let believed = self.weight[index].max(LEAST_TRUST);
            self.variance.push((noise + alike_px * front + behind * behind) / believed);
            self.believed.push(believed);
        }
        let level = (self.surroundings.level - patch.from_coded[0][3]) as f32;
        let level = level.abs().max(noise.sqrt());
        // Noise there is no clutter.
        let clutter = self.surroundings.color_variance.map(|all| (all as f32 - noise).max(0.0));
        self.color_variance.clear();
        for ((block, residuals), near) in self.blocks.iter().zip(&self.color_residuals).zip(&self.color_near)
        {
            let block = *block as usize;
            let likelier = self.front_of_block(patch, block) / IN_FRONT;
            let hidden = (likelier * (HIDES * near / level).powi(2)).min(1.0);
            let covered = self.color_covered[block];
            let believed = self.color_weight[block].max(LEAST_TRUST);
            let mut variance = [0.0; 2];
            for (k, variance) in variance.iter_mut().enumerate() {
                let value = patch.colors[block][k] - residuals[k] - patch.from_coded[k + 1][3] as f32;
                let behind = (1.0 - covered).powi(2) * clutter[k];
                *variance = (noise + alike * (hidden * (covered * value).powi(2) + behind)) / believed;
            }
            self.believed.push(believed);
            self.color_variance.push(variance);
        }
        self.scale.clear();
        self.scale.extend(self.variance.iter().map(|v| v.sqrt().recip()));
        self.color_scale.clear();
        self.color_scale.extend(self.color_variance.iter().map(|pair| pair.map(|v| v.sqrt().recip())));
    }

    /// Derivatives of both colour differences of a block: the mean over its pixels.
    #[inline(always)]
    fn color_row(&self, patch: &Patch, model: &Model, block: usize, rows: &mut [Row; 2]) {
        let own = if patch.step == 1 { self.slot[block].checked_sub(1) } else { None };
        if let Some(place) = own {
            rows.copy_from_slice(&self.shown[place as usize][1..]);
            return;
        }
        *rows = [[0.0; WIDTH]; 2];
        visit(patch, block, model.p[SITING], |pixel, weight, by_siting| {
            if let Some(place) = self.slot[pixel].checked_sub(1) {
                for (row, channel) in rows.iter_mut().zip(&self.shown[place as usize][1..]) {
                    add_scaled(row, channel, weight);
                }
            }
            for (row, value) in rows.iter_mut().zip(self.colors_shown(patch, pixel)) {
                row[SITING] += by_siting * value;
            }
        });
    }
}

/// Sets a row to a multiple of another.
#[inline(always)]
fn set_scaled(out: &mut Row, row: &Row, scale: f32) {
    for (out, value) in out.iter_mut().zip(row) {
        *out = value * scale;
    }
}
