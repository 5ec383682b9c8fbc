//! The rigid motion that best carries one set of points onto another.

use crate::GeometryError;
use crate::attitude::rotation_of;
use crate::svd::jacobi_svd;
use nalgebra::{DMatrix, Isometry3, Matrix3, Translation3, Vector3};

/// A rigid motion and its residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidFit {
    /// Takes body coordinates into world coordinates.
    pub world_from_body: Isometry3<f64>,
    /// Distance of each point, moved, from the one it should reach.
    pub residuals_m: Vec<f64>,
    /// Weighted root mean square of those distances.
    pub rms_m: f64,
}

/// Below this ratio of the second to the first spread the points count as one line: the turn about it would
/// be a thousand times less certain than the others.
const COLLINEAR_RATIO: f64 = 1e-3;

/// Weighted least-squares rigid motion from body to world points (Kabsch 1976; Umeyama 1991 for the
/// reflection).
///
/// Points are taken in pairs up to the shorter of the lists; weights are 1/m² or relative, non-negative. The
/// answer is always a rotation, never a mirror image, also for coplanar points.
///
/// # Errors
/// [`GeometryError::TooFewMarkers`], [`GeometryError::CollinearMarkers`], [`GeometryError::NotFinite`].
pub fn rigid_fit(
    points_in_body_m: &[Vector3<f64>],
    points_in_world_m: &[Vector3<f64>],
    weights: &[f64],
) -> Result<RigidFit, GeometryError> {
    let n = points_in_body_m.len().min(points_in_world_m.len()).min(weights.len());
    let used = weights.iter().take(n).filter(|w| **w > 0.0).count();
    if used < 3 {
        return Err(GeometryError::TooFewMarkers { found: used });
    }
    let finite = points_in_body_m.iter().chain(points_in_world_m).all(|p| p.iter().all(|x| x.is_finite()))
        && weights.iter().all(|w| w.is_finite() && *w >= 0.0);
    if !finite {
        return Err(GeometryError::NotFinite { what: "a marker position or weight" });
    }
    let total: f64 = weights.iter().take(n).sum();
    let mean = |points: &[Vector3<f64>]| {
        points.iter().zip(weights).take(n).map(|(p, w)| p * (*w / total)).sum::<Vector3<f64>>()
    };
    let (centre_body, centre_world) = (mean(points_in_body_m), mean(points_in_world_m));
    refuse_line(&points_in_body_m[..n], &centre_body, weights, total)?;
    refuse_line(&points_in_world_m[..n], &centre_world, weights, total)?;
    let mut cross = DMatrix::zeros(3, 3);
    for ((b, w), weight) in points_in_body_m.iter().zip(points_in_world_m).zip(weights).take(n) {
        cross += (w - centre_world) * (b - centre_body).transpose() * (*weight / total);
    }
    let svd = jacobi_svd(&cross);
    let (u, v) = (svd.u.fixed_view::<3, 3>(0, 0), svd.v.fixed_view::<3, 3>(0, 0));
    let proper = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v.transpose()).determinant().signum()));
    let rotation = rotation_of(u * proper * v.transpose());
    let world_from_body =
        Isometry3::from_parts(Translation3::from(centre_world - rotation * centre_body), rotation);
    let residuals_m: Vec<f64> = points_in_body_m
        .iter()
        .zip(points_in_world_m)
        .take(n)
        .map(|(b, w)| (world_from_body.rotation * b + world_from_body.translation.vector - w).norm())
        .collect();
    let rms_m = (residuals_m.iter().zip(weights).map(|(r, w)| w * r * r).sum::<f64>() / total).sqrt();
    Ok(RigidFit { world_from_body, residuals_m, rms_m })
}

fn refuse_line(
    points: &[Vector3<f64>],
    centre: &Vector3<f64>,
    weights: &[f64],
    total: f64,
) -> Result<(), GeometryError> {
    let rows =
        DMatrix::from_fn(points.len(), 3, |i, j| (points[i][j] - centre[j]) * (weights[i] / total).sqrt());
    let spread = jacobi_svd(&rows).singular_values;
    let across = spread[1];
    if across <= COLLINEAR_RATIO * spread[0] {
        return Err(GeometryError::CollinearMarkers { spread_mm: across * 1e3 });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SQUARE: [[f64; 3]; 4] =
        [[0.225, 0.225, 0.1], [0.225, -0.225, 0.1], [-0.225, -0.225, 0.1], [-0.225, 0.225, 0.1]];

    fn square() -> Vec<Vector3<f64>> {
        SQUARE.iter().map(|p| Vector3::from(*p)).collect()
    }

    proptest! {
        #[test]
        fn an_exact_motion_comes_back(t in proptest::array::uniform3(-5.0..5.0), turn in proptest::array::uniform3(-3.0..3.0),
            used in 3usize..=4)
        {
            let truth = Isometry3::new(Vector3::from(t), Vector3::from(turn));
            let body = &square()[..used];
            let world: Vec<_> = body.iter().map(|p| truth.rotation * p + truth.translation.vector).collect();
            let fit = rigid_fit(body, &world, &[1.0, 2.0, 0.5, 1.0]).unwrap();
            prop_assert!(fit.world_from_body.rotation.angle_to(&truth.rotation) < 1e-7);
            prop_assert!((fit.world_from_body.translation.vector - truth.translation.vector).norm() < 1e-12);
            prop_assert!(fit.rms_m < 1e-13);
        }
    }

    #[test]
    fn a_mirrored_body_never_gives_a_mirrored_pose() {
        let mut body = square();
        body.push(Vector3::new(0.0, 0.0, -0.2));
        let world: Vec<_> = body.iter().map(|p| Vector3::new(p.x, p.y, -p.z)).collect();
        let fit = rigid_fit(&body, &world, &[1.0; 5]).unwrap();
        assert!(
            (fit.world_from_body.rotation.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-12
        );
        assert!(fit.rms_m > 0.05, "a mirror image must leave residuals, not {}", fit.rms_m);
    }

    #[test]
    fn a_weightless_point_does_not_matter() {
        let body = square();
        let mut world = body.clone();
        world[3] += Vector3::new(1.0, 2.0, 3.0);
        let fit = rigid_fit(&body, &world, &[1.0, 1.0, 1.0, 0.0]).unwrap();
        assert!(fit.world_from_body.translation.vector.norm() < 1e-12);
        assert!(fit.residuals_m[3] > 3.0);
    }

    #[test]
    fn lines_and_pairs_are_refused() {
        let line: Vec<_> =
            (0..4).map(|i| Vector3::new(f64::from(i) * 0.1, f64::from(i) * 0.2, 0.0)).collect();
        assert!(matches!(rigid_fit(&line, &line, &[1.0; 4]), Err(GeometryError::CollinearMarkers { .. })));
        let two = &line[..2];
        assert!(matches!(rigid_fit(two, two, &[1.0; 2]), Err(GeometryError::TooFewMarkers { found: 2 })));
        let bad = vec![Vector3::new(f64::NAN, 0.0, 0.0); 3];
        assert!(matches!(rigid_fit(&bad, &bad, &[1.0; 3]), Err(GeometryError::NotFinite { .. })));
    }
}
