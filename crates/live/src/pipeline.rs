//! From detections to poses, instant by instant, by the batch run's own join and association.

use mavsight_flight::Vehicle;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_pipeline::{CameraTiming, FlightAssociator, Lookahead, PipelineError, Synchronizer};
use mavsight_pose::{Association, CameraClock, MovedCamera, Rig, TrackedDetection};

/// Frames of each camera from which its rate is estimated before anything is joined.
const WARM: usize = 6;
/// Frames of one camera that are kept while others have not begun; beyond them the join begins without these.
const MOST_KEPT: usize = 120;
/// Interval of a camera whose rate is unknown: thirty frames a second.
const USUAL_S: f64 = 1.0 / 30.0;

/// One instant with its association and pose.
#[derive(Debug)]
pub struct InstantEstimate<'a> {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// Detections of all cameras, ordered by camera and track.
    pub seen: &'a [TrackedDetection],
    /// Markers of the detections, and the pose.
    pub association: Association,
    /// Cameras found to be moved so far.
    pub moved: &'a [MovedCamera],
}

/// A camera before the join begins.
#[derive(Debug)]
struct WaitingCamera {
    size: ImageSize,
    clock: CameraClock,
    readout: Vector2<f64>,
    interval_s: Option<f64>,
    is_gone: bool,
    frames: Vec<(i64, Vec<TrackedDetection>)>,
}

impl WaitingCamera {
    fn is_ready(&self) -> bool {
        self.is_gone || self.frames.len() >= WARM
    }

    /// Median interval of the frames so far.
    fn median_interval_s(&self) -> Option<f64> {
        let mut steps: Vec<i64> = self.frames.windows(2).map(|w| w[1].0 - w[0].0).collect();
        steps.sort_unstable();
        steps.get(steps.len() / 2).map(|ns| *ns as f64 * 1e-9)
    }
}

/// Join, association and pose estimation behind the trackers.
///
/// No decision depends on the time of day, so that a recording gives the same poses at any pace.
#[derive(Debug)]
pub struct LivePipeline {
    cameras: Vec<WaitingCamera>,
    synchronizer: Option<Synchronizer>,
    associator: FlightAssociator,
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
        let waiting = |(k, c): (usize, &mavsight_pose::RigCamera)| {
            let (clock, readout) = clocks.get(k).copied().unwrap_or((CameraClock::default(), Vector2::y()));
            let (size, frames) = (c.camera.size, Vec::new());
            WaitingCamera { size, clock, readout, interval_s: None, is_gone: false, frames }
        };
        let cameras = rig.cameras.iter().enumerate().map(waiting).collect();
        Ok(Self { cameras, synchronizer: None, associator: FlightAssociator::new(rig, vehicle)? })
    }

    /// Adds the detections of a frame. The first frames are kept until the rate of each camera is known.
    pub fn push(&mut self, camera: usize, stamp_ns: i64, detections: &[TrackedDetection]) {
        if let Some(synchronizer) = &mut self.synchronizer {
            synchronizer.push(camera, stamp_ns, detections);
            return;
        }
        let Some(own) = self.cameras.get_mut(camera) else { return };
        own.frames.push((stamp_ns, detections.to_vec()));
        let is_full = own.frames.len() >= MOST_KEPT;
        if is_full || self.cameras.iter().all(WaitingCamera::is_ready) {
            self.begin();
        }
    }

    /// Begins the join with the rates that the frames so far show.
    pub fn begin(&mut self) {
        if self.synchronizer.is_some() {
            return;
        }
        let intervals: Vec<_> = self.cameras.iter().map(WaitingCamera::median_interval_s).collect();
        let fastest_s = intervals.iter().flatten().copied().reduce(f64::min).unwrap_or(USUAL_S);
        let joined = self.cameras.iter_mut().zip(&intervals).map(|(c, interval_s)| {
            let interval_s = interval_s.unwrap_or(fastest_s);
            c.interval_s = Some(interval_s);
            CameraTiming { size: c.size, clock: c.clock, readout: c.readout, interval_s }
        });
        let mut synchronizer = Synchronizer::new(&joined.collect::<Vec<_>>(), Lookahead::NextFrame);
        let mut frames: Vec<(i64, usize, i64, Vec<TrackedDetection>)> = Vec::new();
        for (k, camera) in self.cameras.iter_mut().enumerate() {
            if camera.is_gone {
                synchronizer.go_without(k, i64::MAX);
            }
            let clock = camera.clock;
            frames.extend(camera.frames.drain(..).map(|(t, seen)| (clock.time_ns(t), k, t, seen)));
        }
        frames.sort_by_key(|f| (f.0, f.1));
        for (_, camera, stamp_ns, detections) in frames {
            synchronizer.push(camera, stamp_ns, &detections);
        }
        self.synchronizer = Some(synchronizer);
    }

    /// Whether the join has begun.
    pub fn has_begun(&self) -> bool {
        self.synchronizer.is_some()
    }

    /// Median time between a camera's frames, once known.
    pub fn interval_s(&self, camera: usize) -> Option<f64> {
        self.cameras.get(camera)?.interval_s
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
        if let Some(own) = self.cameras.get_mut(camera) {
            own.is_gone |= until_ns == i64::MAX;
        }
        let has_frames = self.cameras.iter().any(|c| c.frames.len() >= WARM);
        if has_frames && self.cameras.iter().all(WaitingCamera::is_ready) {
            self.begin();
        }
    }

    /// Waits for a camera again that has come back.
    pub fn wait_again(&mut self, camera: usize) {
        if let Some(synchronizer) = &mut self.synchronizer {
            synchronizer.wait_again(camera);
        } else if let Some(own) = self.cameras.get_mut(camera) {
            own.is_gone = false;
        }
    }

    /// The instant that is incomplete, and the cameras that it waits for.
    pub fn waits(&self) -> Option<(i64, impl Iterator<Item = usize> + '_)> {
        let synchronizer = self.synchronizer.as_ref()?;
        let t_ns = synchronizer.waiting_ns()?;
        Some((t_ns, (0..self.cameras.len()).filter(move |c| synchronizer.waits_for(*c, t_ns))))
    }

    /// A note if the detections so far fit no pose of the body; `None` before there are enough instants.
    ///
    /// # Errors
    /// [`PipelineError::MixedUp`] where cameras exchanged, mirrored or turned upside down explain the misfit.
    pub fn misfit(&self, rig: &Rig) -> Option<Result<Option<String>, PipelineError>> {
        self.associator.is_sampled().then(|| self.associator.misfit(rig))
    }

    /// The next complete instant.
    pub fn next_instant(&mut self) -> Option<InstantEstimate<'_>> {
        let (t_ns, seen) = self.synchronizer.as_mut()?.next_instant()?;
        let association = self.associator.associate(t_ns, seen);
        Some(InstantEstimate { t_ns, seen, association, moved: self.associator.moved_cameras() })
    }
}
