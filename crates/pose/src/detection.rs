//! A ball in an image: followed by a camera's tracker, and later identified as a marker.

use mavsight_geometry::{Matrix2, Vector2};

/// A detection of a track: one camera sees a ball that it follows, and nobody knows yet which marker it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedDetection {
    /// Time stamp of the frame by the camera's own clock; after the cameras are joined, the common instant.
    pub t_ns: i64,
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Number of the track: it does not change while the camera follows the ball.
    pub track_id: u32,
    /// Index of the colour among those of the markers, as in [`Associator::new`](crate::Associator::new).
    pub color: usize,
    /// Centre of the ball's image.
    pub pixel: Vector2<f64>,
    /// Covariance of the centre.
    pub covariance_px2: Matrix2<f64>,
    /// Apparent diameter; 0 where it is not known.
    pub diameter_px: f64,
    /// Whether the track has not moved in the image for long. Such balls are tried last.
    pub is_static: bool,
    /// Whether the track is the most likely of its colour in this camera to be a marker.
    pub is_preferred: bool,
}

/// One marker seen in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkerObservation {
    /// Middle of the exposure; of a [`CameraStream`](crate::CameraStream), the time stamp by the camera's own
    /// clock.
    pub t_ns: i64,
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Index of the marker on the body.
    pub marker: usize,
    /// Centre of the ball's image.
    pub pixel: Vector2<f64>,
    /// Covariance of the centre.
    pub covariance_px2: Matrix2<f64>,
}

/// Largest ratio between the diameter seen and the one expected: a ball half hidden still shows more.
const MOST_SIZE_RATIO: f64 = 1.6;

impl TrackedDetection {
    /// Whether its diameter is about as expected; a number that is not above zero is not known.
    pub(crate) fn may_have_diameter(&self, expected_px: f64) -> bool {
        let ratio = self.diameter_px / expected_px;
        let is_known = self.diameter_px > 0.0 && expected_px > 0.0;
        !is_known || (1.0 / MOST_SIZE_RATIO..=MOST_SIZE_RATIO).contains(&ratio)
    }

    /// This detection as an observation of a marker.
    pub fn of_marker(&self, marker: usize) -> MarkerObservation {
        let Self { t_ns, camera, pixel, covariance_px2, .. } = *self;
        MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 }
    }
}
