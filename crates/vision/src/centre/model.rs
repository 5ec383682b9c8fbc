//! The forward model of one ball: what a pixel shows, and its derivatives.

use crate::color::encode;
use crate::outline::Outline;
use nalgebra::SVector;

/// Centre x and y, radius, edge width; ball colour of three channels; shading of first order (x, y, z of the surface's
/// normal) and second (xy, xz, yz, x² - y², z²); slopes x and y of the neutral light
/// that a gloss adds; columns by which the colour differences are sited to the right of the left pixel of their block.
pub(super) const COUNT: usize = 18;
pub(super) const RADIUS: usize = 2;
pub(super) const EDGE: usize = 3;
pub(super) const BALL: usize = 4;
pub(super) const SHADE: usize = 7;
pub(super) const GLOSS: usize = 15;
pub(super) const SITING: usize = 17;
/// Terms of the shading, and those of first order among them.
const SHADES: usize = GLOSS - SHADE;
pub(super) const FIRST_ORDER: usize = 3;
pub(super) type Parameters = SVector<f64, COUNT>;
/// Derivatives by all parameters, the value or residual behind them, and nothing in what is left of whole lanes of four.
pub(super) type Row = [f64; WIDTH];
pub(super) const RESIDUAL: usize = COUNT;
pub(super) const WIDTH: usize = 20;

/// A ball and the coordinates of its shading.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model {
    pub(super) p: Parameters,
    /// The disc whose normals shade the ball: its centre and radius.
    pub(super) origin: (f64, f64),
    pub(super) unit_px: f64,
    pub(super) outline: Outline,
}

/// What is behind a pixel: linear light, and the slope of light over code there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Behind {
    light: [f64; 3],
    decoding: [f64; 3],
}

impl Behind {
    /// Of a light.
    pub(super) fn of(light: [f64; 3]) -> Self {
        Self { light, decoding: light.map(|l| encode(l).1.recip()) }
    }
}

/// What a pixel shows: its channels, less their constants, behind their derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    pub(super) covered: f64,
    pub(super) channels: [Row; 3],
    /// Derivative of each code by the code of what is behind.
    pub(super) open: f64,
}

impl Shown {
    /// Nothing yet.
    pub(super) const NOTHING: Self = Self { covered: 0.0, channels: [[0.0; WIDTH]; 3], open: 0.0 };
}

/// The blur rounds off the normal's steep fall at the rim: an edge width over the radius, of a ball 6 px wide.
const RIM_SOFT: f64 = 0.2;
const FAR: f64 = 4.5;
/// 1/√(2π).
const DENSITY: f64 = 0.398_942_280_401_432_7;

/// Normal distribution function (Abramowitz and Stegun 26.2.17, error below 7.5e-8), given the density at `z`.
fn normal_cdf(z: f64, density: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let series =
        0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429)));
    let tail = density * t * series;
    if z >= 0.0 { 1.0 - tail } else { tail }
}

impl Model {
    /// Fraction of a pixel that the disc covers: a Gaussian edge (lens, aperture and pixel together).
    #[inline(always)]
    pub(super) fn coverage(&self, x_px: f64, y_px: f64) -> f64 {
        let (z, ..) = self.edge_at(x_px, y_px);
        if z.abs() > FAR {
            return if z > 0.0 { 1.0 } else { 0.0 };
        }
        normal_cdf(z, DENSITY * (-0.5 * z * z).exp())
    }

    /// Distance of a place inside the edge, in edge widths.
    pub(super) fn depth_edges(&self, x_px: f64, y_px: f64) -> f64 {
        self.edge_at(x_px, y_px).0
    }

    /// Distance of a pixel inside the edge, in edge widths; its derivatives by centre, radius and edge width, in which
    /// the outline's own stretch is taken as constant.
    #[inline(always)]
    fn edge_at(&self, x_px: f64, y_px: f64) -> (f64, [f64; 4]) {
        let p = &self.p;
        let (size, ax, ay) = self.outline.measure(x_px - p[0], y_px - p[1]);
        let scale = (ax * ax + ay * ay).sqrt().max(1e-9);
        let stretch = size.max(1e-9) / (scale * p[EDGE]);
        // Blur draws the half-covered contour of a small disc inwards (Huertas & Medioni 1986).
        let bend = p[EDGE] * p[EDGE] / (2.0 * p[RADIUS]);
        let by_centre = [ax / (scale * p[EDGE]), ay / (scale * p[EDGE])];
        let by_radius = stretch * (1.0 + bend / p[RADIUS]);
        let z = (p[RADIUS] - bend - size) * stretch;
        (z, [by_centre[0], by_centre[1], by_radius, -(z + 2.0 * bend * stretch) / p[EDGE]])
    }

    /// First and second spherical harmonics of the normal at a place, in which the light on a matt ball under any lamps is
    /// known to about 2 % (Basri & Jacobs 2003; Ramamoorthi & Hanrahan 2001), less their means over the disc, so that the
    /// colour stays that of the whole ball; and what the slope of each along two axes is, per pixel, as far as it matters to
    /// the centre.
    #[inline(always)]
    fn harmonics_at(&self, x_px: f64, y_px: f64) -> [[f64; SHADES]; 3] {
        let per_px = self.unit_px.recip();
        let (x, y) = ((x_px - self.origin.0) * per_px, (y_px - self.origin.1) * per_px);
        let (size, ..) = self.outline.measure(x, y);
        let left = 1.0 - size * size;
        let z2 = 0.5 * (left + (left * left + RIM_SOFT * RIM_SOFT).sqrt());
        let z = z2.sqrt();
        let (xp, yp, zp) = (x * per_px, y * per_px, z * per_px);
        [
            [x, y, z - 2.0 / 3.0, x * y, x * z, y * z, x * x - y * y, z2 - 0.5],
            [per_px, 0.0, 0.0, yp, zp, 0.0, 2.0 * xp, 0.0],
            [0.0, per_px, 0.0, xp, 0.0, zp, -2.0 * yp, 0.0],
        ]
    }

    /// The rim at a pixel.
    #[inline(always)]
    fn rim_at(&self, x_px: f64, y_px: f64) -> Rim {
        let (z, by) = self.edge_at(x_px, y_px);
        if z.abs() > FAR {
            return Rim { covered: if z > 0.0 { 1.0 } else { 0.0 }, slope: [0.0; 4], bend: [[0.0; 2]; 4] };
        }
        let density = DENSITY * (-0.5 * z * z).exp();
        let edge_px = self.p[EDGE];
        let distance_px = (self.p[RADIUS] - z * edge_px).max(0.5 * edge_px);
        let normal = [by[0] * edge_px, by[1] * edge_px];
        let curved = (distance_px * edge_px).recip();
        let mut bend = [[0.0; 2]; 4];
        for axis in 0..2 {
            for k in 0..2 {
                let same = if k == axis { 1.0 } else { 0.0 };
                bend[k][axis] = density * ((normal[axis] * normal[k] - same) * curved - z * by[k] * by[axis]);
            }
            bend[RADIUS][axis] = -density * z * by[RADIUS] * by[axis];
            bend[EDGE][axis] = density * (-by[axis] / edge_px - z * by[EDGE] * by[axis]);
        }
        Rim { covered: normal_cdf(z, density), slope: by.map(|d| density * d), bend }
    }

    /// What a pixel shows whose uncovered part shows `behind`, in the channels that these combinations of codes are.
    #[inline(always)]
    pub(super) fn show(
        &self,
        place: (f64, f64),
        behind: &Behind,
        from_coded: &[[f64; 4]; 3],
        shown: &mut Shown,
    ) {
        let p = &self.p;
        let Rim { covered, slope, bend } = self.rim_at(place.0, place.1);
        let [terms, across, down] = self.harmonics_at(place.0, place.1);
        // Blur of variance w² moves light along its slope: f·disc blurred is f·(disc blurred) + w² ∇f·∇(disc blurred).
        let spread = p[EDGE] * p[EDGE];
        let mut lit = [0.0; SHADES];
        let (mut face, mut seen, mut along_x, mut along_y) = (0.0, 0.0, 0.0, 0.0);
        for i in 0..SHADES {
            lit[i] = covered * terms[i] - spread * (across[i] * slope[0] + down[i] * slope[1]);
            face += p[SHADE + i] * terms[i];
            seen += p[SHADE + i] * lit[i];
            along_x += p[SHADE + i] * across[i];
            along_y += p[SHADE + i] * down[i];
        }
        let (shade, whole) = (1.0 + face, covered + seen);
        let gloss_face = p[GLOSS] * terms[0] + p[GLOSS + 1] * terms[1];
        let gloss_seen = p[GLOSS] * lit[0] + p[GLOSS + 1] * lit[1];
        shown.covered = covered;
        shown.open = 0.0;
        shown.channels = [[0.0; WIDTH]; 3];
        for c in 0..3 {
            let ball = p[BALL + c];
            let (code, gain) = encode(behind.light[c] * (1.0 - covered) + ball * whole + gloss_seen);
            shown.open += (1.0 - covered) * gain * behind.decoding[c] / 3.0;
            let mut by: Row = [0.0; WIDTH];
            by[RESIDUAL] = code;
            let contrast = ball * shade + gloss_face - behind.light[c];
            let along = [ball * along_x + p[GLOSS] * across[0], ball * along_y + p[GLOSS + 1] * down[1]];
            for k in 0..4 {
                by[k] =
                    gain * (contrast * slope[k] - spread * (along[0] * bend[k][0] + along[1] * bend[k][1]));
            }
            by[EDGE] -= gain * 2.0 * p[EDGE] * (along[0] * slope[0] + along[1] * slope[1]);
            by[BALL + c] = gain * whole;
            for i in 0..SHADES {
                by[SHADE + i] = gain * ball * lit[i];
            }
            (by[GLOSS], by[GLOSS + 1]) = (gain * lit[0], gain * lit[1]);
            for (channel, part) in shown.channels.iter_mut().zip(from_coded) {
                add_scaled(channel, &by, part[c]);
            }
        }
    }
}

/// Adds a multiple of a row.
#[inline(always)]
pub(super) fn add_scaled(sum: &mut Row, row: &Row, weight: f64) {
    for (out, value) in sum.iter_mut().zip(row) {
        *out += weight * value;
    }
}

/// Coverage of a pixel at the rim, its derivatives by centre, radius and edge width, and the derivatives by these of the
/// first two.
struct Rim {
    covered: f64,
    slope: [f64; 4],
    bend: [[f64; 2]; 4],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_the_numeric_ones() {
        let mut p = Parameters::zeros();
        p.as_mut_slice()[..17].copy_from_slice(&[
            10.2, 8.9, 2.6, 0.6, 0.5, 0.1, 0.05, 0.2, -0.3, 0.1, 0.05, -0.1, 0.1, -0.05, 0.1, 0.01, -0.01,
        ]);
        let model = Model { p, origin: (10.0, 9.0), unit_px: 2.5, outline: Outline::ROUND };
        let behind = Behind::of([0.4, 0.42, 0.35]);
        let channels = [[0.3, 0.6, 0.1, 0.0], [0.5, -0.5, 0.0, 0.0], [0.1, 0.2, -0.7, 0.0]];
        for (x, y) in [(12.0, 9.0), (10.0, 11.0), (8.0, 7.0), (10.0, 9.0)] {
            let shown = |model: &Model| {
                let mut shown = Shown::NOTHING;
                model.show((x, y), &behind, &channels, &mut shown);
                shown
            };
            let got = shown(&model);
            for k in 0..SITING {
                let value = |h: f64| {
                    let mut moved = model;
                    moved.p[k] += h;
                    shown(&moved).channels.map(|c| c[RESIDUAL])
                };
                let (up, down) = (value(1e-5), value(-1e-5));
                for c in 0..3 {
                    let want = (up[c] - down[c]) / 2e-5;
                    assert!(
                        (got.channels[c][k] - want).abs() < 0.02 * want.abs() + 0.2,
                        "{k} {c}: {} for {want}",
                        got.channels[c][k]
                    );
                }
            }
            assert!((model.coverage(x, y) - got.covered).abs() < 1e-12);
        }
    }
}
