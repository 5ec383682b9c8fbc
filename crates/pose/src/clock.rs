//! Clocks of cameras that were not started together: how late, how fast, and how slowly their rows are read.

mod equations;
mod leaps;
mod path;
mod search;
#[cfg(test)]
mod tests;

pub use path::{PathPoint, PathVelocity, PixelPath};

use crate::{BodyMarker, MarkerObservation, Rig};
use equations::Problem;
use mavsight_geometry::{ImageSize, Vector2};
use std::fmt;

/// A clock counts as told where its offset's standard deviation is at most this part of a frame's interval.
const TOLD_INTERVALS: f64 = 0.125;

/// A difference of this many standard deviations is no chance: one in sixteen thousand normal numbers is.
const SIGNIFICANT: f64 = 4.0;

/// An offset matters where it moves centres by this part of their standard deviation at the flight's image speed: it would
/// add a thirtieth to their errors.
const RELEVANT_STD: f64 = 0.25;

/// Standard deviation of a quartz clock's rate between two cameras: crystals of consumer electronics are sold with
/// tolerances of 20 to 100 parts in a million.
pub const QUARTZ_DRIFT_STD: f64 = 100e-6;

/// What a camera's time stamps mean: stamp = offset + (1 + drift)·t for the middle row of an image, and rows further along the
/// readout are exposed later by `line_time_s` each.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraClock {
    /// How late the stamps are at t = 0.
    pub offset_s: f64,
    /// How much faster than the first camera's the clock runs: 50e-6 gains 50 µs a second.
    pub drift: f64,
    /// Time from one row of the sensor to the next.
    pub line_time_s: f64,
}

impl CameraClock {
    /// The time of what has a stamp and lies `rows_px` beyond the image's middle along the readout.
    pub fn time_s(&self, stamp_ns: i64, rows_px: f64) -> f64 {
        (stamp_ns as f64 * 1e-9 - self.offset_s) / (1.0 + self.drift) + rows_px * self.line_time_s
    }

    /// The time of the middle row, in nanoseconds; a stamp of an exact clock as it is.
    pub fn time_ns(&self, stamp_ns: i64) -> i64 {
        if self.offset_s == 0.0 && self.drift == 0.0 {
            return stamp_ns;
        }
        (self.time_s(stamp_ns, 0.0) * 1e9).round() as i64
    }
}

/// What is known of a clock before the flight: a start, and a standard deviation of each part. 0: known exactly; infinite: nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockPrior {
    /// The start.
    pub clock: CameraClock,
    /// Of the offset.
    pub offset_std_s: f64,
    /// Of the drift.
    pub drift_std: f64,
    /// Of the line time.
    pub line_time_std_s: f64,
}

impl ClockPrior {
    /// A clock that is known.
    pub fn known(clock: CameraClock) -> Self {
        Self { clock, offset_std_s: 0.0, drift_std: 0.0, line_time_std_s: 0.0 }
    }

    /// A quartz clock started at any time, with a global shutter.
    pub fn unknown() -> Self {
        Self {
            offset_std_s: f64::INFINITY,
            drift_std: QUARTZ_DRIFT_STD,
            ..Self::known(CameraClock::default())
        }
    }
}

/// Stretches of time of which the sights are enough for [`estimate_clocks`], for recordings that span `from_ns..=to_ns` by their
/// presumed clocks: all of a flight of up to four minutes, else sixty of four seconds, evenly spread.
///
/// The estimation looks at 2000 instants wherever they lie. Sixty stretches see the clocks drift apart over the same span; errors that
/// last through a stretch are in the scatter between parts of the flight, which standard deviations allow for. A stretch is as
/// long as it takes for clocks that are a second apart to share three of its seconds.
pub fn informative_stretches_ns((from_ns, to_ns): (i64, i64)) -> Vec<(i64, i64)> {
    let span_ns = to_ns.saturating_sub(from_ns);
    if span_ns <= STRETCHES * STRETCH_NS {
        return vec![(from_ns, to_ns)];
    }
    let begin = |k: i64| from_ns + ((span_ns - STRETCH_NS) as f64 * k as f64 / (STRETCHES - 1) as f64) as i64;
    (0..STRETCHES).map(|k| (begin(k), begin(k) + STRETCH_NS)).collect()
}

const STRETCHES: i64 = 60;
const STRETCH_NS: i64 = 4_000_000_000;

/// What one camera saw, by its own clock.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraStream {
    /// Median time between its images.
    pub interval_s: f64,
    /// Unit vector along which rows are read one after another; (0, 1) where the file is not rotated.
    pub readout: Vector2<f64>,
    /// Observations in the order of time; their times are time stamps by this camera's clock.
    pub observations: Vec<MarkerObservation>,
    /// What is known of its clock.
    pub prior: ClockPrior,
}

impl CameraStream {
    /// How far along the readout a pixel lies from the image's middle.
    pub fn rows_px(&self, size: ImageSize, pixel: &Vector2<f64>) -> f64 {
        self.readout.dot(&(pixel - image_middle(size)))
    }

    /// The path of each marker under a clock.
    pub fn paths(&self, size: ImageSize, markers: usize, clock: &CameraClock) -> Vec<PixelPath> {
        let mut paths = vec![PixelPath::new(self.interval_s); markers];
        for o in &self.observations {
            if let Some(path) = paths.get_mut(o.marker) {
                let t_s = clock.time_s(o.t_ns, self.rows_px(size, &o.pixel));
                path.push(t_s, o.pixel, o.covariance_px2);
            }
        }
        paths
    }
}

/// The middle of an image.
pub fn image_middle(size: ImageSize) -> Vector2<f64> {
    Vector2::new(f64::from(size.width_px) - 1.0, f64::from(size.height_px) - 1.0) * 0.5
}

/// What was made of a clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClockVerdict {
    /// The first camera's: time is what it shows.
    Reference,
    /// Nothing was to be estimated.
    Known,
    /// What the flight shows is no more than chance, or too small to matter: left as it was.
    InStep,
    /// Set right by what the flight shows.
    SetRight,
    /// The flight is too slow, or too little of it is seen by two cameras, to tell: left as it was.
    TooSlow {
        /// Root mean square speed of the markers in the image.
        speed_px_s: f64,
        /// Speed at which a flight as long would tell; infinite where the cameras share no instant.
        needed_px_s: f64,
        /// The same for the aircraft.
        needed_m_s: f64,
    },
}

/// A camera's clock as the flight shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockEstimate {
    /// The clock to go by.
    pub clock: CameraClock,
    /// What the flight shows, whether it is gone by or not.
    pub shown: CameraClock,
    /// Standard deviation of the offset shown; infinite where nothing is.
    pub offset_std_s: f64,
    /// Standard deviation of the drift shown, had it been estimated.
    pub drift_std: f64,
    /// Standard deviation of the line time; 0 where it was given.
    pub line_time_std_s: f64,
    /// What was made of it.
    pub verdict: ClockVerdict,
}

impl ClockEstimate {
    fn as_given(prior: &ClockPrior, verdict: ClockVerdict) -> Self {
        Self {
            clock: prior.clock,
            shown: prior.clock,
            offset_std_s: prior.offset_std_s,
            drift_std: prior.drift_std,
            line_time_std_s: prior.line_time_std_s,
            verdict,
        }
    }
}

impl fmt::Display for ClockEstimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (offset_ms, std_ms) = (1e3 * self.shown.offset_s, 1e3 * self.offset_std_s);
        match self.verdict {
            ClockVerdict::Reference => write!(f, "the reference"),
            ClockVerdict::Known => write!(f, "{offset_ms:.3} ms late, as given"),
            ClockVerdict::InStep => {
                write!(f, "taken as given: the flight shows {offset_ms:+.3} ± {std_ms:.3} ms")
            }
            ClockVerdict::SetRight => {
                write!(f, "set right: {offset_ms:+.3} ± {std_ms:.3} ms late")?;
                let (drift, drift_std) = (1e6 * self.shown.drift, 1e6 * self.drift_std);
                if drift != 0.0 {
                    write!(f, ", {drift:+.1} ± {drift_std:.1} ppm fast")?;
                }
                Ok(())
            }
            ClockVerdict::TooSlow { speed_px_s, needed_px_s, needed_m_s } => {
                write!(
                    f,
                    "taken as given: the flight is too slow to tell its offset (balls move at {speed_px_s:.1} px/s; "
                )?;
                if needed_px_s <= speed_px_s {
                    write!(f, "what else is not known hides it: fly for longer, or give time_offset_s)")
                } else if needed_px_s.is_finite() {
                    write!(
                        f,
                        "{needed_px_s:.0} px/s would do: fly or carry the aircraft about at {needed_m_s:.2} m/s, or give time_offset_s)"
                    )
                } else {
                    write!(f, "two cameras never see it together: give time_offset_s)")
                }
            }
        }
    }
}

/// The clocks of all cameras from one flight of a rigid body.
///
/// The poses that fit all cameras best at the instants of the fastest camera leave reprojection errors; offsets, drifts and line
/// times are what makes these least, by Gauss and Newton with the markers' image velocities as derivatives, the poses and a
/// lasting error of each centre eliminated, and long residuals bounded (Huber 1981). An offset of which nothing is known is first
/// sought within ± 1 s. Standard deviations allow for noise beyond what is claimed and for errors that last over a
/// twenty-fourth of the flight. The first camera's clock is the reference.
///
/// What the flight shows is gone by where it is significant and matters ([`ClockVerdict`]).
pub fn estimate_clocks(rig: &Rig, markers: &[BodyMarker], streams: &[CameraStream]) -> Vec<ClockEstimate> {
    let mut out: Vec<ClockEstimate> = streams
        .iter()
        .enumerate()
        .map(|(k, s)| {
            let verdict = if k == 0 { ClockVerdict::Reference } else { ClockVerdict::Known };
            ClockEstimate::as_given(&s.prior, verdict)
        })
        .collect();
    if streams.len() != rig.cameras.len() {
        return out;
    }
    search::solve(&mut Problem::new(rig, markers, streams), &mut out);
    out
}
