//! Following everything of a marker's colour from frame to frame.

use crate::centre::LEAST_RADIUS_PX;
use crate::color::{ColorModel, Seen, to_linear};
use crate::detect::{Expected, Workspace, is_measurable};
use crate::health::{self, BallHealth};
use crate::optics::Known;
use crate::segment::Window;
use crate::{BallCandidate, BallColor, Frame, Vector2, VisionError};
use mavsight_geometry::Camera;
use std::ops::RangeInclusive;

/// Frames without a sighting after which the motion of a ball is no longer extrapolated.
const MOST_MISSED: u32 = 5;
/// Sightings before which a ball that is missed is given up after two frames: a fleck of noise.
const FEW_SEEN: u32 = 3;

/// Change of size or brightness between sightings beyond which it is another thing: half a stop of shade, or the range
/// changing by half.
const MOST_CHANGE: f64 = 1.6;
/// Sightings over which the apparent radius is averaged: a third of a second of video.
const RADIUS_MEMORY: u32 = 10;
/// Standard deviation of the change of the range from frame to frame, as a part of it: a metre a second at six metres
/// and thirty frames a second.
const RADIUS_CHANGE: f64 = 0.005;

/// Balls that are followed beyond the markers of a colour: what of a room's things looks like one.
const MOST_OTHERS: usize = 6;
/// Frames without a diameter of motion after which a ball counts as one that stays: a second or two of video.
const STAYS_FRAMES: u64 = 45;
/// Frames between looks at the whole frame while all that is wanted is seen: a newcomer is met within a quarter second,
/// or within two frames where something else of the colour has been seen before.
const LOOK_AROUND: u64 = 8;
const LOOK_AROUND_OFTEN: u64 = 2;

/// One ball that may be a marker of a colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorSighting {
    /// Which of the tracker's colours.
    pub color: usize,
    /// The same number for the same thing from frame to frame, in one camera, for as long as it is followed.
    pub id: u32,
    /// What was seen.
    pub ball: BallCandidate,
    /// Whether it has long stayed at one place of the image.
    pub stays: bool,
    /// Whether, of what is seen of its colour, it is the most likely to be a marker: what has moved, and was followed longest.
    pub leads: bool,
}

/// Finds all that may be a marker in each frame of one camera: each thing near where it is expected, and newcomers in the
/// whole frame.
///
/// What is not seen is not there; nothing is ever guessed. Which of several balls of one colour is the marker is left to
/// who knows the other cameras and the body.
#[derive(Debug, Clone)]
pub struct Tracker {
    model: ColorModel,
    range_px: (f64, f64),
    colors: Vec<ColorState>,
    tracks: Vec<Track>,
    workspace: Workspace,
    found: Vec<crate::detect::Sighting>,
    sightings: Vec<ColorSighting>,
    leading: Vec<Option<BallCandidate>>,
    frames: u64,
    next_id: u32,
    health: Vec<BallHealth>,
    is_dark: bool,
}

/// What is known of one colour.
#[derive(Debug, Clone, Copy)]
struct ColorState {
    /// Markers of the colour.
    markers: usize,
    /// Whether more than those were once seen.
    others: bool,
}

/// What is known of one thing.
#[derive(Debug, Clone)]
struct Track {
    color: usize,
    id: u32,
    last: BallCandidate,
    velocity_px: Option<Vector2<f64>>,
    missed: u32,
    /// Sum of the linear colours seen, for the mean.
    colors: [f32; 3],
    seen: u32,
    mean_radius_px: f64,
    expected: Option<Expected>,
    /// Where it was when it last had moved by a diameter, and in which frame that was.
    place: Vector2<f64>,
    moved_at: u64,
    has_moved: bool,
}

impl Tracker {
    /// A tracker of markers, one of each colour, whose apparent diameters stay in the range.
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
            colors: vec![ColorState { markers: 1, others: false }; colors.len()],
            tracks: Vec::new(),
            workspace: Workspace::default(),
            found: Vec::new(),
            sightings: Vec::new(),
            leading: vec![None; colors.len()],
            frames: 0,
            next_id: 0,
            health: vec![BallHealth::default(); colors.len()],
            is_dark: false,
        })
    }

    /// The same for a camera that is known: the images of balls are stretched as it does. Without, it is taken to have a
    /// horizontal field of view of 60°.
    #[must_use]
    pub fn with_camera(mut self, camera: Camera) -> Self {
        self.workspace.camera = Some(camera);
        self
    }

    /// The same where several markers share a colour: how many there are of each, in the order of the colours.
    #[must_use]
    pub fn with_markers(mut self, of_color: &[usize]) -> Self {
        for (state, markers) in self.colors.iter_mut().zip(of_color) {
            state.markers = (*markers).max(1);
        }
        self
    }

    /// Looks at the next frame: all balls that may be markers, those followed longest first.
    pub fn candidates(&mut self, frame: &Frame) -> &[ColorSighting] {
        self.sightings.clear();
        self.frames += 1;
        for track in 0..self.tracks.len() {
            self.near_prediction(frame, track);
        }
        self.look_around(frame);
        self.tracks.retain(|t| t.missed <= MOST_MISSED && (t.missed < 2 || t.seen > FEW_SEEN));
        for color in 0..self.colors.len() {
            if let Some(lead) = self.lead(color) {
                let id = self.tracks[lead].id;
                self.sightings.iter_mut().filter(|s| s.id == id).for_each(|s| s.leads = true);
                self.model.learn(color, &Seen::of(self.tracks[lead].colors));
                if self.frames % health::EVERY == 1 {
                    let seen = self.sightings.iter().filter(|s| s.color == color).count();
                    let others = seen.saturating_sub(self.colors[color].markers);
                    self.health[color].look(frame, &self.model, color, &self.tracks[lead].last, others);
                }
            }
        }
        self.is_dark = self.sightings.is_empty() && health::is_dark(frame);
        &self.sightings
    }

    /// How well the balls of each colour have been seen so far.
    pub fn health(&self) -> &[BallHealth] {
        &self.health
    }

    /// Whether the last frame was dark all over.
    pub fn is_dark(&self) -> bool {
        self.is_dark
    }

    /// Standard deviation of the blur of edges, pixel included, as the balls have shown it.
    pub fn edge_px(&self) -> f64 {
        self.workspace.optics.expected().edge_px.mean
    }

    /// Looks at the next frame: for each colour the ball that has been followed longest, those that moved first; None where
    /// there is none.
    pub fn observe(&mut self, frame: &Frame) -> &[Option<BallCandidate>] {
        self.candidates(frame);
        for color in 0..self.colors.len() {
            self.leading[color] = self.lead(color).map(|t| self.tracks[t].last);
        }
        &self.leading
    }

    /// The track of a colour that is most likely a marker's, of those seen in this frame.
    fn lead(&self, color: usize) -> Option<usize> {
        let live = |t: &usize| self.tracks[*t].color == color && self.tracks[*t].missed == 0;
        (0..self.tracks.len()).filter(live).max_by(|a, b| {
            let (a, b) = (&self.tracks[*a], &self.tracks[*b]);
            (a.has_moved, a.seen).cmp(&(b.has_moved, b.seen)).then(b.id.cmp(&a.id))
        })
    }

    fn near_prediction(&mut self, frame: &Frame, index: usize) {
        let track = &self.tracks[index];
        let (middle, reach_px) = track.search();
        let color = track.color;
        self.workspace.segmenter.collect(frame, &Window::around(frame, middle, reach_px));
        self.workspace.expected = track.expected(middle);
        self.workspace.search(frame, &self.model, color, self.range_px, &mut self.found);
        self.workspace.expected = None;
        let track = &self.tracks[index];
        let agrees = |ball: &BallCandidate| {
            (ball.pixel - middle).norm() <= reach_px
                && track.agrees(ball)
                && !self.sightings.iter().any(|s| s.color == color && is_same(&s.ball, ball))
        };
        // The nearest of those that look about as much like a ball as the best.
        let agreeing = self.found.iter().filter(|s| agrees(&s.ball));
        let best = agreeing.clone().map(|s| s.ball.score).fold(0.0, f64::max);
        let away = |ball: &BallCandidate| (ball.pixel - middle).norm();
        let nearest = agreeing
            .filter(|s| s.ball.score >= 0.5 * best)
            .min_by(|a, b| away(&a.ball).total_cmp(&away(&b.ball)))
            .copied();
        let Some(sighting) = nearest else {
            self.tracks[index].missed += 1;
            return;
        };
        let (taken, found) = sighting.optics;
        self.workspace.optics.learn(taken, found);
        let track = &mut self.tracks[index];
        track.expected = Some(sighting.expected);
        track.advance(sighting.ball, self.frames);
        self.sightings.push(track.sighting(self.frames));
    }

    /// Looks for newcomers of each colour that is due in the whole frame.
    fn look_around(&mut self, frame: &Frame) {
        let mut collected = false;
        for color in 0..self.colors.len() {
            if !self.is_due(color) {
                continue;
            }
            if !collected {
                self.workspace.segmenter.collect(frame, &Window::whole(frame));
                collected = true;
            }
            self.workspace.known.clear();
            let known = self.sightings.iter().map(|s| (s.ball.pixel, 0.5 * s.ball.diameter_px));
            self.workspace.known.extend(known);
            self.workspace.search(frame, &self.model, color, self.range_px, &mut self.found);
            self.workspace.known.clear();
            for sighting in &self.found {
                let others = self.tracks.iter().filter(|t| t.color == color && t.missed == 0).count();
                if others >= self.colors[color].markers + MOST_OTHERS {
                    break;
                }
                let ball = sighting.ball;
                if self.sightings.iter().any(|s| is_same(&s.ball, &ball)) {
                    continue;
                }
                let lost = self.tracks.iter_mut().find(|t| {
                    let (middle, reach_px) = t.search();
                    t.color == color
                        && t.missed > 0
                        && t.agrees(&ball)
                        && (ball.pixel - middle).norm() <= reach_px
                });
                if let Some(track) = lost {
                    track.advance(ball, self.frames);
                    self.sightings.push(track.sighting(self.frames));
                    continue;
                }
                let track = Track::of(color, self.next_id, ball, self.frames);
                self.next_id = self.next_id.wrapping_add(1);
                self.sightings.push(track.sighting(self.frames));
                self.tracks.push(track);
            }
        }
    }

    /// Whether a colour's newcomers are to be looked for in this frame.
    fn is_due(&mut self, color: usize) -> bool {
        let own = self.tracks.iter().filter(|t| t.color == color);
        let live = own.clone().filter(|t| t.missed == 0).count();
        let lost = own.clone().any(|t| t.missed > 0);
        let moving = own.filter(|t| t.missed == 0 && t.is_moving(self.frames)).count();
        let state = &mut self.colors[color];
        state.others |= live > state.markers;
        let often = state.others && moving < state.markers;
        let every = if often { LOOK_AROUND_OFTEN } else { LOOK_AROUND };
        live < state.markers || lost || self.frames.is_multiple_of(every)
    }
}

/// Whether two balls are the same thing in the image.
fn is_same(a: &BallCandidate, b: &BallCandidate) -> bool {
    (a.pixel - b.pixel).norm() <= 0.25 * a.diameter_px.max(b.diameter_px)
}

impl Track {
    fn of(color: usize, id: u32, ball: BallCandidate, frame: u64) -> Self {
        let mut track = Self {
            color,
            id,
            last: ball,
            velocity_px: None,
            missed: 0,
            colors: [0.0; 3],
            seen: 0,
            mean_radius_px: 0.0,
            expected: None,
            place: ball.pixel,
            moved_at: frame,
            has_moved: false,
        };
        track.learn(&ball);
        track
    }

    fn sighting(&self, frame: u64) -> ColorSighting {
        let stays = frame - self.moved_at > STAYS_FRAMES;
        ColorSighting { color: self.color, id: self.id, ball: self.last, stays, leads: false }
    }

    fn is_moving(&self, frame: u64) -> bool {
        self.has_moved && frame - self.moved_at <= STAYS_FRAMES
    }

    /// Where to look and how far around.
    fn search(&self) -> (Vector2<f64>, f64) {
        let expected = self.last.pixel + self.velocity_px.unwrap_or_default() * f64::from(self.missed + 1);
        // Room for the ball with its rim, and for the motion that is not foreseen: another diameter a frame.
        (expected, 2.0 * self.mean_radius_px * (1.5 + f64::from(self.missed)) + 2.0)
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
        let brightness = |light: [f32; 3]| light[0] + light[1] + light[2];
        let ratio = brightness(to_linear(ball.color)) * self.seen as f32 / brightness(self.colors);
        let size = 0.5 * ball.diameter_px / self.mean_radius_px;
        (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&size)
            && (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&f64::from(ratio))
    }

    fn advance(&mut self, ball: BallCandidate, frame: u64) {
        let frames = f64::from(self.missed + 1);
        self.velocity_px = Some((ball.pixel - self.last.pixel) / frames);
        self.last = ball;
        self.missed = 0;
        if (ball.pixel - self.place).norm() > ball.diameter_px {
            self.place = ball.pixel;
            self.moved_at = frame;
            self.has_moved = true;
        }
        self.learn(&ball);
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
