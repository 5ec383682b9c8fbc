//! The result of a refinement, and its prior.

use crate::{BodyMarker, PoseError, Rig};
use mavsight_geometry::{Vector2, Vector3};
use nalgebra::DMatrix;

/// Cameras, marker positions and systematic errors of centres, as a flight has refined them, with their
/// uncertainty.
///
/// The world's axes remain where the control points have put them. The markers are given in the body axes for
/// which their displacements from the vehicle file have no common shift and turn (Procrustes): if the ruler
/// was off by σ in each coordinate, these are off from the file's true axes by about σ/√n, for every pose
/// alike.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedFlight {
    /// The cameras, with their uncertainty.
    pub rig: Rig,
    /// The body with the refined positions.
    pub markers: Vec<BodyMarker>,
    /// Constant errors of centres, camera by camera, marker by marker.
    pub offsets_px: Vec<Vector2<f64>>,
    /// Uncertainty of all three together: 16 rows a camera, 3 a marker (body axes, m), 2 for each marker in
    /// each camera (camera by camera, px); each column one standard deviation along an independent direction.
    pub uncertainty: DMatrix<f64>,
    /// Standard deviation of each coordinate of each marker.
    pub markers_std_m: Vec<Vector3<f64>>,
    /// Largest angle between the attitudes of two frames.
    pub turned_rad: f64,
    /// Sum of the squared whitened residuals before and after the refinement.
    pub chi_square: (f64, f64),
    /// Estimated ratio of the residuals' variance to the stated covariances of the centres.
    pub variance_factor: f64,
    /// Instants that entered.
    pub frames: usize,
    /// Standard deviation of the systematic errors of centres, as it was given or found.
    pub centres_std_px: f64,
    pub(super) markers_prior_m: f64,
}

/// Prior knowledge of the body and the centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightPrior {
    /// Standard deviation of each coordinate of the markers' positions: a ruler is good to 1 or 2 mm, to half
    /// a millimetre with care.
    pub markers_std_m: f64,
    /// Standard deviation of the systematic error of a centre, independent for each coordinate of each marker
    /// in each camera; 0 for none, `None` to estimate it from the residuals.
    pub centres_std_px: Option<f64>,
}

impl RefinedFlight {
    /// Succeeds if the flight determines the body's shape better than the vehicle file did. While the
    /// aircraft keeps its attitude, systematic errors of centres look like markers elsewhere; when it turns,
    /// they do not.
    ///
    /// # Errors
    /// [`PoseError::ShapeNotShown`] for a flight that turns too little.
    pub fn shape_is_shown(&self) -> Result<(), PoseError> {
        // The ruler leaves its variance in each direction but the six of the whole body's motion.
        let free = (3 * self.markers.len()).saturating_sub(6).max(1) as f64;
        let sum_m2: f64 = self.markers_std_m.iter().map(Vector3::norm_squared).sum();
        let (std_m, prior_std_m) = ((sum_m2 / free).sqrt(), self.markers_prior_m);
        if std_m < SHOWN * prior_std_m {
            return Ok(());
        }
        let (turned_rad, systematic_px) = (self.turned_rad, self.centres_std_px);
        Err(PoseError::ShapeNotShown { std_m, prior_std_m, turned_rad, systematic_px })
    }
}

/// A shape whose standard deviation is not below this part of the file's is not worth a change of the body.
const SHOWN: f64 = 0.9;
