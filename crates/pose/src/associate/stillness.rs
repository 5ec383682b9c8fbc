//! Cameras whose balls stand still in their images while another camera sees the body move.

use super::associator::Associator;
use super::frame::Frame;
use super::history::{MovedCamera, SHIFTED};
use crate::TrackedDetection;
use mavsight_geometry::Vector2;

/// Images that show the same from which a camera may be frozen: one more than what changes a rate repeats, as for copies.
const REPEATED: usize = 5;

/// Part of the stated variance below which balls are not seen anew: of three balls in one image, noise is that small once in
/// two hundred, in five images running never.
const NO_NOISE: f64 = 1.0 / 9.0;

/// It stands still for so long after another camera first saw the body move, ns: what moves later is no frozen camera but one
/// whose clock is another, and clocks of one flight are less than a second apart.
const LONGEST_APART_NS: i64 = 1_000_000_000;

/// What stands still is three balls or more.
const BALLS: usize = 3;

/// One camera's images, for as long as they show the same.
#[derive(Debug, Clone, Default)]
pub(super) struct Repeated {
    since_ns: i64,
    images: usize,
    /// What all cameras saw when it began: camera, track and place.
    began: Vec<(usize, u32, Vector2<f64>)>,
    /// The camera that first saw the body move since, by how much, and when.
    first: Option<(usize, Vector2<f64>, i64)>,
}

/// How far a camera's balls are from where they were: in the mean, its variance, and the mean square in parts of what noise
/// alone makes of it.
struct Displaced {
    mean_px: Vector2<f64>,
    variance_px2: f64,
    of_noise: f64,
}

impl Repeated {
    fn begin(&mut self, frame: Frame) {
        (self.since_ns, self.images, self.first) = (frame.t_ns, 1, None);
        self.began.clear();
        self.began.extend(frame.seen.iter().map(|s| (s.camera, s.track_id, s.pixel)));
    }

    fn displaced(&self, camera: usize, seen: &[TrackedDetection]) -> Option<Displaced> {
        let (mut n, mut sum_px, mut variance_px2, mut of_noise) = (0, Vector2::zeros(), 0.0, 0.0);
        for own in seen.iter().filter(|s| s.camera == camera) {
            let before = self.began.iter().find(|b| (b.0, b.1) == (camera, own.track_id));
            let Some((_, _, before_px)) = before else { continue };
            let (by_px, trace_px2) = (own.pixel - before_px, own.covariance_px2.trace());
            n += 1;
            sum_px += by_px;
            variance_px2 += trace_px2;
            of_noise += by_px.norm_squared() / (2.0 * trace_px2);
        }
        let count = n as f64;
        (n >= BALLS).then(|| Displaced {
            mean_px: sum_px / count,
            variance_px2: variance_px2 / (count * count),
            of_noise: of_noise / count,
        })
    }
}

impl Associator {
    /// Leaves a camera out that shows the same image over and over, with no more than an encoder's noise, while another
    /// one sees the body move, and goes on moving: what leaps once was pushed itself.
    pub(super) fn watch_stillness(&mut self, frame: Frame) {
        let scale = self.noise.scale().unwrap_or(1.0);
        let is_far = |by_px: Vector2<f64>, variance_px2: f64| {
            by_px.norm_squared() > SHIFTED * SHIFTED * scale * variance_px2
        };
        let cameras = self.cameras.len();
        self.watch.repeated.resize(cameras, Repeated::default());
        for camera in 0..cameras {
            if self.watch.is_moved(camera) || !frame.seen.iter().any(|s| s.camera == camera) {
                continue;
            }
            let own = &mut self.watch.repeated[camera];
            if own.displaced(camera, frame.seen).is_none_or(|d| d.of_noise > NO_NOISE) {
                own.begin(frame);
                continue;
            }
            own.images += 1;
            if own.images < REPEATED {
                continue;
            }
            for other in (0..cameras).filter(|c| *c != camera) {
                let Some(seen) = self.watch.repeated[camera].displaced(other, frame.seen) else { continue };
                if self.watch.is_moved(other) || !is_far(seen.mean_px, seen.variance_px2) {
                    continue;
                }
                let own = &mut self.watch.repeated[camera];
                let t_ns = frame.t_ns;
                let (first, first_px, first_ns) = *own.first.get_or_insert((other, seen.mean_px, t_ns));
                let is_long = t_ns - first_ns >= LONGEST_APART_NS;
                if is_long && first == other && is_far(seen.mean_px - first_px, 2.0 * seen.variance_px2) {
                    let still_since_ns = Some(own.since_ns);
                    let shift_px = seen.mean_px;
                    self.watch.moved.push(MovedCamera { camera, t_ns, shift_px, still_since_ns });
                    break;
                }
            }
        }
    }
}
