//! What several tests share: the paper's set-up.

use mavsight_geometry::{Camera, ImageSize, Intrinsics, Vector3};

pub(crate) const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

pub(crate) fn cameras() -> [Camera; 2] {
    let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
    let target = Vector3::new(0.0, 0.0, 1.5);
    [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]].map(|c| Camera::looking_at(Vector3::from(c), target, k, SIZE))
}

/// The corners of the control frame of 3 m.
pub(crate) fn cube() -> Vec<Vector3<f64>> {
    let side = |i: u32, bit: u32| if (i >> bit) & 1 == 1 { 1.5 } else { -1.5 };
    (0..8).map(|i| Vector3::new(side(i, 0), side(i, 1), side(i, 2) + 1.5)).collect()
}

/// The cameras as a rig, calibrated from the exact images of the control frame.
pub(crate) fn rig() -> crate::Rig {
    let controls: Vec<_> = cameras()
        .iter()
        .enumerate()
        .map(|(i, camera)| crate::CameraControl {
            name: format!("cam{}", i + 1),
            size: SIZE,
            points: cube()
                .iter()
                .enumerate()
                .map(|(k, p)| mavsight_geometry::ControlPoint {
                    name: format!("p{k}"),
                    point_in_world_m: *p,
                    pixel: camera.project(p).unwrap().pixel,
                    pixel_cov_px2: mavsight_geometry::Matrix2::identity() * 0.01,
                })
                .collect(),
            ball_radius_m: vec![0.0; 8],
            survey_std_m: vec![0.0; 8],
        })
        .collect();
    crate::calibrate(&controls).unwrap()
}
