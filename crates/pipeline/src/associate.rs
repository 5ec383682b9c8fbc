//! What the trackers of all cameras saw at one instant, as candidates for the vehicle's markers.

use crate::health;
use crate::markers::{MARKERS_STD_M, MarkerColors, body_markers};
use crate::misfit::{self, ClockEvidence, MovingDecoy, MovingDecoys, ObservationSample};
use crate::pushed::Push;
use crate::tracked::Tracked;
use crate::watch::{CameraWatch, standing};
use crate::{Cause, Finding, PipelineError};
use mavsight_flight::Vehicle;
use mavsight_geometry::{Camera, Vector3};
use mavsight_pose::{
    Association, Associator, MovedCamera, Observations, PoseEstimator, PoseSample, Rig, TrackedDetection,
};

/// One instant of a flight: what all cameras saw, and what was made of it.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a> {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// What was seen, by camera and number.
    pub seen: &'a [TrackedDetection],
    /// Which is which, and the pose.
    pub association: &'a Association,
    /// Cameras that were found so far to be moved or frozen; they take no part from then on.
    pub moved: &'a [MovedCamera],
}

/// Associates the detections of all cameras with the markers, instant by instant.
#[derive(Debug)]
pub struct FlightAssociator {
    associator: Associator,
    cameras: Vec<Camera>,
    colors: Vec<usize>,
    sample: ObservationSample,
    moving: MovingDecoys,
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
        let cameras = rig.cameras.iter().map(|c| c.camera).collect();
        let (sample, moving) = (ObservationSample::default(), MovingDecoys::default());
        Ok(Self { associator, cameras, colors, sample, moving })
    }

    /// What happened to the cameras and how well they saw the markers, into what was tracked.
    ///
    /// Watches come with the usual time between the frames of their cameras: instants are those of the fastest, so each frame of
    /// another is seen at several.
    pub(crate) fn finish(&self, rig: &Rig, watches: Vec<(CameraWatch, f64)>, tracked: &mut Tracked) {
        let markers = self.colors.len();
        let fastest_s = watches.iter().map(|(_, interval_s)| *interval_s).fold(f64::INFINITY, f64::min);
        let mut seen = vec![0_u32; watches.len() * markers];
        tracked.observations.iter().for_each(|o| seen[o.camera * markers + o.marker] += 1);
        for (camera, ((watch, interval_s), seen)) in
            watches.into_iter().zip(seen.chunks(markers.max(1))).enumerate()
        {
            let instants = watch.health.frames as f64 * interval_s / fastest_s;
            let shares: Vec<f64> = seen.iter().map(|n| f64::from(*n) / instants.max(1.0)).collect();
            let (health, findings) = watch.report(camera, &self.colors, &shares);
            tracked.health.push(health);
            tracked.findings.extend(findings);
        }
        tracked.findings.extend(health::findings(&tracked.health, &self.names()));
        tracked.findings.extend(self.decoys(rig));
        let standing = standing(rig, self.associator.moved_cameras(), &tracked.findings);
        tracked.findings.extend(standing);
    }

    /// Balls of a marker's colour and size that stand in the room or move through it.
    fn decoys(&self, rig: &Rig) -> Vec<Finding> {
        let markers = self.associator.estimator().markers();
        let name = |color: usize| {
            self.colors.iter().position(|c| *c == color).map_or("a marker", |m| markers[m].name.as_str())
        };
        let standing = self.sample.unclaimed().balls(rig, markers, &self.colors);
        let stands = |(color, at): (usize, Vector3<f64>)| {
            format!(
                "A ball of the colour and size of {} stands in the room at ({:.2}, {:.2}, {:.2}) m: no pose uses it. Cover it.",
                name(color),
                at.x,
                at.y,
                at.z
            )
        };
        let moves = |MovingDecoy { color, from: (from_ns, from), to: (to_ns, to) }: &MovingDecoy| {
            format!(
                "A ball of the colour and size of {} moves through the room, from ({:.2}, {:.2}, {:.2}) m at {:.3} s to ({:.2}, {:.2}, \
                 {:.2}) m at {:.3} s, while the aircraft is seen elsewhere: no pose uses it. Keep it out of the cameras' view.",
                name(*color),
                from.x,
                from.y,
                from.z,
                *from_ns as f64 * 1e-9,
                to.x,
                to.y,
                to.z,
                *to_ns as f64 * 1e-9
            )
        };
        let notes = standing.into_iter().map(stands).chain(self.moving.found().iter().map(moves));
        notes.map(|note| Finding::of(Cause::Decoy, None, note)).collect()
    }

    fn names(&self) -> Vec<String> {
        self.associator.estimator().markers().iter().map(|m| m.name.clone()).collect()
    }

    /// Which of the candidates of the next instant are which markers, and the pose they give.
    pub fn associate(&mut self, t_ns: i64, seen: &[TrackedDetection]) -> Association {
        let found = self.associator.associate(t_ns, seen);
        let moved = self.associator.moved_cameras();
        // Of two that contradict each other the cause is open: it may be a wrong frame rate of one of them.
        let is_out = |camera: usize| moved.iter().any(|m| m.camera == camera && m.or.is_none());
        self.sample.take(seen, &self.colors, &found, is_out);
        let markers = self.associator.estimator().markers();
        self.moving.take(&self.cameras, markers, &self.colors, seen, &found);
        found
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

    /// What explains that observations fit no pose of the body; none where they fit.
    ///
    /// # Errors
    /// [`PipelineError::MixedUp`] where recordings or cameras exchanged, mirrored or turned upside down
    /// explain it.
    pub fn misfit(&self, rig: &Rig) -> Result<Vec<Finding>, PipelineError> {
        self.misfit_by_clocks(rig, None)
    }

    /// [`Self::misfit`] with other clocks among what is tried.
    pub(crate) fn misfit_by_clocks(
        &self,
        rig: &Rig,
        clocks: Option<ClockEvidence>,
    ) -> Result<Vec<Finding>, PipelineError> {
        misfit::findings(self.associator.estimator(), rig, &self.sample, clocks)
    }

    /// Since when a camera may have been moved that was found to be.
    pub(crate) fn shifted_since_ns(
        &self,
        moved: &MovedCamera,
        seen: &Observations,
        poses: &[PoseSample],
    ) -> i64 {
        self.associator.shifted_since_ns(moved, seen, poses)
    }

    /// Lets a camera that was found to be moved take part again when it fits again, as the end of a flight that
    /// goes on cannot be waited for.
    pub fn let_cameras_return(&mut self) {
        self.associator.let_cameras_return();
    }

    /// Leaves out a camera that was pushed, until it fits again where cameras may return.
    pub fn leave_out(&mut self, push: &Push) {
        self.associator.leave_out_moved(push.camera, push.t_ns, push.shift_px);
    }

    /// Whether a camera repeats an image from before the body moved on; it takes no part until it shows another.
    pub fn is_stale(&self, camera: usize) -> bool {
        self.associator.is_stale(camera)
    }

    /// Cameras that were found to be moved; they take no part from then on, or until they fit again.
    pub fn moved_cameras(&self) -> &[MovedCamera] {
        self.associator.moved_cameras()
    }
}
