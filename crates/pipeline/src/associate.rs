//! What the trackers of all cameras saw at one instant, as candidates for the vehicle's markers.

use crate::output_error::MARKERS_STD_M;
use crate::watch::{CameraWatch, moved_notes};
use crate::{PipelineError, Tracked};
use mavsight_flight::Vehicle;
use mavsight_pose::{Associator, Candidate, MarkerObservation, PoseEstimator, Rig};
use mavsight_vision::BallColor;

/// The colours of a vehicle's markers, each once, and which of them each marker has.
pub(crate) struct MarkerColors {
    pub(crate) balls: Vec<BallColor>,
    pub(crate) of_marker: Vec<usize>,
}

impl MarkerColors {
    pub(crate) fn of(vehicle: &Vehicle) -> Self {
        let mut out = Self { balls: Vec::new(), of_marker: Vec::new() };
        for marker in &vehicle.marker {
            let rgb = marker.color.rgb();
            let color = out.balls.iter().position(|b| b.rgb == rgb).unwrap_or_else(|| {
                out.balls.push(BallColor { name: marker.name.clone(), rgb });
                out.balls.len() - 1
            });
            out.of_marker.push(color);
        }
        out
    }

    /// How many markers each colour has.
    pub(crate) fn counts(&self) -> Vec<usize> {
        (0..self.balls.len()).map(|c| self.of_marker.iter().filter(|m| **m == c).count()).collect()
    }
}

/// Tells which candidates are which markers.
pub(crate) struct Identities {
    associator: Associator,
    colors: Vec<usize>,
}

impl Identities {
    pub(crate) fn new(rig: &Rig, vehicle: &Vehicle) -> Result<Self, PipelineError> {
        let estimator = PoseEstimator::new(rig, &crate::body_markers(vehicle));
        let colors = MarkerColors::of(vehicle).of_marker;
        let associator = Associator::new(estimator, rig, &colors, MARKERS_STD_M)
            .map_err(|source| PipelineError::Pose { place: "the vehicle's markers".into(), source })?;
        Ok(Self { associator, colors })
    }

    /// What happened to the cameras and how well they saw the markers, into what was tracked.
    pub(crate) fn finish(&self, rig: &Rig, watches: Vec<CameraWatch>, tracked: &mut Tracked) {
        let markers = self.colors.len();
        let mut seen = vec![0; watches.len() * markers];
        tracked.observations.iter().for_each(|o| seen[o.camera * markers + o.marker] += 1);
        for (watch, seen) in watches.into_iter().zip(seen.chunks(markers.max(1))) {
            let (health, notes) = watch.told(&self.colors, seen);
            tracked.health.push(health);
            tracked.notes.extend(notes);
        }
        tracked.notes.extend(moved_notes(rig, self.associator.moved_cameras()));
    }

    /// Adds one instant to what was tracked.
    pub(crate) fn add(&mut self, t_ns: i64, seen: &[Candidate], tracked: &mut Tracked) {
        let found = self.associator.associate(t_ns, seen);
        for (index, marker) in &found.pairs {
            let Candidate { camera, pixel, covariance_px2, diameter_px, .. } = seen[*index];
            let seen = MarkerObservation { t_ns, camera, marker: *marker, pixel, covariance_px2 };
            tracked.observations.push(seen);
            tracked.diameters_px.push(diameter_px);
        }
        tracked.poses.push(crate::solve::provisional(found.sample));
    }
}
