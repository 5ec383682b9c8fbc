//! Cameras that are pushed while the flight goes on: the steps of a batch run, found some frames after they were made.

use super::step::{ImageStep, LoneBalls, WINDOWS, step_before};
use super::{TOGETHER_INTERVALS, least_square, usual};
use crate::clock_step::DECISIVE;
use crate::markers::MarkerColors;
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector2;
use mavsight_pose::TrackedDetection;
use std::collections::VecDeque;

/// Frames on either side of a step that are looked at: those of the shortest parabolas, and one more for what is left without the
/// two beside it.
const BESIDE: usize = WINDOWS[0] + 1;

/// Frames whose steps show what is usual of a camera.
const USUAL_FRAMES: usize = 48;

/// Frames of a flight in which one camera is taken for pushed with the probability of a recording: half an hour of two at 60 Hz.
const FLIGHT_FRAMES: usize = 2 * 60 * 1800;

/// Intervals between frames after which it is no longer waited for what other cameras saw of a step.
const LONGEST_WAIT: i64 = 30;

/// When a frame of a camera was filmed.
#[derive(Debug, Clone, Copy)]
pub struct FrameTime {
    /// By the camera's own clock.
    pub stamp_ns: i64,
    /// By the clock of all cameras.
    pub t_ns: i64,
    /// Usual time to the next frame.
    pub interval_ns: i64,
}

/// A camera that was pushed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Push {
    /// Index in the rig.
    pub camera: usize,
    /// Its first frame afterwards.
    pub t_ns: i64,
    /// By how much the images of the balls shifted, in common.
    pub shift_px: Vector2<f64>,
    /// From when on it is known: whatever the order in which the frames of the cameras arrive, they are there by then.
    pub known_ns: i64,
}

/// A step before a frame; a square of zero where there is none.
#[derive(Debug, Clone, Copy)]
struct Scored {
    t_ns: i64,
    step: ImageStep,
}

/// A step that is a push if no other camera's images step.
#[derive(Debug, Clone, Copy)]
struct Suspect {
    push: Push,
    near_ns: i64,
    square: f64,
    forgotten_ns: i64,
}

#[derive(Debug, Default)]
struct Watched {
    frames: VecDeque<LoneBalls>,
    times_ns: VecDeque<i64>,
    scored: VecDeque<Scored>,
    suspect: Option<Suspect>,
}

/// Looks for cameras that are pushed, as their frames come: a push is found some eight frames after it was made.
///
/// As in a batch run, the images of the balls of one camera jump then from one frame to the next, and those of no other camera do.
/// Balls are those that alone have the colour of a marker; three are needed, and frames in their beat.
#[derive(Debug)]
pub struct PushWatch {
    counts: Vec<usize>,
    /// Square of a step that is none by chance.
    stepped: f64,
    cameras: Vec<Watched>,
}

impl PushWatch {
    /// For so many cameras that see a vehicle.
    pub fn new(cameras: usize, vehicle: &Vehicle) -> Self {
        let cameras = (0..cameras).map(|_| Watched::default()).collect();
        let counts = MarkerColors::of(vehicle).counts();
        Self { counts, stepped: least_square(FLIGHT_FRAMES), cameras }
    }

    /// Begins anew with a camera: its image stood, or it was left out.
    pub fn forget(&mut self, camera: usize) {
        if let Some(own) = self.cameras.get_mut(camera) {
            *own = Watched::default();
        }
    }

    /// Takes a frame of a camera: a camera that is found to have been pushed.
    pub fn take(&mut self, camera: usize, time: FrameTime, seen: &[TrackedDetection]) -> Option<Push> {
        let variance_px2 = |s: &TrackedDetection| 0.5 * s.covariance_px2.trace();
        let balls = seen.iter().map(|s| (s.color, s.pixel, variance_px2(s)));
        self.cameras.get_mut(camera)?.add(time, balls, &self.counts, self.stepped - DECISIVE);
        self.suspect(camera, time);
        let found = (0..self.cameras.len()).find_map(|camera| self.decided(camera))?;
        self.forget(found.camera);
        Some(found)
    }

    /// Suspects a camera whose latest step is clear.
    fn suspect(&mut self, camera: usize, time: FrameTime) {
        let own = &mut self.cameras[camera];
        own.suspect = own.suspect.filter(|s| time.t_ns <= s.forgotten_ns);
        let Some(latest) = own.scored.back().filter(|s| s.step.square >= self.stepped) else { return };
        let square = own.in_usual(latest.step.square);
        if square < self.stepped || own.suspect.is_some_and(|before| before.square >= square) {
            return;
        }
        let near_ns = (TOGETHER_INTERVALS * time.interval_ns as f64) as i64;
        let behind_ns = near_ns + (BESIDE as i64 + 1) * time.interval_ns;
        let (t_ns, shift_px) = (latest.t_ns, latest.step.by_px);
        let push = Push { camera, t_ns, shift_px, known_ns: t_ns + behind_ns };
        let forgotten_ns = t_ns + LONGEST_WAIT * time.interval_ns;
        own.suspect = Some(Suspect { push, near_ns, square, forgotten_ns });
    }

    /// A suspect that is a push, once the other cameras have shown that nothing steps in their images: what does was done to the
    /// aircraft.
    fn decided(&mut self, camera: usize) -> Option<Push> {
        let suspect = self.cameras[camera].suspect?;
        let others = || (0..self.cameras.len()).filter(|k| *k != camera).map(|k| &self.cameras[k]);
        let until_ns = suspect.push.t_ns + suspect.near_ns;
        if others().any(|other| other.scored.back().is_none_or(|last| last.t_ns < until_ns)) {
            return None;
        }
        let least = (suspect.square - DECISIVE).min(self.stepped);
        let is_near = |s: &Scored| (s.t_ns - suspect.push.t_ns).abs() <= suspect.near_ns;
        let steps = |other: &Watched| {
            let mut near = other.scored.iter().filter(|s| is_near(s) && s.step.square > least);
            near.any(|s| other.in_usual(s.step.square) > least)
        };
        let is_own = !others().any(steps);
        self.cameras[camera].suspect = None;
        is_own.then_some(suspect.push)
    }
}

impl Watched {
    fn add(
        &mut self,
        time: FrameTime,
        balls: impl Iterator<Item = (usize, Vector2<f64>, f64)> + Clone,
        counts: &[usize],
        least: f64,
    ) {
        let is_full = self.frames.len() > 2 * BESIDE;
        // In flight nothing is allocated for the balls of a frame.
        let mut latest = if is_full { self.frames.pop_front() } else { None }.unwrap_or_default();
        if is_full {
            self.times_ns.pop_front();
        }
        latest.take(time.stamp_ns, balls, counts);
        self.frames.push_back(latest);
        self.times_ns.push_back(time.t_ns);
        if self.frames.len() <= 2 * BESIDE {
            return;
        }
        let none = ImageStep { by_px: Vector2::zeros(), square: 0.0 };
        let step = step_before(&self.frames, BESIDE, time.interval_ns as f64, least).unwrap_or(none);
        if self.scored.len() == USUAL_FRAMES {
            self.scored.pop_front();
        }
        self.scored.push_back(Scored { t_ns: self.times_ns[BESIDE], step });
    }

    /// The square of a step in parts of what is usual.
    fn in_usual(&self, square: f64) -> f64 {
        square / usual(self.scored.iter().map(|s| s.step.square as f32))
    }
}
