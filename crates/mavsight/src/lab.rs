//! The virtual laboratory: the paper's cameras, control frame and aircraft, filmed.

use mavsight_flight::Vehicle;
use mavsight_geometry::{EulerAngles, Isometry3, UnitQuaternion, Vector3, world_from_body};
use mavsight_scene::{Aircraft, ControlFrame, Film, PaintedBall, Room, Sensor};
use mavsight_score::{VirtualCamera, VirtualLab};
use mavsight_session::{ControlPointRow, TruthRow};

/// The paper's cameras.
pub(crate) fn cameras() -> Vec<VirtualCamera> {
    VirtualLab::paper().cameras
}

/// The paper's control frame.
pub(crate) fn control_points() -> Vec<ControlPointRow> {
    VirtualLab::paper().control
}

/// The balls and the hull of a vehicle.
pub(crate) fn aircraft(vehicle: &Vehicle) -> Aircraft {
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
pub(crate) fn control_frame(points: &[ControlPointRow]) -> ControlFrame {
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
pub(crate) fn film<'a>(room: &'a Room, camera: &VirtualCamera, index: usize, seed: u64) -> Film<'a> {
    let seed = seed.wrapping_mul(1_000_003).wrapping_add(index as u64);
    Film::new(room, camera.camera, Sensor { seed, ..Sensor::default() })
}

/// One frame of a flight; the shutter is open for a quarter of the interval around the state's time.
pub(crate) fn frame(
    film: &Film<'_>,
    index: usize,
    aircraft: &Aircraft,
    state: &TruthRow,
    interval_s: f64,
) -> Vec<u8> {
    let open_s = Sensor::default().exposure_fraction * interval_s;
    film.frame(index as u64, aircraft, |share| pose_near(state, share * open_s))
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
