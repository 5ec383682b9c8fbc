//! The odds of an assignment: evidence that the detections are the body's, against balls that lie there by
//! chance.

use super::associator::Associator;
use super::belief::Belief;
use super::expected::Expected;
use super::frame::{Frame, Pairs};
use crate::{PoseEstimate, TrackedDetection};
use mavsight_geometry::{Matrix3, Matrix6, Vector3};
use nalgebra::{Cholesky, Const};
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
            evidence[*marker].add(&expected, candidate, &factor, &ByChance { rivals, area_px2 });
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

/// Detections of a marker's colour that one camera has by chance: their number, and the area of its image.
struct ByChance {
    rivals: f64,
    area_px2: f64,
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
    fn add(
        &mut self,
        expected: &Expected,
        candidate: &TrackedDetection,
        factor: &Cholesky<f64, Const<2>>,
        chance: &ByChance,
    ) {
        let error = candidate.pixel - expected.pixel;
        let weighted = factor.solve(&error);
        self.detections += 1;
        self.rivals = self.rivals.max(chance.rivals);
        self.square += error.dot(&weighted);
        self.log_spread += (2.0 * PI * factor.determinant().sqrt()).ln();
        self.log_in_images += (chance.rivals / chance.area_px2).ln();
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
