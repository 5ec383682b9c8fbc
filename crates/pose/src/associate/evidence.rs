//! The odds of an assignment: evidence that the detections are the body's, against balls that lie there by
//! chance.

use super::associator::Associator;
use super::frame::{Frame, Pairs};
use super::history::Belief;
use crate::reprojection::moved;
use crate::{PoseEstimate, TrackedDetection};
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{Isometry3, Matrix2, Matrix3, Matrix6, Point3, Vector2, Vector3};
use nalgebra::{Cholesky, Const, Matrix2x3, Matrix2x6};
use std::f64::consts::PI;

/// Logarithm of the share of balls that are hidden by something else than what hides all of them: one in ten.
const LOG_MISSED: f64 = -2.303;

impl Associator {
    /// Log odds of the body at the estimate against other objects of the markers' colours: the evidence of
    /// the detections by Laplace's approximation (MacKay 1992), for poses as predicted, or uniform over room
    /// and rotations. Other objects lie anywhere in an image or in the room, whichever explains the
    /// detections better.
    pub(super) fn log_odds(
        &self,
        estimate: &PoseEstimate,
        frame: Frame,
        pairs: &Pairs,
        predicted: Option<&Belief>,
    ) -> f64 {
        let belief = Belief::of(estimate);
        let mut normal = Matrix6::zeros();
        let mut evidence = vec![MarkerEvidence::default(); self.colors.len()];
        for (index, marker) in pairs.iter().filter(|p| estimate.markers_used.contains(p.1)) {
            let candidate = &frame.seen[*index];
            let Some(expected) = self.expected(&belief.pose, candidate.camera, *marker) else { continue };
            let Some(factor) = self.detection_covariance(&expected, candidate).cholesky() else { continue };
            normal += expected.jacobian.transpose() * factor.solve(&expected.jacobian);
            let alike = |c: &&TrackedDetection| c.camera == candidate.camera && c.color == candidate.color;
            let rivals = frame.seen.iter().filter(alike).count() as f64;
            let area_px2 = self.cameras[candidate.camera].size.area_px() as f64;
            let of_marker = &mut evidence[*marker];
            of_marker.rivals = of_marker.rivals.max(rivals);
            of_marker.log_in_images += (rivals / area_px2).ln();
            of_marker.add(&expected, candidate.pixel - expected.pixel, &factor);
        }
        let n: usize = evidence.iter().map(|t| t.detections).sum();
        if n < 3 {
            return f64::NEG_INFINITY;
        }
        let squares: f64 = evidence.iter().map(|t| t.square).sum();
        let (scale, log_misfit) = self.noise.misfit(squares, (2 * n).saturating_sub(6) as f64);
        let apart = |t: &MarkerEvidence| t.log_spread(scale) - t.log_chance(scale, self.volume_m3);
        let log_missed = LOG_MISSED * self.missed(&belief, frame, pairs);
        let log_evidence: f64 = log_missed + log_misfit + evidence.iter().map(apart).sum::<f64>();
        let log_prior = match predicted {
            Some(predicted) => -predicted.log_density(&belief),
            None => (self.volume_m3 * 8.0 * PI * PI).ln(),
        };
        let log_posterior = 3.0 * (2.0 * PI * scale).ln() - 0.5 * normal.determinant().ln();
        let odds = log_evidence - log_prior + log_posterior;
        if odds.is_nan() { f64::NEG_INFINITY } else { odds }
    }
}

/// The detections of one marker, as its own and as those of anything else.
#[derive(Debug, Clone, Default)]
struct MarkerEvidence {
    detections: usize,
    rivals: f64,
    square: f64,
    /// Σ ln 2π |R|^½.
    log_spread: f64,
    /// Σ ln of rivals over the image's area.
    log_in_images: f64,
    normal: Matrix3<f64>,
    gradient: Vector3<f64>,
}

impl MarkerEvidence {
    fn add(&mut self, expected: &Expected, error: Vector2<f64>, factor: &Cholesky<f64, Const<2>>) {
        let weighted = factor.solve(&error);
        self.detections += 1;
        self.square += error.dot(&weighted);
        self.log_spread += (2.0 * PI * factor.determinant().sqrt()).ln();
        self.normal += expected.by_point.transpose() * factor.solve(&expected.by_point);
        self.gradient += expected.by_point.transpose() * weighted;
    }

    /// Density of the detections at the pose but for the misfit, with their covariances scaled.
    fn log_spread(&self, scale: f64) -> f64 {
        -self.log_spread - self.detections as f64 * scale.ln()
    }

    /// Density of the detections if they are anything else's.
    fn log_chance(&self, scale: f64, volume_m3: f64) -> f64 {
        let in_space = self.normal.cholesky().filter(|_| self.detections > 1).map(|c| {
            let left = (self.square - self.gradient.dot(&c.solve(&self.gradient))).max(0.0);
            let cloud = 1.5 * (2.0 * PI * scale).ln() - 0.5 * c.determinant().ln();
            (self.rivals / volume_m3).ln() + cloud + self.log_spread(scale) - 0.5 * left / scale
        });
        in_space.map_or(self.log_in_images, |s| s.max(self.log_in_images))
    }
}

pub(super) struct Expected {
    pub(super) pixel: Vector2<f64>,
    pub(super) jacobian: Matrix2x6<f64>,
    by_point: Matrix2x3<f64>,
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

    /// Squared distance of a candidate from a marker in standard deviations; none if of the wrong size or
    /// behind.
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
