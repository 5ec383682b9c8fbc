//! Cameras from a wand of 500 mm waved for 20 s and the paper's control frame, over simulated recordings:
//! `cargo run --release -p mavsight-pose --example wand`.
//!
//! An argument is the number of recordings (20 without one). Balls of 4 cm are seen by the paper's cameras
//! with 0.1 px of noise thirty times a second, the eight balls of the control frame with 0.05 px; scale comes
//! from both, axes from the frame.

use mavsight_geometry::{
    Camera, ControlPoint, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, UnitQuaternion, Vector2, Vector3,
};
use mavsight_pose::{CameraControl, MarkerObservation, MovedObject, calibrate_with};
use mavsight_random::Random;

const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };
const WAND_STD_PX: f64 = 0.1;
const CONTROL_STD_PX: f64 = 0.05;

fn cameras() -> [Camera; 2] {
    let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
    let target = Vector3::new(0.0, 0.0, 1.5);
    [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]].map(|c| Camera::looking_at(Vector3::from(c), target, k, SIZE))
}

/// The wand on a figure through the volume, turning as it goes.
fn waved(t_s: f64, phase: f64) -> Isometry3<f64> {
    let wave = |hz: f64, shift: f64| (std::f64::consts::TAU * hz * t_s + shift + phase).sin();
    let at = Vector3::new(1.1 * wave(0.17, 0.0), 1.1 * wave(0.23, 1.0), 1.5 + 1.0 * wave(0.31, 2.0));
    let turn = Vector3::new(1.5 * wave(0.41, 0.5), 1.5 * wave(0.29, 1.5), 1.5 * wave(0.37, 2.5));
    Isometry3::from_parts(at.into(), UnitQuaternion::from_scaled_axis(turn))
}

fn noise(random: &mut Random, std_px: f64) -> Vector2<f64> {
    Vector2::new(random.normal(), random.normal()) * std_px
}

fn wand(random: &mut Random) -> MovedObject {
    let empty = MovedObject::wand(0.5, 0.0, [("red", 0.04), ("green", 0.04)], Vec::new());
    let mut observations = Vec::new();
    let phase = random.uniform() * 6.0;
    for k in 0..600 {
        let pose = waved(f64::from(k) / 30.0, phase);
        for (camera, view) in cameras().iter().enumerate() {
            for (marker, ball) in empty.points.iter().enumerate() {
                let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
                let Ok(seen) = view.project_ball(&centre, ball.radius_m) else { continue };
                if SIZE.contains(&seen.pixel, 5.0) {
                    let covariance_px2 = Matrix2::identity() * WAND_STD_PX * WAND_STD_PX;
                    let pixel = seen.pixel + noise(random, WAND_STD_PX);
                    let t_ns = i64::from(k) * 33_333_333;
                    observations.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                }
            }
        }
    }
    MovedObject { observations, ..empty }
}

fn control(random: &mut Random) -> Vec<CameraControl> {
    let side = |i: u32, bit: u32| if (i >> bit) & 1 == 1 { 1.5 } else { -1.5 };
    let table: Vec<Vector3<f64>> =
        (0..8).map(|i| Vector3::new(side(i, 0), side(i, 1), side(i, 2) + 1.5)).collect();
    let one = |(k, camera): (usize, &Camera)| {
        let points: Vec<ControlPoint> = table
            .iter()
            .enumerate()
            .map(|(i, place)| ControlPoint {
                name: format!("p{i}"),
                point_in_world_m: *place,
                pixel: camera.project_ball(place, 0.03).expect("in view").pixel
                    + noise(random, CONTROL_STD_PX),
                pixel_cov_px2: Matrix2::identity() * CONTROL_STD_PX * CONTROL_STD_PX,
            })
            .collect();
        CameraControl::exact(format!("cam{}", k + 1), SIZE, points, vec![0.03; 8])
    };
    cameras().iter().enumerate().map(one).collect()
}

fn main() {
    let recordings = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(20u32);
    let mut random = Random::new(41, 0);
    println!("| control | scale error, RMS % | camera centres, RMS mm | claimed mm |");
    println!("|---|---|---|---|");
    for (name, has_wand) in [("frame alone", false), ("frame and wand", true)] {
        let (mut scale, mut centres, mut claimed) = (0.0, 0.0, 0.0);
        for _ in 0..recordings {
            let objects: Vec<MovedObject> = has_wand.then(|| wand(&mut random)).into_iter().collect();
            let rig = calibrate_with(&control(&mut random), &objects).expect("a rig");
            let truth = cameras();
            let apart = |a: &Camera, b: &Camera| (a.centre_in_world() - b.centre_in_world()).norm();
            let ratio =
                apart(&rig.cameras[0].camera, &rig.cameras[1].camera) / apart(&truth[0], &truth[1]) - 1.0;
            scale += ratio * ratio / f64::from(recordings);
            for (found, truth) in rig.cameras.iter().zip(&truth) {
                let error = found.camera.centre_in_world() - truth.centre_in_world();
                centres += error.norm_squared() / f64::from(2 * recordings);
                claimed += found.centre_std_m.norm_squared() / f64::from(2 * recordings);
            }
        }
        let [scale, centres, claimed] = [scale, centres, claimed].map(f64::sqrt);
        println!("| {name} | {:.4} | {:.2} | {:.2} |", 100.0 * scale, 1e3 * centres, 1e3 * claimed);
    }
}
