//! The rigid motion that best carries one set of points onto another.

use crate::GeometryError;
use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};

/// Below this ratio of the second to the first spread the points count as one line: the turn about it would
/// be a thousand times less certain than the others.
const COLLINEAR_RATIO: f64 = 1e-3;

/// Least-squares rigid motion that carries the first point of each pair onto the second: the quaternion of
/// the largest eigenvalue (Horn 1987).
///
/// It is always a rotation, never a mirror image, also for coplanar points. Nothing is allocated.
///
/// # Errors
/// [`GeometryError::TooFewMarkers`], [`GeometryError::CollinearMarkers`], [`GeometryError::NotFinite`].
pub fn rigid_fit(
    pairs: impl IntoIterator<Item = (Vector3<f64>, Vector3<f64>)>,
) -> Result<Isometry3<f64>, GeometryError> {
    let (mut found, mut from, mut to) = (0, Vector3::zeros(), Vector3::zeros());
    let (mut spreads, mut cross) = ([Matrix3::zeros(); 2], Matrix3::zeros());
    for (a, b) in pairs {
        // Sums about the running means (Welford 1962).
        found += 1;
        let (from_a, from_b): (Vector3<f64>, Vector3<f64>) = (a - from, b - to);
        from += from_a / f64::from(found);
        to += from_b / f64::from(found);
        spreads[0] += from_a * (a - from).transpose();
        spreads[1] += from_b * (b - to).transpose();
        cross += from_a * (b - to).transpose();
    }
    if found < 3 {
        return Err(GeometryError::TooFewMarkers { found: found as usize });
    }
    if !spreads.iter().flatten().all(|x| x.is_finite()) {
        return Err(GeometryError::NotFinite { what: "a marker position" });
    }
    for spread in &spreads {
        let mut along = spread.symmetric_eigenvalues().map(|v| (v.max(0.0) / f64::from(found)).sqrt());
        along.as_mut_slice().sort_by(f64::total_cmp);
        if along[1] <= COLLINEAR_RATIO * along[2] {
            return Err(GeometryError::CollinearMarkers { spread_mm: along[1] * 1e3 });
        }
    }
    let (skew, trace) = (cross - cross.transpose(), cross.trace());
    let turn = Vector3::new(skew[(1, 2)], skew[(2, 0)], skew[(0, 1)]);
    let mut form = Matrix4::zeros();
    form[(0, 0)] = trace;
    form.fixed_view_mut::<3, 1>(1, 0).copy_from(&turn);
    form.fixed_view_mut::<1, 3>(0, 1).copy_from(&turn.transpose());
    let symmetric = cross + cross.transpose() - Matrix3::identity() * trace;
    form.fixed_view_mut::<3, 3>(1, 1).copy_from(&symmetric);
    let eigen = form.symmetric_eigen();
    let q = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]));
    Ok(Isometry3::from_parts(Translation3::from(to - rotation * from), rotation))
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

    fn fit(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Result<Isometry3<f64>, GeometryError> {
        rigid_fit(from.iter().copied().zip(to.iter().copied()))
    }

    fn rms_m(fit: &Isometry3<f64>, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
        let square = |(a, b): (&Vector3<f64>, &Vector3<f64>)| {
            (fit.rotation * a + fit.translation.vector - b).norm_squared()
        };
        (from.iter().zip(to).map(square).sum::<f64>() / from.len() as f64).sqrt()
    }

    proptest! {
        #[test]
        fn an_exact_motion_comes_back(t in proptest::array::uniform3(-5.0..5.0), turn in proptest::array::uniform3(-3.0..3.0),
            used in 3usize..=4)
        {
            let truth = Isometry3::new(Vector3::from(t), Vector3::from(turn));
            let body = &square()[..used];
            let world: Vec<_> = body.iter().map(|p| truth.rotation * p + truth.translation.vector).collect();
            let found = fit(body, &world).unwrap();
            prop_assert!(found.rotation.angle_to(&truth.rotation) < 1e-7);
            prop_assert!((found.translation.vector - truth.translation.vector).norm() < 1e-12);
            prop_assert!(rms_m(&found, body, &world) < 1e-13);
        }
    }

    #[test]
    fn a_mirrored_body_never_gives_a_mirrored_pose() {
        let mut body = square();
        body.push(Vector3::new(0.0, 0.0, -0.2));
        let world: Vec<_> = body.iter().map(|p| Vector3::new(p.x, p.y, -p.z)).collect();
        let found = fit(&body, &world).unwrap();
        assert!((found.rotation.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-12);
        let rms_m = rms_m(&found, &body, &world);
        assert!(rms_m > 0.05, "a mirror image must leave residuals, not {rms_m}");
    }

    /// No other motion leaves less: the residuals have no gradient by the motion (Kabsch 1976).
    #[test]
    fn no_motion_nearby_fits_points_with_noise_better() {
        let body = square();
        let world: Vec<_> = (0..4)
            .map(|k| body[k] + Vector3::new(0.01 * (k as f64).sin(), 0.02 * (3.0 * k as f64).cos(), 0.3))
            .collect();
        let found = fit(&body, &world).unwrap();
        let least = rms_m(&found, &body, &world);
        for k in 0..6 {
            for by in [-1e-4, 1e-4] {
                let part = |from: usize| Vector3::from_fn(|i, _| if from + i == k { by } else { 0.0 });
                let other = found * Isometry3::new(part(0), part(3));
                assert!(rms_m(&other, &body, &world) > least, "{k}");
            }
        }
    }

    #[test]
    fn lines_and_pairs_are_refused() {
        let line: Vec<_> =
            (0..4).map(|i| Vector3::new(f64::from(i) * 0.1, f64::from(i) * 0.2, 0.0)).collect();
        assert!(matches!(fit(&line, &line), Err(GeometryError::CollinearMarkers { .. })));
        assert!(matches!(fit(&line, &square()), Err(GeometryError::CollinearMarkers { .. })));
        assert!(matches!(fit(&square(), &line), Err(GeometryError::CollinearMarkers { .. })));
        let two = &line[..2];
        assert!(matches!(fit(two, two), Err(GeometryError::TooFewMarkers { found: 2 })));
        let bad = vec![Vector3::new(f64::NAN, 0.0, 0.0); 3];
        assert!(matches!(fit(&bad, &bad), Err(GeometryError::NotFinite { .. })));
    }
}
