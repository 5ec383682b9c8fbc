//! The virtual laboratory: the paper's cameras, control frame and aircraft, filmed.

use mavsight_flight::{Color, Vehicle};
use mavsight_geometry::{
    Camera, EulerAngles, ImageSize, Intrinsics, Isometry3, UnitQuaternion, Vector3, world_from_body,
};
use mavsight_scene::{Aircraft, ControlFrame, Film, PaintedBall, Room, Sensor};
use mavsight_session::{ControlPointRow, TruthRow};

/// One camera of the laboratory.
pub(crate) struct LabCamera {
    /// Name.
    pub(crate) name: String,
    /// Where and what it is.
    pub(crate) camera: Camera,
}

/// Section 3 of the paper: two cameras of 640×480 and 53° across, 6.36 m from the middle of the control frame, whose axes
/// cross there at a right angle.
pub(crate) fn cameras() -> Vec<LabCamera> {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let intrinsics = Intrinsics::from_horizontal_fov(size, 53_f64.to_radians());
    let target = Vector3::new(0.0, 0.0, 1.5);
    [("cam1", 4.5), ("cam2", -4.5)]
        .map(|(name, x)| LabCamera {
            name: name.to_owned(),
            camera: Camera::looking_at(Vector3::new(x, -4.5, 1.5), target, intrinsics, size),
        })
        .into()
}

/// The control frame of 3 m with a 6 cm ball at each corner.
pub(crate) fn control_points() -> Vec<ControlPointRow> {
    let ball = |name: &str, position_m: [f64; 3], color: [u8; 3]| ControlPointRow {
        name: name.to_owned(),
        position_m,
        diameter_m: 0.06,
        std_m: 0.0,
        color: Color::new(color[0], color[1], color[2]),
    };
    vec![
        ball("red", [-1.5, -1.5, 0.0], [0xd8, 0x1c, 0x1c]),
        ball("green", [1.5, -1.5, 0.0], [0x1c, 0xa0, 0x34]),
        ball("blue", [1.5, 1.5, 0.0], [0x24, 0x3c, 0xd4]),
        ball("yellow", [-1.5, 1.5, 0.0], [0xe6, 0xc8, 0x18]),
        ball("magenta", [-1.5, -1.5, 3.0], [0xc8, 0x20, 0x90]),
        ball("cyan", [1.5, -1.5, 3.0], [0x18, 0xa8, 0xb4]),
        ball("orange", [1.5, 1.5, 3.0], [0xe0, 0x6a, 0x14]),
        ball("violet", [-1.5, 1.5, 3.0], [0x7a, 0x30, 0xc0]),
    ]
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

/// The control frame as it is filmed.
pub(crate) fn control_frame() -> ControlFrame {
    let balls: Vec<PaintedBall> = control_points()
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
pub(crate) fn film<'a>(room: &'a Room, camera: &LabCamera, index: usize, seed: u64) -> Film<'a> {
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
