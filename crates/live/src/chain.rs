//! From what cameras see to poses, instant by instant: the batch run's own join and association.

use mavsight_flight::Vehicle;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_pipeline::{CameraTiming, FlightAssociator, Lookahead, PipelineError, Sight, Synchronizer};
use mavsight_pose::{Association, CameraClock, Candidate, MovedCamera, Rig};

/// Frames of each camera from which its rate is told before anything is joined.
const WARM: usize = 6;
/// Frames of one camera that are held for the others to begin; beyond them it begins without.
const MOST_HELD: usize = 120;
/// Interval of a camera of which nothing is known: that of thirty frames a second.
const USUAL_S: f64 = 1.0 / 30.0;

/// One instant, with what was made of it.
#[derive(Debug)]
pub struct Told<'a> {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// What was seen, by camera and number.
    pub seen: &'a [Candidate],
    /// Which is which, and the pose.
    pub association: Association,
    /// Cameras that were found to be moved until then.
    pub moved: &'a [MovedCamera],
}

/// One camera of the chain.
#[derive(Debug)]
struct Held {
    size: ImageSize,
    clock: CameraClock,
    readout: Vector2<f64>,
    interval_s: Option<f64>,
    is_gone: bool,
    frames: Vec<(i64, Vec<Sight>)>,
}

impl Held {
    /// The interval that was given, or that its frames show.
    fn shown_s(&self) -> Option<f64> {
        let mut steps: Vec<i64> = self.frames.windows(2).map(|w| w[1].0 - w[0].0).collect();
        steps.sort_unstable();
        self.interval_s.or_else(|| steps.get(steps.len() / 2).map(|ns| *ns as f64 * 1e-9))
    }
}

/// The chain behind the trackers. It decides nothing by the time of day, so that a recording gives the same poses at any pace.
#[derive(Debug)]
pub struct LiveChain {
    cameras: Vec<Held>,
    joiner: Option<Synchronizer>,
    identities: FlightAssociator,
}

impl LiveChain {
    /// A chain for a rig and a vehicle; each camera has a clock and a direction in which a rolling shutter goes.
    ///
    /// # Errors
    /// Markers of one colour that can change places so that the body looks the same.
    pub fn new(
        rig: &Rig,
        vehicle: &Vehicle,
        clocks: &[(CameraClock, Vector2<f64>)],
    ) -> Result<Self, PipelineError> {
        let of = |(k, c): (usize, &mavsight_pose::RigCamera)| {
            let (clock, readout) = clocks.get(k).copied().unwrap_or((CameraClock::default(), Vector2::y()));
            let size = c.camera.size;
            Held { size, clock, readout, interval_s: None, is_gone: false, frames: Vec::new() }
        };
        let cameras = rig.cameras.iter().enumerate().map(of).collect();
        Ok(Self { cameras, joiner: None, identities: FlightAssociator::new(rig, vehicle)? })
    }

    /// Takes what a camera saw in a frame. The first frames are held until each camera has shown its rate.
    pub fn push(&mut self, camera: usize, stamp_ns: i64, sights: &[Sight]) {
        if let Some(joiner) = &mut self.joiner {
            joiner.push(camera, stamp_ns, sights);
            return;
        }
        let Some(own) = self.cameras.get_mut(camera) else { return };
        own.frames.push((stamp_ns, sights.to_vec()));
        let is_long = own.frames.len() >= MOST_HELD;
        if is_long || self.cameras.iter().all(|c| c.is_gone || c.frames.len() >= WARM) {
            self.begin();
        }
    }

    /// Begins to join, with what has been seen of the cameras' rates.
    pub fn begin(&mut self) {
        if self.joiner.is_some() {
            return;
        }
        let fastest_s = self.cameras.iter().filter_map(Held::shown_s).fold(f64::INFINITY, f64::min);
        let others_s = if fastest_s.is_finite() { fastest_s } else { USUAL_S };
        for camera in &mut self.cameras {
            camera.interval_s = Some(camera.shown_s().unwrap_or(others_s));
        }
        let about = |c: &Held| CameraTiming {
            size: c.size,
            clock: c.clock,
            readout: c.readout,
            interval_s: c.interval_s.unwrap_or(others_s),
        };
        let cameras: Vec<CameraTiming> = self.cameras.iter().map(about).collect();
        let mut joiner = Synchronizer::new(&cameras, Lookahead::NextFrame);
        let mut held: Vec<(i64, usize, i64, Vec<Sight>)> = Vec::new();
        for (k, camera) in self.cameras.iter_mut().enumerate() {
            if camera.is_gone {
                joiner.go_without(k, i64::MAX);
            }
            let clock = camera.clock;
            held.extend(camera.frames.drain(..).map(|(t, s)| (clock.time_ns(t), k, t, s)));
        }
        held.sort_by_key(|h| (h.0, h.1));
        for (_, camera, stamp_ns, sights) in held {
            joiner.push(camera, stamp_ns, &sights);
        }
        self.joiner = Some(joiner);
    }

    /// Whether instants are being joined.
    pub fn has_begun(&self) -> bool {
        self.joiner.is_some()
    }

    /// Median time between a camera's frames, once it is known.
    pub fn interval_s(&self, camera: usize) -> Option<f64> {
        self.cameras.get(camera)?.interval_s
    }

    /// By how much a camera's stamps are late, nothing but its offset considered: the common time of one.
    pub fn time_ns(&self, camera: usize, stamp_ns: i64) -> i64 {
        self.cameras.get(camera).map_or(stamp_ns, |c| c.clock.time_ns(stamp_ns))
    }

    /// A camera is not waited for up to a time; i64::MAX: not at all.
    pub fn go_without(&mut self, camera: usize, until_ns: i64) {
        if let Some(joiner) = &mut self.joiner {
            joiner.go_without(camera, until_ns);
        } else if let Some(own) = self.cameras.get_mut(camera) {
            own.is_gone |= until_ns == i64::MAX;
        }
        if self.joiner.is_none()
            && self.cameras.iter().any(|c| c.frames.len() >= WARM)
            && self.cameras.iter().all(|c| c.is_gone || c.frames.len() >= WARM)
        {
            self.begin();
        }
    }

    /// A camera is back: it is waited for again.
    pub fn wait_again(&mut self, camera: usize) {
        if let Some(joiner) = &mut self.joiner {
            joiner.wait_again(camera);
        } else if let Some(own) = self.cameras.get_mut(camera) {
            own.is_gone = false;
        }
    }

    /// The instant that waits for something, and which cameras it waits for.
    pub fn waits(&self) -> Option<(i64, impl Iterator<Item = usize> + '_)> {
        let joiner = self.joiner.as_ref()?;
        let t_ns = joiner.waiting_ns()?;
        Some((t_ns, (0..self.cameras.len()).filter(move |c| joiner.waits_for(*c, t_ns))))
    }

    /// Once enough instants are told: what is to be said of sights that fit no pose of the body, if they do not; `None` before.
    ///
    /// # Errors
    /// [`PipelineError::MixedUp`] where cameras exchanged, mirrored or turned upside down explain it.
    pub fn misfit(&self, rig: &Rig) -> Option<Result<Option<String>, PipelineError>> {
        self.identities.is_sampled().then(|| self.identities.misfit(rig))
    }

    /// The next instant for which all has come.
    pub fn next_told(&mut self) -> Option<Told<'_>> {
        let (t_ns, seen) = self.joiner.as_mut()?.next_instant()?;
        let association = self.identities.associate(t_ns, seen);
        Some(Told { t_ns, seen, association, moved: self.identities.moved_cameras() })
    }
}
