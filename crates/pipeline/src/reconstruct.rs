//! Marker observations into poses.

use crate::associate::FlightAssociator;
use crate::markers::body_markers;
use crate::poses::{pose_at, poses_anew, provisional};
use crate::tracked::Tracked;
use crate::{Cause, Finding, PipelineError, misfit};
use mavsight_flight::Vehicle;
use mavsight_geometry::Isometry3;
use mavsight_pose::{
    Association, MarkerObservation, MovedCamera, Observations, PoseError, PoseEstimator, Rig,
    TrackedDetection,
};

/// Why a body that is upside down all the while may be another than the file's.
const UPSIDE_DOWN: &str = "it is upside down all the while: colours exchanged, axes turned, or flown so";

/// Poses of instants as they come, each with the last one before it as a hint, and all of them again at the
/// end.
pub(crate) struct Reconstruction {
    estimator: PoseEstimator,
    previous: Option<Isometry3<f64>>,
    pub(crate) tracked: Tracked,
}

impl Reconstruction {
    pub(crate) fn new(rig: &Rig, vehicle: &Vehicle) -> Self {
        let estimator = PoseEstimator::new(rig, &body_markers(vehicle));
        Self { estimator, previous: None, tracked: Tracked::default() }
    }

    /// What was seen at the next instant.
    pub(crate) fn add(&mut self, t_ns: i64, seen: Vec<MarkerObservation>) {
        let sample = pose_at(&self.estimator, t_ns, &seen, self.previous.as_ref());
        self.previous = sample.estimate.as_ref().ok().map(|e| e.world_from_body).or(self.previous);
        seen.iter().for_each(|o| self.tracked.observations.push(o));
        self.tracked.poses.push(provisional(sample));
    }

    /// An instant whose detections are associated with the markers.
    pub(crate) fn add_associated(&mut self, seen: &[TrackedDetection], association: Association) {
        for (index, marker) in &association.pairs {
            let t_ns = association.sample.t_ns;
            let observation = MarkerObservation { t_ns, ..seen[*index].of_marker(*marker) };
            self.tracked.observations.push(&observation);
            self.tracked.diameters_px.push(seen[*index].diameter_px as f32);
        }
        self.tracked.poses.push(provisional(association.sample));
    }

    /// Takes back what cameras are said to have seen while their images were frozen, or after they may have been moved, before
    /// that was noticed: the poses are estimated anew without it.
    pub(crate) fn leave_out_moved(&mut self, associator: &FlightAssociator) {
        let moved = associator.moved_cameras();
        let since_ns = |m: &MovedCamera| match m.still_since_ns {
            Some(since_ns) => since_ns + 1,
            None => associator.shifted_since_ns(m, &self.tracked.observations, &self.tracked.poses),
        };
        let all: Vec<(&MovedCamera, i64)> = moved.iter().map(|m| (m, since_ns(m))).collect();
        // Of two of which either was moved both are left out alike.
        let from_ns = |m: &MovedCamera| {
            let both = all.iter().filter(|(n, _)| n.camera == m.camera || Some(n.camera) == m.or);
            both.map(|(_, since_ns)| *since_ns).min()
        };
        let from: Vec<(usize, Option<i64>)> = moved.iter().map(|m| (m.camera, from_ns(m))).collect();
        let is_off = |o: &MarkerObservation| {
            from.iter().any(|(camera, from_ns)| *camera == o.camera && from_ns.is_some_and(|t| o.t_ns >= t))
        };
        if !self.tracked.observations.iter().any(|o| is_off(&o)) {
            return;
        }
        let all = std::mem::take(&mut self.tracked.observations);
        let diameters_px = std::mem::take(&mut self.tracked.diameters_px);
        for (o, diameter_px) in all.iter().zip(diameters_px).filter(|(o, _)| !is_off(o)) {
            self.tracked.observations.push(&o);
            self.tracked.diameters_px.push(diameter_px);
        }
        let mut seen = Vec::new();
        for pose in &mut self.tracked.poses {
            self.tracked.observations.at(pose.t_ns, &mut seen);
            if seen.is_empty() && pose.estimate.is_ok() {
                pose.estimate = Err(PoseError::NotMeasured);
            }
        }
    }

    /// Takes back the poses where what was seen is not the body of the vehicle file, in its colours, its size or its axes, or may
    /// as well be another: what was taken for a marker is another one, and no covariance allows for that.
    pub(crate) fn withhold_what_is_of_another_body(&mut self) {
        let is_of_body =
            |cause: &Cause| matches!(cause, Cause::ColorsExchanged | Cause::BodyScale | Cause::BodyAxes);
        let is_another = |f: &&Finding| !f.causes.is_empty() && f.causes.iter().all(is_of_body);
        let Some(finding) = self.tracked.findings.iter().find(is_another) else { return };
        let words = match finding.cause() {
            Some(cause @ (Cause::ColorsExchanged | Cause::BodyScale)) => cause.words(),
            _ => UPSIDE_DOWN,
        };
        self.tracked.observations = Observations::default();
        self.tracked.diameters_px.clear();
        for pose in &mut self.tracked.poses {
            pose.estimate = Err(PoseError::AnotherBody(words));
        }
    }

    /// All poses, with what the whole flight has shown of the centres' systematic errors.
    pub(crate) fn finish(mut self) -> Result<Tracked, PipelineError> {
        poses_anew(self.estimator, &mut self.tracked)
            .map_err(|source| PipelineError::Pose { place: "centres".into(), source })?;
        Ok(self.tracked)
    }
}

/// The poses of a flight whose markers were observed elsewhere: what follows detection in [`crate::track`].
/// Instants come in the order of time; an instant without observations is one without a pose.
///
/// # Errors
/// No instants, observations that are not numbers, or such as another camera would have made, or one turned
/// about.
pub fn reconstruct(
    rig: &Rig,
    vehicle: &Vehicle,
    instants: impl IntoIterator<Item = (i64, Vec<MarkerObservation>)>,
) -> Result<Tracked, PipelineError> {
    let mut all = Reconstruction::new(rig, vehicle);
    let instants = instants.into_iter();
    all.tracked.reserve(instants.size_hint().0, rig.cameras.len() * vehicle.marker.len());
    instants.for_each(|(t_ns, seen)| all.add(t_ns, seen));
    if all.tracked.poses.is_empty() {
        return Err(PipelineError::NoFrames { camera: "the table of observations".into() });
    }
    all.tracked.findings = misfit::of_observations(&all.estimator, rig, &all.tracked.observations, None)?;
    all.withhold_what_is_of_another_body();
    all.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{rig, seen_by};
    use mavsight_pose::PoseSample;
    use std::collections::BTreeMap;

    fn reconstructed(vehicle: &Vehicle) -> Tracked {
        let mut instants: BTreeMap<i64, Vec<MarkerObservation>> = BTreeMap::new();
        for seen in (0..3).flat_map(|camera| seen_by(camera, 0..90)) {
            instants.entry(seen.t_ns).or_default().push(seen);
        }
        reconstruct(&rig(), vehicle, instants).expect("a flight")
    }

    /// Positions ten times too large, and colours of opposite balls that turn a flat body over, were named, and the poses given
    /// all the same.
    #[test]
    fn poses_of_a_body_that_is_not_the_files_are_withheld() {
        let sound = Vehicle::paper();
        assert!(reconstructed(&sound).poses.iter().all(|p| p.estimate.is_ok()));
        let (mut larger, mut exchanged) = (sound.clone(), sound);
        for marker in &mut larger.marker {
            marker.position_m = marker.position_m.map(|x| 10.0 * x);
        }
        let opposite_m = exchanged.marker[2].position_m;
        exchanged.marker[2].position_m = exchanged.marker[0].position_m;
        exchanged.marker[0].position_m = opposite_m;
        for (vehicle, words) in [(larger, Cause::BodyScale.words()), (exchanged, UPSIDE_DOWN)] {
            let tracked = reconstructed(&vehicle);
            let is_withheld = |p: &PoseSample| p.estimate == Err(PoseError::AnotherBody(words));
            assert!(tracked.poses.iter().all(is_withheld), "{:?}", tracked.poses[0]);
            assert_eq!(tracked.observations.iter().count(), 0);
        }
    }
}
