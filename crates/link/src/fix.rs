//! One instant of a flight, measured or not.

use mavsight_geometry::{Isometry3, Vector3};
use nalgebra::Matrix6;

/// One instant, as it goes to every outlet.
#[derive(Debug, Clone, PartialEq)]
pub struct Fix {
    /// Counts instants, measured or not, from 0.
    pub sequence: u64,
    /// Middle of the exposure, nanoseconds of the UNIX epoch; of a replay, as if it were filmed now.
    pub captured_ns: i64,
    /// When the last of its frames was in hand, same clock.
    pub received_ns: i64,
    /// The pose, where it was measured.
    pub measured: Option<Measured>,
    /// Goes up by one (and round) at each measured pose that does not follow from the one before: after the
    /// aircraft was lost, or a camera was left out or came back. A camera that is late for one instant
    /// changes nothing.
    pub resets: u8,
}

/// A pose that was measured, with what the causal filter knows of the motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The pose as the markers of this instant alone have it.
    pub world_from_body: Isometry3<f64>,
    /// Position in world axes (m²), then a small turn about body axes (rad²): t + δt, R exp(δθ).
    pub covariance: Matrix6<f64>,
    /// Velocity and rates by the causal filter; none until it has run long enough to know them.
    pub moving: Option<Moving>,
    /// Markers that entered.
    pub markers: usize,
    /// Root mean square residual of their coordinates; none where nothing is left over that could disagree.
    pub residual_px: Option<f64>,
}

/// Velocity and rates in body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Moving {
    /// u, v, w.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// Of velocity (m²/s²), then rates (rad²/s²).
    pub covariance: Matrix6<f64>,
}
