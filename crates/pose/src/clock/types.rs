//! Clocks of cameras, what is known of them beforehand, and what a flight shows of them.

use super::path::PixelPath;
use crate::MarkerObservation;
use mavsight_geometry::{ImageSize, Vector2};
use std::fmt;

/// Standard deviation of one quartz clock's rate against another's, of cameras or flight controllers: crystals of consumer
/// electronics are sold with tolerances of 20 to 100 parts in a million.
pub const QUARTZ_DRIFT_STD: f64 = 100e-6;

/// What a camera's time stamps mean: stamp = offset + (1 + drift)·t for the middle row of an image, and rows
/// further along the readout are exposed later by `line_time_s` each.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraClock {
    /// How late the stamps are at t = 0.
    pub offset_s: f64,
    /// How much faster than the first camera's the clock runs: 50e-6 gains 50 µs a second.
    pub drift: f64,
    /// Time from one row of the sensor to the next.
    pub line_time_s: f64,
}

/// Parts of a clock that are estimated, in the order of [`CameraClock::parts`].
pub(super) const OFFSET: usize = 0;
pub(super) const DRIFT: usize = 1;
pub(super) const LINE_TIME: usize = 2;

impl CameraClock {
    pub(super) fn parts(&mut self) -> [&mut f64; 3] {
        [&mut self.offset_s, &mut self.drift, &mut self.line_time_s]
    }

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

/// What is known of a clock before the flight: a start, and a standard deviation of each part. 0: known
/// exactly; infinite: nothing.
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
    pub(super) fn stds(&self) -> [f64; 3] {
        [self.offset_std_s, self.drift_std, self.line_time_std_s]
    }

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
    /// The flight is too slow, or too little of it is seen by two cameras, to show it: left as it was.
    TooSlow {
        /// Root mean square speed of the markers in the image.
        speed_px_s: f64,
        /// Speed at which a flight as long would show it; infinite where the cameras share no instant.
        needed_px_s: f64,
        /// That speed of the aircraft.
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
    pub(super) fn as_given(prior: &ClockPrior) -> Self {
        let ClockPrior { clock, offset_std_s, drift_std, line_time_std_s } = *prior;
        let verdict = ClockVerdict::Known;
        Self { clock, shown: clock, offset_std_s, drift_std, line_time_std_s, verdict }
    }
}

/// No small aircraft flies faster in a room: it would cross ten metres in a third of a second.
const FASTEST_M_S: f64 = 30.0;

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
                let remedy = if needed_px_s <= speed_px_s {
                    "what else is not known hides it: fly for longer, or give time_offset_s".to_owned()
                } else if needed_px_s.is_finite() && needed_m_s > FASTEST_M_S {
                    "no speed in a room would do: mend what else is wrong first, or give time_offset_s"
                        .to_owned()
                } else if needed_px_s.is_finite() {
                    format!(
                        "{needed_px_s:.0} px/s would do: fly or carry the aircraft about at {needed_m_s:.2} m/s, or give time_offset_s"
                    )
                } else {
                    "two cameras never see it together: give time_offset_s".to_owned()
                };
                // What noise adds to the speeds is taken off their squares.
                let speed = if speed_px_s > 0.0 {
                    format!("balls move at {speed_px_s:.1} px/s")
                } else {
                    "their noise hides how balls move where two cameras see them".to_owned()
                };
                write!(
                    f,
                    "taken as given: the flight is too slow to determine its offset ({speed}; {remedy})"
                )
            }
        }
    }
}
