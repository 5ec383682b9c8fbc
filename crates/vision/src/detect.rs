//! Finding balls of given colours in a whole frame.

use crate::centre::{self, LEAST_RADIUS_PX, Siting, Start};
use crate::color::{ColorModel, Seen, encode, to_linear};
use crate::patch::Patch;
use crate::segment::{Blob, Segmenter, Window};
use crate::{BallColor, Frame, Matrix2, Vector2, VisionError};
use std::ops::RangeInclusive;

/// A region that looks like a ball of a marker's colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallCandidate {
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
    /// Colour in the middle of the fitted disc, sRGB-coded.
    pub color: [u8; 3],
}

/// Regions of one colour that are looked at closely in one frame, the strongest first.
const MOST_BLOBS: usize = 16;

/// Gates that the mean hue of a region, edges included, may be from the marker's before it is looked at closely.
const LOOSE_GATE: f64 = 2.0;
/// Least standard deviation of the siting that is learned.
const LEAST_SITING_STD_PX: f64 = 0.02;

/// Searches whole frames for balls of given colours.
#[derive(Debug, Clone)]
pub struct Detector {
    model: ColorModel,
}

/// Working space of a search, reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Workspace {
    pub(crate) segmenter: Segmenter,
    patch: Patch,
    pub(crate) siting: Siting,
    /// Mean and standard deviation of the radius of the ball that is followed.
    pub(crate) known_radius_px: Option<(f64, f64)>,
}

impl Detector {
    /// A detector of the given colours.
    ///
    /// # Errors
    /// [`VisionError::ColorsTooClose`] naming two markers of one hue, [`VisionError::ColorTooGrey`] for a marker
    /// without one, [`VisionError::NoMarkers`] for an empty list.
    pub fn new(colors: &[BallColor]) -> Result<Self, VisionError> {
        Ok(Self { model: ColorModel::new(colors)? })
    }

    /// Every region that may be a ball with an apparent diameter in the range: one list a colour, best first.
    ///
    /// A ball that is not seen yields an empty list. Balls below 3 px are not measured, whatever the range; a range
    /// that is not finite or does not reach 3 px yields nothing at all.
    pub fn candidates(
        &self,
        frame: &Frame,
        expected_diameter_px: RangeInclusive<f64>,
    ) -> Vec<Vec<BallCandidate>> {
        let range_px = (*expected_diameter_px.start(), *expected_diameter_px.end());
        let mut lists = vec![Vec::new(); self.model.len()];
        if !is_measurable(range_px) {
            return lists;
        }
        let mut workspace = Workspace::default();
        workspace.segmenter.collect(frame, &Window::whole(frame));
        let mut found = Vec::new();
        for (marker, list) in lists.iter_mut().enumerate() {
            workspace.search(frame, &self.model, marker, range_px, &mut found);
            list.extend(found.iter().map(|(candidate, _)| *candidate));
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
    /// Keeps what a followed ball tells of the siting of colour differences, a property of the encoder.
    ///
    /// It is never taken to be known better than the model of an edge is good for.
    pub(crate) fn learn_siting(&mut self, siting: Siting) {
        let floor_px2 = LEAST_SITING_STD_PX * LEAST_SITING_STD_PX;
        self.siting = Siting { variance_px2: siting.variance_px2.max(floor_px2), ..siting };
    }

    /// Balls of one marker among the collected pixels, best first.
    pub(crate) fn search(
        &mut self,
        frame: &Frame,
        model: &ColorModel,
        marker: usize,
        range_px: (f64, f64),
        found: &mut Vec<(BallCandidate, Siting)>,
    ) {
        found.clear();
        self.segmenter.regions(model, marker, area_gate_px(range_px));
        let blobs = &mut self.segmenter.blobs;
        blobs.sort_unstable_by(|a, b| b.strength.total_cmp(&a.strength));
        blobs.truncate(MOST_BLOBS);
        for blob in blobs.iter() {
            if model.gate_fraction(marker, &blob.seen()) > LOOSE_GATE {
                continue;
            }
            found.extend(measure(
                frame,
                blob,
                (model, marker),
                range_px,
                (&mut self.patch, self.siting, self.known_radius_px),
            ));
        }
        found.sort_unstable_by(|a, b| b.0.score.total_cmp(&a.0.score));
    }
}

/// Coloured pixels that a disc of the expected diameters yields: two thirds of them may be lost to blur, glare or an
/// arm, and a rim of one pixel may be tinged.
fn area_gate_px((smallest_px, largest_px): (f64, f64)) -> (f64, f64) {
    let disc = |diameter_px: f64| 0.25 * std::f64::consts::PI * diameter_px * diameter_px;
    let smallest = smallest_px.max(2.0 * LEAST_RADIUS_PX);
    (disc(smallest) / 3.0, disc(largest_px + 2.0))
}

/// Fits the ball of a region and judges it.
fn measure(
    frame: &Frame,
    blob: &Blob,
    (model, marker): (&ColorModel, usize),
    range_px: (f64, f64),
    (patch, siting, known_radius_px): (&mut Patch, Siting, Option<(f64, f64)>),
) -> Option<(BallCandidate, Siting)> {
    let radius_px = (0.5 * range_px.0, 0.5 * range_px.1);
    let start_px =
        (blob.area_px / std::f64::consts::PI).sqrt().clamp(radius_px.0.max(LEAST_RADIUS_PX), radius_px.1);
    // A ring of background about as wide as the blur can reach.
    patch.fill(frame, blob.pixel, start_px + 3.0);
    let start = Start { siting, known_radius_px, ..start_colors(frame, blob.pixel, start_px) };
    let fit = centre::fit(patch, radius_px, &start)?;
    if !frame.size.contains(&fit.pixel, fit.radius_px) {
        return None;
    }
    let seen = Seen::of(fit.ball);
    let gate = model.gate_fraction(marker, &seen);
    if !seen.is_colored() || gate > 1.0 {
        return None;
    }
    let disc_px = std::f64::consts::PI * fit.radius_px * fit.radius_px;
    let filled = (blob.area_px / disc_px).min(disc_px / blob.area_px);
    let candidate = BallCandidate {
        pixel: fit.pixel,
        covariance_px2: fit.covariance_px2,
        area_px: blob.area_px,
        diameter_px: 2.0 * fit.radius_px,
        score: (1.0 - 0.5 * gate) * filled.sqrt() * fit.trusted,
        color: fit.ball.map(|light| encode(f64::from(light)).0.round().clamp(0.0, 255.0) as u8),
    };
    Some((candidate, fit.siting))
}

/// Colours in the middle of a region and, as the mean of a ring, around it.
fn start_colors(frame: &Frame, middle: Vector2<f64>, radius_px: f64) -> Start {
    let at = |offset_x: f64, offset_y: f64| {
        let clamp = |v: f64, count: u32| v.round().clamp(0.0, f64::from(count.max(1) - 1)) as usize;
        let x = clamp(middle.x + offset_x, frame.size.width_px);
        let y = clamp(middle.y + offset_y, frame.size.height_px);
        to_linear(frame.rgb(x, y))
    };
    let ring_px = radius_px + 2.5;
    let mut background = [0.0; 3];
    const DIRECTIONS: u8 = 8;
    for i in 0..DIRECTIONS {
        let (sin, cos) = (f64::from(i) / f64::from(DIRECTIONS) * std::f64::consts::TAU).sin_cos();
        for (sum, light) in background.iter_mut().zip(at(ring_px * cos, ring_px * sin)) {
            *sum += light / f32::from(DIRECTIONS);
        }
    }
    Start { radius_px, ball: at(0.0, 0.0), background, siting: Siting::default(), known_radius_px: None }
}
