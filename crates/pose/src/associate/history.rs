//! What is known from the instants before: the pose, the noise, and whether the cameras stand still.

use super::associator::DECISIVE_LOG_ODDS;
use super::stillness::Repeated;
use crate::estimate::CLAIM_DEGREES;
use crate::reprojection::moved;
use crate::{PoseEstimate, TrackedDetection};
use mavsight_geometry::{Isometry3, Matrix6, Vector2};
use nalgebra::Vector6;

/// Unpredicted acceleration of the body, and of each marker against its middle: standard gravity.
const ACCELERATION_M_S2: f64 = 9.81;
/// Speed to reckon with before it was measured: a run across the room.
const SPEED_M_S: f64 = 3.0;

/// A pose with its covariance, ordered as in [`PoseEstimate`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief {
    pub(super) pose: Isometry3<f64>,
    pub(super) covariance: Matrix6<f64>,
    /// What unpredicted motion may have shifted; 0 for what was measured.
    pub(super) shift_m: f64,
}

impl Belief {
    pub(super) fn of(estimate: &PoseEstimate) -> Self {
        Self { pose: estimate.world_from_body, covariance: estimate.covariance(), shift_m: 0.0 }
    }

    /// Squared distance of another belief, in standard deviations of their difference.
    pub(super) fn distance(&self, other: &Self) -> f64 {
        let change = change(&self.pose, &other.pose);
        let spread = self.covariance + other.covariance;
        spread.cholesky().map_or(f64::INFINITY, |c| change.dot(&c.solve(&change)))
    }

    /// Both beliefs together, weighted by their covariances; none where they contradict each other.
    fn with(&self, seen: &Self) -> Option<Self> {
        if self.distance(seen) > crate::estimate::chi_square_quantile(6) {
            return None;
        }
        let gain = self.covariance * (self.covariance + seen.covariance).cholesky()?.inverse();
        let covariance = self.covariance - gain * self.covariance;
        Some(Self {
            pose: moved(&self.pose, &(gain * change(&self.pose, &seen.pose))),
            covariance: (covariance + covariance.transpose()) * 0.5,
            shift_m: 0.0,
        })
    }

    /// Logarithm of the density with which another belief is where it is.
    pub(super) fn log_density(&self, other: &Self) -> f64 {
        let spread = (self.covariance + other.covariance) * (2.0 * std::f64::consts::PI);
        -0.5 * (self.distance(other) + spread.determinant().ln())
    }
}

/// What leads from one pose to the other: a shift in world axes, then a turn in body axes.
fn change(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Vector6<f64> {
    let shift = to.translation.vector - from.translation.vector;
    let turn = (from.rotation.inverse() * to.rotation).scaled_axis();
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

#[derive(Debug, Clone, Default)]
pub(super) struct History {
    last: Option<(i64, Belief)>,
    before: Option<(i64, Belief)>,
}

impl History {
    /// Adds a pose, with what was predicted where that is where it is.
    pub(super) fn push(&mut self, t_ns: i64, estimate: &PoseEstimate, predicted: Option<&Belief>) {
        let seen = Belief::of(estimate);
        let both = predicted.and_then(|p| p.with(&seen)).unwrap_or(seen);
        self.before = self.last.replace((t_ns, both));
    }

    /// The pose that constant velocity leads to, with what an unpredicted acceleration does to it; none where
    /// that is more than the size of the body, from where on it cannot distinguish markers.
    pub(super) fn predicted(&self, t_ns: i64, size_m: f64) -> Option<Belief> {
        let (last_ns, last) = self.last.as_ref()?;
        let ahead_s = (t_ns - last_ns) as f64 * 1e-9;
        let mut covariance = last.covariance;
        let mut pose = last.pose;
        let mut shift_m = SPEED_M_S * ahead_s;
        if let Some((before_ns, before)) = &self.before {
            let apart_s = (last_ns - before_ns) as f64 * 1e-9;
            let accelerated_m = 0.5 * ACCELERATION_M_S2 * ahead_s * (ahead_s + apart_s);
            if apart_s > 0.0 && accelerated_m < shift_m {
                let ratio = ahead_s / apart_s;
                pose = moved(&last.pose, &(change(&before.pose, &last.pose) * ratio));
                covariance = covariance * (1.0 + ratio).powi(2) + before.covariance * ratio.powi(2);
                shift_m = accelerated_m;
            }
        }
        if ahead_s.is_nan() || ahead_s <= 0.0 || shift_m > size_m {
            return None;
        }
        let turn_rad = shift_m / size_m;
        for k in 0..3 {
            covariance[(k, k)] += shift_m * shift_m;
            covariance[(k + 3, k + 3)] += turn_rad * turn_rad;
        }
        Some(Belief { pose, covariance, shift_m })
    }
}

/// Share of what is known of the noise that is kept from frame to frame: some seconds of video.
const NOISE_MEMORY: f64 = 0.99;
/// Redundancy from which one instant shows how large its noise is: three markers in two cameras.
pub(super) const LEAST_DEGREES: f64 = 6.0;

/// What the residuals so far show of the claimed covariances.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Noise {
    squares: f64,
    degrees: f64,
}

impl Noise {
    /// The factor on the claims, and the logarithm of the misfit's density: Student's, as the factor is known
    /// as if by [`CLAIM_DEGREES`] (Gelman et al. 2013, section 2.6); where nothing was seen yet and residuals
    /// show more than that, theirs.
    pub(super) fn misfit(&self, squares: f64, degrees: f64) -> (f64, f64) {
        if self.degrees == 0.0 && degrees >= LEAST_DEGREES {
            let scale = (squares / degrees).max(1.0);
            return (scale, -0.5 * squares / scale);
        }
        let scale = self.scale().unwrap_or(1.0);
        (scale, -0.5 * (CLAIM_DEGREES + degrees) * (squares / (CLAIM_DEGREES * scale)).ln_1p())
    }

    /// The factor on the claims, where anything was seen yet.
    pub(super) fn scale(&self) -> Option<f64> {
        (self.degrees > 0.0).then(|| (self.squares / self.degrees).max(1.0))
    }

    /// What is beyond chance by the noise so far counts as much as chance allows (Huber 1981): noise that grows is followed, a
    /// camera that was pushed is not taken for noise.
    pub(super) fn learn(&mut self, estimate: &PoseEstimate, squares: f64, degrees: f64) {
        if estimate.left_out.is_empty() && degrees >= LEAST_DEGREES {
            let most = |scale: f64| scale * crate::estimate::chi_square_quantile(degrees as usize);
            let squares = squares.min(self.scale().map_or(f64::INFINITY, most));
            self.squares = NOISE_MEMORY * self.squares + squares;
            self.degrees = NOISE_MEMORY * self.degrees + degrees;
        }
    }
}

/// Standard deviations, in the plane, beyond which a camera's view is shifted. By chance it is so twice in a
/// row once in a hundred hours of two cameras at 60 Hz: p² · 432 000 = 0.01, and √(-2 ln p) of that.
pub(super) const SHIFTED: f64 = 4.2;
/// Instants over which a camera's usual shift is averaged: some seconds.
const USUAL: f64 = 200.0;

/// A camera that was moved while it filmed, or whose image stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovedCamera {
    /// Index in the rig.
    pub camera: usize,
    /// First instant at which its view was shifted.
    pub t_ns: i64,
    /// By how much the body's image was shifted then.
    pub shift_px: Vector2<f64>,
    /// Since when its balls have stood still, where most of the shift has come since: its image is frozen, and
    /// it is the aircraft that moved.
    pub still_since_ns: Option<i64>,
    /// The camera that may have been moved in its place: what two cameras see together does not show which of them it was.
    /// Neither takes part from then on.
    pub or: Option<usize>,
}

/// A camera's balls, for as long as they stand still in its images.
#[derive(Debug, Clone, Default)]
struct Still {
    since_ns: i64,
    /// By how much the camera's view was shifted then.
    shift_px: Vector2<f64>,
    /// Track and place of each.
    balls: Vec<(u32, Vector2<f64>)>,
}

impl Still {
    /// Whether a camera has the same balls in the same places, to within three standard deviations of a centre.
    fn is_of(&self, camera: usize, seen: &[TrackedDetection]) -> bool {
        let mut standing = 0;
        for own in seen.iter().filter(|s| s.camera == camera) {
            let Some((_, at)) = self.balls.iter().find(|b| b.0 == own.track_id) else { continue };
            if (own.pixel - at).norm_squared() > 9.0 * own.covariance_px2.trace() {
                return false;
            }
            standing += 1;
        }
        standing >= 3
    }

    /// Takes the balls of a camera as they are at a time; in flight nothing is allocated for them again.
    fn begin(&mut self, camera: usize, (t_ns, seen): (i64, &[TrackedDetection]), shift_px: Vector2<f64>) {
        (self.since_ns, self.shift_px) = (t_ns, shift_px);
        self.balls.clear();
        self.balls.extend(seen.iter().filter(|s| s.camera == camera).map(|s| (s.track_id, s.pixel)));
    }
}

/// Instants after which a camera that was found to be moved, and fits again, is used again: their mean square is
/// known to a fifth then.
pub(super) const FITTING_INSTANTS: u32 = 30;
/// Ratio of that mean square to the usual one up to which the camera fits: by chance it is more once in 140 times,
/// and where a shift of one standard deviation is left, half the times.
const FITTING: f64 = 1.5;

/// How a camera that was found to be moved has fitted since it last did not.
#[derive(Debug, Clone, Copy, Default)]
struct Fitting {
    instants: u32,
    squares: f64,
    /// Logarithm of the odds that it is not shifted any more as it was found to be.
    log_odds: f64,
}

/// What is known of the cameras' standing still.
#[derive(Debug, Clone, Default)]
pub(super) struct Watch {
    /// Whether a camera that was found to be moved is used again when it fits again.
    pub(super) may_return: bool,
    fitting: Vec<Fitting>,
    pub(super) suspects: Vec<MovedCamera>,
    pub(super) moved: Vec<MovedCamera>,
    /// For each camera the mean square shift of its view of the body while it stands, in standard deviations:
    /// 2, and more where cameras are less exact than is claimed.
    usual: Vec<f64>,
    /// Instants without one in between at which two cameras saw the body alike, up to the last one.
    pub(super) agreed: usize,
    still: Vec<Still>,
    pub(super) repeated: Vec<Repeated>,
}

impl Watch {
    pub(super) fn is_moved(&self, camera: usize) -> bool {
        self.moved.iter().any(|m| m.camera == camera)
    }

    pub(super) fn is_out(&self, camera: usize) -> bool {
        let suspects = self.suspects.iter().filter(|s| s.or.is_none());
        self.moved.iter().chain(suspects).any(|m| m.camera == camera)
    }

    /// Leaves a camera out from now on, and with it the one that may have been moved in its place.
    pub(super) fn leave_out(&mut self, found: MovedCamera) {
        let rival = found.or.filter(|_| found.still_since_ns.is_none());
        self.moved.push(MovedCamera { or: rival, ..found });
        if let Some(other) = rival.filter(|other| !self.is_moved(*other)) {
            let (camera, or) = (other, Some(found.camera));
            self.moved.push(MovedCamera { camera, or, shift_px: -found.shift_px, ..found });
        }
    }

    /// Since when the balls of a camera stand still, where most of the shift of its view has come since.
    pub(super) fn still_since_ns(
        &mut self,
        camera: usize,
        (t_ns, seen): (i64, &[TrackedDetection]),
        shift_px: Vector2<f64>,
    ) -> Option<i64> {
        if self.still.len() <= camera {
            self.still.resize(camera + 1, Still::default());
        }
        let still = &mut self.still[camera];
        if !still.is_of(camera, seen) {
            still.begin(camera, (t_ns, seen), shift_px);
        }
        (2.0 * (shift_px - still.shift_px).norm() > shift_px.norm()).then_some(still.since_ns)
    }

    /// Whether a shift is beyond what is usual of a camera; what is not becomes part of that.
    pub(super) fn is_beyond_usual(&mut self, camera: usize, square: f64) -> bool {
        let usual = self.usual(camera);
        let is_beyond = is_beyond(square, *usual);
        if !is_beyond {
            *usual += (square - *usual) / USUAL;
        }
        is_beyond
    }

    fn usual(&mut self, camera: usize) -> &mut f64 {
        if self.usual.len() <= camera {
            self.usual.resize(camera + 1, 2.0);
        }
        &mut self.usual[camera]
    }

    /// Takes the square of the shift of a camera that was found to be moved, and the logarithm of the odds against that shift; none
    /// where its image stands or does not show enough. It is used again when its shift has long been what it was before, and the
    /// other cameras show well enough that it is not the one that was found.
    pub(super) fn fits(&mut self, camera: usize, fit: Option<(f64, f64)>) {
        let usual = *self.usual(camera);
        if self.fitting.len() <= camera {
            self.fitting.resize(camera + 1, Fitting::default());
        }
        let fitting = &mut self.fitting[camera];
        let Some((square, log_odds)) = fit.filter(|(square, _)| !is_beyond(*square, usual)) else {
            *fitting = Fitting::default();
            return;
        };
        (fitting.instants, fitting.squares) = (fitting.instants + 1, fitting.squares + square);
        fitting.log_odds += log_odds;
        if fitting.instants < FITTING_INSTANTS {
            return;
        }
        if fitting.squares > FITTING * usual.max(2.0) * f64::from(fitting.instants) {
            *fitting = Fitting::default();
        } else if fitting.log_odds >= DECISIVE_LOG_ODDS {
            self.moved.retain(|m| m.camera != camera);
            *fitting = Fitting::default();
        }
    }
}

fn is_beyond(square: f64, usual: f64) -> bool {
    square > SHIFTED * SHIFTED * (0.5 * usual).max(1.0)
}
