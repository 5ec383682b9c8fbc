//! A flight whose end joins its beginning, filmed once, and the truth of it at any time.

use anyhow::{Result, anyhow};
use mavsight::flight::Vehicle;
use mavsight::geometry::{
    EulerAngles, ImageSize, Isometry3, Matrix6, Point3, UnitQuaternion, Vector2, Vector3, world_from_body,
};
use mavsight::lab;
use mavsight::pipeline::{ControlStill, calibrate_from_stills};
use mavsight::pose::Rig;
use mavsight::scene::{FilmStream, Room, Sensor};
use mavsight::score::VirtualCamera;
use mavsight::vision::Frame;
use std::sync::Arc;

pub(crate) const RATE_HZ: f64 = 30.0;
pub(crate) const INTERVAL_NS: i64 = 33_333_333;
pub(crate) const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };
/// Length of the piece that is played over and over.
const LOOP_S: f64 = 8.0;
const LOOP_FRAMES: u64 = (LOOP_S * RATE_HZ) as u64;

/// Time of a frame by its number.
pub(crate) fn time_ns(frame: u64) -> i64 {
    (frame as f64 / RATE_HZ * 1e9).round() as i64
}

/// The aircraft at a time: swinging and turning in the middle of the room, the same every eight seconds.
pub(crate) fn pose(t_s: f64) -> Isometry3<f64> {
    let s = |turns: f64, phase: f64| (std::f64::consts::TAU * turns * t_s / LOOP_S + phase).sin();
    let place = Vector3::new(
        0.3 * s(1.0, 0.3) + 0.04 * s(4.0, 0.0),
        0.25 * s(1.0, 2.0) + 0.04 * s(3.0, 1.0),
        1.5 + 0.12 * s(2.0, 1.0),
    );
    let angles = EulerAngles {
        phi_rad: 0.08 * s(3.0, 0.4) + 0.03 * s(7.0, 0.0),
        theta_rad: 0.08 * s(4.0, 1.4) + 0.03 * s(6.0, 0.7),
        psi_rad: -0.393 + 0.15 * s(1.0, 0.0),
    };
    world_from_body(place, angles)
}

/// Components of a pose less the truth over their standard deviations: the largest.
pub(crate) fn largest_ratio(t_s: f64, estimate: &Isometry3<f64>, covariance: &Matrix6<f64>) -> f64 {
    let truth = pose(t_s);
    let shift = estimate.translation.vector - truth.translation.vector;
    let turn = (UnitQuaternion::from(estimate.rotation).inverse() * truth.rotation).scaled_axis();
    let parts = shift.iter().chain(turn.iter()).enumerate();
    parts.map(|(k, error)| error.abs() / covariance[(k, k)].sqrt()).fold(0.0, f64::max)
}

/// The film of two cameras, and what is known of them.
pub(crate) struct Film {
    pub(crate) vehicle: Vehicle,
    pub(crate) rig: Rig,
    cameras: Vec<VirtualCamera>,
    frames: Vec<Vec<Frame>>,
}

impl Film {
    pub(crate) fn new(seed: u64) -> Result<Self> {
        let (vehicle, points, cameras) = (Vehicle::paper(), lab::control_points(), lab::cameras());
        let (room, aircraft) = (Room::meeting_room(), lab::aircraft(&vehicle));
        let films: Vec<_> =
            cameras.iter().enumerate().map(|(k, camera)| lab::film(&room, camera, k, seed)).collect();
        if cameras.iter().any(|c| c.camera.size != SIZE) {
            return Err(anyhow!("the cameras of the room are not of 640x480"));
        }
        let control = lab::control_frame(&points);
        let stills = cameras.iter().zip(&films).map(|(camera, film)| {
            let frame = Frame::from_rgb(SIZE, film.still(Some(&control)))?;
            Ok(ControlStill { camera: camera.name.clone(), frame })
        });
        let rig = calibrate_from_stills(&stills.collect::<Result<Vec<_>>>()?, &points, &[])?;
        let open_s = Sensor::default().exposure_fraction / RATE_HZ;
        let roll = |film| {
            let mut stream = FilmStream::new(film);
            let frame = |n: u64| {
                let mut rgb = vec![0; 3 * SIZE.area_px()];
                let at = |share: f64| pose(n as f64 / RATE_HZ + share * open_s);
                stream.frame_into(n, &aircraft, at, &mut rgb);
                Ok(Frame::from_rgb(SIZE, rgb)?)
            };
            (0..LOOP_FRAMES).map(frame).collect::<Result<Vec<_>>>()
        };
        let frames = films.into_iter().map(roll).collect::<Result<Vec<_>>>()?;
        Ok(Self { vehicle, rig, cameras, frames })
    }

    /// What a camera films in a frame without a fault.
    pub(crate) fn frame(&self, camera: usize, frame: u64) -> &Frame {
        &self.frames[camera][(frame % LOOP_FRAMES) as usize]
    }

    /// Where the images of the balls are in a frame, with their radii.
    pub(crate) fn balls(&self, camera: usize, frame: u64) -> impl Iterator<Item = (Vector2<f64>, f64)> {
        let (camera, at) = (self.cameras[camera].camera, pose(frame as f64 / RATE_HZ));
        self.vehicle.marker.iter().filter_map(move |ball| {
            let centre = (at * Point3::from(Vector3::from(ball.position_m))).coords;
            let image = camera.project_ball(&centre, 0.5 * ball.diameter_m).ok()?;
            let depth_m = (camera.cam_from_world * Point3::from(centre)).z;
            Some((image.pixel, 0.5 * camera.intrinsics.fx_px * ball.diameter_m / depth_m))
        })
    }
}

pub(crate) type SharedFilm = Arc<Film>;
