//! The forward model of one ball: what a pixel shows, and its derivatives.

use super::constants::PIXEL_STD_PX;
use super::curve::encode;
use super::edge::cover;
use super::gloss::{GLOSSES, Gloss};
use super::lanes::{GROUP, Lanes};
use super::places::Places;
use crate::Vector3;
use crate::outline::Outline;
use nalgebra::SVector;
use pulp::{Scalar, Simd};

/// Centre x and y, radius, edge width; ball colour of three channels; shading of first order (x, y, z of the
/// surface's normal) and second (xy, xz, yz, x² - y², z²); neutral light in the three patterns that a gloss
/// mirrors; columns by which the colour differences are sited to the right of the left pixel of their block;
/// shading of fourth order.
pub(super) const COUNT: usize = 20;
pub(super) const RADIUS: usize = 2;
pub(super) const EDGE: usize = 3;
pub(super) const BALL: usize = 4;
pub(super) const SHADE: usize = 7;
pub(super) const GLOSS: usize = 15;
pub(super) const SITING: usize = GLOSS + GLOSSES;
pub(super) const FOURTH: usize = 19;
/// Terms of the shading, and those of first order among them.
pub(super) const SHADES: usize = GLOSS - SHADE;
pub(super) const FIRST_ORDER: usize = 3;
pub(super) type Parameters = SVector<f64, COUNT>;
/// Derivatives by all parameters and the value or residual behind them, in whole groups.
pub(super) type Row = [f32; WIDTH];
pub(super) const RESIDUAL: usize = COUNT;
pub(super) const WIDTH: usize = 24;

/// A ball and the coordinates of its shading.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model {
    pub(super) p: Parameters,
    /// The disc whose normals shade the ball: its centre and radius.
    pub(super) origin: (f64, f64),
    pub(super) unit_px: f64,
    /// Part of the radius over which the blur rounds off the normal's steep fall at the rim.
    pub(super) soft: f64,
    pub(super) outline: Outline,
    /// Unit vector to where most of the light comes from, in the coordinates of the shading.
    pub(super) lamp: [f64; 3],
    /// Where lamps are expected: right, down and towards the camera as the ball is seen.
    pub(super) up: Option<Vector3<f64>>,
    pub(super) gloss: Gloss,
}

/// Derivatives of what a pixel shows, of each channel.
pub(super) type Shown = [Row; 3];
pub(super) const NOTHING: Shown = [[0.0; WIDTH]; 3];

/// What pixels show, in whole groups.
#[derive(Debug, Clone, Default)]
pub(super) struct Values {
    /// Their channels, less the constants.
    pub(super) channels: [Vec<f32>; 3],
    pub(super) covered: Vec<f32>,
    /// Derivative of each code by the code of what is behind.
    pub(super) open: Vec<f32>,
}

impl Values {
    /// Makes room for as many pixels.
    pub(super) fn make_room(&mut self, pixels: usize) {
        let whole = pixels.next_multiple_of(GROUP);
        let Self { channels: [bright, across, along], covered, open } = self;
        [bright, across, along, covered, open].into_iter().for_each(|values| values.resize(whole, 0.0));
    }
}

/// Derivatives of each channel by all parameters and its value, for a group of pixels. What no model sets
/// remains 0.
pub(super) type Columns = [[[f32; GROUP]; WIDTH]; 3];
pub(super) const NO_COLUMNS: Columns = [[[0.0; GROUP]; WIDTH]; 3];

impl Model {
    /// Whether the edge is as sharp as any can be.
    pub(super) fn is_sharpest(&self) -> bool {
        self.p[EDGE] <= PIXEL_STD_PX
    }

    /// Fraction of each pixel that the disc covers, and its distance inside the edge in edge widths.
    #[inline(always)]
    pub(super) fn coverage<S: Simd>(
        &self,
        simd: S,
        places: &[[f32; GROUP]; 2],
    ) -> ([f32; GROUP], [f32; GROUP]) {
        let (mut covered, mut depth) = ([0.0; GROUP], [0.0; GROUP]);
        for part in 0..Lanes::<S>::PARTS {
            let at = (Lanes::load(simd, &places[0], part), Lanes::load(simd, &places[1], part));
            let (z, _) = self.edge_at(simd, at);
            cover(simd, z).0.store(&mut covered, part);
            z.store(&mut depth, part);
        }
        (covered, depth)
    }

    /// Distance of a place inside the edge, in edge widths.
    pub(super) fn depth_edges(&self, (x_px, y_px): (f64, f64)) -> f32 {
        let simd = Scalar::new();
        let mut depth = [0.0];
        self.edge_at(simd, (Lanes::splat(simd, x_px), Lanes::splat(simd, y_px))).0.store(&mut depth, 0);
        depth[0]
    }

    /// Distance of pixels inside the edge, in edge widths; its derivatives by centre, radius and edge width,
    /// in which the outline's own stretch is taken as constant.
    #[inline(always)]
    fn edge_at<S: Simd>(&self, simd: S, (x_px, y_px): (Lanes<S>, Lanes<S>)) -> (Lanes<S>, [Lanes<S>; 4]) {
        let p = &self.p;
        let all = |value: f64| Lanes::splat(simd, value);
        let (dx, dy) = (x_px - all(p[0]), y_px - all(p[1]));
        let (square, ax, ay) = self.measure(simd, dx, dy);
        let size = square.sqrt();
        let scale = (ax * ax + ay * ay).sqrt().max(all(1e-9));
        let inverse = all(1.0) / (scale * all(p[EDGE]));
        let stretch = size.max(all(1e-9)) * inverse;
        // Blur draws the half-covered contour of a small disc inwards (Huertas & Medioni 1986).
        let bend = p[EDGE] * p[EDGE] / (2.0 * p[RADIUS]);
        let by_radius = stretch * all(1.0 + bend / p[RADIUS]);
        let z = (all(p[RADIUS] - bend) - size) * stretch;
        let by_edge = (z + all(2.0 * bend) * stretch) * all(-p[EDGE].recip());
        (z, [ax * inverse, ay * inverse, by_radius, by_edge])
    }

    /// dᵀ A d with the outline's matrix A, and A d.
    #[inline(always)]
    pub(super) fn measure<S: Simd>(
        &self,
        simd: S,
        dx: Lanes<S>,
        dy: Lanes<S>,
    ) -> (Lanes<S>, Lanes<S>, Lanes<S>) {
        let [xx, xy, yy] = self.outline.matrix().map(|value| Lanes::splat(simd, value));
        let (ax, ay) = (xx * dx + xy * dy, xy * dx + yy * dy);
        ((dx * ax + dy * ay).max(Lanes::splat(simd, 0.0)), ax, ay)
    }

    /// The rim at pixels.
    #[inline(always)]
    fn rim_at<S: Simd>(&self, simd: S, at: (Lanes<S>, Lanes<S>)) -> Rim<S> {
        let all = |value: f64| Lanes::splat(simd, value);
        let (z, by) = self.edge_at(simd, at);
        let (covered, density) = cover(simd, z);
        let edge_px = all(self.p[EDGE]);
        let distance_px = (all(self.p[RADIUS]) - z * edge_px).max(all(0.5 * self.p[EDGE]));
        let curved = all(1.0) / (distance_px * edge_px);
        let mut bend = [[all(0.0); 2]; 4];
        for axis in 0..2 {
            let normal = by[axis] * edge_px;
            for k in 0..2 {
                let same = all(if k == axis { 1.0 } else { 0.0 });
                bend[k][axis] = density * ((normal * by[k] * edge_px - same) * curved - z * by[k] * by[axis]);
            }
            let along = density * by[axis];
            bend[RADIUS][axis] = all(0.0) - along * z * by[RADIUS];
            bend[EDGE][axis] = all(0.0) - along * (all(self.p[EDGE].recip()) + z * by[EDGE]);
        }
        Rim { covered, slope: by.map(|d| density * d), bend }
    }

    /// What a group of pixels shows, that at `first` and those behind, in the channels that these
    /// combinations of codes are, with its derivatives. The columns are working space.
    #[inline(always)]
    pub(super) fn show<S: Simd>(
        &self,
        simd: S,
        (places, first): (&Places, usize),
        from_coded: &[[f64; 4]; 3],
        columns: &mut Columns,
        (shown, values): (&mut [Shown], &mut Values),
    ) {
        let group = first..first + GROUP;
        let (covered, open) = (&mut values.covered[group.clone()], &mut values.open[group.clone()]);
        for part in 0..Lanes::<S>::PARTS {
            let from = |values: &[f32]| Lanes::load(simd, &values[first..first + GROUP], part);
            let behind = [from(&places.light[0]), from(&places.light[1]), from(&places.light[2])];
            let face = self.face(simd, (from(&places.x), from(&places.y)));
            let (codes, gains) = self.coded(simd, &face, &behind);
            let uncovered = Lanes::splat(simd, 1.0) - face.rim.covered;
            let mut through = Lanes::splat(simd, 0.0);
            for (gain, decoding) in gains.iter().zip(&places.decoding) {
                through = through + *gain * from(decoding);
            }
            face.rim.covered.store(covered, part);
            (uncovered * through * Lanes::splat(simd, 1.0 / 3.0)).store(open, part);
            for (columns, parts) in columns.iter_mut().zip(from_coded) {
                self.differentiate(simd, (&face, &behind), (&codes, &gains), parts, (columns, part));
            }
        }
        for (channel, columns) in columns.iter().enumerate() {
            values.channels[channel][group.clone()].copy_from_slice(&columns[RESIDUAL]);
            for (lane, shown) in shown.iter_mut().enumerate() {
                for (value, column) in shown[channel].iter_mut().zip(columns) {
                    *value = column[lane];
                }
            }
        }
    }

    /// Coverage and shading of pixels.
    #[inline(always)]
    fn face<S: Simd>(&self, simd: S, at: (Lanes<S>, Lanes<S>)) -> Face<S> {
        let p = &self.p;
        let all = |value: f64| Lanes::splat(simd, value);
        let rim = self.rim_at(simd, at);
        let normal = self.normal_at(simd, at);
        let [terms, across, down] = self.harmonics_of(simd, &normal);
        let [term, by_x, by_y] = self.fourth_of(simd, &normal);
        // Blur of variance w² moves light along its slope: f·disc blurred is f·(disc blurred) + w² ∇f·∇(disc
        // blurred).
        let spread = all(p[EDGE] * p[EDGE]);
        let mut lit = [all(0.0); SHADES];
        let (mut face, mut seen, mut along) = (all(1.0), rim.covered, [all(0.0); 2]);
        for i in 0..SHADES {
            let weight = all(p[SHADE + i]);
            lit[i] = rim.covered * terms[i] - spread * (across[i] * rim.slope[0] + down[i] * rim.slope[1]);
            face = face + weight * terms[i];
            seen = seen + weight * lit[i];
            along = [along[0] + weight * across[i], along[1] + weight * down[i]];
        }
        let weight = all(p[FOURTH]);
        let fourth = rim.covered * term - spread * (by_x * rim.slope[0] + by_y * rim.slope[1]);
        (face, seen) = (face + weight * term, seen + weight * fourth);
        along = [along[0] + weight * by_x, along[1] + weight * by_y];
        let [mirrored, across, down] = self.gloss.terms(simd, &normal);
        let per_px = all(self.unit_px.recip());
        let mut gloss = [all(0.0); GLOSSES];
        let (mut gloss_face, mut gloss_seen, mut gloss_along) = (all(0.0), all(0.0), [all(0.0); 2]);
        for i in 0..GLOSSES {
            let weight = all(p[GLOSS + i]);
            let (by_x, by_y) = (across[i] * per_px, down[i] * per_px);
            gloss[i] = rim.covered * mirrored[i] - spread * (by_x * rim.slope[0] + by_y * rim.slope[1]);
            gloss_face = gloss_face + weight * mirrored[i];
            gloss_seen = gloss_seen + weight * gloss[i];
            gloss_along = [gloss_along[0] + weight * by_x, gloss_along[1] + weight * by_y];
        }
        Face { lit, fourth, shade: face, whole: seen, along, gloss, gloss_face, gloss_seen, gloss_along, rim }
    }

    /// Codes of pixels and their derivatives by light.
    #[inline(always)]
    fn coded<S: Simd>(
        &self,
        simd: S,
        face: &Face<S>,
        behind: &[Lanes<S>; 3],
    ) -> ([Lanes<S>; 3], [Lanes<S>; 3]) {
        let uncovered = Lanes::splat(simd, 1.0) - face.rim.covered;
        let (mut codes, mut gains) = (*behind, *behind);
        for c in 0..3 {
            let ball = Lanes::splat(simd, self.p[BALL + c]);
            let light = behind[c] * uncovered + ball * face.whole + face.gloss_seen;
            (codes[c], gains[c]) = encode(simd, light);
        }
        (codes, gains)
    }

    /// A channel and its derivatives.
    #[inline(always)]
    fn differentiate<S: Simd>(
        &self,
        simd: S,
        (face, behind): (&Face<S>, &[Lanes<S>; 3]),
        (codes, gains): (&[Lanes<S>; 3], &[Lanes<S>; 3]),
        parts: &[f64; 4],
        (columns, part): (&mut [[f32; GROUP]; WIDTH], usize),
    ) {
        let p = &self.p;
        let zero = Lanes::splat(simd, 0.0);
        let (mut code, mut contrast, mut along) = (zero, zero, [zero; 2]);
        let (mut by_shade, mut by_gloss) = (zero, zero);
        for c in 0..3 {
            let gain = gains[c] * Lanes::splat(simd, parts[c]);
            let ball = Lanes::splat(simd, p[BALL + c]);
            code = code + codes[c] * Lanes::splat(simd, parts[c]);
            contrast = contrast + gain * (ball * face.shade + face.gloss_face - behind[c]);
            for (axis, along) in along.iter_mut().enumerate() {
                *along = *along + gain * (ball * face.along[axis] + face.gloss_along[axis]);
            }
            (by_shade, by_gloss) = (by_shade + gain * ball, by_gloss + gain);
            (gain * face.whole).store(&mut columns[BALL + c], part);
        }
        let Rim { slope, bend, .. } = &face.rim;
        let spread = Lanes::splat(simd, p[EDGE] * p[EDGE]);
        for k in 0..4 {
            let mut by = contrast * slope[k] - spread * (along[0] * bend[k][0] + along[1] * bend[k][1]);
            if k == EDGE {
                let twice = Lanes::splat(simd, 2.0 * p[EDGE]);
                by = by - twice * (along[0] * slope[0] + along[1] * slope[1]);
            }
            by.store(&mut columns[k], part);
        }
        for (column, lit) in columns[SHADE..].iter_mut().zip(&face.lit) {
            (by_shade * *lit).store(column, part);
        }
        (by_shade * face.fourth).store(&mut columns[FOURTH], part);
        for (column, gloss) in columns[GLOSS..].iter_mut().zip(&face.gloss) {
            (by_gloss * *gloss).store(column, part);
        }
        code.store(&mut columns[RESIDUAL], part);
    }
}

/// Adds a multiple of a row.
#[inline(always)]
pub(super) fn add_scaled(sum: &mut Row, row: &Row, weight: f32) {
    for (out, value) in sum.iter_mut().zip(row) {
        *out += weight * value;
    }
}

/// Coverage of pixels at the rim, its derivatives by centre, radius and edge width, and the derivatives by
/// these of the first two.
struct Rim<S: Simd> {
    covered: Lanes<S>,
    slope: [Lanes<S>; 4],
    bend: [[Lanes<S>; 2]; 4],
}

/// Rim and shading of pixels: the shading's terms as they are seen, their sum inside the ball and as seen,
/// and its slope; likewise of the gloss.
struct Face<S: Simd> {
    rim: Rim<S>,
    lit: [Lanes<S>; SHADES],
    fourth: Lanes<S>,
    shade: Lanes<S>,
    whole: Lanes<S>,
    along: [Lanes<S>; 2],
    gloss: [Lanes<S>; GLOSSES],
    gloss_face: Lanes<S>,
    gloss_seen: Lanes<S>,
    gloss_along: [Lanes<S>; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Covers<'a>(&'a Model, &'a [[f32; GROUP]; 2]);

    impl pulp::WithSimd for Covers<'_> {
        type Output = [f32; GROUP];

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> [f32; GROUP] {
            self.0.coverage(simd, self.1).0
        }
    }

    #[test]
    fn derivatives_are_the_numeric_ones() {
        // Between the rounding of single precision and the curvature.
        const STEP: f64 = 2e-3;
        let mut p = Parameters::zeros();
        p[FOURTH] = 0.05;
        p.as_mut_slice()[..SITING].copy_from_slice(&[
            10.2, 8.9, 2.6, 0.6, 0.5, 0.1, 0.05, 0.2, -0.3, 0.1, 0.05, -0.1, 0.1, -0.05, 0.1, 0.01, -0.01,
            0.05,
        ]);
        let lamp = [0.36, -0.8, 0.48];
        let up = Some(Vector3::new(0.36, -0.8, 0.48));
        let model = Model { origin: (10.0, 9.0), unit_px: 2.5, lamp, ..Model::new(p, Outline::ROUND, up) };
        let from_coded = [[0.3, 0.6, 0.1, 0.0], [0.5, -0.5, 0.0, 0.0], [0.1, 0.2, -0.7, 0.0]];
        for (x, y) in [(12.0, 9.0), (10.0, 11.0), (8.0, 7.0), (10.0, 9.0)] {
            let mut places = Places::default();
            places.push((x, y));
            places.finish();
            places.light_up_from(0, &[0.4, 0.42, 0.35]);
            places.decode(Scalar::new());
            let shown = |model: &Model| {
                let (mut shown, mut values) = ([NOTHING], Values::default());
                values.make_room(1);
                let (simd, mut columns) = (Scalar::new(), NO_COLUMNS);
                model.show(simd, (&places, 0), &from_coded, &mut columns, (&mut shown, &mut values));
                (shown[0], values)
            };
            let (got, at) = shown(&model);
            for k in (0..SITING).chain([FOURTH]) {
                let value = |h: f64| {
                    let mut moved = model;
                    moved.p[k] += h;
                    shown(&moved).1.channels.map(|c| f64::from(c[0]))
                };
                let (up, down) = (value(STEP), value(-STEP));
                for c in 0..3 {
                    let want = (up[c] - down[c]) / (2.0 * STEP);
                    assert!(
                        (f64::from(got[c][k]) - want).abs() < 0.02 * want.abs() + 0.2,
                        "{k} {c}: {} for {want}",
                        got[c][k]
                    );
                }
            }
            let places = [[x as f32; GROUP], [y as f32; GROUP]];
            let (covered, depth) = model.coverage(Scalar::new(), &places);
            assert_eq!(covered[..], at.covered[..]);
            assert_eq!(depth, [model.depth_edges((x, y)); GROUP]);
            assert_eq!(pulp::Arch::new().dispatch(Covers(&model, &places)), covered);
        }
    }
}
