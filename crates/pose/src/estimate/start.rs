//! Where the iteration begins: from triangulated markers, or from one camera's view of three.

use super::estimator::PoseEstimator;
use super::gates::DECISIVE_CHI_SQUARE;
use super::p3p;
use super::solve::Solution;
use super::view::{View, of_markers};
use crate::PoseError;
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::{GeometryError, Isometry3, Matrix3, UnitQuaternion, Vector3};
use nalgebra::{Matrix4, Quaternion, Rotation3, Translation3};

/// Two minima nearer than this share of the body's size are one.
const SAME_POSE: f64 = 1e-3;

/// A pose before counts as evidence for the minimum that is nearer to it by this factor at least.
const CLEARLY_NEARER: f64 = 0.5;

/// Sine of the least angle between two rays that places a point well enough to start from (half a degree).
const LEAST_PARALLAX: f64 = 0.01;

/// Below this ratio of the second to the first spread the points count as one line.
const COLLINEAR_RATIO: f64 = 1e-3;

/// The rigid motion that best carries body points onto world points: the quaternion of the largest
/// eigenvalue (Horn 1987). It does what [`mavsight_geometry::rigid_fit`] does, without weights and
/// without the heap.
fn carried(
    pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>,
) -> Result<Isometry3<f64>, GeometryError> {
    let (mut n, mut body, mut world) = (0.0, Vector3::zeros(), Vector3::zeros());
    let (mut spread, mut cross) = (Matrix3::zeros(), Matrix3::zeros());
    for (b, w) in pairs {
        // Sums about the running means (Welford 1962).
        n += 1.0;
        let (from_body, from_world): (Vector3<f64>, Vector3<f64>) = (b - body, w - world);
        body += from_body / n;
        world += from_world / n;
        spread += from_body * (b - body).transpose();
        cross += from_body * (w - world).transpose();
    }
    let mut along = spread.symmetric_eigenvalues().map(|v| (v.max(0.0) / n).sqrt());
    along.as_mut_slice().sort_by(f64::total_cmp);
    if along[1] <= COLLINEAR_RATIO * along[2] || along[1].is_nan() {
        return Err(GeometryError::CollinearMarkers { spread_mm: along[1] * 1e3 });
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
    Ok(Isometry3::from_parts(Translation3::from(world - rotation * body), rotation))
}

impl PoseEstimator {
    /// The best pose of the given markers.
    pub(super) fn solve(
        &self,
        views: &[View],
        used: &[usize],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<Solution, PoseError> {
        let own = of_markers(views, used);
        if used.len() < 3 || own.len() < 3 {
            return Err(PoseError::TooFewMarkers {
                seen: used.len(),
                markers: self.markers.len(),
                observations: own.len(),
            });
        }
        match self.triangulated_start(&own, used) {
            Some(Ok(start)) => self.descend(&own, &start),
            Some(Err(error)) => {
                let start = previous.ok_or(error)?;
                self.descend(&own, start)
            }
            None => self.best_of_views(&own, used, previous),
        }
    }

    /// A rigid fit to the markers that two cameras saw; `None` where they are fewer than three.
    fn triangulated_start(
        &self,
        own: &[View],
        used: &[usize],
    ) -> Option<Result<Isometry3<f64>, GeometryError>> {
        let mut triangulated = 0;
        let fit = carried(used.iter().filter_map(|marker| {
            let point = self.nearest_to_rays(own, *marker)?;
            triangulated += 1;
            Some((self.markers[*marker].marker_in_body_m, point))
        }));
        (triangulated >= 3).then_some(fit)
    }

    /// The point nearest to all rays of a marker, where two of them differ enough in direction.
    fn nearest_to_rays(&self, own: &[View], marker: usize) -> Option<Vector3<f64>> {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        let mut first: Option<Vector3<f64>> = None;
        let mut widest: f64 = 0.0;
        for s in own.iter().filter(|s| s.marker == marker) {
            let ray = self.cameras[s.camera].ray(&s.pixel).ok()?;
            let across = Matrix3::identity() - ray * ray.transpose();
            normal += across;
            right += across * self.centres[s.camera];
            widest = first.map_or(widest, |f| widest.max(f.cross(&ray).norm()));
            first = first.or(Some(ray));
        }
        (widest > LEAST_PARALLAX).then(|| normal.cholesky().map(|c| c.solve(&right))).flatten()
    }

    /// Every minimum that some camera's view of three markers leads to, the mirrored ones among them; the
    /// best, if it is distinguished by its chi-square or by the pose before.
    fn best_of_views(
        &self,
        own: &[View],
        used: &[usize],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<Solution, PoseError> {
        let mut minima: Vec<Solution> = Vec::new();
        let mut starts: Vec<Isometry3<f64>> = previous.into_iter().copied().collect();
        for camera in 0..self.cameras.len() {
            let view: Vec<View> = own.iter().copied().filter(|s| s.camera == camera).collect();
            for pose in self.three_point_poses(&view) {
                starts.push(pose);
                starts.extend(self.mirrored(&view, &pose));
            }
        }
        let nothing = PoseError::TooFewMarkers {
            seen: used.len(),
            markers: self.markers.len(),
            observations: own.len(),
        };
        if starts.is_empty() {
            return Err(nothing);
        }
        let size_m = self.size_m(used);
        for start in &starts {
            let Ok(found) = self.descend(own, start) else { continue };
            let known = minima
                .iter()
                .any(|m| self.apart_m(used, &m.world_from_body, &found.world_from_body) < SAME_POSE * size_m);
            if !known {
                minima.push(found);
            }
        }
        minima.sort_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
        let best = minima.first().ok_or(nothing)?;
        let gate = DECISIVE_CHI_SQUARE * best.variance_factor();
        let likely: Vec<&Solution> =
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
        let mut by_distance: Vec<(f64, &Solution)> =
            likely.into_iter().map(|m| (self.apart_m(used, &m.world_from_body, before), m)).collect();
        by_distance.sort_by(|a, b| a.0.total_cmp(&b.0));
        let decided = by_distance[0].0 < CLEARLY_NEARER * by_distance[1].0;
        decided.then(|| by_distance[0].1.clone()).ok_or(ambiguous)
    }

    /// Poses that one camera's view of three markers allows, from the triangle of the largest area on the
    /// body.
    fn three_point_poses(&self, view: &[View]) -> Vec<Isometry3<f64>> {
        let place = |s: &View| self.markers[s.marker].marker_in_body_m;
        let mut best: (f64, Option<[&View; 3]>) = (0.0, None);
        for (i, a) in view.iter().enumerate() {
            for (j, b) in view.iter().enumerate().skip(i + 1) {
                for c in view.iter().skip(j + 1) {
                    let area = (place(b) - place(a)).cross(&(place(c) - place(a))).norm();
                    if area > best.0 {
                        best = (area, Some([a, b, c]));
                    }
                }
            }
        }
        let Some(three) = best.1 else { return Vec::new() };
        let camera = &self.cameras[three[0].camera];
        let rays = three.map(|s| camera.ray(&s.pixel));
        let [Ok(a), Ok(b), Ok(c)] = rays else { return Vec::new() };
        let (rays, body) = ([a, b, c], three.map(place));
        let centre = self.centres[three[0].camera];
        p3p::distances(&rays, &body)
            .into_iter()
            .filter_map(|s| {
                let pairs: [_; 3] = std::array::from_fn(|i| (body[i], centre + rays[i] * s[i]));
                carried(pairs.into_iter()).ok()
            })
            .collect()
    }

    /// The other pose in which flat markers look much the same from afar: their plane tipped the other
    /// way about the line of observation (Oberkampf, DeMenthon & Davis 1996; Schweighofer & Pinz 2006).
    /// The plane is the one of least spread.
    fn mirrored(&self, view: &[View], pose: &Isometry3<f64>) -> Option<Isometry3<f64>> {
        let places: Vec<Vector3<f64>> =
            view.iter().map(|s| self.markers[s.marker].marker_in_body_m).collect();
        let middle = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
        let spread: Matrix3<f64> = places.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let turn = matrix_of(&pose.rotation);
        let at = turn * middle + pose.translation.vector;
        let line = (at - self.centres[view.first()?.camera]).try_normalize(0.0)?;
        let reflect = |n: &Vector3<f64>| Matrix3::identity() - n * n.transpose() * 2.0;
        let turned = reflect(&line) * turn * reflect(&normal);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turned));
        Some(Isometry3::from_parts(Translation3::from(at - turned * middle), rotation))
    }

    fn size_m(&self, used: &[usize]) -> f64 {
        let first = self.markers[used[0]].marker_in_body_m;
        used.iter().map(|m| (self.markers[*m].marker_in_body_m - first).norm()).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal3;
    use mavsight_geometry::rigid_fit;

    #[test]
    fn horns_motion_is_the_rigid_fit() {
        let mut seed = 2;
        for count in [3, 4, 7] {
            for _ in 0..50 {
                let turn = UnitQuaternion::from_scaled_axis(normal3(&mut seed) * 2.0);
                let body: Vec<_> = (0..count).map(|_| normal3(&mut seed)).collect();
                let world: Vec<_> = body.iter().map(|b| turn * b + normal3(&mut seed) * 0.05).collect();
                let want = rigid_fit(&body, &world, &vec![1.0; count]).unwrap().world_from_body;
                let pairs: Vec<_> = body.into_iter().zip(world).collect();
                let got = carried(pairs.into_iter()).unwrap();
                assert!(got.rotation.angle_to(&want.rotation) < 1e-7);
                assert!((got.translation.vector - want.translation.vector).norm() < 1e-7);
            }
        }
    }
}
