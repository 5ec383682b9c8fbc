//! Finding balls of given colours in a whole frame.

use crate::centre::{CentreFit, FitPolicy, Fitter, Followed, LEAST_RADIUS_PX, Start, encode_one};
use crate::color::{ColorModel, Seen, to_linear};
use crate::optics::{Known, Learned, Optics};
use crate::outline::{Outline, up_as_seen, usual_camera};
use crate::patch::Patch;
use crate::segment::{Region, Segmenter};
use crate::window::Window;
use crate::{BallColor, Frame, Matrix2, Vector2, VisionError};
use mavsight_geometry::Camera;
use std::ops::{Range, RangeInclusive};

/// A region that looks like a ball of a marker's colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Centre of the outline.
    pub pixel: Vector2<f64>,
    /// Covariance of the centre.
    pub covariance_px2: Matrix2<f64>,
    /// Coloured pixels of the region.
    pub area_px: f64,
    /// Diameter of the fitted disc.
    pub diameter_px: f64,
    /// How well colour and shape agree with a ball of that marker: 0 (not at all) to 1.
    pub score: f64,
    /// Mean colour of the fitted disc, sRGB-coded.
    pub color: [u8; 3],
}

/// Regions of one colour that are looked at closely in one frame, the strongest first.
const MOST_REGIONS: usize = 16;

/// Gates that the mean hue of a region, edges included, may be from the marker's before it is looked at
/// closely.
const LOOSE_GATE: f64 = 2.0;
/// Pixels around a region that are looked at: the blur of the rim and a ring of background beyond it.
const RING_PX: f64 = 5.0;

/// How far from where its region shows it a ball may be predicted: the middle of a region is known to about a
/// quarter of this.
const AS_PREDICTED_PX: f64 = 0.5;

/// Searches whole frames for balls of given colours.
#[derive(Debug, Clone)]
pub struct Detector {
    model: ColorModel,
    workspace: Workspace,
}

/// Working space of a search, reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Workspace {
    pub(crate) segmenter: Segmenter,
    patch: Patch,
    fitter: Fitter,
    /// What followed balls showed of the lens and the encoder.
    pub(crate) optics: Learned,
    /// The camera, where it is known.
    pub(crate) camera: Option<Camera>,
    /// The ball that is followed, where one is.
    pub(crate) expected: Option<Expected>,
    /// Centres and radii of what is known already and is not looked at again.
    pub(crate) known: Vec<(Vector2<f64>, f64)>,
    /// Rows in which a region's middle must lie to be looked at, where not all count.
    pub(crate) rows: Option<Range<usize>>,
}

/// What is known of a ball from the frames before.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    pub(crate) radius_px: Known,
    /// How it looked.
    pub(crate) followed: Followed,
    /// Where its motion takes it.
    pub(crate) pixel: Option<Vector2<f64>>,
    /// From the middle of its region to its centre.
    pub(crate) from_region_px: Vector2<f64>,
}

impl Detector {
    /// A detector of the given colours.
    ///
    /// # Errors
    /// [`VisionError::ColorsTooClose`] naming two markers of one hue, [`VisionError::ColorTooGrey`] for a
    /// marker without one, [`VisionError::NoMarkers`] for an empty list.
    pub fn new(colors: &[BallColor]) -> Result<Self, VisionError> {
        let workspace = Workspace { fitter: Fitter::new(FitPolicy::STILL), ..Workspace::default() };
        Ok(Self { model: ColorModel::new(colors)?, workspace })
    }

    /// The same for a camera that is known, or nearly: the images of balls are stretched as it does, and
    /// lamps are looked for above, along the world's z. Without, it is taken to have a horizontal field of
    /// view of 60°, and lamps may be anywhere.
    #[must_use]
    pub fn with_camera(mut self, camera: Camera) -> Self {
        self.workspace.camera = Some(camera);
        self
    }

    /// Every region that may be a ball with an apparent diameter in the range: one list a colour, best first.
    ///
    /// A ball that is not seen yields an empty list. Balls below 3 px are not measured, whatever the range; a
    /// range that is not finite or does not reach 3 px yields nothing at all.
    pub fn detect(
        &mut self,
        frame: &Frame,
        expected_diameter_px: RangeInclusive<f64>,
    ) -> Vec<Vec<Detection>> {
        let range_px = (*expected_diameter_px.start(), *expected_diameter_px.end());
        let mut lists = vec![Vec::new(); self.model.len()];
        if !is_measurable(range_px) {
            return lists;
        }
        let workspace = &mut self.workspace;
        workspace.segmenter.collect(frame, &Window::whole(frame));
        let mut found = Vec::new();
        for (marker, list) in lists.iter_mut().enumerate() {
            workspace.search(frame, &self.model, marker, range_px, &mut found);
            list.extend(found.iter().map(|found_ball| found_ball.detection));
        }
        lists
    }
}

/// Whether a range of diameters is one, and holds a ball whose centre can be fitted.
pub(crate) fn is_measurable((smallest_px, largest_px): (f64, f64)) -> bool {
    smallest_px > 0.0
        && smallest_px <= largest_px
        && largest_px.is_finite()
        && largest_px >= 2.0 * LEAST_RADIUS_PX
}

impl Workspace {
    /// Balls of one marker among the collected pixels, best first.
    pub(crate) fn search(
        &mut self,
        frame: &Frame,
        model: &ColorModel,
        marker: usize,
        range_px: (f64, f64),
        found: &mut Vec<Found>,
    ) {
        found.clear();
        self.segmenter.regions(model, marker, area_gate_px(range_px));
        let regions = &mut self.segmenter.regions_found;
        regions.sort_unstable_by(|a, b| b.strength.total_cmp(&a.strength));
        regions.truncate(MOST_REGIONS);
        let optics = self.optics.expected();
        let camera = self.camera.unwrap_or_else(|| usual_camera(frame.size));
        for region in regions.iter() {
            let within = |at: &Vector2<f64>, radius_px: f64| (at - region.pixel).norm() <= radius_px;
            // A part of a ball that has been found whole is no other.
            let is_known = self.known.iter().any(|(at, radius_px)| within(at, *radius_px))
                || found.iter().any(|s| within(&s.detection.pixel, 0.5 * s.detection.diameter_px));
            let is_elsewhere = self.rows.as_ref().is_some_and(|r| !r.contains(&(region.pixel.y as usize)));
            if is_known || is_elsewhere || model.gate_fraction(marker, &region.seen()) > LOOSE_GATE {
                continue;
            }
            let fit = {
                let start = start_in(&camera, self.camera.as_ref(), optics, start(frame, region, range_px));
                self.patch.fill(frame, region.pixel, start.radius_px + RING_PX);
                let range_px = (0.5 * range_px.0, (0.5 * range_px.1).min(largest_radius_px(region.area_px)));
                let followed = self.expected.and_then(|expected| {
                    let seen = region.pixel + expected.from_region_px;
                    let predicted = expected.pixel.filter(|p| (p - seen).norm() < AS_PREDICTED_PX);
                    let pixel = predicted.unwrap_or(seen);
                    self.fitter.fit(&self.patch, range_px, &expected.start(Start { pixel, ..start })).ok()
                });
                let known_radius_px = self.expected.map(|e| e.radius_px);
                let start = Start { known_radius_px, ..start };
                followed.or_else(|| self.fitter.fit(&self.patch, range_px, &start).ok())
            };
            found.extend(fit.and_then(|fit| {
                let from_region_px = fit.pixel - region.pixel;
                found_ball(frame, (model, marker), &fit, (from_region_px, region.area_px))
            }));
        }
        found.sort_unstable_by(|a, b| b.detection.score.total_cmp(&a.detection.score));
    }
}

/// What a fit says of a ball of the marker, with where in its region it was seen; None if it is none.
fn found_ball(
    frame: &Frame,
    model: (&ColorModel, usize),
    fit: &CentreFit,
    (from_region_px, area_px): (Vector2<f64>, f64),
) -> Option<Found> {
    judge(frame, area_px, model, fit).map(|detection| Found {
        detection,
        expected: Expected { radius_px: fit.radius_px, followed: fit.followed, pixel: None, from_region_px },
        optics: (fit.taken, fit.optics),
    })
}

impl Expected {
    /// Where a fit begins that knows this.
    fn start(&self, start: Start) -> Start {
        Start { known_radius_px: Some(self.radius_px), followed: Some(self.followed), ..start }
    }
}

/// The same in an image whose optics are known as far as that.
fn start_in(usual: &Camera, camera: Option<&Camera>, optics: Optics, start: Start) -> Start {
    let outline = Outline::at(usual, &start.pixel);
    let up = camera.and_then(|camera| up_as_seen(camera, &start.pixel));
    Start { optics, outline, up, ..start }
}

/// Part of a disc's pixels that are coloured at least: two thirds of them may be lost to blur, glare or an
/// arm.
const LEAST_COLORED: f64 = 1.0 / 3.0;

/// Radius of the largest ball of which a region of so many coloured pixels may be what is seen.
fn largest_radius_px(area_px: f64) -> f64 {
    (area_px / (LEAST_COLORED * std::f64::consts::PI)).sqrt()
}

/// Coloured pixels that a disc of the expected diameters yields, of which a rim of one pixel more may be
/// tinged.
fn area_gate_px((smallest_px, largest_px): (f64, f64)) -> (f64, f64) {
    let disc = |diameter_px: f64| 0.25 * std::f64::consts::PI * diameter_px * diameter_px;
    let smallest = smallest_px.max(2.0 * LEAST_RADIUS_PX);
    (LEAST_COLORED * disc(smallest), disc(largest_px + 2.0))
}

/// Where the fit of a region's ball begins.
fn start(frame: &Frame, region: &Region, range_px: (f64, f64)) -> Start {
    let least_px = (0.5 * range_px.0).max(LEAST_RADIUS_PX);
    let radius_px = (region.area_px / std::f64::consts::PI).sqrt().clamp(least_px, 0.5 * range_px.1);
    let clamp = |v: f64, count: u32| v.round().clamp(0.0, f64::from(count.max(1) - 1)) as usize;
    let x = clamp(region.pixel.x, frame.size.width_px);
    let y = clamp(region.pixel.y, frame.size.height_px);
    Start {
        pixel: region.pixel,
        radius_px,
        ball: to_linear(frame.rgb(x, y)),
        optics: Optics::default(),
        outline: Outline::ROUND,
        up: None,
        known_radius_px: None,
        followed: None,
    }
}

/// A fitted ball with what it says of the camera and of itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    pub(crate) detection: Detection,
    pub(crate) expected: Expected,
    /// Optics taken as known, and found.
    pub(crate) optics: (Optics, Optics),
}

/// Whether a fitted disc is a ball of the marker, and how well it agrees.
fn judge(
    frame: &Frame,
    area_px: f64,
    (model, marker): (&ColorModel, usize),
    fit: &CentreFit,
) -> Option<Detection> {
    let radius_px = fit.radius_px.mean;
    if !frame.size.contains(&fit.pixel, radius_px) {
        return None;
    }
    let seen = Seen::of(fit.ball);
    let gate = model.gate_fraction(marker, &seen);
    if !seen.is_colored() || gate > 1.0 {
        return None;
    }
    let disc_px = std::f64::consts::PI * radius_px * radius_px;
    let filled = (area_px / disc_px).min(disc_px / area_px);
    Some(Detection {
        pixel: fit.pixel,
        covariance_px2: fit.covariance_px2,
        area_px,
        diameter_px: 2.0 * radius_px,
        score: (1.0 - 0.5 * gate) * filled.sqrt() * fit.trusted,
        color: fit.ball.map(|light| encode_one(light).0.round().clamp(0.0, 255.0) as u8),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_region_may_be_the_smallest_ball_and_a_whole_disc_one_of_its_own_size() {
        for smallest_px in [3.0, 5.5, 20.0] {
            let (least_px, most_px) = area_gate_px((smallest_px, 40.0));
            assert!((largest_radius_px(least_px) / (0.5 * smallest_px) - 1.0).abs() < 1e-12);
            assert!(largest_radius_px(most_px) > 20.0);
        }
        assert!((largest_radius_px(std::f64::consts::PI) - 3f64.sqrt()).abs() < 1e-12);
    }
}
