//! The shared film, every frame of both cameras: each marker against the projection of its true place.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_geometry::{EulerAngles, Point3, Vector3, world_from_body};
use mavsight_vision::{BallColor, Frame, ImageSize, Tracker, Vector2, YuvMatrix};
use std::path::{Path, PathBuf};
use std::process::Command;

const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

/// Name, nominal colour and place in body axes of the four markers of the film's vehicle.
const MARKERS: [(&str, [u8; 3], [f64; 3]); 4] = [
    ("red", [0xd0, 0x2a, 0x2a], [0.225, 0.225, 0.10]),
    ("green", [0x2f, 0xa0, 0x3c], [0.225, -0.225, 0.10]),
    ("blue", [0x33, 0x45, 0xc0], [-0.225, -0.225, 0.10]),
    ("yellow", [0xd8, 0xbc, 0x30], [-0.225, 0.225, 0.10]),
];

fn shared_data() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("MAVSIGHT_DATA").map_or_else(beside, PathBuf::from).join("paper-flight");
    folder.is_dir().then_some(folder)
}

/// Projection by a camera at (±4.5, -4.5, 1.5) m that looks at (0, 0, 1.5) m with 641.5 px of focal length.
fn project(camera: usize, point: Vector3<f64>) -> Vector2<f64> {
    let side = if camera == 1 { 1.0 } else { -1.0 };
    let (x, y, z) = (point.x - 4.5 * side, point.y + 4.5, point.z - 1.5);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let forward = half * (y - side * x);
    Vector2::new(319.5 + 641.5 * half * (x + side * y) / forward, 239.5 - 641.5 * z / forward)
}

/// Position and attitude of every frame.
fn truth(folder: &Path) -> Vec<Vec<f64>> {
    let table = std::fs::read_to_string(folder.join("truth.csv")).unwrap();
    table.lines().skip(1).map(|l| l.split(',').map(|c| c.parse().unwrap()).collect()).collect()
}

fn marker_in_world(row: &[f64], place: [f64; 3]) -> Vector3<f64> {
    let attitude = EulerAngles { phi_rad: row[7], theta_rad: row[8], psi_rad: row[9] };
    (world_from_body(Vector3::new(row[1], row[2], row[3]), attitude) * Point3::from(place)).coords
}

fn decoded(film: &Path) -> Option<Vec<u8>> {
    let output = Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(film)
        .args(["-pix_fmt", "yuv420p", "-f", "rawvideo", "-"])
        .output()
        .ok()?;
    output.status.success().then_some(output.stdout)
}

#[test]
fn every_marker_of_every_frame() {
    let Some(folder) = shared_data() else {
        println!("skipped: no shared data; set MAVSIGHT_DATA");
        return;
    };
    let truth = truth(&folder);
    let colors: Vec<BallColor> =
        MARKERS.iter().map(|(name, rgb, _)| BallColor { name: (*name).into(), rgb: *rgb }).collect();
    for camera in [1, 2] {
        let Some(film) = decoded(&folder.join(format!("cam{camera}.mp4"))) else {
            println!("skipped: ffmpeg is not to be had");
            return;
        };
        let mut tracker = Tracker::new(&colors, 2.0..=12.0).unwrap();
        let mut errors: Vec<Vec<Vector2<f64>>> = vec![vec![]; MARKERS.len()];
        let mut normalized = vec![0.0; MARKERS.len()];
        for (bytes, row) in film.chunks_exact(SIZE.area_px() * 3 / 2).zip(&truth) {
            let (luma, rest) = bytes.split_at(SIZE.area_px());
            let (blue, red) = rest.split_at(SIZE.area_px() / 4);
            let planes = [luma.to_vec(), blue.to_vec(), red.to_vec()];
            let frame = Frame::from_yuv420(SIZE, planes, false, YuvMatrix::Bt709).unwrap();
            for (marker, seen) in tracker.update_preferred(&frame).iter().enumerate() {
                if let Some(ball) = seen {
                    let error = ball.pixel - project(camera, marker_in_world(row, MARKERS[marker].2));
                    let information = ball.covariance_px2.try_inverse().unwrap();
                    normalized[marker] += 0.5 * error.dot(&(information * error)) / 300.0;
                    errors[marker].push(error);
                }
            }
        }
        for (((name, ..), errors), normalized) in MARKERS.iter().zip(&errors).zip(normalized) {
            let worst_px = errors.iter().map(|e| e.norm()).fold(0.0, f64::max);
            let rms_px =
                (errors.iter().map(|e| e.norm_squared()).sum::<f64>() / (2.0 * errors.len() as f64)).sqrt();
            println!(
                "camera {camera} {name:7} seen {} rms {rms_px:.3} worst {worst_px:.2} px, NEES {normalized:.2}",
                errors.len()
            );
            assert!(errors.len() == 300, "{name} is seen in {} frames", errors.len());
            assert!(worst_px < 0.6, "{name} is taken for something else: {worst_px} px");
            assert!(rms_px < 0.2, "{name}: {rms_px} px");
            // Rods and arms that touch a ball leave a systematic error of up to two claimed deviations.
            assert!(normalized < 4.0, "{name}: errors are {normalized:.1} times the claimed variance");
        }
    }
}
