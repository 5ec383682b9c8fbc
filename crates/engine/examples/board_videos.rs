//! Calibrates the cameras of a folder from their videos of one board, and measures the board with them: the distances
//! of neighbouring corners that two cameras triangulate, against the square's side.
//!
//! ```sh
//! cargo run --release -p mavsight-engine --example board_videos -- FOLDER
//! ```
//! The folder holds `cam_0.mp4`, `cam_1.mp4` and so on. The board is that of Caliscope's test recordings (repository
//! mprib/caliscope, `tests/sessions/charuco_calibration_2_cam/calibration/extrinsic`): 4 by 5 squares of 54 mm, printed
//! with black and white exchanged.

use mavsight_geometry::{ImagePoint, Vector2, Vector3, triangulate};
use mavsight_pipeline::{
    Board, CameraFeed, PipelineError, TimedFrame, board_of, calibrate_from_observations,
};
use mavsight_pose::{ClockPrior, MarkerObservation, MovedObject, Rig};
use mavsight_session::FrameSource;
use std::error::Error;
use std::path::{Path, PathBuf};

const SQUARE_M: f64 = 0.054;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give the folder with cam_0.mp4, cam_1.mp4 and so on")?;
    let videos: Vec<PathBuf> = (0..)
        .map(|k| Path::new(&folder).join(format!("cam_{k}.mp4")))
        .take_while(|path| path.exists())
        .collect();
    let board = Board {
        columns: 3,
        rows: 4,
        square_m: SQUARE_M,
        together: true,
        dictionary: Some("DICT_4X4_1000".to_owned()),
        marker_m: Some(0.75 * SQUARE_M),
        inverted: true,
    };
    let (mut cameras, mut feeds) = (Vec::new(), Vec::new());
    for (k, path) in videos.iter().enumerate() {
        let source = FrameSource::open(path, None)?;
        cameras.push((format!("cam_{k}"), source.size()));
        let mut feed = feed(format!("cam_{k}"), source);
        if k > 0 {
            feed.clock = ClockPrior::unknown();
        }
        feeds.push(Some(feed));
    }
    let object = board_of(&board, feeds)?;
    let rig = calibrate_from_observations(&cameras, &[], &[], std::slice::from_ref(&object))?;
    for images in &rig.images {
        println!("{images}");
    }
    for camera in &rig.cameras {
        println!(
            "{}: {}, {:.1} px focal length, residual {:.3} px, centre ± {:.1} mm",
            camera.name,
            camera.model,
            camera.camera.intrinsics.fx_px,
            camera.residual_rms_px,
            1e3 * camera.centre_std_m.norm()
        );
    }
    let observed = instants(&object);
    let mut in_step = observed.clone();
    if let Some(lags) = &object.lags {
        in_step.iter_mut().for_each(|seen| bring_in_step(seen, &rig, lags.std_s));
    }
    for (how, all) in [("as observed", observed), ("at the lag of each instant", in_step)] {
        let edges_mm: Vec<f64> =
            all.iter().flat_map(|seen| edges_m(&rig, seen, &board)).map(|m| 1e3 * m).collect();
        let mean = edges_mm.iter().sum::<f64>() / edges_mm.len() as f64;
        let variance = edges_mm.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / edges_mm.len() as f64;
        let std = variance.sqrt();
        println!("{} edges {how}: {mean:.3} ± {std:.3} mm, of {:.1} mm", edges_mm.len(), 1e3 * SQUARE_M);
    }
    Ok(())
}

fn feed(name: String, source: FrameSource) -> CameraFeed<'static> {
    let (announced, camera) = (source.declared_frames(), name.clone());
    let frames = source.map(move |item| {
        item.map(|(t_ns, frame)| TimedFrame { t_ns, frame })
            .map_err(|e| PipelineError::Source { camera: camera.clone(), source: Box::new(e) })
    });
    CameraFeed::new(name, announced, Box::new(frames))
}

/// A corner in an image, and how fast it moves there.
#[derive(Clone, Copy)]
struct Seen {
    observation: MarkerObservation,
    velocity_px_s: Vector2<f64>,
}

/// What was seen at one time.
fn instants(object: &MovedObject) -> Vec<Vec<Seen>> {
    let velocity = |k: usize| object.lags.as_ref().map_or_else(Vector2::zeros, |l| l.velocities_px_s[k]);
    let seen = |(k, o): (usize, &MarkerObservation)| Seen { observation: *o, velocity_px_s: velocity(k) };
    let mut sorted: Vec<Seen> = object.observations.iter().enumerate().map(seen).collect();
    sorted.sort_by_key(|s| s.observation.t_ns);
    sorted.chunk_by(|a, b| a.observation.t_ns == b.observation.t_ns).map(<[_]>::to_vec).collect()
}

/// Places of the corners that two cameras see, and the sum of the squared residuals over those of the calibration.
fn places_m(rig: &Rig, seen: &[Seen], corners: usize) -> (Vec<Option<Vector3<f64>>>, f64) {
    let mut squares = 0.0;
    let place = |corner: usize| -> Option<Vector3<f64>> {
        let own: Vec<&MarkerObservation> =
            seen.iter().map(|s| &s.observation).filter(|o| o.marker == corner).collect();
        let image = |o: &&MarkerObservation| ImagePoint {
            camera: &rig.cameras[o.camera].camera,
            pixel: o.pixel,
            covariance_px2: o.covariance_px2,
        };
        let found = triangulate(&own.iter().map(image).collect::<Vec<_>>()).ok()?;
        let rms_px = own.iter().map(|o| rig.cameras[o.camera].residual_rms_px).fold(0.0, f64::max);
        squares += 2.0 * own.len() as f64 * (found.residual_px / rms_px).powi(2);
        Some(found.point_in_world_m)
    };
    let places = (0..corners).map(place).collect();
    (places, squares)
}

/// Moves the corners of each camera but the first to where they were when the first saw them: by the lag under which rays
/// meet best, of a standard deviation of `std_s` for each camera, found by golden sections.
fn bring_in_step(seen: &mut [Seen], rig: &Rig, std_s: f64) {
    let corners = 1 + seen.iter().map(|s| s.observation.marker).max().unwrap_or(0);
    for camera in 1..rig.cameras.len() {
        let moved = |lag_s: f64| -> Vec<Seen> {
            let own = seen.iter().copied().filter(|s| s.observation.camera <= camera).map(|mut s| {
                let is_late = s.observation.camera == camera;
                s.observation.pixel -= s.velocity_px_s * if is_late { lag_s } else { 0.0 };
                s
            });
            own.collect()
        };
        let loss = |lag_s: f64| places_m(rig, &moved(lag_s), corners).1 + 0.5 * (lag_s / std_s).powi(2);
        let (mut from, mut to) = (-4.0 * std_s, 4.0 * std_s);
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        for _ in 0..40 {
            let (a, b) = (to - golden * (to - from), from + golden * (to - from));
            (from, to) = if loss(a) < loss(b) { (from, b) } else { (a, to) };
        }
        let lag_s = 0.5 * (from + to);
        for s in seen.iter_mut().filter(|s| s.observation.camera == camera) {
            s.observation.pixel -= s.velocity_px_s * lag_s;
        }
    }
}

/// Distances of corners that are next to one another, of those that two cameras saw.
fn edges_m(rig: &Rig, seen: &[Seen], board: &Board) -> Vec<f64> {
    let (places, _) = places_m(rig, seen, board.columns * board.rows);
    let at = |k: usize| places.get(k).copied().flatten();
    let edge = |k: usize| {
        let along = (k % board.columns + 1 < board.columns).then(|| at(k + 1)).flatten();
        [along, at(k + board.columns)].map(|next| Some((at(k)? - next?).norm()))
    };
    (0..places.len()).flat_map(edge).flatten().collect()
}
