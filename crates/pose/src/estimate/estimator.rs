//! The estimator: a rig, a body, and what is not known of them.

use super::sample::{BodyMarker, MarkerSet, PoseEstimate};
use super::systematic::SystematicErrors;
use crate::reprojection::{PointObservation, Scene};
use crate::{MarkerObservation, PoseError, RefinedFlight, Rig};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Vector2};
use nalgebra::DMatrix;

/// Estimates poses of one body with one rig.
#[derive(Debug, Clone)]
pub struct PoseEstimator {
    pub(super) cameras: Vec<Camera>,
    pub(super) markers: Vec<BodyMarker>,
    pub(super) errors: SystematicErrors,
    /// Constant error of each marker's centre, camera by camera.
    pub(super) offsets_px: Vec<Vector2<f64>>,
}

impl PoseEstimator {
    /// An estimator for a body seen by a rig; the markers' positions count as exact.
    pub fn new(rig: &Rig, markers: &[BodyMarker]) -> Self {
        let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
        Self {
            errors: SystematicErrors::of_rig(rig, markers.len()),
            markers: markers.to_vec(),
            offsets_px: vec![Vector2::zeros(); cameras.len() * markers.len()],
            cameras,
        }
    }

    /// The body.
    pub fn markers(&self) -> &[BodyMarker] {
        &self.markers
    }

    /// Adds the uncertainty of the markers' positions: 3 rows a marker (body axes, m), each column one
    /// standard deviation along an independent direction, so that their covariance is M Mᵀ.
    ///
    /// # Errors
    /// [`PoseError::MarkerUncertainty`] for another number of rows or what is not finite.
    pub fn with_marker_uncertainty(mut self, factor_m: &DMatrix<f64>) -> Result<Self, PoseError> {
        let refused = PoseError::MarkerUncertainty { rows: factor_m.nrows(), needed: 3 * self.markers.len() };
        self.errors = self.errors.with_markers(factor_m).ok_or(refused)?;
        Ok(self)
    }

    /// An estimator with cameras and centres as a flight has shown them, with what that leaves open; the
    /// markers are those of the flight, or where it does not show them, those of the file.
    ///
    /// # Errors
    /// [`PoseError::MarkerUncertainty`] for a body of another number of markers.
    pub fn refined(flight: &RefinedFlight, markers: Option<&[BodyMarker]>) -> Result<Self, PoseError> {
        let mut out = Self::new(&flight.rig, markers.unwrap_or(&flight.markers));
        let needed = 3 * flight.markers.len();
        let refused = PoseError::MarkerUncertainty { rows: 3 * out.markers.len(), needed };
        if out.markers.len() != flight.markers.len() {
            return Err(refused);
        }
        let mut factor = flight.uncertainty.clone();
        if markers.is_some() {
            factor.rows_mut(CAMERA_PARAMETERS * out.cameras.len(), needed).fill(0.0);
        }
        out.errors = out.errors.fitted(factor).ok_or(refused)?;
        out.offsets_px.clone_from(&flight.offsets_px);
        Ok(out)
    }

    pub(crate) fn scene(&self) -> Scene<'_> {
        Scene { cameras: &self.cameras, points: &self.markers }
    }

    /// Observations without the constant errors of their centres.
    pub(super) fn views(
        &self,
        seen: impl Iterator<Item = MarkerObservation>,
    ) -> Result<Vec<PointObservation>, PoseError> {
        let most = self.markers.len().min(MarkerSet::MOST);
        let mut out = Vec::with_capacity(seen.size_hint().1.unwrap_or(0));
        for o in seen {
            let mut view = PointObservation::of(&o, self.cameras.len(), most)?;
            view.pixel -= self.offsets_px[o.camera * self.markers.len() + o.marker];
            out.push(view);
        }
        Ok(out)
    }

    pub(crate) fn views_of(
        &self,
        seen: &[MarkerObservation],
        estimate: &PoseEstimate,
    ) -> Result<Vec<PointObservation>, PoseError> {
        self.views(seen.iter().copied().filter(|o| estimate.markers_used.contains(o.marker)))
    }
}
