//! What tracking yields.

use crate::health::{CameraHealth, CentreQuality};
use crate::{Finding, TimedFrame};
use mavsight_pose::{ClockEstimate, Observations, PoseEstimator, PoseSample};
use nalgebra::Vector6;

/// What tracking yields.
#[derive(Debug, Clone, Default)]
pub struct Tracked {
    /// Every marker seen, by time, camera and marker.
    pub observations: Observations,
    /// Apparent diameters, one for each observation; none where the observations came from elsewhere.
    pub diameters_px: Vec<f32>,
    /// One sample an instant, empty where it could not be measured.
    pub poses: Vec<PoseSample>,
    /// Whether an encoder may have predicted frames of some camera from those before and after them.
    pub may_be_reordered: bool,
    /// How far poses may be displaced together by such frames, one for each pose
    /// ([`mavsight_pose::displacements_of_reordered_frames`]); none where there are none.
    pub displacements: Vec<Vector6<f32>>,
    /// What the poses were estimated with at last; none where they come from elsewhere.
    pub estimator: Option<PoseEstimator>,
    /// The cameras' clocks; none where the observations came from elsewhere.
    pub clocks: Vec<ClockEstimate>,
    /// How well each camera saw the markers; none where the observations came from elsewhere.
    pub health: Vec<CameraHealth>,
    /// What is wrong with cameras, recordings and files, and what explains it.
    pub findings: Vec<Finding>,
    /// A frame of each camera from about the middle of its recording, at its time by the common clock; none where the
    /// observations came from elsewhere.
    pub pictures: Vec<TimedFrame>,
    /// What was missing of the recordings and could not be had, with camera and time.
    pub notes: Vec<String>,
}

impl Tracked {
    /// How good the markers' centres claim to be; `None` where there are none.
    pub fn centre_quality(&self) -> Option<CentreQuality> {
        let std_px = self.observations.iter().map(|o| o.covariance_px2.determinant().powf(0.25));
        let mut all_px: Vec<f64> = std_px.filter(|s| s.is_finite()).collect();
        all_px.sort_by(f64::total_cmp);
        let middle = |part: usize| all_px.get((2 * part + 1) * all_px.len() / 20).copied();
        let mut tenths_px = [0.0; 10];
        for (part, std_px) in tenths_px.iter_mut().enumerate() {
            *std_px = middle(part)?;
        }
        let bias_std_px = self.estimator.as_ref().map_or(0.0, PoseEstimator::bias_std_px);
        Some(CentreQuality { tenths_px, bias_std_px })
    }

    /// Room for so many instants at which so many markers are seen. Lists that double when they are full
    /// leave behind, in an hour of film, as much again.
    pub(crate) fn reserve(&mut self, instants: usize, observations: usize) {
        self.poses.reserve(instants);
        self.observations.reserve(instants, observations);
        self.diameters_px.reserve(instants * observations);
    }
}
