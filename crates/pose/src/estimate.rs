//! The rigid pose of one instant from the markers that the cameras saw.

use crate::{PoseError, Rig};
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{
    Camera, GeometryError, Isometry3, Matrix2, Matrix6, UnitQuaternion, Vector2, Vector3, rigid_fit,
    triangulate,
};
use nalgebra::{Matrix6xX, Point3, Translation3, Vector6};

/// One marker seen by one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerObservation {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Index of the marker on the body.
    pub marker: usize,
    /// Centre of the ball's image.
    pub pixel: Vector2<f64>,
    /// Covariance of that.
    pub covariance_px2: Matrix2<f64>,
}

/// A ball on the body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMarker {
    /// Its name in messages.
    pub name: String,
    /// Centre of the ball, body axes.
    pub marker_in_body_m: Vector3<f64>,
    /// Radius of the ball; 0 for a point.
    pub radius_m: f64,
}

/// A measured pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// The pose.
    pub world_from_body: Isometry3<f64>,
    /// Position in world axes (m²), then a small turn about body axes (rad²): t + δt, R exp(δθ). All that is
    /// not known: pixels, cameras and marker positions.
    pub covariance: Matrix6<f64>,
    /// The part of the covariance that is not new in each frame: what the same errors of cameras and marker positions do
    /// to this pose. Each column is one standard deviation along one independent direction, the same directions in
    /// all poses of a flight; the covariance holds S Sᵀ. No columns: none is known.
    pub systematic: Matrix6xX<f64>,
    /// Markers that entered, ascending.
    pub markers_used: Vec<usize>,
    /// Markers that were seen but disagree with the rigid body, ascending.
    pub left_out: Vec<usize>,
    /// Root mean square residual over the coordinates used.
    pub residual_px: f64,
}

/// One instant: a pose, or why there is none.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSample {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// The pose.
    pub estimate: Option<PoseEstimate>,
    /// Why there is none.
    pub reason: Option<String>,
}

/// Estimates poses of one body with one rig.
#[derive(Debug, Clone)]
pub struct PoseEstimator {
    cameras: Vec<Camera>,
    markers: Vec<BodyMarker>,
}

/// The share of true observations that a gate lets pass is 99.9 %: this is the normal quantile of it.
const GATE_NORMAL_QUANTILE: f64 = 3.090;

/// Levenberg-Marquardt steps; from the linear start four or five suffice.
const MAX_STEPS: usize = 60;

struct Sight {
    camera: usize,
    marker: usize,
    pixel: Vector2<f64>,
    covariance_px2: Matrix2<f64>,
    whitener: Matrix2<f64>,
}

struct Solution {
    world_from_body: Isometry3<f64>,
    normal: Matrix6<f64>,
    chi_square: f64,
    redundancy: usize,
    sum_px2: f64,
    coordinates: usize,
}

impl Solution {
    fn variance_factor(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.chi_square / self.redundancy as f64).max(1.0) }
    }

    fn residual_px(&self) -> f64 {
        (self.sum_px2 / self.coordinates.max(1) as f64).sqrt()
    }
}

impl PoseEstimator {
    /// An estimator for a body seen by a rig.
    pub fn new(rig: &Rig, markers: &[BodyMarker]) -> Self {
        Self { cameras: rig.cameras.iter().map(|c| c.camera).collect(), markers: markers.to_vec() }
    }

    /// The pose that fits all sights of one instant best; observations of other instants are passed over.
    ///
    /// Markers seen by two cameras are triangulated and a rigid fit starts the iteration (`previous` does where fewer
    /// than three are); then the reprojection error of all sights, weighted by their covariances, is minimised. A
    /// marker whose removal lowers the chi-square by more than its 99.9 % quantile (of F, where the rest shows more noise
    /// than was claimed) is left out while three remain.
    ///
    /// # Errors
    /// [`PoseError::TooFewMarkers`], [`PoseError::NotRigid`], [`PoseError::NotConverged`],
    /// [`PoseError::BadObservation`], [`PoseError::Geometry`] for collinear markers.
    pub fn estimate(
        &self,
        t_ns: i64,
        observations: &[MarkerObservation],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseEstimate, PoseError> {
        let sights = observations
            .iter()
            .filter(|o| o.t_ns == t_ns)
            .map(|o| self.sight(o))
            .collect::<Result<Vec<_>, _>>()?;
        let mut used: Vec<usize> =
            (0..self.markers.len()).filter(|m| sights.iter().any(|s| s.marker == *m)).collect();
        let points = self.triangulated(&sights);
        let mut left_out = Vec::new();
        let mut solution = self.solve(&sights, &points, &used, previous);
        while used.len() > 3 {
            let Some((drop, without)) = self.disagreeing(&sights, &points, (&used, &solution), previous)
            else {
                break;
            };
            used.retain(|m| *m != drop);
            left_out.push(drop);
            solution = Ok(without);
        }
        let solution = solution?;
        self.refuse_misfit(&solution, &used)?;
        let inverse = solution
            .normal
            .cholesky()
            .map(|c| c.inverse())
            .ok_or(PoseError::NotConverged { steps: MAX_STEPS, residual_px: solution.residual_px() })?;
        left_out.sort_unstable();
        Ok(PoseEstimate {
            world_from_body: solution.world_from_body,
            covariance: inverse * solution.variance_factor(),
            systematic: Matrix6xX::zeros(0),
            markers_used: used,
            left_out,
            residual_px: solution.residual_px(),
        })
    }

    fn sight(&self, o: &MarkerObservation) -> Result<Sight, PoseError> {
        let bad = |reason| PoseError::BadObservation { camera: o.camera, marker: o.marker, reason };
        if o.camera >= self.cameras.len() {
            return Err(bad("the rig has no such camera"));
        }
        if o.marker >= self.markers.len() {
            return Err(bad("the body has no such marker"));
        }
        if !o.pixel.iter().chain(o.covariance_px2.iter()).all(|x| x.is_finite()) {
            return Err(bad("it is not finite"));
        }
        let whitener = o
            .covariance_px2
            .cholesky()
            .and_then(|c| c.l().try_inverse())
            .filter(|w| w.iter().all(|x| x.is_finite()))
            .ok_or(bad("its covariance is not positive definite"))?;
        Ok(Sight {
            camera: o.camera,
            marker: o.marker,
            pixel: o.pixel,
            covariance_px2: o.covariance_px2,
            whitener,
        })
    }

    /// Place and weight of each marker that two cameras saw.
    fn triangulated(&self, sights: &[Sight]) -> Vec<Option<(Vector3<f64>, f64)>> {
        (0..self.markers.len())
            .map(|marker| {
                let rays: Vec<_> = sights
                    .iter()
                    .filter(|s| s.marker == marker)
                    .map(|s| (&self.cameras[s.camera], s.pixel, s.covariance_px2))
                    .collect();
                let point = triangulate(&rays).ok()?;
                let variance = point.covariance_m2.trace();
                (variance > 0.0).then(|| (point.point_in_world_m, 1.0 / variance))
            })
            .collect()
    }

    fn start(
        &self,
        points: &[Option<(Vector3<f64>, f64)>],
        used: &[usize],
        sights: usize,
        previous: Option<&Isometry3<f64>>,
    ) -> Result<Isometry3<f64>, PoseError> {
        let (mut body, mut world, mut weights) = (vec![], vec![], vec![]);
        for &marker in used {
            if let Some((point, weight)) = points[marker] {
                body.push(self.markers[marker].marker_in_body_m);
                world.push(point);
                weights.push(weight);
            }
        }
        if body.len() >= 3 {
            return match rigid_fit(&body, &world, &weights) {
                Ok(fit) => Ok(fit.world_from_body),
                Err(error) => previous.copied().ok_or(error.into()),
            };
        }
        // Three sights alone leave up to four poses (Grunert 1841); a fourth from another camera decides.
        let decided = used.len() >= 3 && sights > used.len();
        previous.filter(|_| decided).copied().ok_or(PoseError::TooFewMarkers {
            seen: body.len(),
            markers: self.markers.len(),
            sights,
        })
    }

    fn solve(
        &self,
        sights: &[Sight],
        points: &[Option<(Vector3<f64>, f64)>],
        used: &[usize],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<Solution, PoseError> {
        let sights: Vec<&Sight> = sights.iter().filter(|s| used.contains(&s.marker)).collect();
        let mut pose = self.start(points, used, sights.len(), previous)?;
        let (mut now, mut gradient) = self.equations(&sights, &pose)?;
        let mut damping = 0.0;
        for _ in 0..MAX_STEPS {
            let mut damped = now.normal;
            for k in 0..6 {
                damped[(k, k)] *= 1.0 + damping;
            }
            let not_converged = PoseError::NotConverged { steps: MAX_STEPS, residual_px: now.residual_px() };
            let step = damped.cholesky().ok_or(not_converged)?.solve(&gradient);
            let tried = moved(&pose, &step);
            // The decrement is the drop of the chi-square that the step still promises.
            let decrement = step.dot(&gradient);
            match self.equations(&sights, &tried) {
                Ok((next, slope)) if next.chi_square <= now.chi_square * (1.0 + 1e-12) + 1e-18 => {
                    pose = tried;
                    (now, gradient) = (next, slope);
                    damping *= 0.1;
                    if decrement < 1e-12 {
                        return Ok(now);
                    }
                }
                _ if decrement < 1e-12 => return Ok(now),
                _ => damping = if damping == 0.0 { 1e-3 } else { damping * 10.0 },
            }
        }
        Err(PoseError::NotConverged { steps: MAX_STEPS, residual_px: now.residual_px() })
    }

    /// Normal equations at a pose.
    fn equations(
        &self,
        sights: &[&Sight],
        pose: &Isometry3<f64>,
    ) -> Result<(Solution, Vector6<f64>), GeometryError> {
        let mut normal = Matrix6::zeros();
        let mut gradient = Vector6::zeros();
        let (mut chi_square, mut sum_px2) = (0.0, 0.0);
        for s in sights {
            let marker = &self.markers[s.marker];
            let centre = (pose * Point3::from(marker.marker_in_body_m)).coords;
            let seen = self.cameras[s.camera].project_ball(&centre, marker.radius_m)?;
            let jacobian = s.whitener * d_pixel_d_pose(&seen, pose, &marker.marker_in_body_m);
            let error = s.pixel - seen.pixel;
            let whitened = s.whitener * error;
            normal += jacobian.transpose() * jacobian;
            gradient += jacobian.transpose() * whitened;
            chi_square += whitened.norm_squared();
            sum_px2 += error.norm_squared();
        }
        let coordinates = 2 * sights.len();
        let redundancy = coordinates.saturating_sub(6);
        Ok((
            Solution { world_from_body: *pose, normal, chi_square, redundancy, sum_px2, coordinates },
            gradient,
        ))
    }

    /// The marker that disagrees most with the body of the others, if one does.
    fn disagreeing(
        &self,
        sights: &[Sight],
        points: &[Option<(Vector3<f64>, f64)>],
        (used, all): (&[usize], &Result<Solution, PoseError>),
        previous: Option<&Isometry3<f64>>,
    ) -> Option<(usize, Solution)> {
        let all_chi_square = all.as_ref().map_or(f64::INFINITY, |s| s.chi_square);
        if all_chi_square <= chi_square_gate(2) {
            return None;
        }
        let mut best: Option<(usize, Solution)> = None;
        for &marker in used {
            let rest: Vec<usize> = used.iter().copied().filter(|m| *m != marker).collect();
            let Ok(without) = self.solve(sights, points, &rest, previous) else { continue };
            let better = best.as_ref().is_none_or(|(_, b)| {
                without.chi_square * b.redundancy.max(1) as f64
                    <= b.chi_square * without.redundancy.max(1) as f64
            });
            if better {
                best = Some((marker, without));
            }
        }
        let (marker, without) = best?;
        let own = 2 * sights.iter().filter(|s| s.marker == marker).count();
        let drop = all_chi_square - without.chi_square;
        let beyond_claim = drop > chi_square_gate(own);
        let ratio = drop / own as f64 / without.variance_factor();
        let beyond_rest = without.variance_factor() <= 1.0
            || without.redundancy < 3
            || beyond_f_gate(ratio, own, without.redundancy);
        (beyond_claim && beyond_rest).then_some((marker, without))
    }

    /// Markers that miss by more than their own radius are not the body's markers.
    fn refuse_misfit(&self, solution: &Solution, used: &[usize]) -> Result<(), PoseError> {
        let residual_px = solution.residual_px();
        let factor = solution.variance_factor();
        let radius_m = used.iter().map(|m| self.markers[*m].radius_m).fold(0.0, f64::max);
        let apparent_px = self
            .cameras
            .iter()
            .filter_map(|c| {
                let depth_m =
                    (c.cam_from_world * Point3::from(solution.world_from_body.translation.vector)).z.abs();
                (depth_m > 0.0).then(|| c.intrinsics.fx_px * radius_m / depth_m)
            })
            .fold(0.0, f64::max);
        let beyond_noise = solution.chi_square > chi_square_gate(solution.redundancy);
        if radius_m > 0.0 && beyond_noise && residual_px > apparent_px {
            return Err(PoseError::NotRigid { residual_px, times: factor.sqrt() });
        }
        Ok(())
    }
}

fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + step.fixed_rows::<3>(0)),
        pose.rotation * UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned()),
    )
}

/// The 99.9 % quantile of chi-square (Wilson & Hilferty 1931; within 3 % from 2 degrees of freedom on, within 2 % from 4).
fn chi_square_gate(degrees: usize) -> f64 {
    let d = degrees.max(1) as f64;
    let c = 2.0 / (9.0 * d);
    d * (1.0 - c + GATE_NORMAL_QUANTILE * c.sqrt()).powi(3)
}

/// Whether a ratio of variances is beyond the 99.9 % quantile of F (Paulson 1942; a seventh too high for 6
/// degrees of freedom below, right from 12 on).
fn beyond_f_gate(ratio: f64, above: usize, below: usize) -> bool {
    let (a, b) = (2.0 / (9.0 * above as f64), 2.0 / (9.0 * below as f64));
    let root = ratio.cbrt();
    let normal = ((1.0 - b) * root - (1.0 - a)) / (b * root * root + a).sqrt();
    normal > GATE_NORMAL_QUANTILE
}

#[cfg(test)]
mod tests;
