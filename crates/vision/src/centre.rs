//! The centre of a ball to a small fraction of a pixel, with its covariance.
//!
//! A forward model of the image: a disc whose edge is blurred by a Gaussian (lens, aperture, pixel) covers a fraction
//! of each pixel; light mixes linearly there, ball and background; the sum is coded by the sRGB curve, and colour
//! differences are means over the pixels that they stand for. The ball has one colour times a shading of first and
//! second order, as a matt surface does. What is behind comes from what is around ([`surroundings`]), with its
//! covariance: where an arm or an edge meets the ball, those pixels count for less, and the centre is worth less. The
//! parameters are found by generalised least squares (Gauss-Newton) on coded values, where the noise of a sensor and the
//! rounding to 8 bits are about uniform.
//!
//! Mixing in linear light matters: on coded values a ball seems up to a tenth too small or too large, more so on the
//! side where it is darker, which moves its centre.
//!
//! Samples that fit badly (something in front of the ball) lose their weight (Tukey's biweight).

mod cholesky;
mod equations;
mod model;
mod samples;
mod surroundings;

use crate::optics::{Known, Optics};
use crate::outline::Outline;
use crate::patch::Patch;
use crate::{Matrix2, Vector2};
use equations::{Covariance, Equations};
use model::{BALL, COUNT, EDGE, FIRST_ORDER, GLOSS, Model, Parameters, RADIUS, SHADE, SITING};
use nalgebra::{Cholesky, SMatrix};
use surroundings::Disc;

/// Smallest radius whose centre is fitted.
pub(crate) const LEAST_RADIUS_PX: f64 = 1.5;
/// A fitted radius may fall short of the true one by this factor, since it is traded against the blur.
const RADIUS_MARGIN: f64 = 1.25;
/// Standard deviation of a one-pixel box: no edge is sharper.
const PIXEL_STD_PX: f64 = 0.288_675;
/// Coverage below which a pixel counts as clear of the ball, and above one less which as inside it.
const CLEAR: f64 = 0.01;
/// Rounds in which background and noise are set anew, and steps in each.
const ROUNDS: usize = 8;
const STEPS: usize = 4;
/// Rounds after which trust and noise are kept, so that the steps shrink.
const WEIGHED_ROUNDS: usize = 4;
/// Rounds before which nothing is final.
const LEAST_ROUNDS: usize = 2;
/// Squared length, in standard deviations, of a step that no longer matters.
const SMALL_STEP: f64 = 0.01;
/// Movement after which the background is estimated again.
const SAME_PLACE_PX: f64 = 0.1;
/// Part of the diameter by which a centre may be off whatever the image shows: moulded balls are round to a few
/// thousandths (the rules of table tennis allow six), and the light on them is modelled to about as much.
const MODEL_STD: f64 = 0.001;
/// Movement of the centre, in edge widths, for what the face shows beyond the model as a part of its contrast. A patch of
/// relative strength s that reaches the rim moves an edge of width w by s w √π (matched filter of a Gaussian edge); the
/// rim has room for about five such patches, half a radius wide, of which two directions take √(2/5).
const TEXTURE_GAIN: f64 = 1.121;
/// Standard deviations by which a ball must differ from its background in some channel.
const LEAST_CONTRAST: f64 = 6.0;
/// Part of the disc whose samples must be believed.
const LEAST_TRUSTED: f64 = 0.5;
/// Standard deviations of the shading's coefficients of first and second order as parts of the ball's colour: a matt sphere
/// lit from one side and half as much from all around has 0.5, and passes what light has of the second order 3/8 as
/// strongly as what it has of the first (Ramamoorthi & Hanrahan 2001, eq. 9).
const SHADE_STD: [f64; 2] = [0.5, 0.2];
/// Standard deviation of the slope of the light that a gloss adds: a dielectric mirrors 4 % of what falls on it, of which a
/// quarter may come from one side.
const GLOSS_STD: f64 = 0.01;
/// Noise of a pixel before a film has shown its own: two levels, a consumer camera's in a lit room (shot noise of 8000
/// electrons is 1.4 levels at half the range), and the number of samples that this guess counts for.
pub(crate) const NOISE_STD: f64 = 2.0;
const NOISE_WEIGHT: f64 = 20.0;
/// Least variance of a code: rounding to whole levels.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;

/// A fitted ball.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) pixel: Vector2<f64>,
    pub(crate) covariance_px2: Matrix2<f64>,
    pub(crate) radius_px: Known,
    /// Linear light of the ball, mean over its disc.
    pub(crate) ball: [f32; 3],
    /// Part of the disc whose samples were believed, 0 to 1.
    pub(crate) trusted: f64,
    /// With what was known of it before.
    pub(crate) optics: Optics,
}

/// Where a fit starts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    pub(crate) pixel: Vector2<f64>,
    pub(crate) radius_px: f64,
    /// Linear light of the ball.
    pub(crate) ball: [f32; 3],
    pub(crate) optics: Optics,
    pub(crate) outline: Outline,
    /// The radius, where something is known of it beforehand.
    pub(crate) known_radius_px: Option<Known>,
}

/// Fits balls; its working space is reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fitter {
    equations: Equations,
}

impl Fitter {
    /// Fits the ball in the patch.
    ///
    /// None if it does not converge to a disc with a radius in `radius_px` that stands out and is mostly visible.
    pub(crate) fn fit(&mut self, patch: &Patch, radius_px: (f64, f64), start: &Start) -> Option<Fit> {
        if !patch.is_whole() {
            return None;
        }
        let range_px = (radius_px.0.max(LEAST_RADIUS_PX) / RADIUS_MARGIN, radius_px.1 * RADIUS_MARGIN);
        let mut model = first_guess(start, range_px);
        let prior = prior(start, &model);
        let reach_px = 1.0 + model.unit_px;
        self.equations.begin(patch);
        let mut last_place = None;
        for round in 0..ROUNDS {
            let place = model.p.xy();
            (model.origin, model.unit_px) = ((place.x, place.y), model.p[RADIUS]);
            let same = last_place.is_some_and(|last: Vector2<f64>| (last - place).norm() < SAME_PLACE_PX);
            if round < LEAST_ROUNDS || !same {
                self.equations.look_around(patch, &model)?;
                last_place = Some(place);
            }
            let mut settled = false;
            for step in 0..STEPS {
                let covariance = if step == 0 { Covariance::Anew } else { Covariance::Kept };
                let change = self.step(patch, &model, &prior, covariance)?;
                settled = change.1 < SMALL_STEP;
                model.p += change.0;
                model.p[RADIUS] = model.p[RADIUS].clamp(range_px.0, range_px.1);
                model.p[EDGE] = model.p[EDGE].clamp(PIXEL_STD_PX, 0.6 * model.p[RADIUS].max(LEAST_RADIUS_PX));
                if (model.p.xy() - start.pixel).norm() > reach_px {
                    return None;
                }
                if settled {
                    break;
                }
            }
            if settled && same && round >= LEAST_ROUNDS {
                return self.summarize(patch, &model, &prior, range_px);
            }
            if round < WEIGHED_ROUNDS {
                self.equations.reweigh(patch, &model, round);
            }
            if round >= LEAST_ROUNDS && self.equations.trusted() < LEAST_TRUSTED {
                return None;
            }
        }
        None
    }

    /// One step of Gauss-Newton, and its squared length in standard deviations.
    fn step(
        &mut self,
        patch: &Patch,
        model: &Model,
        prior: &[Known; COUNT],
        covariance: Covariance,
    ) -> Option<(Parameters, f64)> {
        let (mut information, mut gradient) = self.equations.normal(patch, model, covariance)?;
        for (i, known) in prior.iter().enumerate() {
            information[(i, i)] += known.variance.recip();
            gradient[i] += (known.mean - model.p[i]) / known.variance;
        }
        let mut change = Cholesky::new(information)?.solve(&gradient);
        let length = gradient.dot(&change);
        let longest = change.fixed_rows::<4>(0).amax();
        if !longest.is_finite() {
            return None;
        }
        if longest > 0.5 {
            change *= 0.5 / longest;
        }
        Some((change, length))
    }

    /// Covariance, colour and plausibility at the solution.
    fn summarize(
        &mut self,
        patch: &Patch,
        model: &Model,
        prior: &[Known; COUNT],
        range_px: (f64, f64),
    ) -> Option<Fit> {
        let p = &model.p;
        let inside_range = p[RADIUS] > range_px.0 && p[RADIUS] < range_px.1;
        let (mut information, _): (SMatrix<f64, COUNT, COUNT>, _) =
            self.equations.normal(patch, model, Covariance::Anew)?;
        for (i, known) in prior.iter().enumerate() {
            information[(i, i)] += known.variance.recip();
        }
        let covariance = Cholesky::new(information)?.inverse();
        let linear = [0, 1, 2].map(|channel| p[BALL + channel]);
        let texture_px = TEXTURE_GAIN * p[EDGE] * self.equations.texture(patch, &linear);
        let model_px2 = (MODEL_STD * 2.0 * p[RADIUS]).powi(2) + texture_px * texture_px;
        let covariance_px2 = covariance.fixed_view::<2, 2>(0, 0) + Matrix2::identity() * model_px2;
        let trusted = self.equations.trusted();
        let uncertain = covariance_px2.trace() > 0.5 * p[RADIUS] * p[RADIUS];
        let good = covariance_px2.iter().all(|v| v.is_finite())
            && inside_range
            && !uncertain
            && self.equations.contrast(patch, &linear) > LEAST_CONTRAST
            && trusted > LEAST_TRUSTED;
        let known = |i: usize| Known { mean: p[i], variance: covariance[(i, i)] };
        good.then(|| Fit {
            pixel: p.xy(),
            covariance_px2,
            radius_px: known(RADIUS),
            ball: linear.map(|l| l.clamp(0.0, 1.0) as f32),
            trusted,
            optics: Optics { siting_px: known(SITING), edge_px: known(EDGE) },
        })
    }
}

fn first_guess(start: &Start, range_px: (f64, f64)) -> Model {
    let mut p = Parameters::zeros();
    (p[0], p[1]) = (start.pixel.x, start.pixel.y);
    let radius_px = start.known_radius_px.map_or(start.radius_px, |known| known.mean);
    p[RADIUS] = radius_px.clamp(range_px.0, range_px.1);
    p[EDGE] = start.optics.edge_px.mean;
    for (channel, light) in start.ball.iter().enumerate() {
        p[BALL + channel] = f64::from(*light);
    }
    p[SITING] = start.optics.siting_px.mean;
    Model { p, origin: (p[0], p[1]), unit_px: p[RADIUS], outline: start.outline }
}

/// What is known beforehand: little of place, radius and colour.
fn prior(start: &Start, model: &Model) -> [Known; COUNT] {
    // Flat over any image, and over the range of linear light.
    let mut prior = model.p.data.0[0].map(|mean| Known { mean, variance: 1e6 });
    for known in &mut prior[BALL..SHADE] {
        known.variance = 1.0;
    }
    prior[GLOSS..SITING].fill(Known { mean: 0.0, variance: GLOSS_STD * GLOSS_STD });
    for (i, known) in prior[SHADE..GLOSS].iter_mut().enumerate() {
        let std = SHADE_STD[usize::from(i >= FIRST_ORDER)];
        *known = Known { mean: 0.0, variance: std * std };
    }
    prior[EDGE] = start.optics.edge_px;
    prior[SITING] = start.optics.siting_px;
    if let Some(known) = start.known_radius_px {
        prior[RADIUS] = known;
    }
    prior
}

/// The disc of a model.
fn disc(model: &Model) -> Disc {
    let p = &model.p;
    Disc { x_px: p[0], y_px: p[1], radius_px: p[RADIUS], edge_px: p[EDGE] }
}
