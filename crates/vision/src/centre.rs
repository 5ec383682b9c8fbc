//! The centre of a ball to a small fraction of a pixel, with its covariance.
//!
//! A forward model of the image: a disc whose edge is blurred by a Gaussian (lens and aperture) covers a fraction of
//! each sample; light mixes linearly there, ball and background; the sum is coded by the sRGB curve and, for video, by
//! the luma matrix. Background: constant and gradient in each channel. Ball: one colour, times a shading of first and
//! second order that is the same in all channels, as it is on a matt surface. All parameters are found together by
//! Gauss-Newton on coded values, where the noise of a sensor and the rounding to 8 bits are about uniform.
//!
//! Mixing in linear light matters: on coded values a ball seems up to a tenth too small or too large, more so on the
//! side where it is darker, which moves its centre.
//!
//! Samples that fit badly (an arm that touches the ball, something in front of it) lose their weight (Tukey's biweight).

use crate::color::encode;
use crate::patch::{Group, Patch};
use crate::{Matrix2, Vector2};
use nalgebra::{Cholesky, SMatrix, SVector, Vector4};
use std::ops::Range;

/// Smallest radius whose centre is fitted.
pub(crate) const LEAST_RADIUS_PX: f64 = 1.5;
/// A fitted radius may fall short of the true one by this factor, since it is traded against the blur.
const RADIUS_MARGIN: f64 = 1.25;
/// Standard deviation of a one-pixel box: no edge is sharper.
const PIXEL_STD_PX: f64 = 0.288_675;
/// Variance of rounding to whole levels.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;
/// Biweight cut-off with 95 % efficiency on Gaussian noise.
const CUT_OFF: f64 = 4.685;
/// A Gaussian's standard deviation over its median absolute value.
const MEDIAN_TO_DEVIATION: f64 = 1.4826;
const MOST_STEPS: usize = 20;
/// Steps before which the trust in samples is set anew; kept afterwards, so that the steps shrink.
const WEIGHED_STEPS: Range<usize> = 2..9;
/// Squared length, in standard deviations, of a step that no longer matters.
const SMALL_STEP: f64 = 0.01;
/// Edge width of a camera in focus: lens blur about as wide as a pixel, with an uncertainty that holds a soft lens and
/// motion of a pixel or two.
const EDGE_STD_PX: (f64, f64) = (0.6, 0.25);
/// Part of the diameter by which light that the model does not describe (gloss, third-order shading) may move a centre.
const MODEL_STD: f64 = 0.01;
/// Standard deviations by which a ball must differ from its background in some channel.
const LEAST_CONTRAST: f64 = 6.0;
/// Standard deviations of the shading's slope and curvature over one radius, as parts of the colour in the middle: a
/// matt sphere lit from one side has a slope near one, lit evenly from all sides none.
const SHADE_STD: [f64; 2] = [0.5, 0.25];

/// Centre, radius and edge width; background constant, slope in x, slope in y of three channels; ball colour of three
/// channels; shading slopes x, y and curvatures xx, xy, yy; columns by which the colour differences are sited to the right
/// of the left luma sample they belong to.
const COUNT: usize = 22;
const BACKGROUND: usize = 4;
const BALL: usize = 13;
const SHADE: usize = 16;
const SITING: usize = 21;
/// Parameters that the residuals of one channel have been fitted with.
const PARAMETERS: usize = COUNT / 3;
/// What is known of the siting of colour differences: left (H.264's default) or centred (JFIF, MPEG-1, and what many
/// converters really do), and files rarely say which.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Siting {
    pub(crate) mean_px: f64,
    pub(crate) variance_px2: f64,
}

impl Default for Siting {
    /// Halfway between the two, and as uncertain.
    fn default() -> Self {
        Self { mean_px: 0.25, variance_px2: 0.25 * 0.25 }
    }
}

type Parameters = SVector<f64, COUNT>;
type Information = SMatrix<f64, COUNT, COUNT>;

/// A fitted ball.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) pixel: Vector2<f64>,
    pub(crate) covariance_px2: Matrix2<f64>,
    pub(crate) radius_px: f64,
    /// Linear light in the middle of the ball.
    pub(crate) ball: [f32; 3],
    /// Part of the disc whose samples were believed, 0 to 1.
    pub(crate) trusted: f64,
    /// The siting of colour differences, what was known of it before included.
    pub(crate) siting: Siting,
}

/// Where a fit starts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    pub(crate) radius_px: f64,
    /// Linear light of the ball and of what is around it.
    pub(crate) ball: [f32; 3],
    pub(crate) background: [f32; 3],
    pub(crate) siting: Siting,
    /// Mean and standard deviation of the radius, where it is known beforehand.
    pub(crate) known_radius_px: Option<(f64, f64)>,
}

/// Fits the ball in the middle of the patch.
///
/// None if it does not converge to a disc with a radius in `radius_px` that stands out and is mostly visible.
pub(crate) fn fit(patch: &mut Patch, radius_px: (f64, f64), start: &Start) -> Option<Fit> {
    let least_px = radius_px.0.max(LEAST_RADIUS_PX) / RADIUS_MARGIN;
    let most_px = radius_px.1 * RADIUS_MARGIN;
    let mut p = Parameters::zeros();
    p[2] = start.radius_px.clamp(least_px, most_px);
    p[3] = 2.0 * PIXEL_STD_PX;
    p[SITING] = start.siting.mean_px;
    for channel in 0..3 {
        p[BACKGROUND + channel] = f64::from(start.background[channel]);
        p[BALL + channel] = f64::from(start.ball[channel]);
    }
    let mut state = State {
        scale_px: p[2],
        siting: start.siting,
        known_radius_px: start.known_radius_px,
        noise: [[4.0; 3]; 2],
    };
    let mut converged = false;
    for step in 0..MOST_STEPS {
        predict(patch, &p, &state);
        if WEIGHED_STEPS.contains(&step) {
            reweigh(patch, &mut state);
        }
        let (information, gradient) = normal_equations(patch, &p, &state);
        let damped =
            information + Information::from_diagonal(&(information.diagonal() * 1e-4).add_scalar(1e-9));
        let mut change = Cholesky::new(damped)?.solve(&gradient);
        let step_length = gradient.dot(&change);
        let longest = change.fixed_rows::<4>(0).amax();
        if !longest.is_finite() {
            return None;
        }
        if longest > 0.5 {
            change *= 0.5 / longest;
        }
        p += change;
        p[2] = p[2].clamp(least_px, most_px);
        p[3] = p[3].clamp(PIXEL_STD_PX, 0.6 * p[2].max(LEAST_RADIUS_PX));
        let strayed = p[0].hypot(p[1]) > 1.0 + state.scale_px;
        let no_ball = step > 5 && (p[2] <= least_px || p[2] >= most_px);
        if strayed || no_ball {
            return None;
        }
        if step > 3 && step_length < SMALL_STEP {
            converged = true;
            break;
        }
    }
    if !converged || p[2] <= least_px || p[2] >= most_px {
        return None;
    }
    summarize(patch, &p, &state)
}

/// Covariance, colour and plausibility at the solution.
fn summarize(patch: &mut Patch, p: &Parameters, state: &State) -> Option<Fit> {
    predict(patch, p, state);
    let (information, _) = normal_equations(patch, p, state);
    let covariance = Cholesky::new(information)?.inverse();
    let model_px = MODEL_STD * 2.0 * p[2];
    let covariance_px2 = covariance.fixed_view::<2, 2>(0, 0) * misfit(patch, state).max(1.0)
        + Matrix2::identity() * (model_px * model_px);
    let (mut covered, mut believed) = (0.0, 0.0);
    for (sample, predicted) in patch.groups[0].samples.iter().zip(&patch.groups[0].predicted) {
        covered += predicted.covered;
        believed += predicted.covered * sample.trust;
    }
    let trusted = believed / covered;
    let shade = shading(p, p[0] / state.scale_px, p[1] / state.scale_px);
    let linear = [0, 1, 2].map(|channel| p[BALL + channel] * shade);
    let mut contrast = 0.0_f64;
    for (group, noise) in patch.groups.iter().zip(&state.noise) {
        for (row, noise) in group.from_coded.iter().zip(noise).take(group.channels) {
            let differs: f64 =
                (0..3).map(|c| row[c] * (encode(linear[c]).0 - encode(p[BACKGROUND + c]).0)).sum();
            contrast = contrast.max(differs.abs() / noise.sqrt());
        }
    }
    let uncertain = covariance_px2.trace() > 0.5 * p[2] * p[2];
    let good = covariance_px2.iter().all(|v| v.is_finite())
        && !uncertain
        && contrast > LEAST_CONTRAST
        && trusted > 0.5;
    good.then(|| Fit {
        pixel: patch.middle + p.xy(),
        covariance_px2,
        radius_px: p[2],
        ball: linear.map(|l| l.clamp(0.0, 1.0) as f32),
        trusted,
        siting: Siting { mean_px: p[SITING], variance_px2: covariance[(SITING, SITING)] },
    })
}

/// Mean square of the residuals near the disc over their expected one (reduced chi-square), doubtful samples counted at
/// the cut-off: above one where clutter touches the ball and the centre is worth less than the noise alone says.
fn misfit(patch: &Patch, state: &State) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (group, noise) in patch.groups.iter().zip(&state.noise) {
        for sample in group.predicted.iter().filter(|s| s.near) {
            for (residual, noise) in sample.residual.iter().zip(noise).take(group.channels) {
                sum += (residual * residual / noise).min(CUT_OFF * CUT_OFF);
                count += 1.0;
            }
        }
    }
    sum / f64::max(count, 1.0)
}

/// Covered fraction of a sample and its derivatives by centre, radius and edge width.
fn coverage(p: &Parameters, aperture_px2: f64, x_px: f64, y_px: f64) -> (f64, Vector4<f64>) {
    let (dx, dy) = (x_px - p[0], y_px - p[1]);
    let distance = dx.hypot(dy).max(1e-9);
    let width = (p[3] * p[3] + aperture_px2).sqrt();
    let z = (p[2] - distance) / width;
    if z.abs() > 4.0 {
        return (if z > 0.0 { 1.0 } else { 0.0 }, Vector4::zeros());
    }
    let density = 0.398_942_280_4 * (-0.5 * z * z).exp();
    let slope = density / width;
    let by_edge = -slope * z * p[3] / width;
    (normal_cdf(z, density), Vector4::new(slope * dx / distance, slope * dy / distance, slope, by_edge))
}

/// Normal distribution function (Abramowitz and Stegun 26.2.17, error below 7.5e-8), given the density at `z`.
fn normal_cdf(z: f64, density: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let series =
        0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429)));
    let tail = density * t * series;
    if z >= 0.0 { 1.0 - tail } else { tail }
}

fn shading(p: &Parameters, x: f64, y: f64) -> f64 {
    1.0 + p[SHADE] * x + p[SHADE + 1] * y + p[SHADE + 2] * x * x + p[SHADE + 3] * x * y + p[SHADE + 4] * y * y
}

/// What stays the same or changes slowly during a fit.
struct State {
    /// Unit of the slopes and curvatures.
    scale_px: f64,
    siting: Siting,
    known_radius_px: Option<(f64, f64)>,
    /// Variance of each channel of each group.
    noise: [[f64; 3]; 2],
}

/// What the model says of one sample.
#[derive(Debug, Clone)]
pub(crate) struct Predicted {
    covered: f64,
    slope: Vector4<f64>,
    /// Place in units of the scale.
    x: f64,
    y: f64,
    shade: f64,
    background: [f64; 3],
    /// Derivative of each coded colour by linear light.
    gain: [f64; 3],
    residual: [f64; 3],
    near: bool,
}

fn predict(patch: &mut Patch, p: &Parameters, state: &State) {
    for group in &mut patch.groups {
        let Group { samples, predicted, channels, aperture_px2, from_coded, .. } = group;
        let shift_px = if *aperture_px2 > 0.0 { p[SITING] } else { 0.0 };
        let reach_px = p[2] + 3.0 * (p[3] * p[3] + *aperture_px2).sqrt();
        predicted.clear();
        predicted.extend(samples.iter().map(|sample| {
            let x_px = sample.x_px + shift_px;
            let (covered, slope) = coverage(p, *aperture_px2, x_px, sample.y_px);
            let (x, y) = (x_px / state.scale_px, sample.y_px / state.scale_px);
            let shade = shading(p, x, y);
            let background =
                [0, 1, 2].map(|c| p[BACKGROUND + c] + p[BACKGROUND + 3 + c] * x + p[BACKGROUND + 6 + c] * y);
            let coded =
                [0, 1, 2].map(|c| encode(background[c] + covered * (p[BALL + c] * shade - background[c])));
            let mut residual = [0.0; 3];
            for (channel, row) in from_coded.iter().enumerate().take(*channels) {
                let value = row[3] + row[0] * coded[0].0 + row[1] * coded[1].0 + row[2] * coded[2].0;
                residual[channel] = sample.value[channel] - value;
            }
            let near = (x_px - p[0]).hypot(sample.y_px - p[1]) < reach_px;
            Predicted { covered, slope, x, y, shade, background, gain: coded.map(|c| c.1), residual, near }
        }));
    }
}

impl Predicted {
    /// Derivatives of one channel by all parameters, and the range of those that are not zero.
    fn jacobian(&self, p: &Parameters, row: &[f64; 4], sited: bool) -> (Parameters, Range<usize>) {
        let (x, y) = (self.x, self.y);
        let mut out = Parameters::zeros();
        let (mut contrast, mut lit) = (0.0, 0.0);
        for c in 0..3 {
            let gain = row[c] * self.gain[c];
            contrast += gain * (p[BALL + c] * self.shade - self.background[c]);
            lit += gain * p[BALL + c];
            let open = gain * (1.0 - self.covered);
            out[BACKGROUND + c] = open;
            out[BACKGROUND + 3 + c] = open * x;
            out[BACKGROUND + 6 + c] = open * y;
            out[BALL + c] = gain * self.covered * self.shade;
        }
        for (i, slope) in self.slope.iter().enumerate() {
            out[i] = contrast * slope;
        }
        let lit = lit * self.covered;
        for (i, factor) in [x, y, x * x, x * y, y * y].into_iter().enumerate() {
            out[SHADE + i] = lit * factor;
        }
        if sited {
            out[SITING] = -out[0];
        }
        let range = if self.slope[2] != 0.0 {
            0..COUNT
        } else if self.covered > 0.5 {
            BALL..SITING
        } else {
            BACKGROUND..BALL
        };
        (out, range)
    }
}

/// Numbers that are worked on together, and how many such blocks hold all parameters.
const LANES: usize = 4;
const BLOCKS: usize = COUNT.div_ceil(LANES);

fn padded(parameters: &Parameters) -> [[f64; LANES]; BLOCKS] {
    let mut out = [[0.0; LANES]; BLOCKS];
    for (i, value) in parameters.iter().enumerate() {
        out[i / LANES][i % LANES] = *value;
    }
    out
}

/// Information matrix and gradient of all parameters, with what is known of edge, shading and siting beforehand.
fn normal_equations(patch: &Patch, p: &Parameters, state: &State) -> (Information, Parameters) {
    let mut sums = [[[0.0; LANES]; BLOCKS]; COUNT];
    let mut gradient = Parameters::zeros();
    for (group, noise) in patch.groups.iter().zip(&state.noise) {
        let sited = group.aperture_px2 > 0.0;
        for (sample, predicted) in group.samples.iter().zip(&group.predicted) {
            if sample.trust == 0.0 {
                continue;
            }
            let rows = group.from_coded.iter().zip(noise).zip(&predicted.residual);
            for ((row, noise), residual) in rows.take(group.channels) {
                let (jacobian, range) = predicted.jacobian(p, row, sited);
                let weight = sample.trust / noise;
                gradient.axpy(residual * weight, &jacobian, 1.0);
                let padded = padded(&jacobian);
                for i in range {
                    let weighted = jacobian[i] * weight;
                    for (sum, value) in sums[i].iter_mut().zip(&padded) {
                        for lane in 0..LANES {
                            sum[lane] += weighted * value[lane];
                        }
                    }
                }
            }
        }
    }
    let mut information = Information::from_fn(|row, column| sums[column][row / LANES][row % LANES]);
    information.fill_upper_triangle_with_lower_triangle();
    let mut know = |i: usize, mean: f64, variance: f64| {
        information[(i, i)] += 1.0 / variance;
        gradient[i] += (mean - p[i]) / variance;
    };
    for i in SHADE..SITING {
        let std = SHADE_STD[usize::from(i >= SHADE + 2)];
        know(i, 0.0, std * std);
    }
    know(3, EDGE_STD_PX.0, EDGE_STD_PX.1 * EDGE_STD_PX.1);
    if let Some((mean_px, std_px)) = state.known_radius_px {
        know(2, mean_px, std_px * std_px);
    }
    know(SITING, state.siting.mean_px, state.siting.variance_px2);
    (information, gradient)
}

/// Sets each channel's noise variance from the median residual near the disc and each sample's trust from it.
fn reweigh(patch: &mut Patch, state: &mut State) {
    for (group, noise) in patch.groups.iter_mut().zip(&mut state.noise) {
        let Group { samples, predicted, residuals, channels, .. } = group;
        for (channel, noise) in noise.iter_mut().enumerate().take(*channels) {
            residuals.clear();
            residuals.extend(predicted.iter().filter(|s| s.near).map(|s| s.residual[channel].abs()));
            let count = residuals.len();
            if count <= PARAMETERS {
                continue;
            }
            let (_, median, _) = residuals.select_nth_unstable_by(count / 2, f64::total_cmp);
            let deviation = MEDIAN_TO_DEVIATION * *median;
            let freedom = count as f64 / (count - PARAMETERS) as f64;
            *noise = deviation * deviation * freedom + ROUNDING_VARIANCE;
        }
        for (sample, predicted) in samples.iter_mut().zip(predicted.iter()) {
            let worst = (0..*channels).fold(0.0_f64, |worst, channel| {
                worst.max(predicted.residual[channel] * predicted.residual[channel] / noise[channel])
            });
            let u = worst / (CUT_OFF * CUT_OFF);
            sample.trust = if u < 1.0 { (1.0 - u) * (1.0 - u) } else { 0.0 };
        }
    }
}
