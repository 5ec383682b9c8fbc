//! A camera to start the adjustment from.

use crate::BodyMarker;
use crate::reprojection::{PointObservation, Scene};
use crate::three_points::pose_in_view;
use mavsight_geometry::{Camera, ControlPoint, Dlt, GeometryError, ImageSize, Intrinsics, Isometry3};

/// Fewest points of a camera: a pinhole of 7 free parameters with three coordinates left to contradict it.
pub(super) const MIN_POINTS: usize = 5;

/// Angles across the width from which the search starts where the DLT has no answer.
const FIELDS_RAD: [f64; 5] = [0.35, 0.6, 0.9, 1.3, 1.8];

/// Cameras near the one that saw the points, in no order: the adjustment decides.
///
/// The linear transformation where it exists and gives a plausible camera, else the best pose for several
/// fields of view.
pub(super) fn starts(points: &[ControlPoint], size: ImageSize) -> Result<Vec<Camera>, GeometryError> {
    if points.len() < MIN_POINTS {
        return Err(GeometryError::TooFewControlPoints { found: points.len(), needed: MIN_POINTS });
    }
    let refused = match Dlt::fit(points).and_then(|dlt| dlt.camera(size)) {
        Ok(camera) if is_plausible(&camera) => return Ok(vec![camera]),
        Ok(_) => GeometryError::UndeterminedCamera { condition: f64::INFINITY },
        Err(
            error @ (GeometryError::TooFewControlPoints { .. }
            | GeometryError::UndeterminedCamera { .. }
            | GeometryError::OriginInFocalPlane { .. }),
        ) => error,
        Err(error) => return Err(error),
    };
    let found: Vec<Camera> = FIELDS_RAD.iter().filter_map(|field| posed(points, *field, size)).collect();
    if found.is_empty() { Err(refused) } else { Ok(found) }
}

/// Fields of 7° to 160°, pixels within a factor 2 of square, principal point on the image.
fn is_plausible(camera: &Camera) -> bool {
    let k = &camera.intrinsics;
    let (width, height) = (f64::from(camera.size.width_px), f64::from(camera.size.height_px));
    let aspect = k.fx_px / k.fy_px;
    (0.09..8.0).contains(&(k.fx_px / width))
        && (0.5..2.0).contains(&aspect)
        && (0.0..width).contains(&k.cx_px)
        && (0.0..height).contains(&k.cy_px)
        && k.skew_px.abs() < 0.2 * k.fx_px
}

/// A pinhole of a known field of view, at the pose that suits the points best.
fn posed(points: &[ControlPoint], field_rad: f64, size: ImageSize) -> Option<Camera> {
    let pinhole =
        Camera::undistorted(Isometry3::identity(), Intrinsics::from_horizontal_fov(size, field_rad), size);
    let body = points.iter().map(|p| BodyMarker {
        name: String::new(),
        marker_in_body_m: p.point_in_world_m,
        radius_m: 0.0,
    });
    let (cameras, body) = ([pinhole], body.collect::<Vec<_>>());
    let seen = |(k, p): (usize, &ControlPoint)| PointObservation::new(0, k, p.pixel, p.pixel_cov_px2);
    let view: Vec<_> = points.iter().enumerate().filter_map(seen).collect();
    let fit = pose_in_view(Scene { cameras: &cameras, points: &body }, &view)?;
    Some(Camera { cam_from_world: fit.world_from_body, ..pinhole })
}
