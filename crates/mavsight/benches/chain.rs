//! Medians of the steps of the chain, on the virtual room: `cargo bench -p mavsight`.

// criterion_group! writes a public function without a docstring.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use mavsight::flight::{Scenario, Vehicle, simulate};
use mavsight::geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Isometry3, Matrix2, Vector3, world_from_body,
};
use mavsight::pose::{BodyMarker, CameraControl, MarkerObservation, PoseEstimator, calibrate};
use mavsight::scene::{Aircraft, Film, PaintedBall, Room, Sensor};
use mavsight::vision::{BallColor, Detector, Frame, Tracker};
use std::hint::black_box;

fn camera(x_m: f64) -> Camera {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let intrinsics = Intrinsics::from_horizontal_fov(size, 53_f64.to_radians());
    Camera::looking_at(Vector3::new(x_m, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), intrinsics, size)
}

fn pose() -> Isometry3<f64> {
    let attitude = EulerAngles { psi_rad: -0.4, ..EulerAngles::default() };
    world_from_body(Vector3::new(0.0, 0.0, 1.5), attitude)
}

/// The corners of a cube of 3 m as a camera sees them.
fn control(name: &str, x_m: f64) -> CameraControl {
    let view = camera(x_m);
    let points = (0..8)
        .map(|k: u8| {
            let side = |bit: u8| if k & bit == 0 { -1.5 } else { 1.5 };
            let point_in_world_m = Vector3::new(side(1), side(2), side(4) + 1.5);
            ControlPoint {
                name: k.to_string(),
                point_in_world_m,
                pixel: view.project(&point_in_world_m).expect("in view").pixel,
                pixel_cov_px2: Matrix2::identity() * 0.0025,
            }
        })
        .collect();
    CameraControl::exact(name.to_owned(), view.size, points, vec![0.0; 8])
}

fn aircraft(vehicle: &Vehicle) -> Aircraft {
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

fn seeing(c: &mut Criterion) {
    let vehicle = Vehicle::paper();
    let (room, craft) = (Room::meeting_room(), aircraft(&vehicle));
    let view = camera(4.5);
    let film = Film::new(&room, view, Sensor::default());
    c.bench_function("film one frame, 640x480", |b| b.iter(|| black_box(film.frame(0, &craft, |_| pose()))));
    let frame = Frame::from_rgb(view.size, film.frame(0, &craft, |_| pose())).expect("a frame");
    let colors: Vec<BallColor> =
        vehicle.marker.iter().map(|m| BallColor { name: m.name.clone(), rgb: m.color.rgb() }).collect();
    let mut detector = Detector::new(&colors).expect("a detector");
    c.bench_function("detect four balls in a whole frame", |b| {
        b.iter(|| black_box(detector.candidates(&frame, 3.0..=12.0)));
    });
    let mut tracker = Tracker::new(&colors, 3.0..=12.0).expect("a tracker");
    tracker.observe(&frame);
    c.bench_function("track four balls", |b| b.iter(|| black_box(tracker.observe(&frame).len())));
}

fn solving(c: &mut Criterion) {
    let vehicle = Vehicle::paper();
    let body: Vec<BodyMarker> = mavsight::pipeline::body_markers(&vehicle);
    let rig = calibrate(&[control("cam1", 4.5), control("cam2", -4.5)]).expect("a rig");
    let mut seen = Vec::new();
    for (k, c) in rig.cameras.iter().enumerate() {
        for (m, marker) in body.iter().enumerate() {
            let centre = (pose() * mavsight::geometry::Point3::from(marker.marker_in_body_m)).coords;
            let pixel = c.camera.project_ball(&centre, marker.radius_m).expect("in view").pixel;
            let covariance_px2 = Matrix2::identity() * 0.0025;
            seen.push(MarkerObservation { t_ns: 0, camera: k, marker: m, pixel, covariance_px2 });
        }
    }
    let estimator = PoseEstimator::new(&rig, &body);
    c.bench_function("pose of eight sightings", |b| b.iter(|| black_box(estimator.estimate(0, &seen, None))));
    let scenario = Scenario::paper();
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let times = scenario.frame_times_s();
    c.bench_function("simulate 10 s", |b| {
        b.iter(|| black_box(simulate(&vehicle, &inputs, &scenario.start(), &times)));
    });
}

criterion_group! { name = benches; config = Criterion::default().sample_size(20); targets = seeing, solving }
criterion_main!(benches);
