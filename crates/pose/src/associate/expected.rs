//! The image of a marker as a belief predicts it, and the distance of a detection from it.

use super::associator::Associator;
use super::belief::Belief;
use crate::TrackedDetection;
use crate::reprojection::moved;
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{Isometry3, Matrix2, Point3, Vector2, Vector3};
use nalgebra::{Matrix2x3, Matrix2x6};

pub(super) struct Expected {
    pub(super) pixel: Vector2<f64>,
    pub(super) jacobian: Matrix2x6<f64>,
    pub(super) by_point: Matrix2x3<f64>,
    pub(super) diameter_px: f64,
}

impl Associator {
    /// What a camera sees of a marker of the body at a pose.
    pub(super) fn expected(&self, pose: &Isometry3<f64>, camera: usize, marker: usize) -> Option<Expected> {
        let (view, ball) = (self.cameras.get(camera)?, &self.estimator.markers()[marker]);
        let centre: Vector3<f64> = (pose * Point3::from(ball.marker_in_body_m)).coords;
        let seen = view.project_ball(&centre, ball.radius_m).ok()?;
        let range_m = (centre - view.centre_in_world()).norm();
        let focal_px = (view.intrinsics.fx_px * view.intrinsics.fy_px).abs().sqrt();
        Some(Expected {
            pixel: seen.pixel,
            jacobian: d_pixel_d_pose(&seen, pose, &ball.marker_in_body_m),
            by_point: seen.d_pixel_d_point_in_world,
            diameter_px: focal_px * 2.0 * ball.radius_m / range_m,
        })
    }

    /// Covariance of a detection against the body: the centre's and that of the marker's place.
    pub(super) fn detection_covariance(
        &self,
        expected: &Expected,
        candidate: &TrackedDetection,
    ) -> Matrix2<f64> {
        let place = expected.by_point * expected.by_point.transpose() * self.markers_std_m.powi(2);
        candidate.covariance_px2 + place
    }

    /// Squared distance of a candidate from where a marker is believed, in standard deviations; none where it
    /// is not of the size or behind the camera.
    pub(super) fn distance(
        &self,
        belief: &Belief,
        candidate: &TrackedDetection,
        marker: usize,
    ) -> Option<f64> {
        let expected = self.expected(&belief.pose, candidate.camera, marker)?;
        if !candidate.may_have_diameter(expected.diameter_px) {
            return None;
        }
        let spread = expected.jacobian * belief.covariance * expected.jacobian.transpose()
            + self.detection_covariance(&expected, candidate);
        let error = candidate.pixel - expected.pixel;
        spread.cholesky().map(|c| error.dot(&c.solve(&error)))
    }

    /// The belief after a candidate is taken for a marker (the update of a Kalman filter).
    pub(super) fn narrow(&self, belief: &mut Belief, candidate: &TrackedDetection, marker: usize) {
        let Some(expected) = self.expected(&belief.pose, candidate.camera, marker) else { return };
        let seen = belief.covariance * expected.jacobian.transpose();
        let spread = expected.jacobian * seen + self.detection_covariance(&expected, candidate);
        let Some(inverse) = spread.try_inverse() else { return };
        let gain = seen * inverse;
        belief.pose = moved(&belief.pose, &(gain * (candidate.pixel - expected.pixel)));
        let narrowed = belief.covariance - gain * seen.transpose();
        belief.covariance = (narrowed + narrowed.transpose()) * 0.5;
    }
}
