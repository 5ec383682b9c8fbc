//! Following every marker from frame to frame.

use crate::centre::LEAST_RADIUS_PX;
use crate::color::{ColorModel, Seen, to_linear};
use crate::detect::{Expected, Sighting, Workspace, is_measurable};
use crate::optics::Known;
use crate::segment::Window;
use crate::{BallCandidate, BallColor, Frame, Vector2, VisionError};
use mavsight_geometry::Camera;
use std::ops::RangeInclusive;

/// Frames without a sighting after which a marker's motion is no longer extrapolated.
const MOST_MISSED: u32 = 5;

/// Change of size or brightness between sightings beyond which it is another thing: half a stop of shade, or the range
/// changing by half.
const MOST_CHANGE: f64 = 1.6;
/// Sightings over which the apparent radius is averaged: a third of a second of video.
const RADIUS_MEMORY: u32 = 10;
/// Standard deviation of the change of the range from frame to frame, as a part of it: a metre a second at six metres
/// and thirty frames a second.
const RADIUS_CHANGE: f64 = 0.005;

/// Finds each marker in each frame of one camera, near where it is expected if possible.
///
/// A marker that is not seen is None; nothing is ever guessed.
#[derive(Debug, Clone)]
pub struct Tracker {
    model: ColorModel,
    range_px: (f64, f64),
    tracks: Vec<Track>,
    workspace: Workspace,
    found: Vec<Sighting>,
    sightings: Vec<Option<BallCandidate>>,
}

/// What is known of one marker.
#[derive(Debug, Clone, Default)]
struct Track {
    last: Option<BallCandidate>,
    velocity_px: Option<Vector2<f64>>,
    missed: u32,
    /// Sum of the linear colours seen, for the mean.
    colors: [f32; 3],
    seen: u32,
    mean_radius_px: f64,
    expected: Option<Expected>,
    external: Option<Vector2<f64>>,
}

impl Tracker {
    /// A tracker of markers whose apparent diameters stay in the range.
    ///
    /// # Errors
    /// As [`crate::Detector::new`], and [`VisionError::DiameterRange`] if no ball in the range can be measured.
    pub fn new(colors: &[BallColor], expected_diameter_px: RangeInclusive<f64>) -> Result<Self, VisionError> {
        let (smallest_px, largest_px) = (*expected_diameter_px.start(), *expected_diameter_px.end());
        let needed_px = 2.0 * LEAST_RADIUS_PX;
        if !is_measurable((smallest_px, largest_px)) {
            return Err(VisionError::DiameterRange { smallest_px, largest_px, needed_px });
        }
        let model = ColorModel::new(colors)?;
        Ok(Self {
            model,
            range_px: (smallest_px, largest_px),
            tracks: vec![Track::default(); colors.len()],
            workspace: Workspace::default(),
            found: Vec::new(),
            sightings: vec![None; colors.len()],
        })
    }

    /// The same for a camera that is known: the images of balls are stretched as it does. Without, it is taken to have a
    /// horizontal field of view of 60°.
    #[must_use]
    pub fn with_camera(mut self, camera: Camera) -> Self {
        self.workspace.camera = Some(camera);
        self
    }

    /// States where a marker should appear in the next frame, for instance by projecting a predicted pose.
    ///
    /// Used for that frame alone; a marker number that does not exist and a pixel that is not finite are ignored.
    pub fn predict(&mut self, marker: usize, pixel: Vector2<f64>) {
        if let Some(track) = self.tracks.get_mut(marker)
            && pixel.iter().all(|v| v.is_finite())
        {
            track.external = Some(pixel);
        }
    }

    /// Looks for every marker in the next frame: one entry a marker, None where it is not seen.
    pub fn observe(&mut self, frame: &Frame) -> &[Option<BallCandidate>] {
        let mut lost = false;
        for marker in 0..self.tracks.len() {
            self.sightings[marker] = self.near_prediction(frame, marker);
            lost |= self.sightings[marker].is_none();
        }
        if lost {
            self.whole_frame(frame);
        }
        for marker in 0..self.tracks.len() {
            let sighting = self.sightings[marker];
            self.tracks[marker].advance(sighting);
            if let Some(ball) = sighting {
                self.tracks[marker].learn(&ball);
                self.model.learn(marker, &Seen::of(self.tracks[marker].colors));
            }
        }
        &self.sightings
    }

    fn near_prediction(&mut self, frame: &Frame, marker: usize) -> Option<BallCandidate> {
        let (middle, reach_px) = self.tracks[marker].search(self.range_px)?;
        self.workspace.segmenter.collect(frame, &Window::around(frame, middle, reach_px));
        self.workspace.expected = self.tracks[marker].expected(middle);
        self.workspace.search(frame, &self.model, marker, self.range_px, &mut self.found);
        self.workspace.expected = None;
        let track = &self.tracks[marker];
        let near = |ball: &BallCandidate| (ball.pixel - middle).norm() <= reach_px && track.agrees(ball);
        let sighting = self.found.iter().copied().find(|sighting| near(&sighting.ball))?;
        let (taken, found) = sighting.optics;
        self.workspace.optics.learn(taken, found);
        self.tracks[marker].expected = Some(sighting.expected);
        Some(sighting.ball)
    }

    fn whole_frame(&mut self, frame: &Frame) {
        self.workspace.segmenter.collect(frame, &Window::whole(frame));
        for marker in 0..self.tracks.len() {
            if self.sightings[marker].is_some() {
                continue;
            }
            self.workspace.search(frame, &self.model, marker, self.range_px, &mut self.found);
            let track = &self.tracks[marker];
            let sightings = &self.sightings;
            let free = |ball: &BallCandidate| {
                sightings
                    .iter()
                    .flatten()
                    .all(|other| (other.pixel - ball.pixel).norm() > 0.25 * ball.diameter_px)
            };
            self.sightings[marker] =
                self.found.iter().map(|sighting| sighting.ball).find(|ball| track.agrees(ball) && free(ball));
        }
    }
}

impl Track {
    /// Where to look and how far around; None if nothing is known.
    fn search(&self, range_px: (f64, f64)) -> Option<(Vector2<f64>, f64)> {
        let diameter_px = if self.seen > 0 { 2.0 * self.mean_radius_px } else { range_px.1 };
        let expected = match (self.external, self.last) {
            (Some(pixel), _) => pixel,
            (None, Some(last)) if self.missed <= MOST_MISSED => {
                last.pixel + self.velocity_px.unwrap_or_default() * f64::from(self.missed + 1)
            }
            _ => return None,
        };
        // Room for the ball with its rim, and for the motion that is not foreseen: another diameter a frame.
        Some((expected, diameter_px * (1.5 + f64::from(self.missed)) + 2.0))
    }

    /// What to expect of the ball; None before it was first followed.
    fn expected(&self, middle: Vector2<f64>) -> Option<Expected> {
        let expected = self.expected?;
        let known = expected.radius_px;
        let change_px = RADIUS_CHANGE * f64::from(self.missed + 1) * known.mean;
        let radius_px = Known { variance: known.variance + change_px * change_px, ..known };
        Some(Expected { radius_px, pixel: self.velocity_px.map(|_| middle), ..expected })
    }

    /// Whether a ball is of about the size and brightness of the one followed.
    fn agrees(&self, ball: &BallCandidate) -> bool {
        if self.seen == 0 {
            return true;
        }
        let brightness = |light: [f32; 3]| light[0] + light[1] + light[2];
        let ratio = brightness(to_linear(ball.color)) * self.seen as f32 / brightness(self.colors);
        let size = 0.5 * ball.diameter_px / self.mean_radius_px;
        (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&size)
            && (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&f64::from(ratio))
    }

    fn advance(&mut self, sighting: Option<BallCandidate>) {
        self.external = None;
        match (sighting, self.last) {
            (Some(ball), Some(last)) => {
                let frames = f64::from(self.missed + 1);
                self.velocity_px = (self.missed <= MOST_MISSED).then(|| (ball.pixel - last.pixel) / frames);
                self.last = sighting;
                self.missed = 0;
            }
            (Some(_), None) => self.last = sighting,
            (None, Some(_)) => self.missed = self.missed.saturating_add(1),
            (None, None) => {}
        }
    }

    fn learn(&mut self, ball: &BallCandidate) {
        for (sum, value) in self.colors.iter_mut().zip(to_linear(ball.color)) {
            *sum += value;
        }
        self.seen += 1;
        let gain = 1.0 / f64::from(self.seen.min(RADIUS_MEMORY));
        self.mean_radius_px += gain * (0.5 * ball.diameter_px - self.mean_radius_px);
    }
}
