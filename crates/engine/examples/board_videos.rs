//! Calibrates the cameras of a folder from their videos of one board, and measures the board with them: the distances
//! of neighbouring corners that two cameras triangulate, against the square's side.
//!
//! ```sh
//! cargo run --release -p mavsight-engine --example board_videos -- FOLDER
//! ```
//! The folder holds `cam_0.mp4`, `cam_1.mp4` and so on. The board is that of Caliscope's test recordings (repository
//! mprib/caliscope, `tests/sessions/charuco_calibration_2_cam/calibration/extrinsic`): 4 by 5 squares of 54 mm, printed
//! with black and white exchanged.

use mavsight_geometry::{ImagePoint, Vector3, triangulate};
use mavsight_pipeline::{
    Board, CameraFeed, PipelineError, TimedFrame, board_of, calibrate_from_observations,
};
use mavsight_pose::{MarkerObservation, Rig};
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
        feeds.push(Some(feed(format!("cam_{k}"), source)));
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
    let edges_mm: Vec<f64> = edges_m(&rig, &object.observations, board.columns).map(|m| 1e3 * m).collect();
    let mean = edges_mm.iter().sum::<f64>() / edges_mm.len() as f64;
    let variance = edges_mm.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / edges_mm.len() as f64;
    println!("{} edges: {mean:.3} ± {:.3} mm, of {:.1} mm", edges_mm.len(), variance.sqrt(), 1e3 * SQUARE_M);
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

/// Distances of corners that are next to one another, of all instants at which two cameras saw both.
fn edges_m<'a>(
    rig: &'a Rig,
    observations: &'a [MarkerObservation],
    columns: usize,
) -> impl Iterator<Item = f64> + 'a {
    let mut sorted: Vec<&MarkerObservation> = observations.iter().collect();
    sorted.sort_by_key(|o| o.t_ns);
    let instants: Vec<Vec<&MarkerObservation>> =
        sorted.chunk_by(|a, b| a.t_ns == b.t_ns).map(<[_]>::to_vec).collect();
    instants.into_iter().flat_map(move |seen| {
        let place = |corner: usize| -> Option<Vector3<f64>> {
            let image = |o: &&MarkerObservation| ImagePoint {
                camera: &rig.cameras[o.camera].camera,
                pixel: o.pixel,
                covariance_px2: o.covariance_px2,
            };
            let images: Vec<ImagePoint> = seen.iter().filter(|o| o.marker == corner).map(image).collect();
            Some(triangulate(&images).ok()?.point_in_world_m)
        };
        let places: Vec<Option<Vector3<f64>>> =
            (0..=seen.iter().map(|o| o.marker).max().unwrap_or(0)).map(place).collect();
        let at = |k: usize| places.get(k).copied().flatten();
        let edge = |k: usize| {
            let along = (k % columns + 1 < columns).then(|| at(k + 1)).flatten();
            [along, at(k + columns)].map(|next| Some((at(k)? - next?).norm()))
        };
        (0..places.len()).flat_map(edge).flatten().collect::<Vec<f64>>()
    })
}
