//! The associator: what it knows of the body, the cameras and the flight so far.

use super::history::{History, Noise, Watch};
use super::symmetry;
use crate::{PoseError, PoseEstimator, PoseSample, Rig};
use mavsight_geometry::{Camera, Vector3, centroid_and_spread};

/// Logarithm of the odds at which an assignment is believed: 999 to 1.
pub(super) const DECISIVE_LOG_ODDS: f64 = 6.907;

/// What one instant's candidates are.
#[derive(Debug, Clone, PartialEq)]
pub struct Association {
    /// The pose, or why there is none.
    pub sample: PoseSample,
    /// Index of the candidate and of its marker, by camera and marker; none without a pose.
    pub pairs: Vec<(usize, usize)>,
}

/// Gives balls to markers, instant by instant.
#[derive(Debug, Clone)]
pub struct Associator {
    pub(super) estimator: PoseEstimator,
    pub(super) cameras: Vec<Camera>,
    pub(super) colors: Vec<usize>,
    pub(super) markers_std_m: f64,
    pub(super) volume_m3: f64,
    /// Root mean square distance of the markers from their middle.
    pub(super) size_m: f64,
    pub(super) history: History,
    pub(super) noise: Noise,
    pub(super) watch: Watch,
}

impl Associator {
    /// An associator for the body of an estimator, whose markers have the given colours (equal numbers for
    /// equal colours) and were placed with a standard deviation.
    ///
    /// # Errors
    /// [`PoseError::SymmetricMarkers`] where markers of one colour can change places so that the body looks
    /// the same.
    pub fn new(
        estimator: PoseEstimator,
        rig: &Rig,
        colors: &[usize],
        markers_std_m: f64,
    ) -> Result<Self, PoseError> {
        let markers = estimator.markers();
        let mut colors = colors.to_vec();
        colors.resize(markers.len(), usize::MAX);
        symmetry::refuse_symmetric(markers, &colors, markers_std_m)?;
        let (_, spread_m) = centroid_and_spread(markers.iter().map(|m| m.marker_in_body_m));
        let size_m = (3f64.sqrt() * spread_m).max(1e-3);
        let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
        let volume_m3 = room_m3(rig, &cameras);
        let (history, noise, watch) = Default::default();
        Ok(Self { estimator, cameras, colors, markers_std_m, volume_m3, size_m, history, noise, watch })
    }

    /// The estimator of poses.
    pub fn estimator(&self) -> &PoseEstimator {
        &self.estimator
    }
}

/// Twice the box around the control points each way, or the cameras' where there are none.
fn room_m3(rig: &Rig, cameras: &[Camera]) -> f64 {
    let mut points = rig.control_points_in_world();
    points.extend(cameras.iter().map(Camera::centre_in_world));
    let low = points.iter().fold(Vector3::repeat(f64::MAX), |a, p| a.inf(p));
    let high = points.iter().fold(Vector3::repeat(f64::MIN), |a, p| a.sup(p));
    (high - low).iter().map(|side| 2.0 * side.clamp(1.0, 1e3)).product()
}

pub(super) fn refused(t_ns: i64, reason: PoseError) -> Association {
    Association { sample: PoseSample { t_ns, estimate: Err(reason) }, pairs: Vec::new() }
}
