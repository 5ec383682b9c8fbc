//! Where the iteration begins: from triangulated markers, or from one camera's view of three.

use super::estimator::PoseEstimator;
use super::gates::DECISIVE_CHI_SQUARE;
use super::sample::MarkerSet;
use crate::PoseError;
use crate::reprojection::{PointObservation, PoseFit};
use crate::three_points::three_point_poses;
use mavsight_geometry::attitude::{matrix_of, rotation_of};
use mavsight_geometry::{GeometryError, Isometry3, Matrix3, Vector3, rigid_fit};
use nalgebra::Translation3;
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
            for pose in three_point_poses(self.scene(), &view) {
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
