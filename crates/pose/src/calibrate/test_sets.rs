//! Control frames as cameras see them, for tests.

use super::CameraControl;
use crate::testing::{SIZE, cameras, cube, normal};
use mavsight_geometry::{Camera, ControlPoint, Matrix2, Vector2, Vector3};

/// The control frame as a camera sees it.
pub(crate) fn control(
    name: &str,
    camera: &Camera,
    std_px: f64,
    radius_m: f64,
    seed: &mut u64,
) -> CameraControl {
    seen(name, camera, &cube(), (std_px, radius_m), seed)
}

pub(crate) fn seen(
    name: &str,
    camera: &Camera,
    places: &[Vector3<f64>],
    (std_px, radius_m): (f64, f64),
    seed: &mut u64,
) -> CameraControl {
    let points: Vec<_> = places
        .iter()
        .enumerate()
        .map(|(i, p)| ControlPoint {
            name: format!("p{i}"),
            point_in_world_m: *p,
            pixel: camera.project_ball(p, radius_m).unwrap().pixel
                + Vector2::new(normal(seed), normal(seed)) * std_px,
            pixel_cov_px2: Matrix2::identity() * std_px.max(1e-4).powi(2),
        })
        .collect();
    let radii = vec![radius_m; points.len()];
    CameraControl::exact(name.to_owned(), SIZE, points, radii)
}

pub(crate) fn both(std_px: f64, seed: &mut u64) -> Vec<CameraControl> {
    let [a, b] = cameras();
    vec![control("cam1", &a, std_px, 0.03, seed), control("cam2", &b, std_px, 0.03, seed)]
}
