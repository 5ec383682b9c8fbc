//! Where a fit starts, and what is known beforehand.

use super::constants::{FOURTH_STD, LEAST_RADIUS_PX, PIXEL_STD_PX, SHADE_STD};
use super::model::{BALL, COUNT, EDGE, FIRST_ORDER, FOURTH, GLOSS, Model, Parameters, RADIUS, SHADE, SITING};
use crate::optics::{Known, Optics};
use crate::outline::Outline;
use crate::{Vector2, Vector3};

/// A fitted radius may fall short of the true one by this factor, since it is traded against the blur.
const RADIUS_MARGIN: f64 = 1.25;

/// What a ball looked like when it was last seen, for its next fit to start from; it is no measurement.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Followed {
    pub(super) parameters: Parameters,
    pub(super) noise_variance: f64,
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

/// The radii that a fit may have.
pub(super) fn with_margin(radius_px: (f64, f64)) -> (f64, f64) {
    (radius_px.0.max(LEAST_RADIUS_PX) / RADIUS_MARGIN, radius_px.1 * RADIUS_MARGIN)
}

pub(super) fn first_guess(start: &Start, range_px: (f64, f64)) -> Model {
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
pub(super) fn within(mut p: Parameters, range_px: (f64, f64)) -> Parameters {
    p[RADIUS] = p[RADIUS].clamp(range_px.0, range_px.1);
    p[EDGE] = p[EDGE].clamp(PIXEL_STD_PX, 0.6 * p[RADIUS].max(LEAST_RADIUS_PX));
    p
}

/// How far two models' discs are apart: middle, radius, and the width of the edge as far out as it reaches.
pub(super) fn distance_px(a: &Parameters, b: &Parameters) -> f64 {
    (a.xy() - b.xy()).norm().max((a[RADIUS] - b[RADIUS]).abs()).max(2.0 * (a[EDGE] - b[EDGE]).abs())
}

/// What is known beforehand: little of place, radius and colour.
pub(super) fn prior(start: &Start, model: &Model) -> [Known; COUNT] {
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

/// What is known beforehand of the shading of first order. Lamps hang above: where it is known where that is,
/// the mean is that of lamps anywhere in the upper half of all directions, whose cosine to the vertical has a
/// mean of 1/2. The spread remains that of any light, as windows and what the floor throws back are not
/// known.
fn first_order(up: Option<Vector3<f64>>) -> [Known; FIRST_ORDER] {
    let variance = SHADE_STD[0] * SHADE_STD[0];
    // The square of the whole slope is that of its three coefficients together.
    let mean = up.unwrap_or_else(Vector3::zeros) * ((3.0 * variance).sqrt() / 2.0);
    [0, 1, 2].map(|k| Known { mean: mean[k], variance })
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
