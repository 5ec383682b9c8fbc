//! A flight whose pose at any instant is a formula of the clock, so that a client can compute what it should
//! have received.
//!
//! Once round in four seconds, banked and nose up by constant angles, rising and sinking twice a round. Of
//! every two seconds the last half one is not measured.

use mavsight_geometry::{EulerAngles, Matrix6, Vector3, world_from_body, world_from_level};
use mavsight_link::{Event, Fix, MarkerView, Measured, Moving, PoseEvent, Scene, Tracking};
use std::f64::consts::{FRAC_PI_2, TAU};

const PERIOD_NS: i64 = 4_000_000_000;
const CYCLE_NS: i64 = 2_000_000_000;
const SEEN_NS: i64 = 1_500_000_000;
const CENTRE_M: [f64; 3] = [0.5, -0.2, 1.2];
const RADIUS_M: f64 = 0.8;
const WAVE_M: f64 = 0.1;
const PHI_RAD: f64 = 0.3;
const THETA_RAD: f64 = 0.1;

/// The covariance: diag(1…6) mm or mrad, and something off the diagonal, squared.
fn covariance() -> Matrix6<f64> {
    let root = Matrix6::from_fn(|i, j| {
        1e-3 * (((5 * i + 3 * j) % 7) as f64 / 7.0 + if i == j { i as f64 + 1.0 } else { 0.0 })
    });
    root * root.transpose()
}

/// The instant captured then.
pub(crate) fn fix(sequence: u64, captured_ns: i64) -> Fix {
    let turning_rad_s = TAU * 1e9 / PERIOD_NS as f64;
    let a = turning_rad_s * captured_ns.rem_euclid(PERIOD_NS) as f64 * 1e-9;
    let [x, y, z] = CENTRE_M;
    let position = Vector3::new(x + RADIUS_M * a.cos(), y + RADIUS_M * a.sin(), z + WAVE_M * (2.0 * a).sin());
    let velocity =
        turning_rad_s * Vector3::new(-RADIUS_M * a.sin(), RADIUS_M * a.cos(), 2.0 * WAVE_M * (2.0 * a).cos());
    let euler = EulerAngles { phi_rad: PHI_RAD, theta_rad: THETA_RAD, psi_rad: -(a + FRAC_PI_2) };
    let level_velocity = world_from_level().inverse() * velocity;
    let rates =
        Vector3::new(-THETA_RAD.sin(), THETA_RAD.cos() * PHI_RAD.sin(), THETA_RAD.cos() * PHI_RAD.cos())
            * -turning_rad_s;
    let seen = captured_ns.rem_euclid(CYCLE_NS) < SEEN_NS;
    Fix {
        sequence,
        captured_ns,
        received_ns: captured_ns + 2_000_000,
        measured: seen.then(|| Measured {
            world_from_body: world_from_body(position, euler),
            covariance: covariance(),
            moving: Some(Moving {
                velocity_in_body_m_s: euler.level_from_body().inverse() * level_velocity,
                rates_rad_s: rates,
                covariance: covariance() * 4.0,
            }),
            markers: 3,
            residual_px: Some(0.1),
        }),
        resets: u8::try_from(captured_ns.div_euclid(CYCLE_NS).rem_euclid(256)).unwrap_or(0),
    }
}

/// The same as an event.
pub(crate) fn event(fix: &Fix) -> Event {
    let pose = fix.measured.as_ref();
    let euler = pose.map(|m| EulerAngles::from_world_from_body(&m.world_from_body));
    let moving = pose.and_then(|m| m.moving.as_ref());
    Event::Pose(Box::new(PoseEvent {
        t_s: fix.captured_ns.rem_euclid(PERIOD_NS) as f64 * 1e-9,
        sequence: fix.sequence,
        captured_ns: fix.captured_ns,
        valid: pose.is_some(),
        tracking: if pose.is_some() { Tracking::Tracking } else { Tracking::Lost },
        position_m: pose.map(|m| m.world_from_body.translation.vector.into()),
        attitude: pose.map(|m| m.world_from_body.rotation).map(|q| [q.w, q.i, q.j, q.k]),
        euler_rad: euler.map(|e| [e.phi_rad, e.theta_rad, e.psi_rad]),
        covariance: pose.map(|m| {
            let mut upper = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
            std::array::from_fn(|_| upper.next().map_or(0.0, |at| m.covariance[at]))
        }),
        velocity_in_body_m_s: moving.map(|m| m.velocity_in_body_m_s.into()),
        velocity_std_m_s: None,
        rates_rad_s: moving.map(|m| m.rates_rad_s.into()),
        rates_std_rad_s: None,
        residual_px: pose.and_then(|m| m.residual_px),
        latency_ms: 2.0,
        reason: pose.is_none().then(|| "hidden".into()),
    }))
}

/// The markers of the aircraft.
pub(crate) fn markers() -> Vec<MarkerView> {
    [[0.2, 0.2, 0.1], [0.2, -0.2, 0.1], [-0.2, 0.2, 0.1], [-0.2, -0.2, 0.0]]
        .iter()
        .enumerate()
        .map(|(k, &in_body_m)| MarkerView {
            name: format!("ball{k}"),
            rgb: [200, 40, 40],
            in_body_m,
            diameter_m: 0.05,
        })
        .collect()
}

/// What stands still.
pub(crate) fn scene() -> Event {
    Event::Scene(Scene {
        name: "circle".into(),
        cameras: Vec::new(),
        markers: markers(),
        volume_m: [[-1.0, -1.0, 0.0], [2.0, 1.0, 2.0]],
    })
}
