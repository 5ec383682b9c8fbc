//! Medians of the steps of the chain, on the virtual laboratory: `cargo bench -p mavsight`.

// criterion_group! writes a public function without a docstring.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use mavsight::flight::Vehicle;
use mavsight::geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, Vector3,
    world_from_body,
};
use mavsight::lab;
use mavsight::pose::{
    CameraControl, CausalFilter, MarkerObservation, PoseEstimator, PoseSample, Rig, calibrate, motion_noise,
    smooth,
};
use mavsight::scene::Room;
use mavsight::score::VirtualCamera;
use mavsight::simulator::{Scenario, simulate};
use mavsight::vision::{BallColor, Detection, Detector, Frame, Tracker};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Noise of a ball's centre, px² in each coordinate.
const CENTRE_VAR_PX2: f64 = 0.0025;

fn pose() -> Isometry3<f64> {
    let attitude = EulerAngles { psi_rad: -0.4, ..EulerAngles::default() };
    world_from_body(Vector3::new(0.0, 0.0, 1.5), attitude)
}

fn colors(vehicle: &Vehicle) -> Vec<BallColor> {
    vehicle.marker.iter().map(|m| BallColor { name: m.name.clone(), rgb: m.color.rgb() }).collect()
}

/// The laboratory's cameras, calibrated from its control frame.
fn rig() -> Rig {
    let control = |camera: VirtualCamera| {
        let points = lab::control_points();
        let seen = points.iter().map(|p| {
            let point_in_world_m = Vector3::from(p.position_m);
            ControlPoint {
                name: p.name.clone(),
                point_in_world_m,
                pixel: camera.camera.project(&point_in_world_m).expect("in view").pixel,
                pixel_cov_px2: Matrix2::identity() * CENTRE_VAR_PX2,
            }
        });
        CameraControl::exact(camera.name, camera.camera.size, seen.collect(), vec![0.0; points.len()])
    };
    calibrate(&lab::cameras().into_iter().map(control).collect::<Vec<_>>()).expect("a rig")
}

/// What the rig sees of the body at one instant.
fn observations(rig: &Rig, vehicle: &Vehicle, t_ns: i64, pose: &Isometry3<f64>) -> Vec<MarkerObservation> {
    let mut seen = Vec::new();
    for (camera, view) in rig.cameras.iter().enumerate() {
        for (marker, ball) in mavsight::pipeline::body_markers(vehicle).iter().enumerate() {
            let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let pixel = view.camera.project_ball(&centre, ball.radius_m).expect("in view").pixel;
            let covariance_px2 = Matrix2::identity() * CENTRE_VAR_PX2;
            seen.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
        }
    }
    seen
}

fn large() -> VirtualCamera {
    let size = ImageSize { width_px: 1920, height_px: 1080 };
    let small = lab::cameras().swap_remove(0);
    let intrinsics = Intrinsics::from_horizontal_fov(size, 53_f64.to_radians());
    VirtualCamera { camera: Camera { intrinsics, size, ..small.camera }, ..small }
}

fn filmed(room: &Room, camera: &VirtualCamera, vehicle: &Vehicle) -> Frame {
    let film = lab::film(room, camera, 0, 1);
    let rgb = film.frame(0, &lab::aircraft(vehicle), |_| pose());
    Frame::from_rgb(camera.camera.size, rgb).expect("a frame")
}

fn seeing(c: &mut Criterion) {
    let vehicle = Vehicle::paper();
    let room = Room::meeting_room();
    let cameras = lab::cameras();
    let (craft, film) = (lab::aircraft(&vehicle), lab::film(&room, &cameras[0], 0, 1));
    c.bench_function("film one frame, 640x480", |b| b.iter(|| black_box(film.frame(0, &craft, |_| pose()))));
    let mut detector = Detector::new(&colors(&vehicle)).expect("a detector");
    for (camera, range) in [(&cameras[0], 3.0..=12.0), (&large(), 9.0..=36.0)] {
        let frame = filmed(&room, camera, &vehicle);
        let name = format!("detect four balls in a whole frame of {} px across", frame.size.width_px);
        c.bench_function(&name, |b| b.iter(|| black_box(detector.detect(&frame, range.clone()))));
    }
    tracking(c, &room, &vehicle);
}

/// A film that is tracked: each camera's frames, its tracker and where it is.
struct Watched {
    frames: Vec<Frame>,
    tracker: Tracker,
}

/// Where the aircraft is in a frame.
type PoseOf<'a> = &'a dyn Fn(usize) -> Isometry3<f64>;

/// Frames of a film, and those at its beginning that are not timed: cameras have started, and whatever
/// flies is followed.
const FILMED: usize = 60;
const BEGUN: usize = 10;

/// Four balls tracked in each of two cameras, to their pose: in one image, hovering (an image of its own
/// for each frame, as each has its own noise), and in the paper's doublet.
fn tracking(c: &mut Criterion, room: &Room, vehicle: &Vehicle) {
    let scenario = Scenario::paper();
    let inputs = scenario.inputs(vehicle).expect("inputs");
    let times = scenario.frame_times_s();
    let states =
        simulate(vehicle, &inputs, &scenario.start(vehicle).expect("a start"), &times).expect("a flight");
    let flown = |k: usize| world_from_body(states[60 + k].position_in_world_m, states[60 + k].attitude);
    let hovering = |_: usize| pose();
    let films: [(&str, usize, PoseOf); 3] =
        [("one image", 1, &hovering), ("a hover", FILMED, &hovering), ("a doublet", FILMED, &flown)];
    for (name, count, pose) in films {
        let mut pair: Vec<Watched> = lab::cameras()
            .iter()
            .enumerate()
            .map(|(index, camera)| {
                let (film, craft) = (lab::film(room, camera, index, 1), lab::aircraft(vehicle));
                let frame = |k: usize| {
                    let rgb = film.frame(k as u64, &craft, |_| pose(k));
                    Frame::from_rgb(camera.camera.size, rgb).expect("a frame")
                };
                Watched { frames: (0..count).map(frame).collect(), tracker: tracker_of(vehicle, camera) }
            })
            .collect();
        let estimator = PoseEstimator::new(&rig(), &mavsight::pipeline::body_markers(vehicle));
        let (mut seen, mut frame) = (Vec::new(), 0);
        // Whoever waits for the pose does not wait for what follows it: newcomers, and what is prepared for
        // the next frame.
        let mut timed = |pairs: u64, what: usize| {
            let mut taken = [Duration::ZERO; 2];
            for _ in 0..pairs {
                if frame == count {
                    frame = 0;
                }
                if frame == 0 && count > 1 {
                    for (Watched { frames, tracker }, camera) in pair.iter_mut().zip(lab::cameras()) {
                        *tracker = tracker_of(vehicle, &camera);
                        for frame in &frames[..BEGUN] {
                            black_box(tracker.update(frame));
                        }
                    }
                    frame = BEGUN;
                }
                let start = Instant::now();
                follow(&mut pair, frame, &mut seen);
                drop(black_box(estimator.estimate(0, &seen, None)));
                taken[0] += start.elapsed();
                let start = Instant::now();
                pair.iter_mut().for_each(|Watched { frames, tracker }| tracker.look_around(&frames[frame]));
                taken[1] += start.elapsed();
                frame += 1;
            }
            taken[what]
        };
        for (what, of) in ["tracked pair to pose", "what follows it"].into_iter().enumerate() {
            c.bench_function(&format!("{of}, {name}"), |b| b.iter_custom(|pairs| timed(pairs, what)));
        }
    }
}

fn tracker_of(vehicle: &Vehicle, camera: &VirtualCamera) -> Tracker {
    Tracker::new(&colors(vehicle), 3.0..=12.0).expect("a tracker").with_camera(camera.camera)
}

/// What both cameras see of the markers.
fn follow(pair: &mut [Watched], frame: usize, seen: &mut Vec<MarkerObservation>) {
    seen.clear();
    for (camera, Watched { frames, tracker }) in pair.iter_mut().enumerate() {
        for track in tracker.follow(&frames[frame]).iter().filter(|track| track.is_preferred) {
            let Detection { pixel, covariance_px2, .. } = track.detection;
            seen.push(MarkerObservation { t_ns: 0, camera, marker: track.color, pixel, covariance_px2 });
        }
    }
}

fn solving(c: &mut Criterion) {
    let vehicle = Vehicle::paper();
    let rig = rig();
    let estimator = PoseEstimator::new(&rig, &mavsight::pipeline::body_markers(&vehicle));
    let seen = observations(&rig, &vehicle, 0, &pose());
    c.bench_function("pose of eight observations", |b| {
        b.iter(|| black_box(estimator.estimate(0, &seen, None)))
    });
    let scenario = Scenario::paper();
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let times = scenario.frame_times_s();
    let start = scenario.start(&vehicle).expect("a start");
    let states = simulate(&vehicle, &inputs, &start, &times).expect("a flight");
    let poses: Vec<PoseSample> = states
        .iter()
        .map(|state| {
            let t_ns = (state.t_s * 1e9).round() as i64;
            let pose = world_from_body(state.position_in_world_m, state.attitude);
            let estimate = estimator.estimate(t_ns, &observations(&rig, &vehicle, t_ns, &pose), None);
            PoseSample { t_ns, estimate }
        })
        .collect();
    let gravity_m_s2 = vehicle.environment.gravity_m_s2;
    let noise = motion_noise(&poses).expect("a noise");
    c.bench_function("causal filter, 300 poses", |b| {
        b.iter(|| {
            let mut filter = CausalFilter::new(noise, gravity_m_s2).expect("a filter");
            poses.iter().for_each(|p| drop(black_box(filter.push(p))));
        });
    });
    c.bench_function("smooth 300 poses, noise estimated", |b| {
        b.iter(|| black_box(smooth(&poses, gravity_m_s2)))
    });
    c.bench_function("simulate 10 s", |b| {
        b.iter(|| black_box(simulate(&vehicle, &inputs, &start, &times)));
    });
}

criterion_group! { name = benches; config = Criterion::default().sample_size(20); targets = seeing, solving }
criterion_main!(benches);
