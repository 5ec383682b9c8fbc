//! A body that is carried about before calibrated cameras, and what they see of it: shared by the tests of
//! this crate, inside and outside, and by its example.

#![allow(dead_code)]

use mavsight_flight::InputSeries;
use mavsight_geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, Vector2, Vector3,
    world_from_body,
};
use mavsight_pose::{BodyMarker, CameraControl, MarkerObservation, Rig, calibrate};
use mavsight_random::Random;

pub(crate) const SMALL: ImageSize = ImageSize { width_px: 640, height_px: 480 };
pub(crate) const LARGE: ImageSize = ImageSize { width_px: 1920, height_px: 1080 };
const RATE_HZ: f64 = 30.0;

/// The paper's places of cameras.
pub(crate) const TWO: [[f64; 3]; 2] = [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]];

/// Cameras at these places, calibrated from 27 exact points whose pixels count as good to `std_px`.
pub(crate) fn rig_at(places_m: &[[f64; 3]], size: ImageSize, std_px: f64) -> Rig {
    let k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
    let side = |i: usize| (i % 3) as f64 * 1.5 - 1.5;
    let points: Vec<Vector3<f64>> =
        (0..27).map(|i| Vector3::new(side(i), side(i / 3), side(i / 9) + 1.5)).collect();
    let control = |(index, place_m): (usize, &[f64; 3])| {
        let camera = Camera::looking_at(Vector3::from(*place_m), Vector3::new(0.0, 0.0, 1.5), k, size);
        let seen = points.iter().map(|p| ControlPoint {
            name: String::new(),
            point_in_world_m: *p,
            pixel: camera.project(p).expect("in view").pixel,
            pixel_cov_px2: Matrix2::identity() * std_px * std_px,
        });
        CameraControl {
            name: format!("cam{}", index + 1),
            size,
            points: seen.collect(),
            ball_radius_m: vec![0.0; 27],
            survey_std_m: vec![0.0; 27],
        }
    };
    let controls: Vec<CameraControl> = places_m.iter().enumerate().map(control).collect();
    calibrate(&controls).expect("a rig")
}

/// Where the body is.
pub(crate) fn pose(t_s: f64) -> Isometry3<f64> {
    let s = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * t_s + phase).sin();
    let place = Vector3::new(0.3 * s(0.37, 0.0), 0.2 * s(0.43, 1.0), 1.5 + 0.15 * s(0.53, 2.0));
    let angles = EulerAngles {
        phi_rad: 0.2 * s(0.61, 0.4),
        theta_rad: 0.2 * s(0.47, 1.4),
        psi_rad: 0.5 + 0.2 * s(0.23, 0.0),
    };
    world_from_body(place, angles)
}

/// What one camera of a rig sees of a body at a time, with uniform noise of this standard deviation.
pub(crate) fn seen_by(
    (rig, camera): (&Rig, usize),
    (body, world_from_body): (&[BodyMarker], &Isometry3<f64>),
    t_ns: i64,
    (std_px, random): (f64, &mut Random),
) -> Vec<MarkerObservation> {
    let mut uniform = || 12f64.sqrt() * std_px * (random.uniform() - 0.5);
    let mut see = |(marker, ball): (usize, &BodyMarker)| {
        let centre = (world_from_body * Point3::from(ball.marker_in_body_m)).coords;
        let pixel = rig.cameras[camera].camera.project_ball(&centre, ball.radius_m).expect("in view").pixel;
        let pixel = pixel + Vector2::new(uniform(), uniform());
        let covariance_px2 = Matrix2::identity() * std_px * std_px;
        MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 }
    };
    body.iter().enumerate().map(&mut see).collect()
}

/// Instants of a flight with what is seen at each, made as they are asked for.
pub(crate) fn instants(
    rig: &Rig,
    body: &[BodyMarker],
    count: usize,
) -> impl Iterator<Item = (i64, Vec<MarkerObservation>)> {
    let mut random = Random::new(1, 0);
    (0..count).map(move |k| {
        let t_ns = (k as f64 / RATE_HZ * 1e9).round() as i64;
        let at = pose(t_ns as f64 * 1e-9);
        let mut see = |camera| seen_by((rig, camera), (body, &at), t_ns, (0.1, &mut random));
        (t_ns, (0..rig.cameras.len()).flat_map(&mut see).collect())
    })
}

/// Inputs at 100 Hz that move all the while.
pub(crate) fn inputs(count: usize) -> InputSeries {
    let times_s: Vec<f64> =
        (0..=(count as f64 / RATE_HZ * 100.0) as usize + 1).map(|k| k as f64 / 100.0).collect();
    let row = |t_s: &f64| {
        [
            215.0 + 5.0 * (0.9 * t_s).sin(),
            215.0 + 4.0 * (1.3 * t_s).cos(),
            0.05 * (2.1 * t_s).sin(),
            0.04 * (1.7 * t_s).cos(),
        ]
    };
    let values = times_s.iter().flat_map(row).collect();
    let names = ["omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"].map(str::to_owned);
    InputSeries::new(names, times_s, values).expect("inputs")
}
