//! Poses of a body from one camera's view of three of its points or more.

use crate::reprojection::{PointObservation, PoseFit, Scene};
use mavsight_geometry::{Isometry3, Vector3, rigid_fit};
use nalgebra::{Matrix4, Schur};

/// Steps from a pose of three points to that of all, and the drop of chi-square that ends them.
const MOST_STEPS: usize = 20;
const CONVERGED: f64 = 1e-4;

/// Sweeps of the QR algorithm after which eigenvalues are not to be had: 30 for each of ten at least, as LAPACK's dlahqr has it.
/// A few for each are usual; of roots that lie symmetric about zero the shifts may return for ever.
const MOST_SWEEPS: usize = 300;

/// The pose that fits one camera's view of four points or more best, of those that three of them allow.
pub(crate) fn pose_in_view(scene: Scene, view: &[PointObservation]) -> Option<PoseFit> {
    let starts = if view.len() > 3 { three_point_poses(scene, view) } else { Vec::new() };
    let near = |start| scene.descend(view, start, f64::INFINITY, CONVERGED, MOST_STEPS).ok();
    starts.iter().filter_map(near).min_by(|a, b| a.loss.total_cmp(&b.loss))
}

/// Poses that one camera's view of three points allows, those of the largest triangle.
pub(crate) fn three_point_poses(scene: Scene, view: &[PointObservation]) -> Vec<Isometry3<f64>> {
    let place = |s: &PointObservation| scene.points[s.point].marker_in_body_m;
    let n = view.len();
    let all = (0..n).flat_map(|i| (i + 1..n).flat_map(move |j| (j + 1..n).map(move |k| [i, j, k])));
    let area = |t: &[usize; 3]| {
        let [a, b, c] = t.map(|i| place(&view[i]));
        (b - a).cross(&(c - a)).norm()
    };
    let largest = all.reduce(|a, b| if area(&b) > area(&a) { b } else { a }).filter(|t| area(t) > 0.0);
    let Some(three) = largest.map(|t| t.map(|i| &view[i])) else { return Vec::new() };
    let camera = &scene.cameras[three[0].camera];
    let rays = three.map(|s| camera.ray(&s.pixel));
    let [Ok(a), Ok(b), Ok(c)] = rays else { return Vec::new() };
    let (rays, body) = ([a, b, c], three.map(place));
    let centre = camera.centre_in_world();
    distances(&rays, &body)
        .into_iter()
        .filter_map(|s| rigid_fit((0..3).map(|i| (body[i], centre + rays[i] * s[i]))).ok())
        .collect()
}

/// The distances along three unit rays from one centre to three points of known places, up to four solutions.
///
/// Grunert (1841) in the form of Haralick, Lee, Ottenberg & Nölle (1994, section 3.1): the eigenvalues of a
/// quartic's companion matrix. Of a pair that is complex near a double root the real part is returned, good
/// enough to start an iteration. Empty for coincident points or rays.
fn distances(rays: &[Vector3<f64>; 3], points: &[Vector3<f64>; 3]) -> Vec<[f64; 3]> {
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
    let of_root = |v: f64| {
        let first = (b2 / (1.0 + v * v - 2.0 * v * cb)).sqrt();
        let u = ((k - 1.0) * v * v - 2.0 * k * cb * v + 1.0 + k) / (2.0 * (cg - v * ca));
        [first, u * first, v * first]
    };
    let is_distance = |s: &f64| s.is_finite() && *s > 0.0;
    real_roots(&quartic).into_iter().map(of_root).filter(|found| found.iter().all(is_distance)).collect()
}

/// Real parts of the roots of a quartic, lowest coefficient first.
fn real_roots(quartic: &[f64; 5]) -> Vec<f64> {
    let largest = quartic.iter().fold(0.0_f64, |a, c| a.max(c.abs()));
    // Of a quartic whose leading term vanishes one root lies at infinity, that is no pose.
    let lead = if quartic[4].abs() > 1e-12 * largest { quartic[4] } else { 1e-12 * largest };
    if !largest.is_finite() || largest == 0.0 {
        return Vec::new();
    }
    let companion = Matrix4::from_fn(|i, j| match j {
        3 => -quartic[i] / lead,
        _ => f64::from(u8::from(i == j + 1)),
    });
    let schur = Schur::try_new(companion, f64::EPSILON, MOST_SWEEPS);
    schur.map_or(Vec::new(), |s| s.complex_eigenvalues().iter().map(|root| root.re).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    #[test]
    fn the_true_distances_are_among_the_solutions_and_all_fit() {
        let mut random = Random::new(8, 0);
        for _ in 0..300 {
            let points = [(); 3].map(|()| Vector3::from(random.normals()) * 0.3 + Vector3::z() * 4.0);
            let rays = points.map(|p| p.normalize());
            let body = points.map(|p| Vector3::new(p.y, -p.x, p.z + 1.0));
            let found = distances(&rays, &body);
            let truth = points.map(|p| p.norm());
            let miss = |s: &[f64; 3]| (0..3).map(|i| (s[i] - truth[i]).abs()).fold(0.0, f64::max);
            assert!(found.iter().any(|s| miss(s) < 1e-3), "{found:?} against {truth:?}");
        }
    }

    /// The search for the eigenvalues of its companion matrix had no end. Its roots are two complex pairs, of which v² is
    /// 3.18 ± 1.66i.
    #[test]
    fn a_quartic_of_roots_symmetric_about_zero_ends() {
        let [constant, square, fourth] = [2.351418566444726, -1.1612401662459497, 0.18252492800102937_f64];
        let real = -square / (2.0 * fourth);
        let want = (0.5 * ((constant / fourth).sqrt() + real)).sqrt();
        for root in real_roots(&[constant, 0.0, square, 0.0, fourth]) {
            assert!((root.abs() - want).abs() < 1e-9, "{root} for {want}");
        }
        // (v - 1)(v - 2)(v - 3)(v - 4)
        let mut usual = real_roots(&[24.0, -50.0, 35.0, -10.0, 1.0]);
        usual.sort_by(f64::total_cmp);
        assert!(usual.iter().zip([1.0, 2.0, 3.0, 4.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{usual:?}");
    }

    #[test]
    fn coincident_points_have_no_pose() {
        let ray = Vector3::z();
        let found = distances(&[ray; 3], &[Vector3::x(); 3]);
        assert!(found.iter().flatten().all(|s| s.is_finite()));
    }
}
