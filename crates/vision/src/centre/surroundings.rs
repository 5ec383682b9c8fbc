//! What is behind a ball, from what is seen around it: mean and covariance of the background at each pixel that the
//! ball covers in part.
//!
//! Brightness: a plane, fitted robustly, and on it clutter (an arm, a skid, an edge of the wall) as a random field whose
//! variance is that of what the plane leaves around the ball ([`super::krige`]). Where nothing but noise is left on the
//! plane, the plane is taken as it is.
//!
//! Colour differences: a robust mean each, in a still a plane; clutter is mostly grey, and they are coarse.

use super::CLEAR;
use super::cholesky::Banded;
use super::krige::{Kriging, Spread};
use super::robust::{Fitted, Plane, Scattered, on};
use crate::patch::Patch;
use pulp::Simd;

/// Width of the ring that is looked at beyond the ball's blurred rim, in edge widths: correlation beyond it is e⁻⁴.
const RING_EDGES: f64 = 4.0;
/// Clutter whose variance is below this part of the noise's does not matter.
pub(super) const LEAST_CLUTTER: f64 = 0.5;
/// Least standard deviation of colours: half a level is what rounding leaves of a uniform wall.
const LEAST_COLOR_STD: f64 = 0.5;

/// A disc with a soft edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disc {
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) radius_px: f64,
    pub(super) edge_px: f64,
}

/// Whether clutter behind the ball is told from what is beside it, or taken as noise: enough as long as it is not clear
/// where the ball is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clutter {
    Predicted,
    AsNoise,
}

/// Ratio of a colour's variance to what was expected beyond which it is another wall.
const MOST_CHANGE: f64 = 2.0;
/// Parts of a turn by which clutter is remembered.
const SECTORS: usize = 16;

/// What was behind a ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Background {
    plane: Plane,
    colors: [Plane; 2],
    color_variance: [f64; 2],
    clutter: f64,
    /// Robust scales of what is left of brightness and colours.
    scales: [f64; 3],
    /// How far what is predicted of clutter may be off, by the direction from the ball.
    deviation: [f32; SECTORS],
}

/// The part of a turn in which a direction lies, by what [`turn`] gives.
fn sector(turn: f64) -> usize {
    (((turn + 2.0) * (0.25 * SECTORS as f64)) as usize).min(SECTORS - 1)
}

/// A number that grows with the angle of a direction, over one turn from -2 to 2.
pub(super) fn turn(x: f64, y: f64) -> f64 {
    let across = x / (x.abs() + y.abs()).max(f64::MIN_POSITIVE);
    if y < 0.0 { across - 1.0 } else { 1.0 - across }
}

/// A plane's value at a place of the patch, by its coefficients from the disc's middle.
fn level_of(plane: &Plane, disc: &Disc) -> impl Fn((f64, f64)) -> f32 + use<> {
    let (plane, middle) = (*plane, (disc.x_px, disc.y_px));
    move |(x, y)| on(&plane, x - middle.0, y - middle.1) as f32
}

/// A plane that is level.
fn of_mean(fitted: &Fitted<f64>) -> Fitted<Plane> {
    let Fitted { middle, square, scale } = *fitted;
    Fitted { middle: Plane::new(middle, 0.0, 0.0), square, scale }
}

/// Square of the distance from the disc's middle as far as which the background is looked at.
fn reach_px2(disc: &Disc) -> f32 {
    let reach_px = disc.radius_px + (3.0 + RING_EDGES) * disc.edge_px;
    (reach_px * reach_px) as f32
}

/// Working space and result.
#[derive(Debug, Clone, Default)]
pub(super) struct Surroundings {
    /// Brightness of the pixels near the ball but free of it, by their place from its centre.
    free: Scattered,
    free_colors: Scattered,
    kriging: Kriging,
    /// Places of the pixels of a rim that was foreseen, from the disc's middle.
    rim_px: Vec<(f32, f32)>,
    plane: Plane,
    /// Brightness expected behind each pixel of the rim.
    pub(super) mean: Vec<f32>,
    /// Covariance of that, in the rim's order; empty without clutter.
    pub(super) covariance: Banded,
    /// Standard deviation of the clutter.
    pub(super) clutter: f64,
    /// That of what is not predicted, where it is taken as noise.
    pub(super) unpredicted: f64,
    /// Brightness in the middle of the plane.
    pub(super) level: f64,
    /// The middle of the planes.
    middle: (f64, f64),
    colors: [Plane; 2],
    pub(super) color_variance: [f64; 2],
    /// Robust scales of what is left of brightness and colours.
    scales: [f64; 3],
}

impl Surroundings {
    /// Estimates the background at the `rim` pixels, which are sorted by their angle around the disc, from how far the
    /// disc covers each pixel and each colour sample of the patch; None with too few free ones.
    #[inline(always)]
    pub(super) fn estimate<S: Simd>(
        &mut self,
        simd: S,
        (patch, disc): (&Patch, &Disc),
        (rim, covered): (&[u32], &[f32]),
        color_covered: &[f32],
        (noise_variance, treated): (f64, Clutter),
    ) -> Option<()> {
        self.find_free((patch, disc), covered);
        let fitted = self.free.plane(simd, noise_variance.sqrt())?;
        let square = self.take_plane(&fitted, disc, noise_variance);
        let level = level_of(&self.plane, disc);
        self.mean.clear();
        self.mean.extend(rim.iter().map(|i| level(patch.place(*i as usize))));
        let clutter = square - noise_variance;
        self.unpredicted = if treated == Clutter::AsNoise { self.clutter } else { 0.0 };
        self.covariance.clear();
        if treated == Clutter::Predicted && clutter > LEAST_CLUTTER * noise_variance {
            let spread = Spread { clutter: self.clutter, noise_variance };
            self.kriging.weigh(simd, (patch, disc.edge_px, spread), (rim, covered), level)?;
            self.kriging.predict(simd, self.clutter, &mut self.mean)?;
            self.kriging.correlate(&mut self.covariance);
        }
        self.color_planes(simd, patch, color_covered, reach_px2(disc))
    }

    /// Finds the pixels near the ball but free of it.
    #[inline(always)]
    fn find_free(&mut self, (patch, disc): (&Patch, &Disc), covered: &[f32]) {
        let reach_px2 = reach_px2(disc);
        self.free.begin(patch.bright.len());
        let rows = patch.bright.chunks_exact(patch.columns).zip(covered.chunks_exact(patch.columns));
        for (row, (brights, covered)) in rows.enumerate() {
            let y = (row as f64 - disc.y_px) as f32;
            for (column, (bright, covered)) in brights.iter().zip(covered).enumerate() {
                let x = (column as f64 - disc.x_px) as f32;
                let counts = (*covered < CLEAR) & (x * x + y * y < reach_px2);
                self.free.offer((x, y), row * patch.columns + column, *bright, counts);
            }
        }
        self.free.finish();
    }

    /// Takes a plane of brightness and the clutter on it; the mean square of what it leaves.
    fn take_plane(&mut self, fitted: &Fitted<Plane>, disc: &Disc, noise_variance: f64) -> f64 {
        (self.plane, self.level) = (fitted.middle, fitted.middle.x);
        self.middle = (disc.x_px, disc.y_px);
        self.scales[0] = fitted.scale;
        self.clutter = (fitted.square - noise_variance).max(0.0).sqrt();
        fitted.square
    }

    /// Takes the background at the rim of a ball that is yet to be seen to be what it last was: sets of what is predicted what does not
    /// depend on the image.
    #[inline(always)]
    pub(super) fn foresee<S: Simd>(
        &mut self,
        simd: S,
        (patch, disc): (&Patch, &Disc),
        (rim, by_angle): (&[u32], &[(f64, u32)]),
        (covered, color_covered): (&[f32], &[f32]),
        (background, noise_variance): (&Background, f64),
    ) -> Option<()> {
        let Background { plane, colors, color_variance, clutter, deviation, scales } = *background;
        self.scales = scales;
        self.find_free((patch, disc), covered);
        self.free_colors.choose(color_covered, CLEAR);
        (self.plane, self.level, self.middle) = (plane, plane.x, (disc.x_px, disc.y_px));
        (self.colors, self.color_variance) = (colors, color_variance);
        (self.clutter, self.unpredicted) = (clutter, 0.0);
        let level = level_of(&plane, disc);
        self.rim_px.clear();
        self.rim_px.extend(rim.iter().map(|i| {
            let (x, y) = patch.place(*i as usize);
            ((x - disc.x_px) as f32, (y - disc.y_px) as f32)
        }));
        self.level_rim();
        self.covariance.clear();
        if clutter * clutter > LEAST_CLUTTER * noise_variance {
            let spread = Spread { clutter, noise_variance };
            self.kriging.weigh(simd, (patch, disc.edge_px, spread), (rim, covered), level)?;
            self.kriging.find_wanted((patch.columns, disc));
            self.kriging.expect(by_angle.iter().map(|(turn, _)| deviation[sector(*turn)]));
            self.kriging.correlate(&mut self.covariance);
        }
        Some(())
    }

    /// Sets the mean behind the rim that was foreseen to the plane.
    #[inline(always)]
    fn level_rim(&mut self) {
        let [level, by_x, by_y] = [self.plane.x, self.plane.y, self.plane.z].map(|value| value as f32);
        self.mean.clear();
        self.mean.extend(self.rim_px.iter().map(|(x, y)| level + by_x * x + by_y * y));
    }

    /// Estimates the background at the rim that was foreseen; whether its colours vary as they did. None with too few free pixels, and
    /// where there is clutter that was not expected.
    #[inline(always)]
    pub(super) fn look<S: Simd>(
        &mut self,
        simd: S,
        (patch, disc): (&Patch, &Disc),
        noise_variance: f64,
    ) -> Option<bool> {
        self.free.take(&patch.bright);
        let fitted = self.free.refine(simd, (&self.plane, self.scales[0]), noise_variance.sqrt())?;
        let square = self.take_plane(&fitted, disc, noise_variance);
        self.level_rim();
        if self.covariance.len() > 0 {
            self.kriging.take_wanted(patch, &self.plane);
            self.kriging.predict(simd, self.clutter, &mut self.mean)?;
        } else if square - noise_variance > LEAST_CLUTTER * noise_variance {
            return None;
        }
        let expected = self.color_variance;
        let near = [0, 1].map(|k| (self.colors[k].x, self.scales[k + 1]));
        let means = self.free_colors.refine_means(simd, &patch.colors, near, LEAST_COLOR_STD)?;
        self.take_colors(&means.map(|fitted| of_mean(&fitted)));
        let ratio = |k: usize| self.color_variance[k].max(noise_variance) / expected[k].max(noise_variance);
        let is_as_expected = |k: usize| (MOST_CHANGE.recip()..=MOST_CHANGE).contains(&ratio(k));
        Some(is_as_expected(0) && is_as_expected(1))
    }

    /// Sets the covariance of what is predicted of a rim that was foreseen as it was looked at.
    #[inline(always)]
    pub(super) fn correlate(&mut self) {
        if self.covariance.len() > 0 {
            self.kriging.correlate(&mut self.covariance);
        }
    }

    /// How far what is predicted at each rim pixel may be off: standard deviations.
    pub(super) fn deviation(&self) -> &[f32] {
        self.kriging.deviation()
    }

    /// What was seen, for the next frame: of clutter by the direction from the ball.
    pub(super) fn background(&self, by_angle: &[(f64, u32)]) -> Background {
        let (mut sums, mut counts) = ([0.0_f32; SECTORS], [0.0_f32; SECTORS]);
        if self.covariance.len() > 0 {
            for ((turn, _), deviation) in by_angle.iter().zip(self.kriging.deviation()) {
                sums[sector(*turn)] += deviation * deviation;
                counts[sector(*turn)] += 1.0;
            }
        }
        let mut deviation = [self.clutter as f32; SECTORS];
        for ((out, sum), count) in deviation.iter_mut().zip(sums).zip(counts) {
            if count > 0.0 {
                *out = (sum / count).sqrt();
            }
        }
        let Self { plane, colors, color_variance, clutter, scales, .. } = *self;
        Background { plane, colors, color_variance, clutter, scales, deviation }
    }

    /// Whether there is the time that a still leaves: then lines beside the ball are followed behind it.
    pub(super) fn in_still(&self) -> bool {
        self.kriging.along_lines
    }

    /// Takes the time of a still.
    pub(super) fn take_time(&mut self) {
        self.kriging.along_lines = true;
    }

    /// Brightness and colour differences in the middle.
    pub(super) fn around(&self) -> [f64; 3] {
        [self.level, self.colors[0].x, self.colors[1].x]
    }

    /// Standard deviation of the clutter near a pixel; that of all around where it is not predicted or nothing near is free.
    pub(super) fn clutter_near(&self, patch: &Patch, pixel: usize, noise_variance: f64) -> f32 {
        let near = || self.kriging.clutter_near(patch, pixel, noise_variance);
        let is_known = self.in_still() && self.covariance.len() > 0;
        is_known.then(near).flatten().unwrap_or(self.clutter) as f32
    }

    /// Colour differences expected behind the ball at a place.
    #[inline(always)]
    pub(super) fn colors_at(&self, (x_px, y_px): (f64, f64)) -> [f64; 2] {
        let (x, y) = (x_px - self.middle.0, y_px - self.middle.1);
        [on(&self.colors[0], x, y), on(&self.colors[1], x, y)]
    }

    /// The same as planes over the patch: level at its first pixel and slopes.
    pub(super) fn colors_from_corner(&self) -> [[f64; 3]; 2] {
        let (x, y) = self.middle;
        self.colors.map(|plane| [on(&plane, -x, -y), plane.y, plane.z])
    }

    #[inline(always)]
    fn color_planes<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        covered: &[f32],
        reach_px2: f32,
    ) -> Option<()> {
        if !self.kriging.along_lines {
            let means = self.free_colors.means(simd, &patch.colors, (covered, CLEAR), LEAST_COLOR_STD)?;
            self.take_colors(&means.map(|fitted| of_mean(&fitted)));
            return Some(());
        }
        let mut planes = [None; 2];
        for (channel, plane) in planes.iter_mut().enumerate() {
            self.free_colors.begin(patch.colors.len());
            let rows =
                patch.colors.chunks_exact(patch.block_columns).zip(covered.chunks_exact(patch.block_columns));
            for (row, (values, covered)) in rows.enumerate() {
                let (left, y) = patch.block_place(row * patch.block_columns);
                let (left, y) = ((left - self.middle.0) as f32, (y - self.middle.1) as f32);
                for (column, (value, covered)) in values.iter().zip(covered).enumerate() {
                    let x = left + (column * patch.step) as f32;
                    let counts = (*covered < CLEAR) & (x * x + y * y < reach_px2);
                    self.free_colors.offer(
                        (x, y),
                        row * patch.block_columns + column,
                        value[channel],
                        counts,
                    );
                }
            }
            self.free_colors.finish();
            *plane = self.free_colors.plane(simd, LEAST_COLOR_STD);
        }
        let [Some(across), Some(along)] = planes else { return None };
        self.take_colors(&[across, along]);
        Some(())
    }

    fn take_colors(&mut self, fitted: &[Fitted<Plane>; 2]) {
        for (channel, fitted) in fitted.iter().enumerate() {
            self.colors[channel] = fitted.middle;
            self.color_variance[channel] = fitted.square;
            self.scales[channel + 1] = fitted.scale;
        }
    }
}
