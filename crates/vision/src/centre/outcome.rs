//! What a fit found, or why it found nothing.

use super::constants::{LEAST_CONTRAST, LIGHT_STD, MODEL_STD, PIXEL_STD_PX};
use super::curve::encode_one;
use super::guess::Followed;
use super::model::{BALL, COUNT, EDGE, Parameters, RADIUS, SITING};
use super::normal::Solved;
use super::samples::{Noise, combined};
use super::stages::Stages;
use super::trust::Trust;
use super::weighted::Left;
use crate::optics::{Known, Optics};
use crate::{Matrix2, Vector2};

/// Movement of the centre, in edge widths, for what the face shows beyond the model as a part of its
/// contrast. A patch of relative strength s that reaches the rim moves an edge of width w by s w √π (matched
/// filter of a Gaussian edge); the rim has room for about five such patches, half a radius wide, of which two
/// directions take √(2/5).
const TEXTURE_GAIN: f64 = 1.121;
/// Part of the disc whose samples must be believed.
pub(super) const LEAST_TRUSTED: f64 = 0.5;

/// A fitted ball.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CentreFit {
    pub(crate) pixel: Vector2<f64>,
    pub(crate) covariance_px2: Matrix2<f64>,
    pub(crate) radius_px: Known,
    /// Linear light of the ball, mean over its disc.
    pub(crate) ball: [f32; 3],
    /// Part of the disc whose samples were believed, 0 to 1.
    pub(crate) trusted: f64,
    /// What was known of the optics before, and with that what the ball shows.
    pub(crate) taken: Optics,
    pub(crate) optics: Optics,
    pub(crate) followed: Followed,
}

/// Why a patch holds no ball that can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoFit {
    /// The patch lies outside the image, in part.
    Cut,
    /// Too few pixels around the ball are free of it.
    NoBackground,
    /// The samples do not determine the parameters.
    Undetermined,
    /// It hardly differs from the background.
    Faint,
    /// The fit went too far from its start, or outgrew the largest radius.
    Lost,
    /// Too few of its samples are believed.
    Hidden,
    /// The most steps were taken.
    NotConverged,
    /// The disc is out of range, or too uncertain.
    Implausible,
}

/// The last step of a fit.
pub(super) struct End<'a> {
    pub(super) stages: Stages<'a>,
    pub(super) trust: &'a Trust,
    pub(super) noise: Noise,
    pub(super) solved: &'a Solved,
    /// What its step left.
    pub(super) left: &'a Left,
    /// Where it led.
    pub(super) p: Parameters,
}

impl End<'_> {
    /// Covariance, colour and plausibility at the solution.
    pub(super) fn summarize(&self, prior: &[Known; COUNT], range_px: (f64, f64)) -> Result<CentreFit, NoFit> {
        let Self { stages, p, .. } = self;
        let is_in_range = p[RADIUS] > range_px.0 && p[RADIUS] < range_px.1;
        let linear = [0, 1, 2].map(|channel| p[BALL + channel]);
        let [across, down] = [0, 1].map(|axis| self.solved.covariance(axis));
        let centre_px2 = Matrix2::from_columns(&[across.xy(), down.xy()]);
        let texture_px = TEXTURE_GAIN * p[EDGE] * self.texture(&linear);
        let model_px2 = (MODEL_STD * 2.0 * p[RADIUS]).powi(2) + texture_px * texture_px;
        let covariance_px2 = centre_px2 + Matrix2::identity() * model_px2;
        let trusted = self.trust.believed(stages);
        let is_uncertain = covariance_px2.trace() > 0.5 * p[RADIUS] * p[RADIUS];
        if trusted <= LEAST_TRUSTED {
            return Err(NoFit::Hidden);
        }
        if contrast(stages, self.noise.variance, &linear) <= LEAST_CONTRAST {
            return Err(NoFit::Faint);
        }
        if !covariance_px2.iter().all(|v| v.is_finite()) || !is_in_range || is_uncertain {
            return Err(NoFit::Implausible);
        }
        let known = |i: usize| Known { mean: p[i], variance: self.solved.covariance(i)[i] };
        Ok(CentreFit {
            pixel: p.xy() + stages.patch.corner(),
            covariance_px2,
            radius_px: known(RADIUS),
            ball: linear.map(|l| l.clamp(0.0, 1.0) as f32),
            trusted,
            taken: Optics { siting_px: prior[SITING], edge_px: prior[EDGE] },
            optics: Optics {
                siting_px: known(SITING),
                edge_px: if p[EDGE] <= PIXEL_STD_PX { prior[EDGE] } else { known(EDGE) },
            },
            followed: Followed { parameters: *p, noise_variance: self.noise.variance },
        })
    }

    /// Standard deviation of what the face shows beyond the model and the noise of a pixel (a shadow, a
    /// highlight, light of higher order), as a part of its difference from the surroundings, by what the last
    /// step has left.
    fn texture(&self, linear: &[f64; 3]) -> f64 {
        let Self { stages, trust, noise, left, .. } = self;
        let from_coded = &stages.patch.from_coded;
        let encoded = linear.map(encoded);
        let coded = encoded.map(|(code, _)| code);
        let differs = |(row, around): (&[f64; 4], f64)| (combined(row, &coded) - around).powi(2);
        let contrast: f64 = std::iter::zip(from_coded, stages.background.around()).map(differs).sum();
        let by_light = |row: &[f64; 4]| -> f64 { (0..3).map(|c| row[c] * encoded[c].1 * linear[c]).sum() };
        let light: f64 = from_coded.iter().map(|row| (LIGHT_STD * by_light(row)).powi(2)).sum();
        let bright = weighted_mean(stages.pixels().map(|(place, pixel)| {
            let weight = stages.linearized.values.covered[place] * trust.weight[pixel];
            (weight, f64::from(left.bright[place].powi(2)) - noise.least)
        }));
        let colors = weighted_mean(stages.blocks().map(|(place, block)| {
            let weight = stages.layout.color_covered[block] * trust.block_weight[block];
            let [first, second] = left.colors[place];
            (weight, f64::from(first * first + second * second) - 2.0 * noise.least)
        }));
        let beyond = (bright + colors).max(0.0);
        ((beyond + light) / contrast.max(noise.variance)).sqrt()
    }
}

/// Mean by weights, of at least one sample.
fn weighted_mean(samples: impl Iterator<Item = (f32, f64)>) -> f64 {
    let sums = samples.map(|(weight, value)| (f64::from(weight), f64::from(weight) * value));
    let (count, sum) = sums.fold((0.0, 0.0), |all, one| (all.0 + one.0, all.1 + one.1));
    sum / f64::max(count, 1.0)
}

/// Greatest difference between a light and the surroundings in any channel, in standard deviations of the
/// noise.
pub(super) fn contrast(stages: &Stages<'_>, noise_variance: f64, linear: &[f64; 3]) -> f64 {
    let coded = linear.map(|light| encoded(light).0);
    let channels = std::iter::zip(&stages.patch.from_coded, stages.background.around());
    let differs = channels.map(|(row, around)| (combined(row, &coded) - around).abs());
    differs.fold(0.0, f64::max) / noise_variance.sqrt()
}

/// Code of a light and its derivative.
fn encoded(light: f64) -> (f64, f64) {
    let (code, gain) = encode_one(light as f32);
    (code.into(), gain.into())
}
