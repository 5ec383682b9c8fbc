//! The scale of the body: marker positions in millimetres or inches, or of another body.

use super::{Alternative, Evidence};
use crate::{Cause, PipelineError};
use mavsight_geometry::{ImagePoint, Vector3, triangulate};
use mavsight_pose::{BodyMarker, MarkerObservation, PoseEstimator, median};

/// Units in which positions are written by mistake, and the factor that a file in metres lacks then.
const UNITS: [(&str, f64); 4] =
    [("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254), ("feet", 0.3048)];

/// A scale this near to a unit's is that: rulers and cameras are better than a hundredth.
const NEAR: f64 = 0.02;

impl Evidence<'_> {
    /// What remains with the markers' places scaled by what the cameras see of their distances; `None` where
    /// no two markers are seen by two cameras.
    pub(super) fn another_scale(&self) -> Result<Option<Alternative>, PipelineError> {
        let ratios = self.instants.iter().flat_map(|seen| self.ratios(seen));
        let Some(scale) = median(ratios.collect()) else { return Ok(None) };
        let scaled =
            |m: &BodyMarker| BodyMarker { marker_in_body_m: m.marker_in_body_m * scale, ..m.clone() };
        let markers: Vec<BodyMarker> = self.estimator.markers().iter().map(scaled).collect();
        let estimator = PoseEstimator::new(self.rig, &markers);
        let Some(fit) = super::median_fit(&estimator, &self.instants)? else { return Ok(None) };
        let unit = UNITS.iter().find(|(_, factor)| (scale / factor - 1.0).abs() < NEAR);
        let what = unit.map_or(String::new(), |(name, _)| format!(" (they seem to be in {name})"));
        let words = format!(
            "with the marker positions of the vehicle file multiplied by {scale:.4}{what}: give them in metres"
        );
        Ok(Some(Alternative { cause: Cause::BodyScale, camera: None, fit, words }))
    }

    /// Distances of markers that two cameras see, over those of the vehicle file.
    fn ratios(&self, seen: &[MarkerObservation]) -> Vec<f64> {
        let places: Vec<(Vector3<f64>, Vector3<f64>)> = self
            .estimator
            .markers()
            .iter()
            .enumerate()
            .filter_map(|(marker, m)| {
                let own = seen.iter().filter(|o| o.marker == marker);
                let images: Vec<ImagePoint<'_>> = own
                    .map(|o| ImagePoint {
                        camera: &self.rig.cameras[o.camera].camera,
                        pixel: o.pixel,
                        covariance_px2: o.covariance_px2,
                    })
                    .collect();
                Some((triangulate(&images).ok()?.point_in_world_m, m.marker_in_body_m))
            })
            .collect();
        let pairs = places.iter().enumerate().flat_map(|(k, a)| places[k + 1..].iter().map(move |b| (a, b)));
        pairs
            .map(|(a, b)| (a.0 - b.0).norm() / (a.1 - b.1).norm())
            .filter(|r| r.is_finite() && *r > 0.0)
            .collect()
    }
}
