//! A camera to start the adjustment from.

use mavsight_geometry::attitude::rotation_of;
use mavsight_geometry::{
    Camera, ControlPoint, Dlt, GeometryError, ImageSize, Intrinsics, Isometry3, Matrix3, Vector2, jacobi_svd,
};
use nalgebra::DMatrix;

/// Fewest points of a camera: a pinhole of 7 free parameters with three coordinates left to contradict it.
pub(super) const MIN_POINTS: usize = 5;

/// Angles across the width from which the search starts where the DLT has no answer.
const FIELDS_RAD: [f64; 5] = [0.35, 0.6, 0.9, 1.3, 1.8];
/// Rounds of the scaled orthographic iteration; it gains about a digit in each.
const ROUNDS: usize = 30;

/// Cameras near the one that saw the points, in no order: the adjustment decides.
///
/// The linear transformation where it exists and gives a plausible camera, else the pose from scaled
/// orthography for several fields of view.
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
    let found: Vec<Camera> = FIELDS_RAD
        .iter()
        .filter_map(|field| orthographic(points, Intrinsics::from_horizontal_fov(size, *field), size))
        .collect();
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

/// The pose of a known pinhole by repeated scaled orthography (DeMenthon & Davis 1995).
fn orthographic(points: &[ControlPoint], k: Intrinsics, size: ImageSize) -> Option<Camera> {
    let (first, rest) = points.split_first()?;
    let normal =
        |p: &ControlPoint| Vector2::new((p.pixel.x - k.cx_px) / k.fx_px, (p.pixel.y - k.cy_px) / k.fy_px);
    let at_first = normal(first);
    let away = DMatrix::from_fn(rest.len(), 3, |i, j| (rest[i].point_in_world_m - first.point_in_world_m)[j]);
    let svd = jacobi_svd(&away);
    if svd.singular_values[2] <= 1e-6 * svd.singular_values[0] {
        return None;
    }
    let inverse = &svd.v * DMatrix::from_diagonal(&svd.singular_values.map(f64::recip)) * svd.u.transpose();
    let mut nearer = vec![0.0; rest.len()];
    let mut pose = Isometry3::identity();
    for _ in 0..ROUNDS {
        let b = DMatrix::from_fn(rest.len(), 2, |i, axis| {
            normal(&rest[i])[axis] * (1.0 + nearer[i]) - at_first[axis]
        });
        let x = &inverse * b;
        let (i, j) = (x.fixed_view::<3, 1>(0, 0), x.fixed_view::<3, 1>(0, 1));
        let depth_m = 2.0 / (i.norm() + j.norm());
        let r1 = i.normalize();
        let r3 = r1.cross(&j).normalize();
        let r2 = r3.cross(&r1);
        if !depth_m.is_finite() || !r3.iter().chain(r2.iter()).all(|x| x.is_finite()) {
            return None;
        }
        for (value, p) in nearer.iter_mut().zip(rest) {
            *value = r3.dot(&(p.point_in_world_m - first.point_in_world_m)) / depth_m;
        }
        let rotation = rotation_of(Matrix3::from_rows(&[r1.transpose(), r2.transpose(), r3.transpose()]));
        let at = at_first.push(1.0) * depth_m - rotation * first.point_in_world_m;
        pose = Isometry3::from_parts(at.into(), rotation);
    }
    let camera = Camera::undistorted(pose, k, size);
    points.iter().all(|p| camera.project(&p.point_in_world_m).is_ok()).then_some(camera)
}
