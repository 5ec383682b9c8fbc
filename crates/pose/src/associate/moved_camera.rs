//! What is known of the cameras' standing still.

use mavsight_geometry::Vector2;

/// Standard deviations, in the plane, beyond which a camera's view is shifted. By chance it is so twice in a
/// row once in a hundred hours of two cameras at 60 Hz: p² · 432 000 = 0.01, and √(-2 ln p) of that.
const SHIFTED: f64 = 4.2;
/// Instants over which a camera's usual shift is averaged: some seconds.
const USUAL: f64 = 200.0;

/// A camera that was moved while it filmed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovedCamera {
    /// Index in the rig.
    pub camera: usize,
    /// First instant at which its view was shifted.
    pub t_ns: i64,
    /// By how much the body's image was shifted then.
    pub shift_px: Vector2<f64>,
}

/// What is known of the cameras' standing still.
#[derive(Debug, Clone, Default)]
pub(super) struct Watch {
    pub(super) suspects: Vec<MovedCamera>,
    pub(super) moved: Vec<MovedCamera>,
    /// For each camera the mean square shift of its view of the body while it stands, in standard deviations:
    /// 2, and more where cameras are less exact than is claimed.
    usual: Vec<f64>,
}

impl Watch {
    pub(super) fn is_out(&self, camera: usize) -> bool {
        self.moved.iter().chain(&self.suspects).any(|m| m.camera == camera)
    }

    /// Whether a shift is beyond what is usual of a camera; what is not becomes part of that.
    pub(super) fn is_beyond_usual(&mut self, camera: usize, square: f64) -> bool {
        if self.usual.len() <= camera {
            self.usual.resize(camera + 1, 2.0);
        }
        let usual = &mut self.usual[camera];
        let is_beyond = square > SHIFTED * SHIFTED * (0.5 * *usual).max(1.0);
        if !is_beyond {
            *usual += (square - *usual) / USUAL;
        }
        is_beyond
    }
}
