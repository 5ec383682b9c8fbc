//! A flight of ten seconds, 300 instants, and twelve free parameters, fitted by output error on one core: to
//! its poses, and straight to the images of four markers in two cameras.

use criterion::{Criterion, criterion_group, criterion_main};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{
    Camera, ControlPoint, ImageSize, Intrinsics, Isometry3, Matrix2, Matrix6, UnitQuaternion, Vector2,
    Vector3, world_from_body,
};
use mavsight_identify::output_error::{
    FlightModel, ImageMeasurements, Measurements, OutputErrorOptions, StateMeasurement, output_error,
};
use mavsight_pose::{BodyMarker, CameraControl, MarkerObservation, Rig, calibrate};
use mavsight_random::Random;
use mavsight_simulator::{Maneuver, Scenario, simulate};
use nalgebra::Point3;
use std::hint::black_box;

const FREE: [&str; 12] = [
    "C_X,alpha_u",
    "C_X,alpha_l",
    "C_m,alpha_u",
    "C_m,alpha_l",
    "C_m,q",
    "tau_l",
    "tau_f",
    "C_X,0",
    "C_Y,0",
    "C_l,0",
    "C_m,0",
    "C_Z,0",
];
const POSITION_STD_M: f64 = 5e-4;
const TURN_STD_RAD: f64 = 9e-4;
const PIXEL_STD_PX: f64 = 0.1;

fn normal3(random: &mut Random) -> Vector3<f64> {
    Vector3::new(random.normal(), random.normal(), random.normal())
}

fn rig() -> Rig {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
    let side = |i: usize, bit: usize| if (i >> bit) & 1 == 1 { 1.5 } else { -1.5 };
    let control = |x_m: f64| {
        let camera = Camera::looking_at(Vector3::new(x_m, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), k, size);
        let seen = (0..8).map(|i| {
            let point_in_world_m = Vector3::new(side(i, 0), side(i, 1), side(i, 2) + 1.5);
            let pixel = camera.project(&point_in_world_m).expect("in view").pixel;
            let pixel_cov_px2 = Matrix2::identity() * 0.01;
            ControlPoint { name: i.to_string(), point_in_world_m, pixel, pixel_cov_px2 }
        });
        CameraControl::exact(format!("at {x_m}"), size, seen.collect(), vec![0.0; 8])
    };
    calibrate(&[control(4.5), control(-4.5)]).expect("a rig")
}

fn problem() -> (FlightModel, InputSeries, Measurements, Measurements) {
    let vehicle = Vehicle::paper();
    let scenario = Scenario {
        maneuver: vec![Maneuver::Multisine {
            channel: "delta_lon".to_owned(),
            start_s: 0.5,
            length_s: 9.5,
            harmonics: vec![3, 5, 7, 11, 15],
            amplitude: 2.5,
        }],
        ..Scenario::paper()
    };
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let start = scenario.start(&vehicle).expect("a start");
    let states = simulate(&vehicle, &inputs, &start, &scenario.frame_times_s()).expect("a flight");
    assert_eq!(states.len(), 300);
    let model = FlightModel::new(&vehicle, &inputs).and_then(|m| m.with_free(&FREE)).expect("a model");
    let (p, t) = (POSITION_STD_M.powi(2), TURN_STD_RAD.powi(2));
    let covariance = Matrix6::from_diagonal(&nalgebra::Vector6::new(p, p, p, t, t, t));
    let (rig, random) = (rig(), &mut Random::new(7, 0));
    let radius_m = 0.5 * vehicle.marker[0].diameter_m;
    let markers: Vec<BodyMarker> = vehicle
        .marker
        .iter()
        .map(|m| BodyMarker { name: m.name.clone(), marker_in_body_m: m.position_m.into(), radius_m })
        .collect();
    let (mut poses, mut seen) = (Vec::new(), Vec::new());
    for s in &states {
        let at = world_from_body(s.position_in_world_m, s.attitude);
        let t_ns = (s.t_s * 1e9).round() as i64;
        let place = at.translation.vector + normal3(random) * POSITION_STD_M;
        let turn = UnitQuaternion::from_scaled_axis(normal3(random) * TURN_STD_RAD);
        let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
        poses.push(StateMeasurement::of_pose(t_ns, pose, covariance));
        for (camera, c) in rig.cameras.iter().enumerate() {
            for (marker, m) in markers.iter().enumerate() {
                let centre = (at * Point3::from(m.marker_in_body_m)).coords;
                let exact = c.camera.project_ball(&centre, m.radius_m).expect("in view").pixel;
                let pixel = exact + Vector2::new(random.normal(), random.normal()) * PIXEL_STD_PX;
                let covariance_px2 = Matrix2::identity() * PIXEL_STD_PX.powi(2);
                seen.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
            }
        }
    }
    let images = ImageMeasurements::new(&rig, &markers, &seen).and_then(|i| i.with_cameras(&rig));
    let images = images.expect("images").with_marker_positions(5e-4);
    (model, inputs, Measurements::States(poses), Measurements::Image(images))
}

fn output_errors(criterion: &mut Criterion) {
    let (model, inputs, poses, images) = problem();
    assert_eq!(model.free().len(), 12);
    let mut group = criterion.benchmark_group("300 instants, 12 free parameters");
    group.sample_size(10);
    for (name, measured) in [("output error", &poses), ("straight from the image", &images)] {
        group.bench_function(name, |b| {
            b.iter(|| {
                output_error(&model, &inputs, black_box(measured), &OutputErrorOptions::default())
                    .expect("a fit")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, output_errors);
criterion_main!(benches);
