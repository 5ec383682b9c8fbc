//! The centre of a ball to a small fraction of a pixel, with its covariance.
//!
//! Model: a disc whose edge is blurred by a Gaussian (lens and pixel aperture) covers a fraction c of each sample;
//! a channel's value is background (constant and gradient) plus c times ball (constant and gradient, for shading).
//! Centre, radius and blur are found by Gauss-Newton; the six linear parameters of each channel are eliminated in
//! each step (variable projection: Golub and Pereyra 1973, in Kaufman's form).
//!
//! The fit works on coded values, not linear light: the sRGB curve is close to a square root, so the noise of a sensor
//! and the rounding to 8 bits are nearly the same at all levels there. The curve bends the profile of the edge alike
//! all around the disc, which the radius and the blur take up and the centre does not feel.
//!
//! Samples that fit badly (an arm that touches the ball, something in front of it) lose their weight (Tukey's biweight).

use crate::patch::{Group, Patch, Sample};
use crate::{Matrix2, Vector2};
use nalgebra::{Cholesky, Matrix4, SMatrix, SVector, Vector4};

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
/// Parameters a channel's residuals have been fitted with: six of its own and about two of the shared four.
const PARAMETERS: usize = 8;
const MOST_STEPS: usize = 25;
/// Steps below this are far inside any achievable standard deviation.
const SMALL_STEP_PX: f64 = 1e-3;
/// Standard deviations by which a ball must differ from its background in some channel.
const LEAST_CONTRAST: f64 = 6.0;

/// A fitted ball.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) pixel: Vector2<f64>,
    pub(crate) covariance_px2: Matrix2<f64>,
    pub(crate) radius_px: f64,
    /// Coded value of each channel in the middle of the ball, full-resolution group first.
    pub(crate) ball: [f64; 3],
    /// Part of the disc whose samples were believed, 0 to 1.
    pub(crate) trusted: f64,
}

/// Centre from the middle of the patch, radius, standard deviation of the edge.
type Shape = Vector4<f64>;
type Linear = SVector<f64, 6>;
type Basis = SMatrix<f64, 6, 6>;

/// The linear solution of one group at a shape.
struct Solved {
    inverse: Basis,
    parameters: [Linear; 3],
}

/// Fits the ball in the middle of the patch.
///
/// None if it does not converge to a disc with a radius in `radius_px` that stands out and is mostly visible.
pub(crate) fn fit(patch: &mut Patch, radius_px: (f64, f64), start_radius_px: f64) -> Option<Fit> {
    let least_px = radius_px.0.max(LEAST_RADIUS_PX) / RADIUS_MARGIN;
    let most_px = radius_px.1 * RADIUS_MARGIN;
    let mut shape = Shape::new(0.0, 0.0, start_radius_px.clamp(least_px, most_px), 2.0 * PIXEL_STD_PX);
    let mut noise = [[1.0; 3]; 2];
    let mut converged = false;
    for step in 0..MOST_STEPS {
        let (information, gradient) = normal_equations(patch, &shape, &mut noise, step >= 2)?;
        let damped = information + Matrix4::from_diagonal(&(information.diagonal() * 1e-3));
        let mut change = Cholesky::new(damped)?.solve(&gradient);
        let longest = change.amax();
        if !longest.is_finite() {
            return None;
        }
        if longest > 0.5 {
            change *= 0.5 / longest;
        }
        let before = shape;
        shape += change;
        shape[2] = shape[2].clamp(least_px, most_px);
        shape[3] = shape[3].clamp(PIXEL_STD_PX, 0.6 * shape[2].max(LEAST_RADIUS_PX));
        if shape.xy().norm() > 1.0 + shape[2] {
            return None;
        }
        if step > 4 && (shape - before).xy().amax() < SMALL_STEP_PX {
            converged = true;
            break;
        }
    }
    if !converged || shape[2] <= least_px || shape[2] >= most_px {
        return None;
    }
    summarize(patch, &shape, &mut noise)
}

/// Covariance, colour and plausibility at the solution.
fn summarize(patch: &mut Patch, shape: &Shape, noise: &mut [[f64; 3]; 2]) -> Option<Fit> {
    let (information, _) = normal_equations(patch, shape, noise, true)?;
    let covariance = Cholesky::new(information)?.inverse();
    let covariance_px2 = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let (mut covered, mut believed) = (0.0, 0.0);
    for sample in &patch.groups[0].samples {
        let (c, _) = coverage(shape, 0.0, sample.x_px, sample.y_px);
        covered += c;
        believed += c * sample.trust;
    }
    let mut ball = [0.0; 3];
    let mut next = ball.iter_mut();
    let mut contrast = 0.0_f64;
    for (group, noise) in patch.groups.iter().zip(noise) {
        if group.channels == 0 {
            continue;
        }
        let solved = solve_group(group, shape)?;
        for (channel, parameters) in solved.parameters.iter().take(group.channels).enumerate() {
            contrast = contrast.max(parameters[3].abs() / noise[channel].sqrt());
            if let Some(value) = next.next() {
                let background =
                    parameters[0] + (parameters[1] * shape[0] + parameters[2] * shape[1]) / shape[2];
                *value = background + parameters[3];
            }
        }
    }
    let trusted = believed / covered;
    let uncertain = covariance_px2.trace() > 0.5 * shape[2] * shape[2];
    let good = covariance_px2.iter().all(|v| v.is_finite())
        && !uncertain
        && contrast > LEAST_CONTRAST
        && trusted > 0.5;
    good.then(|| Fit { pixel: patch.middle + shape.xy(), covariance_px2, radius_px: shape[2], ball, trusted })
}

/// Information matrix and gradient of the shape with the linear parameters eliminated; updates noise and trust.
fn normal_equations(
    patch: &mut Patch,
    shape: &Shape,
    noise: &mut [[f64; 3]; 2],
    robust: bool,
) -> Option<(Matrix4<f64>, Vector4<f64>)> {
    let mut information = Matrix4::zeros();
    let mut gradient = Vector4::zeros();
    for (group, noise) in patch.groups.iter_mut().zip(noise) {
        if group.channels == 0 {
            continue;
        }
        let mut solved = solve_group(group, shape)?;
        if robust {
            reweigh(group, shape, &solved, noise);
            solved = solve_group(group, shape)?;
        }
        accumulate(group, shape, &solved, noise, (&mut information, &mut gradient));
    }
    Some((information, gradient))
}

/// Covered fraction of a sample and its derivatives by centre, radius and edge width.
fn coverage(shape: &Shape, aperture_px2: f64, x_px: f64, y_px: f64) -> (f64, Vector4<f64>) {
    let (dx, dy) = (x_px - shape[0], y_px - shape[1]);
    let distance = dx.hypot(dy).max(1e-9);
    let width = (shape[3] * shape[3] + aperture_px2).sqrt();
    let z = (shape[2] - distance) / width;
    if z.abs() > 6.0 {
        return (if z > 0.0 { 1.0 } else { 0.0 }, Vector4::zeros());
    }
    let density = 0.398_942_280_4 * (-0.5 * z * z).exp();
    let slope = density / width;
    let by_edge = -slope * z * shape[3] / width;
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

fn basis(shape: &Shape, covered: f64, x_px: f64, y_px: f64) -> Linear {
    let scale = 1.0 / shape[2];
    let (bx, by) = (x_px * scale, y_px * scale);
    let (gx, gy) = ((x_px - shape[0]) * scale, (y_px - shape[1]) * scale);
    Linear::new(1.0, bx, by, covered, covered * gx, covered * gy)
}

fn solve_group(group: &Group, shape: &Shape) -> Option<Solved> {
    let mut normal = Basis::zeros();
    let mut right = [Linear::zeros(); 3];
    for sample in &group.samples {
        if sample.trust == 0.0 {
            continue;
        }
        let (c, _) = coverage(shape, group.aperture_px2, sample.x_px, sample.y_px);
        let row = basis(shape, c, sample.x_px, sample.y_px);
        let weighted = row * sample.trust;
        normal.ger(1.0, &weighted, &row, 1.0);
        for (right, value) in right.iter_mut().zip(sample.value).take(group.channels) {
            right.axpy(value, &weighted, 1.0);
        }
    }
    let inverse = Cholesky::new(normal)?.inverse();
    Some(Solved { parameters: right.map(|r| inverse * r), inverse })
}

/// Sets each channel's noise variance from the median residual near the disc and each sample's trust from it.
fn reweigh(group: &mut Group, shape: &Shape, solved: &Solved, noise: &mut [f64; 3]) {
    let Group { samples, residuals, channels, aperture_px2 } = group;
    let reach_px = shape[2] + 3.0 * (shape[3] * shape[3] + *aperture_px2).sqrt();
    for (channel, noise) in noise.iter_mut().enumerate().take(*channels) {
        residuals.clear();
        for sample in samples.iter() {
            if (sample.x_px - shape[0]).hypot(sample.y_px - shape[1]) < reach_px {
                let residual =
                    sample.value[channel] - predicted(sample, shape, *aperture_px2, solved, channel);
                residuals.push(residual.abs());
            }
        }
        let count = residuals.len();
        if count <= PARAMETERS {
            continue;
        }
        let (_, median, _) = residuals.select_nth_unstable_by(count / 2, f64::total_cmp);
        let deviation = MEDIAN_TO_DEVIATION * *median;
        let freedom = count as f64 / (count - PARAMETERS) as f64;
        *noise = deviation * deviation * freedom + ROUNDING_VARIANCE;
    }
    for sample in samples.iter_mut() {
        let worst = (0..*channels).fold(0.0_f64, |worst, channel| {
            let residual = sample.value[channel] - predicted(sample, shape, *aperture_px2, solved, channel);
            worst.max(residual * residual / noise[channel])
        });
        let u = worst / (CUT_OFF * CUT_OFF);
        sample.trust = if u < 1.0 { (1.0 - u) * (1.0 - u) } else { 0.0 };
    }
}

fn predicted(sample: &Sample, shape: &Shape, aperture_px2: f64, solved: &Solved, channel: usize) -> f64 {
    let (c, _) = coverage(shape, aperture_px2, sample.x_px, sample.y_px);
    basis(shape, c, sample.x_px, sample.y_px).dot(&solved.parameters[channel])
}

fn accumulate(
    group: &Group,
    shape: &Shape,
    solved: &Solved,
    noise: &[f64; 3],
    (information, gradient): (&mut Matrix4<f64>, &mut Vector4<f64>),
) {
    let mut own = [Matrix4::<f64>::zeros(); 3];
    let mut cross = [SMatrix::<f64, 4, 6>::zeros(); 3];
    for sample in &group.samples {
        if sample.trust == 0.0 {
            continue;
        }
        let (c, slope) = coverage(shape, group.aperture_px2, sample.x_px, sample.y_px);
        let row = basis(shape, c, sample.x_px, sample.y_px);
        for (channel, parameters) in solved.parameters.iter().take(group.channels).enumerate() {
            let residual = sample.value[channel] - row.dot(parameters);
            let strength = parameters[3]
                + ((sample.x_px - shape[0]) * parameters[4] + (sample.y_px - shape[1]) * parameters[5])
                    / shape[2];
            let jacobian = slope * strength;
            let weighted = jacobian * (sample.trust / noise[channel]);
            own[channel].ger(1.0, &weighted, &jacobian, 1.0);
            cross[channel].ger(1.0, &weighted, &row, 1.0);
            gradient.axpy(residual, &weighted, 1.0);
        }
    }
    for channel in 0..group.channels {
        let projected = cross[channel] * solved.inverse * cross[channel].transpose() * noise[channel];
        *information += own[channel] - projected;
    }
}
