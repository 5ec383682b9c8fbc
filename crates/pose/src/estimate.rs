//! The rigid pose of one instant from the markers that the cameras saw.

mod bias;
mod components;
mod fit;
mod gates;
mod lasting;
mod p3p;
mod sample;
mod solve;
mod start;

use crate::{MarkerObservation, PoseError, RefinedFlight, Rig};
pub use fit::ReprojectionFit;
use gates::{DECISIVE_CHI_SQUARE, beyond_f_gate, chi_square_gate, noise_factor};
pub(crate) use gates::{HUBER_MEAN, chi_square_gate as chi_square_quantile};
use lasting::Lasting;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Matrix2, Point3, Vector2, Vector3};
use nalgebra::DMatrix;
pub use sample::{MarkerSet, PoseEstimate};
pub(crate) use solve::noise_weight;
use solve::{Sight, Solution, of_markers};

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

/// A sight that is expected, before there is a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedObservation {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Index of the marker on the body.
    pub marker: usize,
    /// Covariance that the centre of its image will have.
    pub covariance_px2: Matrix2<f64>,
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
    centres: Vec<Vector3<f64>>,
    markers: Vec<BodyMarker>,
    lasting: Lasting,
    /// By how much each marker's centre is off for good, camera by camera.
    offsets_px: Vec<Vector2<f64>>,
}

/// Levenberg-Marquardt steps; from the linear start four or five suffice.
const MAX_STEPS: usize = 60;

impl PoseEstimator {
    /// An estimator for a body seen by a rig; the markers' positions count as exact.
    pub fn new(rig: &Rig, markers: &[BodyMarker]) -> Self {
        let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
        Self {
            centres: cameras.iter().map(Camera::centre_in_world).collect(),
            lasting: Lasting::of_rig(rig, markers.len()),
            markers: markers.to_vec(),
            offsets_px: vec![Vector2::zeros(); cameras.len() * markers.len()],
            cameras,
        }
    }

    /// The body.
    pub fn markers(&self) -> &[BodyMarker] {
        &self.markers
    }

    /// The same with what is not known of the markers' positions: 3 rows a marker (body axes, m), each column one standard
    /// deviation along an independent direction, so that their covariance is M Mᵀ.
    ///
    /// # Errors
    /// [`PoseError::MarkerUncertainty`] for another number of rows or what is not finite.
    pub fn with_marker_uncertainty(mut self, factor_m: &DMatrix<f64>) -> Result<Self, PoseError> {
        let refused = PoseError::MarkerUncertainty { rows: factor_m.nrows(), needed: 3 * self.markers.len() };
        self.lasting = self.lasting.with_markers(factor_m).ok_or(refused)?;
        Ok(self)
    }

    /// An estimator with cameras and centres as a flight has shown them, with what that leaves open; the markers are those of
    /// the flight, or where it does not show them, those of the file.
    ///
    /// # Errors
    /// [`PoseError::MarkerUncertainty`] for a body of another number of markers.
    pub fn refined(flight: &RefinedFlight, markers: Option<&[BodyMarker]>) -> Result<Self, PoseError> {
        let mut out = Self::new(&flight.rig, markers.unwrap_or(&flight.markers));
        let needed = 3 * flight.markers.len();
        let refused = PoseError::MarkerUncertainty { rows: 3 * out.markers.len(), needed };
        if out.markers.len() != flight.markers.len() {
            return Err(refused);
        }
        let mut factor = flight.uncertainty.clone();
        if markers.is_some() {
            factor.rows_mut(CAMERA_PARAMETERS * out.cameras.len(), needed).fill(0.0);
        }
        out.lasting = out.lasting.fitted(&factor).ok_or(refused)?;
        out.offsets_px.clone_from(&flight.offsets_px);
        Ok(out)
    }

    /// The pose that fits all sights of one instant best; observations of other instants are passed over.
    ///
    /// The reprojection error of all sights, weighted by their covariances, is minimised, with the influence of long
    /// residuals bounded (Huber 1981; 95 % efficient where the noise is normal). The start is a rigid fit to the markers
    /// that two cameras saw; where those are fewer than three, every pose in which one camera sees three of its markers
    /// (Grunert 1841), and its mirror image about the line of sight. A marker whose removal lowers the chi-square by more
    /// than its 99.9 % quantile (of F, where the rest shows more noise than was claimed) is left out while three remain.
    /// Where two minima are both likely, the one much nearer to `previous` is taken.
    ///
    /// # Errors
    /// [`PoseError::TooFewMarkers`], [`PoseError::AmbiguousPose`], [`PoseError::NotRigid`], [`PoseError::NotConverged`],
    /// [`PoseError::BadObservation`], [`PoseError::Geometry`] for collinear markers.
    pub fn estimate(
        &self,
        t_ns: i64,
        observations: &[MarkerObservation],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseEstimate, PoseError> {
        let mut sights = Vec::with_capacity(observations.len());
        for seen in observations.iter().filter(|o| o.t_ns == t_ns) {
            sights.push(self.sight(seen)?);
        }
        let mut used: Vec<usize> =
            (0..self.markers.len()).filter(|m| sights.iter().any(|s| s.marker == *m)).collect();
        let mut left_out = Vec::new();
        let mut solution = self.solve(&sights, &used, previous);
        while used.len() > 3 {
            let Some((drop, without)) = self.disagreeing(&sights, (&used, &solution), previous) else {
                break;
            };
            used.retain(|m| *m != drop);
            left_out.push(drop);
            solution = Ok(without);
        }
        let own = of_markers(&sights, &used);
        let solution = self.bounded_from(&own, solution?);
        self.refuse_misfit(&solution, &used)?;
        self.finished(&own, &solution, (&used, &left_out))
    }

    /// The covariance with which a pose will be measured from sights that are as good as they claim: what
    /// [`PoseEstimator::estimate`] gives where the residuals are as large as expected.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`]; [`PoseError::TooFewMarkers`] and [`PoseError::NotConverged`] for sights that do not
    /// determine the pose; [`PoseError::Geometry`] for a marker behind its camera.
    pub fn predict(
        &self,
        world_from_body: &Isometry3<f64>,
        sights: &[PredictedObservation],
    ) -> Result<PoseEstimate, PoseError> {
        let mut own = Vec::with_capacity(sights.len());
        for s in sights {
            let (camera, marker) = (s.camera, s.marker);
            let (pixel, covariance_px2) = (Vector2::zeros(), s.covariance_px2);
            let mut sight =
                self.sight(&MarkerObservation { t_ns: 0, camera, marker, pixel, covariance_px2 })?;
            sight.pixel = self.projected(&sight, world_from_body)?.pixel;
            own.push(sight);
        }
        let used: Vec<usize> =
            (0..self.markers.len()).filter(|m| own.iter().any(|s| s.marker == *m)).collect();
        if used.len() < 3 {
            let markers = self.markers.len();
            return Err(PoseError::TooFewMarkers { seen: used.len(), markers, observations: own.len() });
        }
        let solution = self.at_pose(&own, world_from_body)?;
        let undetermined = || PoseError::NotConverged { steps: 0, residual_px: 0.0 };
        let new = solution.normal.cholesky().map(|c| c.inverse()).ok_or_else(undetermined)?;
        let (effects, _) = self.systematic(&own, &solution, &new);
        if !new.iter().chain(effects.iter()).all(|x| x.is_finite()) {
            return Err(undetermined());
        }
        let estimate = PoseEstimate::new(*world_from_body, &new);
        Ok(estimate.with_rounded(&effects).by_markers(&used, &[], 0.0))
    }

    fn finished(
        &self,
        own: &[Sight],
        solution: &Solution,
        (used, left_out): (&[usize], &[usize]),
    ) -> Result<PoseEstimate, PoseError> {
        let residual_px = solution.residual_px();
        let inverse = solution
            .normal
            .cholesky()
            .map(|c| c.inverse())
            .ok_or(PoseError::NotConverged { steps: MAX_STEPS, residual_px })?;
        let (effects, left_over) = self.systematic(own, solution, &inverse);
        let factor = noise_factor(solution.chi_square, left_over, solution.redundancy);
        let estimate = PoseEstimate::new(solution.world_from_body, &(inverse * factor));
        let estimate = estimate.with_rounded(&effects);
        Ok(estimate.by_markers(used, left_out, residual_px))
    }

    fn sight(&self, o: &MarkerObservation) -> Result<Sight, PoseError> {
        let bad = |reason| PoseError::BadObservation { camera: o.camera, marker: o.marker, reason };
        if o.camera >= self.cameras.len() {
            return Err(bad("the rig has no such camera"));
        }
        if o.marker >= self.markers.len().min(MarkerSet::MOST) {
            return Err(bad("the body has no such marker, or more than 64"));
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
        let pixel = o.pixel - self.offsets_px[o.camera * self.markers.len() + o.marker];
        Ok(Sight { camera: o.camera, marker: o.marker, pixel, whitener })
    }

    /// The marker that disagrees most with the body of the others, if one does.
    fn disagreeing(
        &self,
        sights: &[Sight],
        (used, all): (&[usize], &Result<Solution, PoseError>),
        previous: Option<&Isometry3<f64>>,
    ) -> Option<(usize, Solution)> {
        let all_chi_square = all.as_ref().map_or(f64::INFINITY, |s| s.chi_square);
        let coordinates = |m: usize| 2 * sights.iter().filter(|s| s.marker == m).count();
        let fewest = used.iter().map(|m| coordinates(*m)).min().unwrap_or(0);
        if all_chi_square <= chi_square_gate(fewest) || matches!(all, Err(PoseError::AmbiguousPose { .. })) {
            return None;
        }
        let mut best: Option<(usize, Solution)> = None;
        for &marker in used {
            let rest: Vec<usize> = used.iter().copied().filter(|m| *m != marker).collect();
            let Ok(without) = self.solve(sights, &rest, previous) else { continue };
            let better = best.as_ref().is_none_or(|(_, b)| {
                without.chi_square * b.redundancy.max(1) as f64
                    <= b.chi_square * without.redundancy.max(1) as f64
            });
            // Without redundancy the rest agrees with anything.
            if better && without.redundancy > 0 {
                best = Some((marker, without));
            }
        }
        let (marker, without) = best?;
        let own = coordinates(marker);
        let drop = all_chi_square - without.chi_square;
        let claimed = all.as_ref().map_or(1.0, |s| self.claimed_excess(sights, used, s));
        let factor = without.variance_factor().max(claimed);
        let beyond_claim = drop > chi_square_gate(own) * claimed;
        // Where all together have no solution, any drop is enough.
        let beyond_rest = all.is_err()
            || factor <= 1.0
            || without.redundancy < 3
            || beyond_f_gate(drop / own as f64 / factor, own, without.redundancy);
        (beyond_claim && beyond_rest).then_some((marker, without))
    }

    /// Factor by which what is not known of cameras and markers raises the mean chi-square.
    fn claimed_excess(&self, sights: &[Sight], used: &[usize], solution: &Solution) -> f64 {
        let own = of_markers(sights, used);
        let explained =
            solution.normal.cholesky().map_or(0.0, |c| self.systematic(&own, solution, &c.inverse()).1);
        1.0 + explained / solution.redundancy.max(1) as f64
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

#[cfg(test)]
mod tests;
