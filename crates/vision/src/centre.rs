//! The centre of a ball to a small fraction of a pixel, with its covariance.
//!
//! A forward model of the image: a disc whose edge is blurred by a Gaussian (lens, aperture, pixel) covers a fraction
//! of each pixel; light mixes linearly there, ball and background; the sum is coded by the sRGB curve, and colour
//! differences are means over the pixels that they stand for. The ball has one colour times a shading of first,
//! second and fourth order, as a matt surface does ([`shading`]), and mirrors some light of the lamps' own ([`gloss`]). What is behind
//! comes from what is around ([`surroundings`]), with its covariance: where an arm or an edge meets the ball, those pixels count for
//! less, and the centre is worth less. The
//! parameters are found by generalised least squares (Gauss-Newton) on coded values, where the noise of a sensor and the
//! rounding to 8 bits are about uniform.
//!
//! Mixing in linear light matters: on coded values a ball seems up to a tenth too small or too large, more so on the
//! side where it is darker, which moves its centre.
//!
//! Samples that fit badly (something in front of the ball) lose their weight (Tukey's biweight).
//!
//! Samples, derivatives and their sums are held in single precision ([`lanes`]), places from the patch's first pixel; what is solved
//! for, and the equations for it, in double.

mod cholesky;
mod curve;
mod edge;
mod equations;
mod foreseen;
mod glare;
mod gloss;
mod krige;
mod lanes;
mod metric;
mod model;
mod normal;
mod places;
mod robust;
mod samples;
mod search;
mod settle;
mod shading;
mod surroundings;
mod vectorized;

pub(crate) use curve::encode_one;
pub(crate) use foreseen::Foreseen;

use crate::optics::{Known, Optics};
use crate::outline::Outline;
use crate::patch::Patch;
use crate::{Matrix2, Vector2, Vector3};
use equations::Equations;
use model::{BALL, COUNT, EDGE, FIRST_ORDER, FOURTH, GLOSS, Model, Parameters, RADIUS, SHADE, SITING};
use normal::Normal;
use settle::End;
use surroundings::{Background, Disc};
use vectorized::Tell;

/// Smallest radius whose centre is fitted.
pub(crate) const LEAST_RADIUS_PX: f64 = 1.5;
/// A fitted radius may fall short of the true one by this factor, since it is traded against the blur.
const RADIUS_MARGIN: f64 = 1.25;
/// Standard deviation of a one-pixel box: no edge is sharper.
const PIXEL_STD_PX: f64 = 0.288_675;
/// Coverage below which a pixel counts as clear of the ball, and above one less which as inside it.
const CLEAR: f32 = 0.01;
/// Times that trust and noise are set before they are kept, so that the steps shrink.
const MOST_WEIGHED: usize = 4;
/// That of the last step: all that is still to come then is a fraction of what noise does to one parameter.
const SMALL_STEP: f64 = 1.0;
/// Movement after which the background is estimated again. A step as short may be foreseen whatever it is in standard deviations.
const SAME_PLACE_PX: f64 = 0.1;
/// Part of the diameter by which a centre may be off whatever the image shows: moulded balls are round to a few
/// thousandths (the rules of table tennis allow six), and the light on them is modelled to about as much.
pub const MODEL_STD: f64 = 0.001;
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
/// The same of the fourth order: of one lamp alone 3/16 of the first ([`shading`]).
const FOURTH_STD: f64 = 3.0 / 16.0 * SHADE_STD[0];
/// Standard deviation of the light that the model leaves out, as a part of the ball's: the sixth order of one lamp, 13/128 of its
/// first, whose square has a mean of 1/13 over the ball.
const LIGHT_STD: f64 = 0.0282 * SHADE_STD[0];
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
    /// What was known of the optics before, and with that what the ball shows.
    pub(crate) taken: Optics,
    pub(crate) optics: Optics,
    pub(crate) followed: Followed,
}

/// What a ball looked like when it was last seen, for its next fit to start from; it tells that fit nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Followed {
    parameters: Parameters,
    noise_variance: f64,
    background: Background,
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
    /// Unit vector up in the directions right, down and towards the camera, as the ball is seen, where known.
    pub(crate) up: Option<Vector3<f64>>,
    /// The radius, where something is known of it beforehand.
    pub(crate) known_radius_px: Option<Known>,
    /// The same ball in a frame before.
    pub(crate) followed: Option<Followed>,
}

/// Fits balls; its working space is reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fitter {
    equations: Equations,
    normal: Normal,
}

impl Fitter {
    /// One that takes the time of a still: lines beside a ball, such as a rod that ends at it, are followed behind its rim, for three
    /// times the work.
    pub(crate) fn for_stills() -> Self {
        let mut fitter = Self::default();
        fitter.equations.take_time();
        fitter
    }

    /// Covariance, colour and plausibility at the solution.
    fn summarize(
        &mut self,
        patch: &Patch,
        prior: &[Known; COUNT],
        range_px: (f64, f64),
        end: &End,
    ) -> Option<Fit> {
        let p = &end.p;
        let inside_range = p[RADIUS] > range_px.0 && p[RADIUS] < range_px.1;
        let linear = [0, 1, 2].map(|channel| p[BALL + channel]);
        let equations = (&mut self.equations, &self.normal);
        let (covariance, siting_px2, texture) = pulp::Arch::new().dispatch(Tell {
            equations,
            patch,
            linear: &linear,
            unweighed: end.unweighed.as_ref(),
        });
        let centre_px2 = Matrix2::from_fn(|i, j| end.gain * covariance[i][j]);
        let texture_px = TEXTURE_GAIN * p[EDGE] * texture;
        let model_px2 = (MODEL_STD * 2.0 * p[RADIUS]).powi(2) + texture_px * texture_px;
        let covariance_px2 = 0.5 * (centre_px2 + centre_px2.transpose()) + Matrix2::identity() * model_px2;
        let trusted = self.equations.trusted();
        let uncertain = covariance_px2.trace() > 0.5 * p[RADIUS] * p[RADIUS];
        let good = covariance_px2.iter().all(|v| v.is_finite())
            && inside_range
            && !uncertain
            && self.equations.contrast(patch, &linear) > LEAST_CONTRAST
            && trusted > LEAST_TRUSTED;
        let known = |i: usize, variance: f64| Known { mean: p[i], variance: end.gain * variance };
        let [radius_px, edge_px] = [RADIUS, EDGE].map(|i| known(i, covariance[i][i]));
        let siting_px = known(SITING, siting_px2);
        good.then(|| Fit {
            pixel: p.xy() + patch.corner(),
            covariance_px2,
            radius_px,
            ball: linear.map(|l| l.clamp(0.0, 1.0) as f32),
            trusted,
            taken: Optics { siting_px: prior[SITING], edge_px: prior[EDGE] },
            optics: Optics {
                siting_px,
                edge_px: if p[EDGE] <= PIXEL_STD_PX { prior[EDGE] } else { edge_px },
            },
            followed: Followed {
                parameters: *p,
                noise_variance: self.equations.noise_variance(),
                background: self.equations.background(),
            },
        })
    }
}

/// The radii that a fit may have.
fn with_margin(radius_px: (f64, f64)) -> (f64, f64) {
    (radius_px.0.max(LEAST_RADIUS_PX) / RADIUS_MARGIN, radius_px.1 * RADIUS_MARGIN)
}

fn first_guess(start: &Start, range_px: (f64, f64)) -> Model {
    let mut p = Parameters::zeros();
    p[EDGE] = start.optics.edge_px.mean;
    p[SITING] = start.optics.siting_px.mean;
    p[RADIUS] = start.known_radius_px.map_or(start.radius_px, |known| known.mean);
    for (channel, light) in start.ball.iter().enumerate() {
        p[BALL + channel] = f64::from(*light);
    }
    for (i, known) in first_order(start.up).iter().enumerate() {
        p[SHADE + i] = known.mean;
    }
    if let Some(followed) = &start.followed {
        p = followed.parameters;
    }
    (p[0], p[1]) = (start.pixel.x, start.pixel.y);
    p[RADIUS] = p[RADIUS].clamp(range_px.0, range_px.1);
    Model::new(p, start.outline, start.up)
}

/// Parameters with a radius and an edge that a fit may have.
fn within(mut p: Parameters, range_px: (f64, f64)) -> Parameters {
    p[RADIUS] = p[RADIUS].clamp(range_px.0, range_px.1);
    p[EDGE] = p[EDGE].clamp(PIXEL_STD_PX, 0.6 * p[RADIUS].max(LEAST_RADIUS_PX));
    p
}

/// The longest of a step's changes in place, radius and edge width.
fn longest(step: &Parameters) -> f64 {
    step.fixed_rows::<4>(0).amax()
}

/// Whether the edge is as sharp as any can be.
fn is_sharpest(model: &Model) -> bool {
    model.p[EDGE] <= PIXEL_STD_PX
}

/// How far two models' discs are apart: middle, radius, and the width of the edge as far out as it reaches.
fn distance_px(a: &Parameters, b: &Parameters) -> f64 {
    (a.xy() - b.xy()).norm().max((a[RADIUS] - b[RADIUS]).abs()).max(2.0 * (a[EDGE] - b[EDGE]).abs())
}

/// What is known beforehand: little of place, radius and colour.
fn prior(start: &Start, model: &Model) -> [Known; COUNT] {
    // Flat over any image, and over the range of linear light.
    let mut prior = model.p.data.0[0].map(|mean| Known { mean, variance: 1e6 });
    for known in &mut prior[BALL..SHADE] {
        known.variance = 1.0;
    }
    for (known, std) in prior[GLOSS..SITING].iter_mut().zip(model.gloss.std()) {
        *known = Known { mean: 0.0, variance: std * std };
    }
    prior[SHADE..SHADE + FIRST_ORDER].copy_from_slice(&first_order(start.up));
    for known in &mut prior[SHADE + FIRST_ORDER..GLOSS] {
        *known = Known { mean: 0.0, variance: SHADE_STD[1] * SHADE_STD[1] };
    }
    prior[FOURTH] = Known { mean: 0.0, variance: FOURTH_STD * FOURTH_STD };
    prior[EDGE] = start.optics.edge_px;
    prior[SITING] = start.optics.siting_px;
    if let Some(known) = start.known_radius_px {
        prior[RADIUS] = known;
    }
    prior
}

/// What is known beforehand of the shading of first order. Lamps hang above: where it is known where that is, the mean is that of lamps
/// anywhere in the upper half of all directions, whose cosine to the vertical has a mean of 1/2. The spread stays that of any light,
/// as windows and what the floor throws back are not known.
fn first_order(up: Option<Vector3<f64>>) -> [Known; FIRST_ORDER] {
    let variance = SHADE_STD[0] * SHADE_STD[0];
    // The square of the whole slope is that of its three coefficients together.
    let mean = up.unwrap_or_else(Vector3::zeros) * ((3.0 * variance).sqrt() / 2.0);
    [0, 1, 2].map(|k| Known { mean: mean[k], variance })
}

/// The disc of a model.
fn disc(model: &Model) -> Disc {
    let p = &model.p;
    Disc { x_px: p[0], y_px: p[1], radius_px: p[RADIUS], edge_px: p[EDGE] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean slope of lamps on a grid of directions.
    #[test]
    fn light_is_expected_from_above_as_from_lamps_all_over_the_upper_half() {
        const GRID: i32 = 100;
        let up = Vector3::new(0.36, -0.8, 0.48);
        let (across, mut sum) = (up.cross(&Vector3::x()).normalize(), Vector3::zeros());
        let slope = SHADE_STD[0] * 3.0_f64.sqrt();
        for (i, k) in (0..GRID).flat_map(|i| (0..GRID).map(move |k| (i, k))) {
            let cosine = (f64::from(i) + 0.5) / f64::from(GRID);
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(GRID)).sin_cos();
            let level = across * cos + up.cross(&across) * sin;
            sum += (up * cosine + level * (1.0 - cosine * cosine).sqrt()) * slope;
        }
        for (got, want) in first_order(Some(up)).iter().zip((sum / f64::from(GRID * GRID)).iter()) {
            assert!((got.mean - want).abs() < 1e-9, "{got:?} for {want}");
        }
        assert!(first_order(None).iter().all(|known| known.mean == 0.0));
    }
}
