//! What the trackers of all cameras saw at one instant, as candidates for the vehicle's markers.

use crate::PipelineError;
use crate::markers::{MARKERS_STD_M, MarkerColors, body_markers};
use crate::mixed_up::{self, ObservationSample};
use crate::tracked::Tracked;
use crate::watch::{CameraWatch, moved_notes};
use mavsight_flight::Vehicle;
use mavsight_pose::{Association, Associator, MovedCamera, PoseEstimator, Rig, TrackedDetection};

/// One instant of a flight: what all cameras saw, and what was made of it.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a> {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// What was seen, by camera and number.
    pub seen: &'a [TrackedDetection],
    /// Which is which, and the pose.
    pub association: &'a Association,
}

/// Associates the detections of all cameras with the markers, instant by instant.
#[derive(Debug)]
pub struct FlightAssociator {
    associator: Associator,
    colors: Vec<usize>,
    sample: ObservationSample,
}

impl FlightAssociator {
    /// For a vehicle before the cameras of a rig.
    ///
    /// # Errors
    /// Markers of one colour that can change places so that the body looks the same.
    pub fn new(rig: &Rig, vehicle: &Vehicle) -> Result<Self, PipelineError> {
        let estimator = PoseEstimator::new(rig, &body_markers(vehicle));
        let colors = MarkerColors::of(vehicle).of_marker;
        let associator = Associator::new(estimator, rig, &colors, MARKERS_STD_M)
            .map_err(|source| PipelineError::Pose { place: "the vehicle's markers".into(), source })?;
        Ok(Self { associator, colors, sample: ObservationSample::default() })
    }

    /// What happened to the cameras and how well they saw the markers, into what was tracked.
    pub(crate) fn finish(&self, rig: &Rig, watches: Vec<CameraWatch>, tracked: &mut Tracked) {
        let markers = self.colors.len();
        let mut seen = vec![0; watches.len() * markers];
        tracked.observations.iter().for_each(|o| seen[o.camera * markers + o.marker] += 1);
        for (watch, seen) in watches.into_iter().zip(seen.chunks(markers.max(1))) {
            let (health, notes) = watch.report(&self.colors, seen);
            tracked.health.push(health);
            tracked.notes.extend(notes);
        }
        tracked.notes.extend(moved_notes(rig, self.associator.moved_cameras()));
    }

    /// Which of the candidates of the next instant are which markers, and the pose they give.
    pub fn associate(&mut self, t_ns: i64, seen: &[TrackedDetection]) -> Association {
        self.sample.take(t_ns, seen, &self.colors);
        self.associator.associate(t_ns, seen)
    }

    /// Spreads the instants from which [`Self::misfit`] is determined over so many; they are the first
    /// otherwise.
    pub(crate) fn spread_over(&mut self, instants: usize) {
        self.sample.spread_over(instants);
    }

    /// Whether there are as many instants as [`Self::misfit`] needs.
    pub fn is_sampled(&self) -> bool {
        self.sample.is_full()
    }

    /// A note on observations that fit no pose of the body, if they do not.
    ///
    /// # Errors
    /// [`PipelineError::MixedUp`] where recordings or cameras exchanged, mirrored or turned upside down
    /// explain it.
    pub fn misfit(&self, rig: &Rig) -> Result<Option<String>, PipelineError> {
        mixed_up::note(self.associator.estimator(), rig, self.sample.observations())
    }

    /// Cameras that were found to be moved; they take no part from then on.
    pub fn moved_cameras(&self) -> &[MovedCamera] {
        self.associator.moved_cameras()
    }
}
