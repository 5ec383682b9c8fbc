//! Cameras whose balls stand still in their images while another camera sees the body move.

use super::associator::Associator;
use super::frame::Frame;
use super::history::{MovedCamera, SHIFTED, Watch};
use crate::{PoseError, TrackedDetection};
use mavsight_geometry::Vector2;

/// Images that show the same from which a camera may be frozen: one more than what changes a rate repeats, as for copies.
pub const STILL_IMAGES: usize = 5;

/// It stands still for so long after another camera first saw the body move, ns: what moves later is no frozen camera but one
/// whose clock is another, and clocks of one flight are less than a second apart.
pub const LONGEST_APART_NS: i64 = 1_000_000_000;

/// Part of the stated variance below which balls are not seen anew: of three balls in one image, noise is that small once in
/// two hundred, in five images running never.
const NO_NOISE: f64 = 1.0 / 9.0;

/// Part of the stated variance below which balls are not seen anew once an image is known to be of another time: an encoder's noise
/// is a third of theirs now and then.
const SOME_NOISE: f64 = 1.0 / 2.0;

/// What stands still is three balls or more.
const BALLS: usize = 3;

/// Where the balls of cameras were at one time.
#[derive(Debug, Clone, Default)]
pub struct BallPlaces {
    /// Camera, track and place of each.
    balls: Vec<(usize, u32, Vector2<f64>)>,
}

/// How far a camera's balls are from where they were.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacement {
    /// In the mean.
    pub mean_px: Vector2<f64>,
    /// Variance of a coordinate of the mean: the noise of both places.
    pub variance_px2: f64,
    /// The mean square in parts of what noise alone makes of it.
    of_noise: f64,
}

impl BallPlaces {
    /// Takes the places of balls; in flight nothing is allocated for them again.
    pub fn take(&mut self, seen: &[TrackedDetection]) {
        self.balls.clear();
        self.balls.extend(seen.iter().map(|s| (s.camera, s.track_id, s.pixel)));
    }

    /// How far the balls of a camera have come since; `None` where fewer than three of them are seen again.
    pub fn displaced(&self, camera: usize, seen: &[TrackedDetection]) -> Option<Displacement> {
        self.displaced_by(BALLS, camera, seen)
    }

    /// As [`Self::displaced`], by so many balls at least.
    fn displaced_by(&self, least: usize, camera: usize, seen: &[TrackedDetection]) -> Option<Displacement> {
        let (mut n, mut sum_px, mut variance_px2, mut of_noise) = (0, Vector2::zeros(), 0.0, 0.0);
        for own in seen.iter().filter(|s| s.camera == camera) {
            let before = self.balls.iter().find(|b| (b.0, b.1) == (camera, own.track_id));
            let Some((_, _, before_px)) = before else { continue };
            let (by_px, trace_px2) = (own.pixel - before_px, own.covariance_px2.trace());
            n += 1;
            sum_px += by_px;
            variance_px2 += trace_px2;
            of_noise += by_px.norm_squared() / (2.0 * trace_px2);
        }
        let count = n as f64;
        (n >= least).then(|| Displacement {
            mean_px: sum_px / count,
            variance_px2: variance_px2 / (count * count),
            of_noise: of_noise / count,
        })
    }

    /// Whether those balls of a camera that are seen again are where they were, to within no more than an encoder's noise: too
    /// few to show that it stands still, while none says that it does not.
    pub fn are_where_they_were(&self, camera: usize, seen: &[TrackedDetection]) -> bool {
        seen.iter().filter(|s| s.camera == camera).all(|own| {
            let before = self.balls.iter().find(|b| (b.0, b.1) == (camera, own.track_id));
            before.is_some_and(|b| {
                (own.pixel - b.2).norm_squared() <= NO_NOISE * 2.0 * own.covariance_px2.trace()
            })
        })
    }
}

impl Displacement {
    /// Whether it is so small that the balls were not seen anew.
    pub fn is_still(&self) -> bool {
        self.of_noise <= NO_NOISE
    }
}

/// Whether a camera's view of the body has shifted beyond chance, by the variance of the shift.
pub fn is_far(by_px: Vector2<f64>, variance_px2: f64) -> bool {
    by_px.norm_squared() > SHIFTED * SHIFTED * variance_px2
}

/// One camera's images, for as long as they show the same.
#[derive(Debug, Clone, Default)]
pub(super) struct Repeated {
    since_ns: i64,
    images: usize,
    /// What all cameras saw when it began.
    began: BallPlaces,
    /// The camera that first saw the body move since, by how much, and when.
    first: Option<(usize, Vector2<f64>, i64)>,
    /// Whether the body moved in its images until then.
    was_moving: bool,
    /// Whether the body has moved since: another camera has seen it, or it moved until then and none sees it anew.
    is_stale: bool,
}

impl Repeated {
    fn begin(&mut self, frame: Frame, was_moving: bool) {
        (self.since_ns, self.images, self.first, self.is_stale) = (frame.t_ns, 1, None, false);
        self.was_moving = was_moving;
        self.began.take(frame.seen);
    }

    /// Whether the last image shows no more than one before it.
    pub(super) fn is_repeated(&self) -> bool {
        self.images > 1
    }
}

impl Associator {
    /// Whether a camera's image shows no more than the one before it.
    pub(super) fn is_repeated(&self, camera: usize) -> bool {
        self.watch.repeated.get(camera).is_some_and(Repeated::is_repeated)
    }

    /// Whether a camera repeats an image from before the body moved on: another camera has seen it move, or it was moving and no camera
    /// sees it anew. Such an image is of another time, whatever it is that holds it, and the camera takes no part until
    /// it shows another one.
    pub fn is_stale(&self, camera: usize) -> bool {
        self.watch.repeated.get(camera).is_some_and(|own| own.is_stale)
    }

    /// Why an instant whose images are repeated has no pose.
    pub(super) fn repeated_image(&self, frame: Frame) -> PoseError {
        let seeing = (0..self.cameras.len()).filter(|c| frame.seen.iter().any(|s| s.camera == *c));
        let repeated = seeing.clone().filter(|c| self.is_repeated(*c)).count();
        PoseError::RepeatedImage { repeated, cameras: seeing.count() }
    }

    /// Leaves a camera out that shows the same image over and over, with no more than an encoder's noise, while another
    /// one sees the body move, and goes on moving: what leaps once was pushed itself.
    pub(super) fn watch_stillness(&mut self, frame: Frame) {
        let scale = self.noise.scale().unwrap_or(1.0);
        let cameras = self.cameras.len();
        self.watch.repeated.resize(cameras, Repeated::default());
        for camera in 0..cameras {
            let is_moved = self.watch.is_moved(camera);
            if is_moved && !self.watch.may_return || !frame.seen.iter().any(|s| s.camera == camera) {
                continue;
            }
            let own = &mut self.watch.repeated[camera];
            match own.began.displaced(camera, frame.seen) {
                Some(by) if by.is_still() || own.is_stale && by.of_noise <= SOME_NOISE => own.images += 1,
                None if own.is_repeated() && own.began.are_where_they_were(camera, frame.seen) => continue,
                by => {
                    own.begin(frame, by.is_some_and(|by| is_far(by.mean_px, scale * by.variance_px2)));
                    continue;
                }
            }
            if is_moved {
                continue;
            }
            for other in (0..cameras).filter(|c| *c != camera) {
                let own = &self.watch.repeated[camera];
                // What one ball shows is enough to go by the others for now, and not to say that the camera froze.
                let Some(seen) = own.began.displaced_by(1, other, frame.seen) else { continue };
                let variance_px2 = scale * seen.variance_px2;
                if self.watch.is_moved(other) || !is_far(seen.mean_px, variance_px2) {
                    continue;
                }
                let own = &mut self.watch.repeated[camera];
                let t_ns = frame.t_ns;
                let (first, first_px, first_ns) = *own.first.get_or_insert((other, seen.mean_px, t_ns));
                if first != other || !is_far(seen.mean_px - first_px, variance_px2) {
                    continue;
                }
                own.is_stale = true;
                let is_body = own.began.displaced(other, frame.seen).is_some();
                if is_body && own.images >= STILL_IMAGES && t_ns - first_ns >= LONGEST_APART_NS {
                    let still_since_ns = Some(own.since_ns);
                    let shift_px = seen.mean_px;
                    self.watch.leave_out(MovedCamera { camera, t_ns, shift_px, still_since_ns, or: None });
                    break;
                }
            }
        }
        self.doubt_all_images(frame);
    }

    /// A body that moves does not stop within one frame in all images to a third of their noise: where none shows it anew they
    /// are of another time.
    fn doubt_all_images(&mut self, frame: Frame) {
        let sees = |watch: &Watch, camera: usize| {
            frame.seen.iter().any(|s| s.camera == camera) && !watch.is_out(camera)
        };
        let seeing = || (0..self.cameras.len()).filter(|c| sees(&self.watch, *c));
        let own = |camera: usize| &self.watch.repeated[camera];
        if !seeing().any(|c| own(c).was_moving) || !seeing().all(|c| own(c).is_repeated()) {
            return;
        }
        for camera in 0..self.cameras.len() {
            self.watch.repeated[camera].is_stale |= sees(&self.watch, camera);
        }
    }
}
