//! The body, predictions for planning, and the result of one instant.

use super::sample::PoseEstimate;
use crate::PoseError;
use mavsight_geometry::{Matrix2, Vector3};

/// A ball on the body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMarker {
    /// Its name in messages.
    pub name: String,
    /// Centre of the ball, body axes.
    pub marker_in_body_m: Vector3<f64>,
    /// Radius of the ball; 0 for a point.
    pub radius_m: f64,
}

/// The prediction of an observation, for planning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedObservation {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Index of the marker on the body.
    pub marker: usize,
    /// Covariance that the centre of its image will have.
    pub covariance_px2: Matrix2<f64>,
}

/// One instant: a pose, or why there is none.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSample {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// The pose, or why there is none.
    pub estimate: Result<PoseEstimate, PoseError>,
}
