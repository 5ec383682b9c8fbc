//! The results of a flight as events.

use crate::InstantEstimate;
use mavsight_flight::Vehicle;
use mavsight_geometry::{Camera, EulerAngles, Isometry3, Point3, Vector2, Vector3};
use mavsight_link::{
    CameraView, DetectedBall, Event, Fix, MarkerView, Measured, Moving, PoseEvent, Scene, Tracking,
    upper_triangle,
};
use mavsight_pose::{MotionSample, PoseError, PoseEstimate, Rig, control_volume};

/// The markers of a vehicle, for listeners.
pub fn marker_views(vehicle: &Vehicle) -> Vec<MarkerView> {
    let view = |m: &mavsight_flight::Marker| MarkerView {
        name: m.name.clone(),
        rgb: m.color.rgb(),
        in_body_m: m.position_m,
        diameter_m: m.diameter_m,
    };
    vehicle.marker.iter().map(view).collect()
}

/// The static scene: the first event.
pub(crate) fn scene(name: &str, rig: &Rig, vehicle: &Vehicle) -> Scene {
    let volume_m = control_volume(rig).map_or([[0.0; 3]; 2], |v| [v.low_m.into(), v.high_m.into()]);
    Scene {
        name: name.to_owned(),
        cameras: rig.cameras.iter().map(|c| view(&c.name, &c.camera)).collect(),
        markers: marker_views(vehicle),
        volume_m,
    }
}

fn view(name: &str, camera: &Camera) -> CameraView {
    let (right, below) = (f64::from(camera.size.width_px) - 0.5, f64::from(camera.size.height_px) - 0.5);
    let axis = camera.cam_from_world.rotation.inverse() * Vector3::z();
    let corner = |u: f64, v: f64| {
        let ray = camera.ray(&Vector2::new(u, v)).unwrap_or(axis);
        let depth = ray.dot(&axis);
        // A corner beyond ninety degrees does not meet the plane of unit depth.
        if depth > 1e-3 { (ray / depth).into() } else { axis.into() }
    };
    CameraView {
        name: name.to_owned(),
        width_px: camera.size.width_px,
        height_px: camera.size.height_px,
        centre_m: camera.centre_in_world().into(),
        corners: [corner(-0.5, -0.5), corner(right, -0.5), corner(right, below), corner(-0.5, below)],
    }
}

pub(crate) fn measured(estimate: &PoseEstimate, motion: Option<&MotionSample>) -> Measured {
    Measured {
        world_from_body: estimate.world_from_body,
        covariance: estimate.covariance(),
        moving: motion.map(|m| Moving {
            velocity_in_body_m_s: m.velocity_in_body_m_s,
            rates_rad_s: m.rates_rad_s,
            covariance: m.covariance.velocity_and_rates(),
        }),
        markers: estimate.markers_used.len(),
        residual_px: estimate.residual_px,
    }
}

pub(crate) fn pose(
    fix: &Fix,
    t_ns: i64,
    tracking: Tracking,
    latency_ns: i64,
    reason: Option<&PoseError>,
) -> Event {
    let measured = fix.measured.as_ref();
    let moving = measured.and_then(|m| m.moving.as_ref());
    let std = |at: usize| {
        let std = |m: &Moving| std::array::from_fn(|k| m.covariance[(at + k, at + k)].max(0.0).sqrt());
        moving.map(std)
    };
    Event::Pose(Box::new(PoseEvent {
        t_s: t_ns as f64 * 1e-9,
        sequence: fix.sequence,
        captured_ns: fix.captured_ns,
        valid: measured.is_some(),
        tracking,
        position_m: measured.map(|m| m.world_from_body.translation.vector.into()),
        attitude: measured.map(|m| {
            let turn = m.world_from_body.rotation;
            [turn.w, turn.i, turn.j, turn.k]
        }),
        euler_rad: measured.map(|m| {
            let angles = EulerAngles::from_world_from_body(&m.world_from_body);
            [angles.phi_rad, angles.theta_rad, angles.psi_rad]
        }),
        covariance: measured.map(|m| upper_triangle(&m.covariance)),
        velocity_in_body_m_s: moving.map(|m| m.velocity_in_body_m_s.into()),
        velocity_std_m_s: std(0),
        rates_rad_s: moving.map(|m| m.rates_rad_s.into()),
        rates_std_rad_s: std(3),
        residual_px: measured.and_then(|m| m.residual_px),
        latency_ms: latency_ns as f64 * 1e-6,
        reason: reason.map(PoseError::to_string),
    }))
}

pub(crate) fn detections<'a>(
    instant: &'a InstantEstimate<'_>,
    rig: &'a Rig,
    vehicle: &'a Vehicle,
) -> impl Iterator<Item = Event> + 'a {
    let pose = instant.association.sample.estimate.as_ref().ok().map(|e| e.world_from_body);
    (0..rig.cameras.len()).map(move |camera| {
        let own = instant.seen.iter().enumerate().filter(move |(_, c)| c.camera == camera);
        let seen = own.map(|(index, c)| {
            let marker = instant.association.pairs.iter().find(|p| p.0 == index).map(|p| p.1);
            let expected = marker
                .zip(pose)
                .and_then(|(m, pose)| expected_px(&rig.cameras[camera].camera, vehicle, m, &pose));
            DetectedBall {
                u_px: c.pixel.x,
                v_px: c.pixel.y,
                diameter_px: c.diameter_px,
                marker,
                residual_px: expected.map(|e| (c.pixel - e).into()),
            }
        });
        Event::Detections { camera, t_s: instant.t_ns as f64 * 1e-9, seen: seen.collect() }
    })
}

pub(crate) fn expected_px(
    camera: &Camera,
    vehicle: &Vehicle,
    marker: usize,
    world_from_body: &Isometry3<f64>,
) -> Option<Vector2<f64>> {
    let ball = vehicle.marker.get(marker)?;
    let centre = (world_from_body * Point3::from(Vector3::from(ball.position_m))).coords;
    camera.project_ball(&centre, 0.5 * ball.diameter_m).ok().map(|p| p.pixel)
}
