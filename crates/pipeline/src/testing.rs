//! What several tests share: two cameras, and what they see of a body that is carried about.

use crate::stream::{StoredDetection, Stream};
use mavsight_flight::Vehicle;
use mavsight_geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, Vector2, Vector3,
    world_from_body,
};
use mavsight_pose::{
    CameraClock, CameraControl, ClockPrior, MarkerObservation, Rig, TrackedDetection, calibrate,
};

pub(crate) const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

/// Standard deviation of the centres.
pub(crate) const STD_PX: f64 = 0.03;

pub(crate) fn rig() -> Rig {
    let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
    let side = |i: usize| (i % 3) as f64 * 1.5 - 1.5;
    let points: Vec<Vector3<f64>> =
        (0..27).map(|i| Vector3::new(side(i), side(i / 3), side(i / 9) + 1.5)).collect();
    let control = |(at, name): (Vector3<f64>, &str)| {
        let camera = Camera::looking_at(at, Vector3::new(0.0, 0.0, 1.5), k, SIZE);
        let seen = points.iter().map(|p| ControlPoint {
            name: String::new(),
            point_in_world_m: *p,
            pixel: camera.project(p).unwrap().pixel,
            pixel_cov_px2: Matrix2::identity() * 1e-5,
        });
        CameraControl {
            name: name.into(),
            size: SIZE,
            points: seen.collect(),
            ball_radius_m: vec![0.0; 27],
            survey_std_m: vec![0.0; 27],
        }
    };
    let places = [
        (Vector3::new(4.5, -4.5, 1.5), "cam1"),
        (Vector3::new(-4.5, -4.5, 2.0), "cam2"),
        (Vector3::new(0.3, 5.5, 2.5), "cam3"),
    ];
    calibrate(&places.map(control)).unwrap()
}

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

/// What one camera of the rig sees over a time, `frames` of them at a rate, with a clock of its own.
pub(crate) fn stream(
    camera: usize,
    clock: CameraClock,
    rate_hz: f64,
    frames: std::ops::Range<usize>,
) -> Stream {
    let rig = rig();
    let view = &rig.cameras[camera].camera;
    let mut out = Stream::new(
        camera,
        rig.cameras[camera].name.clone(),
        ClockPrior::known(CameraClock::default()),
        Vector2::y(),
    );
    let mut random = mavsight_random::Random::new(7, camera as u64);
    let mut uniform = || 12f64.sqrt() * STD_PX * (random.uniform() - 0.5);
    for k in frames {
        let stamp_ns = (k as f64 / rate_hz * 1e9).round() as i64;
        let mut seen = Vec::new();
        let at = pose(clock.time_s(stamp_ns, 0.0));
        for (marker, ball) in Vehicle::paper().marker.iter().enumerate() {
            let centre = (at * Point3::from(Vector3::from(ball.position_m))).coords;
            let pixel = view.project_ball(&centre, ball.diameter_m / 2.0).unwrap().pixel;
            let pixel = pixel + Vector2::new(uniform(), uniform());
            let covariance_px2 = Matrix2::identity() * STD_PX * STD_PX;
            seen.push(TrackedDetection {
                t_ns: stamp_ns,
                camera,
                track_id: marker as u32,
                color: marker,
                pixel,
                covariance_px2,
                diameter_px: 6.0,
                is_static: false,
                is_preferred: true,
            });
        }
        out.add(stamp_ns, &seen, None);
    }
    out
}

/// The same of a camera without a clock of its own, with its balls identified.
pub(crate) fn seen_by(camera: usize, frames: std::ops::Range<usize>) -> Vec<MarkerObservation> {
    let stream = stream(camera, CameraClock::default(), 30.0, frames);
    let markers = Vehicle::paper().marker.len();
    let identified = |(k, s): (usize, &StoredDetection)| MarkerObservation {
        t_ns: stream.stamps_ns[k / markers],
        camera,
        marker: k % markers,
        pixel: s.pixel,
        covariance_px2: Matrix2::identity() * STD_PX * STD_PX,
    };
    stream.detections.iter().enumerate().map(identified).collect()
}
