//! What is known of one object that is followed.

use super::Track;
use super::motion::Motion;
use crate::color::to_linear;
use crate::detect::Expected;
use crate::optics::Known;
use crate::{Detection, Vector2};

/// Change of size or brightness between detections beyond which it is another object: half a stop of shade,
/// or the range changing by half.
const MOST_CHANGE: f64 = 1.6;
/// Detections over which apparent radius and brightness are averaged: a third of a second of video. Both
/// change with the place.
const MEMORY: u32 = 10;
/// Standard deviation of the change of the range from frame to frame, as a part of it: a metre a second at
/// six metres and thirty frames a second.
const RADIUS_CHANGE: f64 = 0.005;

/// Frames without a diameter of motion after which a ball counts as static: a second or two of video.
const STATIC_FRAMES: u64 = 45;

/// What is known of one object.
#[derive(Debug, Clone)]
pub(super) struct TrackState {
    pub(super) color: usize,
    pub(super) id: u32,
    pub(super) last: Detection,
    motion: Motion,
    pub(super) missed: u32,
    /// Whether it is yet to be looked for in this frame.
    pub(super) waits: bool,
    /// Sum of the linear colours seen, for the mean.
    pub(super) colors: [f32; 3],
    pub(super) seen: u32,
    pub(super) mean_radius_px: f64,
    mean_brightness: f32,
    pub(super) expected: Option<Expected>,
    /// Where it was when it last had moved by a diameter or had not been seen before, and in which frame it
    /// had moved.
    pub(super) place: Vector2<f64>,
    pub(super) moved_at: u64,
    pub(super) has_moved: bool,
}

impl TrackState {
    pub(super) fn of(color: usize, id: u32, ball: Detection, frame: u64) -> Self {
        let mut track = Self {
            color,
            id,
            last: ball,
            motion: Motion::at(ball.pixel),
            missed: 0,
            waits: false,
            colors: [0.0; 3],
            seen: 0,
            mean_radius_px: 0.0,
            mean_brightness: 0.0,
            expected: None,
            place: ball.pixel,
            moved_at: frame,
            has_moved: false,
        };
        track.learn(&ball);
        track
    }

    pub(super) fn track(&self, frame: u64) -> Track {
        let is_static = frame - self.moved_at > STATIC_FRAMES;
        Track { color: self.color, id: self.id, detection: self.last, is_static, is_preferred: false }
    }

    pub(super) fn is_moving(&self, frame: u64) -> bool {
        self.has_moved && frame - self.moved_at <= STATIC_FRAMES
    }

    /// Where to look and how far around.
    pub(super) fn search(&self) -> (Vector2<f64>, f64) {
        // Room for the ball with its rim, and for the motion that is not predicted: another diameter a frame.
        (
            self.motion.predicted(self.missed + 1),
            2.0 * self.mean_radius_px * (1.5 + f64::from(self.missed)) + 2.0,
        )
    }

    /// What to expect of the ball; None before it was first followed.
    pub(super) fn expected(&self, middle: Vector2<f64>) -> Option<Expected> {
        let expected = self.expected?;
        let known = expected.radius_px;
        let change_px = RADIUS_CHANGE * f64::from(self.missed + 1) * known.mean;
        let radius_px = Known { variance: known.variance + change_px * change_px, ..known };
        let pixel = self.motion.is_known().then_some(middle);
        Some(Expected { radius_px, pixel, ..expected })
    }

    /// Whether a ball is of about the size and brightness of the one followed.
    pub(super) fn agrees(&self, ball: &Detection) -> bool {
        let ratio = brightness(ball) / self.mean_brightness;
        let size = 0.5 * ball.diameter_px / self.mean_radius_px;
        (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&size)
            && (1.0 / MOST_CHANGE..=MOST_CHANGE).contains(&f64::from(ratio))
    }

    pub(super) fn advance(&mut self, ball: Detection, frame: u64) {
        self.motion.advance(ball.pixel, self.missed + 1);
        // Flecks of a static object come and go, one here and one there: what moves is followed from here to
        // there, and is there in the next frame, too.
        if self.missed > 0 {
            self.place = ball.pixel;
        }
        let is_elsewhere = |ball: &Detection| (ball.pixel - self.place).norm() > ball.diameter_px;
        let has_moved = is_elsewhere(&self.last) && is_elsewhere(&ball);
        self.last = ball;
        self.missed = 0;
        if has_moved {
            self.place = ball.pixel;
            self.moved_at = frame;
            self.has_moved = true;
        }
        self.learn(&ball);
    }

    pub(super) fn learn(&mut self, ball: &Detection) {
        for (sum, value) in self.colors.iter_mut().zip(to_linear(ball.color)) {
            *sum += value;
        }
        self.seen += 1;
        let gain = 1.0 / f64::from(self.seen.min(MEMORY));
        self.mean_radius_px += gain * (0.5 * ball.diameter_px - self.mean_radius_px);
        self.mean_brightness += gain as f32 * (brightness(ball) - self.mean_brightness);
    }
}

/// Linear light of a ball.
fn brightness(ball: &Detection) -> f32 {
    to_linear(ball.color).iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix2;

    /// Seen at places along a row; a gap for each that is none.
    fn seen_at(places: &[Option<f64>]) -> TrackState {
        let ball = |x: f64| Detection {
            pixel: Vector2::new(x, 9.0),
            covariance_px2: Matrix2::identity(),
            area_px: 12.0,
            diameter_px: 4.0,
            score: 1.0,
            color: [200, 40, 40],
        };
        let mut track = TrackState::of(0, 0, ball(0.0), 0);
        for (frame, place) in (1..).zip(places) {
            match place {
                Some(x) => track.advance(ball(*x), frame),
                None => track.missed += 1,
            }
        }
        track
    }

    #[test]
    fn what_leaps_has_not_moved() {
        assert!(seen_at(&[Some(3.0), Some(6.0), Some(9.0)]).has_moved);
        assert!(!seen_at(&[Some(6.0), Some(0.0), Some(6.0)]).has_moved);
        assert!(!seen_at(&[None, Some(6.0), Some(6.0), None, Some(0.0), Some(0.0)]).has_moved);
        assert!(seen_at(&[None, Some(6.0), Some(8.0), Some(11.0), Some(11.0)]).has_moved);
    }
}
