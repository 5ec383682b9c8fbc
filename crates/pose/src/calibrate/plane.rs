//! A plane of known points before one camera: focal length and pose from homographies (Zhang 2000).

use super::moved::at_unit_depth;
use crate::BodyMarker;
use crate::moving::PointSight;
use mavsight_geometry::{
    Camera, ImageSize, Intrinsics, Isometry3, Matrix3, UnitQuaternion, Vector2, Vector3, jacobi_svd,
};
use nalgebra::{DMatrix, Rotation3, Translation3};

/// The homography from points on a plane to their images at unit depth, by the normalised linear method (Hartley &
/// Zisserman 2004, algorithm 4.2); `None` for fewer than four points or such on a line.
fn homography(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let n = pairs.len() as f64;
    let middle = pairs.iter().map(|p| p.0).sum::<Vector2<f64>>() / n;
    let spread = (pairs.iter().map(|p| (p.0 - middle).norm_squared()).sum::<f64>() / n).sqrt();
    if spread.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    let mut rows = DMatrix::zeros((2 * pairs.len()).max(9), 9);
    for (i, (on_plane, image)) in pairs.iter().enumerate() {
        let p = (on_plane - middle) / spread;
        let point = [p.x, p.y, 1.0];
        for k in 0..3 {
            rows[(2 * i, k)] = point[k];
            rows[(2 * i, 6 + k)] = -image.x * point[k];
            rows[(2 * i + 1, 3 + k)] = point[k];
            rows[(2 * i + 1, 6 + k)] = -image.y * point[k];
        }
    }
    let svd = jacobi_svd(&rows);
    if svd.singular_values[7] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    let h = svd.v.column(8);
    let scaled = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let normalise = Matrix3::new(
        1.0 / spread,
        0.0,
        -middle.x / spread,
        0.0,
        1.0 / spread,
        -middle.y / spread,
        0.0,
        0.0,
        1.0,
    );
    Some(scaled * normalise)
}

fn pairs(camera: &Camera, body: &[BodyMarker], sights: &[PointSight]) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let pair = |s: &PointSight| {
        let on_plane = body[s.point].marker_in_body_m.xy();
        Some((on_plane, at_unit_depth(camera, &s.pixel).ok()?))
    };
    sights.iter().filter_map(pair).collect()
}

/// Pose of a board in a camera's axes from its sights in that camera; `None` where they do not show it.
pub(super) fn pose_of_plane(
    camera: &Camera,
    body: &[BodyMarker],
    sights: &[PointSight],
) -> Option<Isometry3<f64>> {
    let h = homography(&pairs(camera, body, sights))?;
    let mut scale = 2.0 / (h.column(0).norm() + h.column(1).norm());
    // The board lies before the camera.
    if h[(2, 2)] < 0.0 {
        scale = -scale;
    }
    let first: Vector3<f64> = (h.column(0) * scale).normalize();
    let third = first.cross(&(h.column(1) * scale)).normalize();
    let second = third.cross(&first);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[first, second, third]));
    let at: Vector3<f64> = h.column(2) * scale;
    let out = Isometry3::from_parts(Translation3::from(at), UnitQuaternion::from_rotation_matrix(&rotation));
    out.to_homogeneous().iter().all(|x| x.is_finite()).then_some(out)
}

/// A pinhole with a centred principal point and square pixels from the homographies of all views: each gives two linear
/// equations for 1/f² (Zhang 2000, equations 3 and 4). A field of 60° where they say nothing.
pub(super) fn pinhole_of_planes(size: ImageSize, body: &[BodyMarker], views: &[Vec<PointSight>]) -> Camera {
    let at = |intrinsics| Camera {
        cam_from_world: Isometry3::identity(),
        intrinsics,
        distortion: Default::default(),
        size,
    };
    // Pixels in units of the width.
    let mut unit = Intrinsics::from_horizontal_fov(size, 1.0);
    (unit.fx_px, unit.fy_px) = (f64::from(size.width_px), f64::from(size.width_px));
    let neutral = at(unit);
    let (mut ab, mut aa) = (0.0, 0.0);
    for view in views {
        let Some(h) = homography(&pairs(&neutral, body, view)) else { continue };
        let h = h / h.column(0).norm().max(h.column(1).norm());
        let (p, q) = (h.column(0), h.column(1));
        for (a, b) in [
            (p[0] * q[0] + p[1] * q[1], p[2] * q[2]),
            (p[0] * p[0] + p[1] * p[1] - q[0] * q[0] - q[1] * q[1], p[2] * p[2] - q[2] * q[2]),
        ] {
            ab -= a * b;
            aa += a * a;
        }
    }
    // (width/f)², of fields from 10° to 140°.
    let square = if aa > 0.0 { ab / aa } else { f64::NAN };
    let mut found = unit;
    if (0.03..30.0).contains(&square) {
        (found.fx_px, found.fy_px) = (unit.fx_px / square.sqrt(), unit.fy_px / square.sqrt());
    } else {
        found = Intrinsics::from_horizontal_fov(size, 1.05);
    }
    at(found)
}
