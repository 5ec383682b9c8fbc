//! The focal length of a camera from its views of a plane of known points (Zhang 2000).

use crate::BodyMarker;
use crate::reprojection::PointObservation;
use mavsight_geometry::{
    Camera, ImageSize, Intrinsics, Isometry3, Matrix3, Vector2, centroid_and_spread, jacobi_svd,
};
use nalgebra::DMatrix;

/// The homography from points on a plane to their images at unit depth, by the normalised linear method
/// (Hartley & Zisserman 2004, algorithm 4.2); `None` for fewer than four points or such on a line.
fn homography(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let (middle, spread) = centroid_and_spread(pairs.iter().map(|p| p.0));
    if spread.is_nan() || spread <= 0.0 {
        return None;
    }
    let mut rows = DMatrix::zeros((2 * pairs.len()).max(9), 9);
    for (i, (on_plane, image)) in pairs.iter().enumerate() {
        let point = ((on_plane - middle) / spread).push(1.0).transpose();
        for axis in 0..2 {
            rows.fixed_view_mut::<1, 3>(2 * i + axis, 3 * axis).copy_from(&point);
            rows.fixed_view_mut::<1, 3>(2 * i + axis, 6).copy_from(&(point * -image[axis]));
        }
    }
    let svd = jacobi_svd(&rows);
    if svd.singular_values[7] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    let scaled = Matrix3::from_fn(|i, j| svd.v[(3 * i + j, 8)]);
    Some(scaled * Matrix3::new_translation(&-middle).append_scaling(1.0 / spread))
}

/// Points on the plane, with their images at unit depth.
fn pairs(
    camera: &Camera,
    body: &[BodyMarker],
    observations: &[PointObservation],
) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let pair = |o: &PointObservation| {
        let ray = camera.cam_from_world.rotation * camera.ray(&o.pixel).ok()?;
        Some((body[o.point].marker_in_body_m.xy(), ray.xy() / ray.z))
    };
    observations.iter().filter_map(pair).collect()
}

/// A pinhole with a centred principal point and square pixels from the homographies of all views: each gives
/// two linear equations for 1/f² (Zhang 2000, equations 3 and 4). A field of 60° where they do not determine
/// it.
pub(super) fn pinhole_of_planes(
    size: ImageSize,
    body: &[BodyMarker],
    views: &[Vec<PointObservation>],
) -> Camera {
    let with_focal = |widths: f64| {
        // Twice the angle whose tangent is half the width over the focal length.
        let field_rad = 2.0 * (0.5 / widths).atan();
        Camera::undistorted(Isometry3::identity(), Intrinsics::from_horizontal_fov(size, field_rad), size)
    };
    let neutral = with_focal(1.0);
    let (mut ab, mut aa) = (0.0, 0.0);
    for view in views {
        let Some(h) = homography(&pairs(&neutral, body, view)) else { continue };
        let h = h / h.column(0).norm().max(h.column(1).norm());
        let (p, q) = (h.column(0), h.column(1));
        let (in_image, along) = (|k: usize| p[k] * p[k] - q[k] * q[k], p[0] * q[0] + p[1] * q[1]);
        for (a, b) in [(along, p[2] * q[2]), (in_image(0) + in_image(1), in_image(2))] {
            ab -= a * b;
            aa += a * a;
        }
    }
    // (width/f)², of fields from 10° to 140°.
    let square = if aa > 0.0 { ab / aa } else { f64::NAN };
    with_focal(if (0.03..30.0).contains(&square) { square.sqrt().recip() } else { 0.5 / 0.525_f64.tan() })
}
