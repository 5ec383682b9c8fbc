//! From detections to poses, instant by instant, by the batch run's own join and association.

use mavsight_flight::Vehicle;
use mavsight_geometry::Vector2;
use mavsight_pipeline::{
    CameraTiming, Finding, FlightAssociator, FrameTime, Lookahead, PRESUMED_INTERVAL_S, PipelineError, Push,
    PushWatch, Synchronizer, usual_interval_ns,
};
use mavsight_pose::{Association, CameraClock, MovedCamera, Rig, TrackedDetection};

/// Frames of each camera from which its rate is estimated before anything is joined.
const WARM: usize = 6;
/// Frames of one camera that are kept while others have not begun; beyond them the join begins without these.
const MOST_KEPT: usize = 120;

/// One instant with its association and pose.
#[derive(Debug)]
pub struct InstantEstimate<'a> {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// Detections of all cameras, ordered by camera and track.
    pub seen: &'a [TrackedDetection],
    /// Markers of the detections, and the pose.
    pub association: Association,
    /// Cameras found to be moved that do not fit again.
    pub moved: &'a [MovedCamera],
    /// Cameras that repeat an image from before the body moved on.
    pub stale: Vec<usize>,
}

/// A frame from before the join began.
#[derive(Debug)]
struct WaitingFrame {
    camera: usize,
    stamp_ns: i64,
    detections: Vec<TrackedDetection>,
}

/// Join, association and pose estimation behind the trackers.
///
/// No decision depends on the time of day, so that a recording gives the same poses at any pace.
#[derive(Debug)]
pub struct LivePipeline {
    cameras: Vec<CameraTiming>,
    gone: Vec<bool>,
    waiting: Vec<WaitingFrame>,
    synchronizer: Option<Synchronizer>,
    associator: FlightAssociator,
    pushes: PushWatch,
    /// Cameras that were pushed, until the instant from which on that is known.
    pushed: Vec<Push>,
}

impl LivePipeline {
    /// A pipeline for a rig and a vehicle; `clocks` holds for each camera its clock and the direction of a
    /// rolling shutter.
    ///
    /// # Errors
    /// Markers of one colour that can be exchanged without changing the body.
    pub fn new(
        rig: &Rig,
        vehicle: &Vehicle,
        clocks: &[(CameraClock, Vector2<f64>)],
    ) -> Result<Self, PipelineError> {
        let timing = |(k, c): (usize, &mavsight_pose::RigCamera)| {
            let (clock, readout) = clocks.get(k).copied().unwrap_or((CameraClock::default(), Vector2::y()));
            CameraTiming { size: c.camera.size, clock, readout, interval_s: PRESUMED_INTERVAL_S }
        };
        let mut associator = FlightAssociator::new(rig, vehicle)?;
        associator.let_cameras_return();
        Ok(Self {
            cameras: rig.cameras.iter().enumerate().map(timing).collect(),
            gone: vec![false; rig.cameras.len()],
            waiting: Vec::new(),
            synchronizer: None,
            associator,
            pushes: PushWatch::new(rig.cameras.len(), vehicle),
            pushed: Vec::new(),
        })
    }

    /// Adds the detections of a frame. The first frames are kept until the rate of each camera is known.
    pub fn push(&mut self, camera: usize, stamp_ns: i64, detections: &[TrackedDetection]) {
        if self.has_begun() {
            self.join(camera, stamp_ns, detections);
        } else if camera < self.cameras.len() {
            self.waiting.push(WaitingFrame { camera, stamp_ns, detections: detections.to_vec() });
            if self.is_ready() || self.stamps_ns(camera).count() >= MOST_KEPT {
                self.begin();
            }
        }
    }

    fn stamps_ns(&self, camera: usize) -> impl Iterator<Item = i64> {
        self.waiting.iter().filter(move |f| f.camera == camera).map(|f| f.stamp_ns)
    }

    fn is_ready(&self) -> bool {
        (0..self.cameras.len()).all(|c| self.gone[c] || self.stamps_ns(c).count() >= WARM)
    }

    /// Begins the join with the rates that the frames so far show.
    pub fn begin(&mut self) {
        if self.synchronizer.is_some() {
            return;
        }
        let interval_s = |c: usize| usual_interval_ns(self.stamps_ns(c)).map(|ns| ns as f64 * 1e-9);
        let intervals: Vec<_> = (0..self.cameras.len()).map(interval_s).collect();
        let fastest_s = intervals.iter().flatten().copied().reduce(f64::min).unwrap_or(PRESUMED_INTERVAL_S);
        for (camera, interval_s) in self.cameras.iter_mut().zip(intervals) {
            camera.interval_s = interval_s.unwrap_or(fastest_s);
        }
        let mut synchronizer = Synchronizer::new(&self.cameras, Lookahead::NextFrame);
        for (camera, _) in self.gone.iter().enumerate().filter(|(_, is_gone)| **is_gone) {
            synchronizer.go_without(camera, i64::MAX);
        }
        let mut frames = std::mem::take(&mut self.waiting);
        frames.sort_by_key(|f| (self.time_ns(f.camera, f.stamp_ns), f.camera));
        self.synchronizer = Some(synchronizer);
        for WaitingFrame { camera, stamp_ns, detections } in frames {
            self.join(camera, stamp_ns, &detections);
        }
    }

    fn join(&mut self, camera: usize, stamp_ns: i64, detections: &[TrackedDetection]) {
        if let Some(synchronizer) = &mut self.synchronizer {
            synchronizer.push(camera, stamp_ns, detections);
        }
        let Some(timing) = self.cameras.get(camera) else { return };
        let (t_ns, interval_ns) = (timing.clock.time_ns(stamp_ns), (1e9 * timing.interval_s) as i64);
        let time = FrameTime { stamp_ns, t_ns, interval_ns };
        self.pushed.extend(self.pushes.take(camera, time, detections));
    }

    /// Whether the join has begun.
    pub fn has_begun(&self) -> bool {
        self.synchronizer.is_some()
    }

    /// Median time between a camera's frames, once known.
    pub fn interval_s(&self, camera: usize) -> Option<f64> {
        self.cameras.get(camera).filter(|_| self.has_begun()).map(|c| c.interval_s)
    }

    /// Median time between the frames of the slowest camera.
    pub fn longest_interval_ns(&self) -> i64 {
        (1e9 * self.cameras.iter().map(|c| c.interval_s).fold(0.0, f64::max)) as i64
    }

    /// Common time of a camera's stamp.
    pub fn time_ns(&self, camera: usize, stamp_ns: i64) -> i64 {
        self.cameras.get(camera).map_or(stamp_ns, |c| c.clock.time_ns(stamp_ns))
    }

    /// Does not wait for a camera up to a time; `i64::MAX`: until [`LivePipeline::wait_again`].
    pub fn go_without(&mut self, camera: usize, until_ns: i64) {
        if let Some(synchronizer) = &mut self.synchronizer {
            synchronizer.go_without(camera, until_ns);
            return;
        }
        if let Some(is_gone) = self.gone.get_mut(camera) {
            *is_gone |= until_ns == i64::MAX;
        }
        let has_frames = (0..self.cameras.len()).any(|c| self.stamps_ns(c).count() >= WARM);
        if has_frames && self.is_ready() {
            self.begin();
        }
    }

    /// Waits for a camera again that has come back.
    pub fn wait_again(&mut self, camera: usize) {
        if let Some(synchronizer) = &mut self.synchronizer {
            synchronizer.wait_again(camera);
        } else if let Some(is_gone) = self.gone.get_mut(camera) {
            *is_gone = false;
        }
    }

    /// The instant that is incomplete, and the cameras that it waits for.
    pub fn waits(&self) -> Option<(i64, impl Iterator<Item = usize> + '_)> {
        let synchronizer = self.synchronizer.as_ref()?;
        let t_ns = synchronizer.waiting_ns()?;
        Some((t_ns, (0..self.cameras.len()).filter(move |c| synchronizer.waits_for(*c, t_ns))))
    }

    /// What explains that the detections so far fit no pose of the body; `None` before there are enough instants.
    ///
    /// # Errors
    /// [`PipelineError::MixedUp`] where cameras exchanged, mirrored or turned upside down explain the misfit.
    pub fn misfit(&self, rig: &Rig) -> Option<Result<Vec<Finding>, PipelineError>> {
        self.associator.is_sampled().then(|| self.associator.misfit(rig))
    }

    /// The next complete instant.
    pub fn next_instant(&mut self) -> Option<InstantEstimate<'_>> {
        let (t_ns, seen) = self.synchronizer.as_mut()?.next_instant()?;
        for push in self.pushed.extract_if(.., |push| push.known_ns <= t_ns) {
            self.associator.leave_out(&push);
        }
        let association = self.associator.associate(t_ns, seen);
        let stale: Vec<usize> = (0..self.cameras.len()).filter(|c| self.associator.is_stale(*c)).collect();
        // An image that stood jumps when it goes on.
        stale.iter().for_each(|camera| self.pushes.forget(*camera));
        let moved = self.associator.moved_cameras();
        Some(InstantEstimate { t_ns, seen, association, moved, stale })
    }
}
