//! The virtual laboratory: the paper's cameras, control frame and aircraft, filmed.

use mavsight_flight::Vehicle;
use mavsight_geometry::{EulerAngles, Isometry3, UnitQuaternion, Vector3, world_from_body};
use mavsight_scene::{Aircraft, ControlFrame, Film, PaintedBall, Room, Sensor};
use mavsight_score::{VirtualCamera, VirtualLab, true_pose};
use mavsight_session::{ControlPointRow, TruthRow};

/// The paper's cameras.
pub fn cameras() -> Vec<VirtualCamera> {
    VirtualLab::paper().cameras
}

/// The paper's control frame.
pub fn control_points() -> Vec<ControlPointRow> {
    VirtualLab::paper().control
}

/// The balls and the hull of a vehicle.
pub fn aircraft(vehicle: &Vehicle) -> Aircraft {
    let balls: Vec<PaintedBall> = vehicle
        .marker
        .iter()
        .map(|m| PaintedBall {
            centre_m: m.position_m.into(),
            radius_m: m.diameter_m / 2.0,
            linear: m.color.to_linear(),
        })
        .collect();
    Aircraft::helicopter(&balls)
}

/// A control frame as it is filmed.
pub fn control_frame(points: &[ControlPointRow]) -> ControlFrame {
    let balls: Vec<PaintedBall> = points
        .iter()
        .map(|p| PaintedBall {
            centre_m: p.position_m.into(),
            radius_m: p.diameter_m / 2.0,
            linear: p.color.to_linear(),
        })
        .collect();
    ControlFrame::new(&balls)
}

/// A camera's film; the noise of each camera is its own.
pub fn film<'a>(room: &'a Room, camera: &VirtualCamera, index: usize, seed: u64) -> Film<'a> {
    let seed = seed.wrapping_mul(1_000_003).wrapping_add(index as u64);
    Film::new(room, camera.camera, Sensor { seed, ..Sensor::default() })
}

/// One frame of a flight; the shutter is open for a quarter of the interval around the state's time.
pub fn frame(
    film: &Film<'_>,
    index: usize,
    aircraft: &Aircraft,
    state: &TruthRow,
    interval_s: f64,
) -> Vec<u8> {
    let open_s = Sensor::default().exposure_fraction * interval_s;
    film.frame(index as u64, aircraft, |share| pose_near(state, share * open_s))
}

/// One frame of a flight at any time between the rows of its truth, by a camera whose rows are read `line_time_s` apart. Before the
/// first row and after the last the aircraft stands still.
pub fn frame_at(
    film: &Film<'_>,
    index: usize,
    aircraft: &Aircraft,
    truth: &[TruthRow],
    when: Shot,
) -> Option<Vec<u8>> {
    let open_s = Sensor::default().exposure_fraction * when.interval_s;
    let (first, last) = (truth.first()?, truth.last()?);
    let start = true_pose(truth, first.t_s)?;
    let pose_at = |share: f64| {
        let t_s = (when.t_s + share * open_s).clamp(first.t_s, last.t_s);
        true_pose(truth, t_s).unwrap_or(start)
    };
    Some(if when.line_time_s == 0.0 {
        film.frame(index as u64, aircraft, pose_at)
    } else {
        film.rolling_frame(index as u64, aircraft, when.line_time_s / open_s, pose_at)
    })
}

/// When a frame is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Middle of the exposure of the middle row.
    pub t_s: f64,
    /// Time from frame to frame.
    pub interval_s: f64,
    /// Time from row to row; 0: all together.
    pub line_time_s: f64,
}

/// The pose a moment before or after a state, with its velocities and accelerations taken as constant.
fn pose_near(state: &TruthRow, dt_s: f64) -> Isometry3<f64> {
    let attitude = EulerAngles { phi_rad: state.phi_rad, theta_rad: state.theta_rad, psi_rad: state.psi_rad };
    let mut near = world_from_body(Vector3::new(state.x_m, state.y_m, state.z_m), attitude);
    let moved = near.rotation * Vector3::new(state.u_m_s, state.v_m_s, state.w_m_s) * dt_s;
    let rates = Vector3::new(state.p_rad_s, state.q_rad_s, state.r_rad_s);
    let accelerations = Vector3::new(state.dp_rad_s2, state.dq_rad_s2, state.dr_rad_s2);
    near.translation.vector += moved;
    near.rotation *= UnitQuaternion::from_scaled_axis(rates * dt_s + accelerations * (0.5 * dt_s * dt_s));
    near
}
