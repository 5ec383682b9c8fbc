//! Control frames as cameras see them, for tests.

use super::rig::CameraControl;
use crate::testing::{SIZE, cameras, cube};
use mavsight_geometry::{Camera, ControlPoint, ImageSize, Intrinsics, Matrix2, Vector2, Vector3};
use mavsight_random::Random;

/// The standard deviation of pixels, and the radius of all balls.
#[derive(Clone, Copy)]
pub(crate) struct Noise {
    pub(crate) std_px: f64,
    pub(crate) radius_m: f64,
}

/// The control frame as a camera sees it.
pub(crate) fn control(
    name: &str,
    camera: &Camera,
    std_px: f64,
    radius_m: f64,
    random: &mut Random,
) -> CameraControl {
    seen(name, camera, &cube(), Noise { std_px, radius_m }, random)
}

pub(crate) fn seen(
    name: &str,
    camera: &Camera,
    places: &[Vector3<f64>],
    Noise { std_px, radius_m }: Noise,
    random: &mut Random,
) -> CameraControl {
    let points: Vec<_> = places
        .iter()
        .enumerate()
        .map(|(i, p)| ControlPoint {
            name: format!("p{i}"),
            point_in_world_m: *p,
            pixel: camera.project_ball(p, radius_m).unwrap().pixel + Vector2::from(random.normals()) * std_px,
            pixel_cov_px2: Matrix2::identity() * std_px.max(1e-4).powi(2),
        })
        .collect();
    let radii = vec![radius_m; points.len()];
    CameraControl::exact(name.to_owned(), SIZE, points, radii)
}

pub(crate) fn both(std_px: f64, random: &mut Random) -> Vec<CameraControl> {
    let [a, b] = cameras();
    vec![control("cam1", &a, std_px, 0.03, random), control("cam2", &b, std_px, 0.03, random)]
}

/// A rig of three unlike cameras: two sizes, a distorted wide lens, non-square pixels.
pub(crate) fn unlike_cameras() -> Vec<Camera> {
    let target = Vector3::new(0.0, 0.0, 1.5);
    let hd = ImageSize { width_px: 1920, height_px: 1080 };
    let mut wide = Intrinsics::from_horizontal_fov(hd, 1.35);
    (wide.cx_px, wide.cy_px) = (wide.cx_px + 18.0, wide.cy_px - 11.0);
    let mut first = Camera::looking_at(Vector3::new(3.6, -2.9, 2.4), target, wide, hd);
    (first.distortion.k1, first.distortion.k2) = (-0.24, 0.07);
    let mut second = Camera::looking_at(Vector3::new(-3.4, -3.2, 1.1), target, wide, hd);
    (second.distortion.k1, second.distortion.k2) = (-0.22, 0.05);
    let mut video = Intrinsics::from_horizontal_fov(SIZE, 0.9);
    video.fy_px *= 1.066;
    vec![first, second, Camera::looking_at(Vector3::new(0.3, 5.2, 2.0), target, video, SIZE)]
}

pub(crate) fn unlike_rig(std_px: f64, survey_std_m: f64, random: &mut Random) -> Vec<CameraControl> {
    let mut places = cube();
    places.extend(cube().iter().map(|p| Vector3::new(p.y * 0.6, -p.x * 0.5 + 0.1, 0.3 + p.z * 0.75)));
    let real: Vec<_> = places.iter().map(|p| p + Vector3::from(random.normals()) * survey_std_m).collect();
    let cameras = unlike_cameras();
    cameras
        .iter()
        .enumerate()
        .map(|(k, camera)| {
            let name = format!("cam{}", k + 1);
            let mut control = seen(&name, camera, &real, Noise { std_px, radius_m: 0.03 }, random);
            control.size = camera.size;
            control.points.iter_mut().zip(&places).for_each(|(p, place)| p.point_in_world_m = *place);
            control.survey_std_m = vec![survey_std_m; places.len()];
            control
        })
        .collect()
}

/// Three cameras around a cube with a cross of four points within.
pub(crate) fn around(std_px: f64, random: &mut Random) -> Vec<CameraControl> {
    let mut places = cube();
    let within = [[0.7, 0.2, 1.1], [-0.6, 0.4, 2.1], [0.1, -0.8, 1.7], [-0.2, 0.5, 0.6]];
    places.extend(within.map(Vector3::from));
    let views = cameras_around();
    let noise = Noise { std_px, radius_m: 0.03 };
    let one = |(k, camera): (usize, &Camera)| seen(&format!("cam{}", k + 1), camera, &places, noise, random);
    views.iter().enumerate().map(one).collect()
}

pub(crate) fn cameras_around() -> Vec<Camera> {
    let target = Vector3::new(0.0, 0.0, 1.5);
    let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
    let [a, b] = cameras();
    vec![a, b, Camera::looking_at(Vector3::new(0.5, 6.0, 3.0), target, k, SIZE)]
}
