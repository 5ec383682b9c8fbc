//! Following everything of a marker's colour from frame to frame.

mod motion;
mod state;

use crate::centre::LEAST_RADIUS_PX;
use crate::color::{ColorModel, Seen};
use crate::detect::{Workspace, is_measurable};
use crate::health::{self, BallHealth};
use crate::window::Window;
use crate::{BallColor, Detection, Frame, VisionError};
use mavsight_geometry::Camera;
use state::TrackState;
use std::ops::{Range, RangeInclusive};

/// Frames without a detection after which the motion of a ball is no longer extrapolated.
const MOST_MISSED: u32 = 5;
/// Detections up to which a ball is new: it is given up when missed in two frames, as a fleck of noise.
const FEW_SEEN: u32 = 3;

/// Balls that are followed beyond the markers of a colour: what else in a room looks like one.
const MOST_OTHERS: usize = 6;
/// Frames in which the whole frame is looked over while all that is wanted is seen, a band of rows in each,
/// so that none takes long: a newcomer is met within a quarter second, or within two frames where something
/// else of the colour has been seen before.
const LOOK_AROUND: u64 = 8;
const LOOK_AROUND_OFTEN: u64 = 2;

/// One ball that may be a marker of a colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Which of the tracker's colours.
    pub color: usize,
    /// Number of the object that is followed, the same from frame to frame in one camera.
    pub id: u32,
    /// The ball in this frame.
    pub detection: Detection,
    /// Whether its image has long not moved.
    pub is_static: bool,
    /// Whether, of what is seen of its colour, it is the most likely to be a marker: what has moved, and was
    /// followed longest.
    pub is_preferred: bool,
}

/// Finds all that may be a marker in each frame of one camera: each object near where it is predicted, and
/// newcomers in the whole frame.
///
/// What is not seen is not there; nothing is ever guessed. Which of several balls of one colour is the marker
/// is left to who knows the other cameras and the body.
#[derive(Debug, Clone)]
pub struct Tracker {
    model: ColorModel,
    range_px: (f64, f64),
    colors: Vec<ColorState>,
    tracks: Vec<TrackState>,
    workspace: Workspace,
    found: Vec<crate::detect::Found>,
    seen: Vec<Track>,
    leading: Vec<Option<Detection>>,
    frames: u64,
    next_id: u32,
    health: Vec<BallHealth>,
    is_dark: bool,
    /// Whether newcomers have been looked for in the last frame, and whether all else that can wait has been
    /// done.
    has_looked: bool,
    is_done: bool,
}

/// What is known of one colour.
#[derive(Debug, Clone, Copy)]
struct ColorState {
    /// Markers of the colour.
    markers: usize,
    /// Whether more than those were once seen.
    others: bool,
}

impl Tracker {
    /// A tracker of markers, one of each colour, whose apparent diameters are in the range.
    ///
    /// # Errors
    /// As [`crate::Detector::new`], and [`VisionError::DiameterRange`] if no ball in the range can be
    /// measured.
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
            seen: Vec::new(),
            leading: vec![None; colors.len()],
            frames: 0,
            next_id: 0,
            health: vec![BallHealth::default(); colors.len()],
            is_dark: false,
            has_looked: true,
            is_done: true,
        })
    }

    /// The same for a camera that is known: the images of balls are stretched as it does, and lamps are
    /// looked for above, along the world's z. Without, it is taken to have a horizontal field of view of 60°,
    /// and lamps may be anywhere.
    #[must_use]
    pub fn with_camera(mut self, camera: Camera) -> Self {
        self.workspace.camera = Some(camera);
        self
    }

    /// The same where several markers share a colour: how many there are of each, in the order of the
    /// colours.
    #[must_use]
    pub fn with_markers(mut self, of_color: &[usize]) -> Self {
        for (state, markers) in self.colors.iter_mut().zip(of_color) {
            state.markers = (*markers).max(1);
        }
        self
    }

    /// Looks at the next frame: all balls that may be markers, those followed longest first.
    /// [`Tracker::follow`] and [`Tracker::look_around`] in one.
    pub fn update(&mut self, frame: &Frame) -> &[Track] {
        self.follow(frame);
        self.look_around(frame);
        &self.seen
    }

    /// What is followed, in the next frame, those followed longest first; all there is where nothing is.
    pub fn follow(&mut self, frame: &Frame) -> &[Track] {
        self.seen.clear();
        self.frames += 1;
        self.tracks.retain(|t| t.missed <= MOST_MISSED && (t.missed < 2 || t.seen > FEW_SEEN));
        for is_new in [false, true] {
            for track in 0..self.tracks.len() {
                self.follow_one(frame, track, is_new);
            }
        }
        (self.has_looked, self.is_done) = (false, false);
        if self.seen.is_empty() {
            self.find_newcomers(frame);
            let seen = self.tracks.iter().filter(|t| t.missed == 0);
            self.seen.extend(seen.map(|t| t.track(self.frames)));
        }
        for color in 0..self.colors.len() {
            if let Some(lead) = self.lead(color) {
                let id = self.tracks[lead].id;
                self.seen.iter_mut().filter(|s| s.id == id).for_each(|s| s.is_preferred = true);
                self.model.learn(color, &Seen::of(self.tracks[lead].colors));
            }
        }
        self.is_dark = self.seen.is_empty() && health::is_dark(frame);
        &self.seen
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

    /// Looks at the next frame: for each colour the ball that has been followed longest, those that moved
    /// first; None where there is none.
    pub fn update_preferred(&mut self, frame: &Frame) -> &[Option<Detection>] {
        self.follow(frame);
        for color in 0..self.colors.len() {
            self.leading[color] = self.lead(color).map(|t| self.tracks[t].last);
        }
        self.look_around(frame);
        &self.leading
    }

    /// The track of a colour that is most likely a marker's, of those seen in this frame.
    fn lead(&self, color: usize) -> Option<usize> {
        let live = |t: &usize| {
            let track = &self.tracks[*t];
            track.color == color && track.missed == 0 && !track.waits
        };
        (0..self.tracks.len()).filter(live).max_by(|a, b| {
            let (a, b) = (&self.tracks[*a], &self.tracks[*b]);
            (a.has_moved, a.seen).cmp(&(b.has_moved, b.seen)).then(b.id.cmp(&a.id))
        })
    }

    /// Looks for a track that is new, or for one that is not. What is new waits where all markers of its
    /// colour have been seen: mostly it is a fleck that is gone by now.
    fn follow_one(&mut self, frame: &Frame, track: usize, is_new: bool) {
        if (self.tracks[track].seen <= FEW_SEEN) != is_new {
            return;
        }
        let color = self.tracks[track].color;
        let seen = self.seen.iter().filter(|s| s.color == color).count();
        let waits = is_new && seen >= self.colors[color].markers;
        self.tracks[track].waits = waits;
        if !waits {
            self.near_prediction(frame, track);
        }
    }

    fn near_prediction(&mut self, frame: &Frame, index: usize) {
        let track = &self.tracks[index];
        let (middle, reach_px) = track.search();
        let color = track.color;
        self.workspace.expected = track.expected(middle);
        self.workspace.segmenter.collect(frame, &Window::around(frame, middle, reach_px));
        self.workspace.search(frame, &self.model, color, self.range_px, &mut self.found);
        self.workspace.expected = None;
        let track = &self.tracks[index];
        let agrees = |ball: &Detection| {
            (ball.pixel - middle).norm() <= reach_px
                && track.agrees(ball)
                && !self.seen.iter().any(|s| s.color == color && is_same(&s.detection, ball))
        };
        // The nearest of those that look about as much like a ball as the best.
        let agreeing = self.found.iter().filter(|s| agrees(&s.detection));
        let best = agreeing.clone().map(|s| s.detection.score).fold(0.0, f64::max);
        let away = |ball: &Detection| (ball.pixel - middle).norm();
        let nearest = agreeing
            .filter(|s| s.detection.score >= 0.5 * best)
            .min_by(|a, b| away(&a.detection).total_cmp(&away(&b.detection)))
            .copied();
        let Some(found) = nearest else {
            self.tracks[index].missed += 1;
            return;
        };
        let (taken, shown) = found.optics;
        self.workspace.optics.learn(taken, shown);
        let track = &mut self.tracks[index];
        track.expected = Some(found.expected);
        track.advance(found.detection, self.frames);
        self.seen.push(track.track(self.frames));
    }

    /// What can wait in a frame, once, after [`Tracker::follow`]: looks for newcomers, which are followed
    /// from the next frame on and reported once they have been seen in some frames, or a marker of their
    /// colour is missing; and looks how well balls are seen. Who waits for what is followed need not wait for
    /// this.
    pub fn look_around(&mut self, frame: &Frame) {
        if std::mem::replace(&mut self.is_done, true) {
            return;
        }
        for track in 0..self.tracks.len() {
            if std::mem::take(&mut self.tracks[track].waits) {
                self.near_prediction(frame, track);
            }
        }
        if !self.has_looked {
            self.find_newcomers(frame);
        }
        if self.frames % health::EVERY == 1 {
            self.look_at_health(frame);
        }
        self.workspace.segmenter.give_back();
    }

    fn look_at_health(&mut self, frame: &Frame) {
        for color in 0..self.colors.len() {
            if let Some(lead) = self.seen.iter().find(|s| s.is_preferred && s.color == color) {
                let seen = self.seen.iter().filter(|s| s.color == color).count();
                let others = seen.saturating_sub(self.colors[color].markers);
                self.health[color].look(frame, &self.model, color, &lead.detection, others);
            }
        }
    }

    /// Looks for newcomers: of a colour of which something is missing in the whole frame, of the others in a
    /// band of it.
    fn find_newcomers(&mut self, frame: &Frame) {
        self.has_looked = true;
        let whole = Window::whole(frame);
        let mut collected = None;
        for color in 0..self.colors.len() {
            let rows = band(whole.rows.len(), self.frames, self.bands(color));
            // A ball whose middle lies in the band is seen whole.
            let beyond = (0.5 * self.range_px.1).ceil() as usize + 2;
            let around = rows.start.saturating_sub(beyond)..(rows.end + beyond).min(whole.rows.end);
            let window = Window { columns: whole.columns.clone(), rows: around };
            if collected.as_ref() != Some(&window) {
                self.workspace.segmenter.collect(frame, &window);
                collected = Some(window);
            }
            self.workspace.known.clear();
            let seen = self.tracks.iter().filter(|t| t.missed == 0);
            self.workspace.known.extend(seen.map(|t| (t.last.pixel, 0.5 * t.last.diameter_px)));
            self.workspace.rows = Some(rows);
            self.workspace.search(frame, &self.model, color, self.range_px, &mut self.found);
            self.workspace.known.clear();
            self.workspace.rows = None;
            self.take_newcomers(color);
        }
    }

    /// Follows what was found of a colour and was not followed.
    fn take_newcomers(&mut self, color: usize) {
        for found in &self.found {
            let others = self.tracks.iter().filter(|t| t.color == color && t.missed == 0).count();
            if others >= self.colors[color].markers + MOST_OTHERS {
                break;
            }
            let ball = found.detection;
            if self.tracks.iter().any(|t| t.missed == 0 && is_same(&t.last, &ball)) {
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
                continue;
            }
            self.tracks.push(TrackState::of(color, self.next_id, ball, self.frames));
            self.next_id = self.next_id.wrapping_add(1);
        }
    }

    /// In how many frames the whole of it is looked over for a colour's newcomers.
    fn bands(&mut self, color: usize) -> u64 {
        let own = self.tracks.iter().filter(|t| t.color == color);
        let live = own.clone().filter(|t| t.missed == 0).count();
        let lost = own.clone().any(|t| t.missed > 0);
        let moving = own.filter(|t| t.missed == 0 && t.is_moving(self.frames)).count();
        let state = &mut self.colors[color];
        state.others |= live > state.markers;
        if live < state.markers || lost {
            return 1;
        }
        if state.others && moving < state.markers { LOOK_AROUND_OFTEN } else { LOOK_AROUND }
    }
}

/// The band of rows whose turn it is in a frame, of so many.
fn band(rows: usize, frame: u64, bands: u64) -> Range<usize> {
    let edge = |k: u64| (rows as u64 * k / bands) as usize;
    edge(frame % bands)..edge(frame % bands + 1)
}

/// Whether two balls are the same object in the image.
fn is_same(a: &Detection, b: &Detection) -> bool {
    (a.pixel - b.pixel).norm() <= 0.25 * a.diameter_px.max(b.diameter_px)
}
