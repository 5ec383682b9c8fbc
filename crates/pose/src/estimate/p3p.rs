//! The poses that show three points in three given directions.

use mavsight_geometry::Vector3;
use nalgebra::Matrix4;

/// The distances along three unit rays from one centre to three points of known places, up to four solutions.
///
/// Grunert (1841) in the form of Haralick, Lee, Ottenberg & Nölle (1994, section 3.1): the eigenvalues of a
/// quartic's companion matrix. Of a pair that is complex near a double root the real part is returned, good
/// enough to start an iteration. Empty for coincident points or rays.
pub(super) fn distances(rays: &[Vector3<f64>; 3], points: &[Vector3<f64>; 3]) -> Vec<[f64; 3]> {
    let side2 = |i: usize, j: usize| (points[i] - points[j]).norm_squared();
    let (a2, b2, c2) = (side2(1, 2), side2(0, 2), side2(0, 1));
    let (ca, cb, cg) = (rays[1].dot(&rays[2]), rays[0].dot(&rays[2]), rays[0].dot(&rays[1]));
    let (k, sum) = ((a2 - c2) / b2, (a2 + c2) / b2);
    let quartic = [
        (1.0 + k).powi(2) - 4.0 * a2 / b2 * cg * cg,
        4.0 * (-k * (1.0 + k) * cb + 2.0 * a2 / b2 * cg * cg * cb - (1.0 - sum) * ca * cg),
        2.0 * (k * k - 1.0 + 2.0 * k * k * cb * cb + 2.0 * (b2 - c2) / b2 * ca * ca
            - 4.0 * sum * ca * cb * cg
            + 2.0 * (b2 - a2) / b2 * cg * cg),
        4.0 * (k * (1.0 - k) * cb - (1.0 - sum) * ca * cg + 2.0 * c2 / b2 * ca * ca * cb),
        (k - 1.0).powi(2) - 4.0 * c2 / b2 * ca * ca,
    ];
    let mut out = Vec::with_capacity(4);
    for v in real_roots(&quartic) {
        let first = (b2 / (1.0 + v * v - 2.0 * v * cb)).sqrt();
        let u = ((k - 1.0) * v * v - 2.0 * k * cb * v + 1.0 + k) / (2.0 * (cg - v * ca));
        let found = [first, u * first, v * first];
        if found.iter().all(|s| s.is_finite() && *s > 0.0) {
            out.push(found);
        }
    }
    out
}

/// Real parts of the roots of a quartic, lowest coefficient first.
fn real_roots(quartic: &[f64; 5]) -> Vec<f64> {
    let largest = quartic.iter().fold(0.0_f64, |a, c| a.max(c.abs()));
    // Of a quartic whose leading term vanishes one root lies at infinity, that is no pose.
    let lead = if quartic[4].abs() > 1e-12 * largest { quartic[4] } else { 1e-12 * largest };
    if !largest.is_finite() || largest == 0.0 {
        return Vec::new();
    }
    let mut companion = Matrix4::zeros();
    for i in 0..4 {
        companion[(i, 3)] = -quartic[i] / lead;
        if i > 0 {
            companion[(i, i - 1)] = 1.0;
        }
    }
    companion.complex_eigenvalues().iter().map(|root| root.re).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal3;

    #[test]
    fn the_true_distances_are_among_the_solutions_and_all_fit() {
        let mut seed = 8;
        for _ in 0..300 {
            let points = [(); 3].map(|()| normal3(&mut seed) * 0.3 + Vector3::z() * 4.0);
            let rays = points.map(|p| p.normalize());
            let body = points.map(|p| Vector3::new(p.y, -p.x, p.z + 1.0));
            let found = distances(&rays, &body);
            let truth = points.map(|p| p.norm());
            let miss = |s: &[f64; 3]| (0..3).map(|i| (s[i] - truth[i]).abs()).fold(0.0, f64::max);
            assert!(found.iter().any(|s| miss(s) < 1e-3), "{found:?} against {truth:?}");
        }
    }

    #[test]
    fn coincident_points_have_no_pose() {
        let ray = Vector3::z();
        let found = distances(&[ray; 3], &[Vector3::x(); 3]);
        assert!(found.iter().flatten().all(|s| s.is_finite()));
    }
}
