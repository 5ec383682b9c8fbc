//! The forward model of one ball: what a pixel shows, and its derivatives.

use crate::color::encode;
use crate::outline::Outline;
use nalgebra::SVector;

/// Centre x and y, radius, edge width; ball colour of three channels; shading slopes x, y and curvatures xx, xy, yy;
/// columns by which the colour differences are sited to the right of the left pixel of their block.
pub(super) const COUNT: usize = 13;
pub(super) const RADIUS: usize = 2;
pub(super) const EDGE: usize = 3;
pub(super) const BALL: usize = 4;
pub(super) const SHADE: usize = 7;
pub(super) const SITING: usize = 12;
/// Parameters that a single pixel depends on.
pub(super) const OWN: usize = SITING;

pub(super) type Parameters = SVector<f64, COUNT>;
/// Derivatives by all parameters, and the residual behind them.
pub(super) type Row = [f64; COUNT + 1];
pub(super) const RESIDUAL: usize = COUNT;

/// A ball and the coordinates of its shading.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model {
    pub(super) p: Parameters,
    /// Where slopes and curvatures are counted from, and their unit.
    pub(super) origin: (f64, f64),
    pub(super) unit_px: f64,
    pub(super) outline: Outline,
}

/// What a pixel shows: coded red, green and blue, and their derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    pub(super) covered: f64,
    pub(super) coded: [f64; 3],
    pub(super) by: [[f64; OWN]; 3],
    /// Derivative of each code by the code of what is behind.
    pub(super) open: f64,
}

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
    pub(super) fn coverage(&self, x_px: f64, y_px: f64) -> f64 {
        let (z, ..) = self.edge_at(x_px, y_px);
        if z.abs() > FAR {
            return if z > 0.0 { 1.0 } else { 0.0 };
        }
        normal_cdf(z, DENSITY * (-0.5 * z * z).exp())
    }

    /// Distance of a pixel inside the edge, in edge widths; its derivatives by centre and radius, in which the outline's
    /// own stretch is taken as constant.
    fn edge_at(&self, x_px: f64, y_px: f64) -> (f64, [f64; 3]) {
        let p = &self.p;
        let (size, ax, ay) = self.outline.measure(x_px - p[0], y_px - p[1]);
        let scale = (ax * ax + ay * ay).sqrt().max(1e-9);
        let stretch = size.max(1e-9) / (scale * p[EDGE]);
        ((p[RADIUS] - size) * stretch, [ax / (scale * p[EDGE]), ay / (scale * p[EDGE]), stretch])
    }

    pub(super) fn shade_at(&self, x_px: f64, y_px: f64) -> (f64, [f64; 5]) {
        let (x, y) = ((x_px - self.origin.0) / self.unit_px, (y_px - self.origin.1) / self.unit_px);
        let terms = [x, y, x * x, x * y, y * y];
        (1.0 + terms.iter().enumerate().map(|(i, t)| t * self.p[SHADE + i]).sum::<f64>(), terms)
    }

    /// What a pixel shows whose uncovered part shows `behind` (linear light).
    pub(super) fn at(&self, x_px: f64, y_px: f64, behind: &[f64; 3]) -> Shown {
        let p = &self.p;
        let (z, by) = self.edge_at(x_px, y_px);
        let (covered, slope) = if z.abs() > FAR {
            (if z > 0.0 { 1.0 } else { 0.0 }, [0.0; 4])
        } else {
            let density = DENSITY * (-0.5 * z * z).exp();
            (normal_cdf(z, density), [by[0], by[1], by[2], -z / p[EDGE]].map(|d| density * d))
        };
        let (shade, terms) = self.shade_at(x_px, y_px);
        let mut shown = Shown { covered, coded: [0.0; 3], by: [[0.0; OWN]; 3], open: 0.0 };
        for c in 0..3 {
            let ball = p[BALL + c] * shade;
            let (code, gain) = encode(behind[c] + covered * (ball - behind[c]));
            shown.coded[c] = code;
            shown.open += (1.0 - covered) * gain / encode(behind[c]).1 / 3.0;
            let by = &mut shown.by[c];
            for (out, s) in by.iter_mut().zip(slope) {
                *out = gain * (ball - behind[c]) * s;
            }
            by[BALL + c] = gain * covered * shade;
            let lit = gain * covered * p[BALL + c];
            for (out, term) in by[SHADE..].iter_mut().zip(terms) {
                *out = lit * term;
            }
        }
        shown
    }
}

impl Shown {
    /// Adds `weight` times one channel and its derivatives; the channel's value without its constant goes where the
    /// residual will stand.
    pub(super) fn add_to(&self, row: &mut Row, channel: &[f64; 4], weight: f64) {
        for ((part, by), coded) in channel.iter().zip(&self.by).zip(self.coded) {
            let w = weight * part;
            for (out, by) in row.iter_mut().zip(by) {
                *out += w * by;
            }
            row[RESIDUAL] += w * coded;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_the_numeric_ones() {
        let mut p = Parameters::zeros();
        p.as_mut_slice()[..12]
            .copy_from_slice(&[10.2, 8.9, 2.6, 0.6, 0.5, 0.1, 0.05, 0.2, -0.3, 0.1, 0.05, -0.1]);
        let model = Model { p, origin: (10.0, 9.0), unit_px: 2.5, outline: Outline::ROUND };
        let behind = [0.4, 0.42, 0.35];
        for (x, y) in [(12.0, 9.0), (10.0, 11.0), (8.0, 7.0), (10.0, 9.0)] {
            let got = model.at(x, y, &behind);
            for k in 0..OWN {
                let value = |h: f64| {
                    let mut moved = model;
                    moved.p[k] += h;
                    moved.at(x, y, &behind).coded
                };
                let (up, down) = (value(1e-5), value(-1e-5));
                for c in 0..3 {
                    let want = (up[c] - down[c]) / 2e-5;
                    assert!(
                        (got.by[c][k] - want).abs() < 0.02 * want.abs() + 0.2,
                        "{k} {c}: {} for {want}",
                        got.by[c][k]
                    );
                }
            }
            assert!((model.coverage(x, y) - got.covered).abs() < 1e-12);
        }
    }
}
