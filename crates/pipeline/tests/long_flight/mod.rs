//! What two cameras see of an aircraft that is carried about for as long as one likes.

use mavsight_flight::{InputSample, InputSeries, Vehicle};
use mavsight_geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, Vector2, Vector3,
    world_from_body,
};
use mavsight_pose::{CameraControl, MarkerObservation, Rig, calibrate};

const SIZE: ImageSize = ImageSize { width_px: 1920, height_px: 1080 };
const STD_PX: f64 = 0.1;
const RATE_HZ: f64 = 30.0;

pub(crate) fn rig() -> Rig {
    let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
    let side = |i: usize| (i % 3) as f64 * 1.5 - 1.5;
    let points: Vec<Vector3<f64>> =
        (0..27).map(|i| Vector3::new(side(i), side(i / 3), side(i / 9) + 1.5)).collect();
    let control = |x: f64| {
        let camera = Camera::looking_at(Vector3::new(x, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), k, SIZE);
        let seen = points.iter().map(|p| ControlPoint {
            name: String::new(),
            point_in_world_m: *p,
            pixel: camera.project(p).expect("in view").pixel,
            pixel_cov_px2: Matrix2::identity() * 1e-2,
        });
        CameraControl {
            name: format!("at {x}"),
            size: SIZE,
            points: seen.collect(),
            ball_radius_m: vec![0.0; 27],
            survey_std_m: vec![0.0; 27],
        }
    };
    calibrate(&[control(4.5), control(-4.5)]).expect("a rig")
}

fn pose(t_s: f64) -> Isometry3<f64> {
    let s = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * t_s + phase).sin();
    let place = Vector3::new(0.3 * s(0.37, 0.0), 0.2 * s(0.43, 1.0), 1.5 + 0.15 * s(0.53, 2.0));
    let angles = EulerAngles {
        phi_rad: 0.2 * s(0.61, 0.4),
        theta_rad: 0.2 * s(0.47, 1.4),
        psi_rad: 0.5 + 0.2 * s(0.23, 0.0),
    };
    world_from_body(place, angles)
}

/// Instants of the flight with what is seen at each, made as they are asked for.
pub(crate) fn instants(rig: &Rig, count: usize) -> impl Iterator<Item = (i64, Vec<MarkerObservation>)> {
    let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
    let vehicle = Vehicle::paper();
    let mut random = mavsight_random::Random::new(1, 0);
    let mut uniform = move || 12f64.sqrt() * STD_PX * (random.uniform() - 0.5);
    (0..count).map(move |k| {
        let t_ns = (k as f64 / RATE_HZ * 1e9).round() as i64;
        let at = pose(t_ns as f64 * 1e-9);
        let mut seen = Vec::with_capacity(cameras.len() * vehicle.marker.len());
        for (camera, view) in cameras.iter().enumerate() {
            for (marker, ball) in vehicle.marker.iter().enumerate() {
                let centre = (at * Point3::from(Vector3::from(ball.position_m))).coords;
                let pixel = view.project_ball(&centre, ball.diameter_m / 2.0).expect("in view").pixel;
                let pixel = pixel + Vector2::new(uniform(), uniform());
                let covariance_px2 = Matrix2::identity() * STD_PX * STD_PX;
                seen.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
            }
        }
        (t_ns, seen)
    })
}

/// Inputs at 100 Hz that move all the while.
#[allow(dead_code)]
pub(crate) fn inputs(count: usize) -> InputSeries {
    let samples = (0..=(count as f64 / RATE_HZ * 100.0) as usize + 1).map(|k| {
        let t_s = k as f64 / 100.0;
        InputSample {
            t_s,
            omega_u_rad_s: 215.0 + 5.0 * (0.9 * t_s).sin(),
            omega_l_rad_s: 215.0 + 4.0 * (1.3 * t_s).cos(),
            delta_lon_rad: 0.05 * (2.1 * t_s).sin(),
            delta_lat_rad: 0.04 * (1.7 * t_s).cos(),
        }
    });
    InputSeries::new(samples.collect()).expect("inputs")
}
