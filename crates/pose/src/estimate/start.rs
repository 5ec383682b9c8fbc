//! Where the iteration begins: from triangulated markers, or from one camera's view of three.

use super::estimator::PoseEstimator;
use super::gates::DECISIVE_CHI_SQUARE;
use super::sample::MarkerSet;
use crate::PoseError;
use crate::reprojection::{PointObservation, PoseFit};
use mavsight_geometry::attitude::{matrix_of, rotation_of};
use mavsight_geometry::{GeometryError, Isometry3, Matrix3, Vector3, rigid_fit};
use nalgebra::{Matrix4, Translation3};
use std::borrow::Cow;

/// Two minima nearer than this share of the body's size are one.
const SAME_POSE: f64 = 1e-3;

/// A pose before counts as evidence for the minimum that is nearer to it by this factor at least.
const CLEARLY_NEARER: f64 = 0.5;

/// Sine of the least angle between two rays that places a point well enough to start from (half a degree).
const LEAST_PARALLAX: f64 = 0.01;

/// The observations of some markers: mostly of all.
pub(super) fn of_markers(views: &[PointObservation], markers: MarkerSet) -> Cow<'_, [PointObservation]> {
    let wanted = |s: &PointObservation| markers.contains(s.point);
    if views.iter().all(wanted) {
        return Cow::Borrowed(views);
    }
    Cow::Owned(views.iter().copied().filter(wanted).collect())
}

impl PoseEstimator {
    pub(super) fn solve(
        &self,
        views: &[PointObservation],
        used: MarkerSet,
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseFit, PoseError> {
        let own = of_markers(views, used);
        if used.len() < 3 || own.len() < 3 {
            return Err(self.too_few(used, own.len()));
        }
        match self.triangulated_start(&own, used) {
            Ok(start) => self.descend(&own, &start),
            Err(GeometryError::TooFewMarkers { .. }) => self.best_of_views(&own, used, previous),
            Err(error) => self.descend(&own, previous.ok_or(error)?),
        }
    }

    pub(super) fn too_few(&self, seen: MarkerSet, observations: usize) -> PoseError {
        PoseError::TooFewMarkers { seen: seen.len(), markers: self.markers.len(), observations }
    }

    fn triangulated_start(
        &self,
        own: &[PointObservation],
        used: MarkerSet,
    ) -> Result<Isometry3<f64>, GeometryError> {
        rigid_fit(
            used.iter()
                .filter_map(|m| Some((self.markers[m].marker_in_body_m, self.nearest_to_rays(own, m)?))),
        )
    }

    /// The point nearest to all rays of a marker, where two of them differ enough in direction.
    fn nearest_to_rays(&self, own: &[PointObservation], marker: usize) -> Option<Vector3<f64>> {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        let mut first: Option<Vector3<f64>> = None;
        let mut widest: f64 = 0.0;
        for s in own.iter().filter(|s| s.point == marker) {
            let ray = self.cameras[s.camera].ray(&s.pixel).ok()?;
            let across = Matrix3::identity() - ray * ray.transpose();
            normal += across;
            right += across * self.cameras[s.camera].centre_in_world();
            widest = first.map_or(widest, |f| widest.max(f.cross(&ray).norm()));
            first = first.or(Some(ray));
        }
        (widest > LEAST_PARALLAX).then(|| normal.cholesky().map(|c| c.solve(&right))).flatten()
    }

    /// The best minimum from any camera's view of three markers, if chi-square or the pose before decide.
    fn best_of_views(
        &self,
        own: &[PointObservation],
        used: MarkerSet,
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseFit, PoseError> {
        let mut minima: Vec<PoseFit> = Vec::new();
        let mut starts: Vec<Isometry3<f64>> = previous.into_iter().copied().collect();
        for camera in 0..self.cameras.len() {
            let view: Vec<_> = own.iter().copied().filter(|s| s.camera == camera).collect();
            for pose in self.three_point_poses(&view) {
                starts.push(pose);
                starts.extend(self.mirrored(&view, &pose));
            }
        }
        let nothing = self.too_few(used, own.len());
        let size_m = self.size_m(used);
        for start in &starts {
            let Ok(found) = self.descend(own, start) else { continue };
            let apart_m = |m: &PoseFit| self.apart_m(used, &m.world_from_body, &found.world_from_body);
            if minima.iter().all(|m| apart_m(m) >= SAME_POSE * size_m) {
                minima.push(found);
            }
        }
        minima.sort_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
        let best = minima.first().ok_or(nothing)?;
        let gate = DECISIVE_CHI_SQUARE * best.variance_factor();
        let likely: Vec<&PoseFit> =
            minima.iter().take_while(|m| m.chi_square <= best.chi_square + gate).collect();
        if likely.len() == 1 {
            return Ok(best.clone());
        }
        let ambiguous = PoseError::AmbiguousPose {
            poses: likely.len(),
            markers: used.len(),
            chi_square: best.chi_square,
            next_chi_square: likely[1].chi_square,
        };
        let before = previous.ok_or(ambiguous.clone())?;
        let mut by_distance: Vec<(f64, &PoseFit)> =
            likely.into_iter().map(|m| (self.apart_m(used, &m.world_from_body, before), m)).collect();
        by_distance.sort_by(|a, b| a.0.total_cmp(&b.0));
        let decided = by_distance[0].0 < CLEARLY_NEARER * by_distance[1].0;
        decided.then(|| by_distance[0].1.clone()).ok_or(ambiguous)
    }

    /// Poses that one camera's view of three markers allows, those of the largest triangle.
    fn three_point_poses(&self, view: &[PointObservation]) -> Vec<Isometry3<f64>> {
        let place = |s: &PointObservation| self.markers[s.point].marker_in_body_m;
        let n = view.len();
        let all = (0..n).flat_map(|i| (i + 1..n).flat_map(move |j| (j + 1..n).map(move |k| [i, j, k])));
        let area = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| place(&view[i]));
            (b - a).cross(&(c - a)).norm()
        };
        let largest = all.reduce(|a, b| if area(&b) > area(&a) { b } else { a }).filter(|t| area(t) > 0.0);
        let Some(three) = largest.map(|t| t.map(|i| &view[i])) else { return Vec::new() };
        let camera = &self.cameras[three[0].camera];
        let rays = three.map(|s| camera.ray(&s.pixel));
        let [Ok(a), Ok(b), Ok(c)] = rays else { return Vec::new() };
        let (rays, body) = ([a, b, c], three.map(place));
        let centre = camera.centre_in_world();
        distances(&rays, &body)
            .into_iter()
            .filter_map(|s| rigid_fit((0..3).map(|i| (body[i], centre + rays[i] * s[i]))).ok())
            .collect()
    }

    /// The other pose in which flat markers look much the same from afar: their plane tipped the other way
    /// about the line of observation (Oberkampf, DeMenthon & Davis 1996; Schweighofer & Pinz 2006). The plane
    /// is the one of least spread.
    fn mirrored(&self, view: &[PointObservation], pose: &Isometry3<f64>) -> Option<Isometry3<f64>> {
        let places: Vec<Vector3<f64>> = view.iter().map(|s| self.markers[s.point].marker_in_body_m).collect();
        let middle = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
        let spread: Matrix3<f64> = places.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let turn = matrix_of(&pose.rotation);
        let at = turn * middle + pose.translation.vector;
        let line = (at - self.cameras[view.first()?.camera].centre_in_world()).try_normalize(0.0)?;
        let reflect = |n: &Vector3<f64>| Matrix3::identity() - n * n.transpose() * 2.0;
        let turned = reflect(&line) * turn * reflect(&normal);
        Some(Isometry3::from_parts(Translation3::from(at - turned * middle), rotation_of(turned)))
    }

    fn size_m(&self, used: MarkerSet) -> f64 {
        let mut places = used.iter().map(|m| self.markers[m].marker_in_body_m);
        let first = places.next().unwrap_or_default();
        places.map(|p| (p - first).norm()).fold(0.0, f64::max)
    }
}

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
    companion.complex_eigenvalues().iter().map(|root| root.re).collect()
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

    #[test]
    fn coincident_points_have_no_pose() {
        let ray = Vector3::z();
        let found = distances(&[ray; 3], &[Vector3::x(); 3]);
        assert!(found.iter().flatten().all(|s| s.is_finite()));
    }
}
