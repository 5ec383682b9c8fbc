//! The pose of one instant, with the markers that disagree left out.

use super::estimator::PoseEstimator;
use super::gates::{beyond_f_gate, chi_square_gate, noise_factor};
use super::sample::PoseEstimate;
use super::solve::{MAX_STEPS, Solution};
use super::types::PredictedObservation;
use super::view::{View, of_markers};
use crate::{MarkerObservation, PoseError};
use mavsight_geometry::{Isometry3, Point3, Vector2};

impl PoseEstimator {
    /// The pose that fits all observations of one instant best; observations of other instants are passed
    /// over.
    ///
    /// The reprojection error of all observations, weighted by their covariances, is minimised, with the
    /// influence of long residuals bounded (Huber 1981; 95 % efficient where the noise is normal). The
    /// start is a rigid fit to the markers that two cameras saw; where those are fewer than three, every
    /// pose in which one camera sees three of its markers (Grunert 1841), and its mirror image about the
    /// viewing ray. A marker whose removal lowers the chi-square by more than its 99.9 % quantile (of F,
    /// where the rest shows more noise than was claimed) is left out while three remain. Where two minima
    /// are both likely, the one much nearer to `previous` is taken.
    ///
    /// # Errors
    /// [`PoseError::TooFewMarkers`], [`PoseError::AmbiguousPose`], [`PoseError::NotRigid`],
    /// [`PoseError::NotConverged`], [`PoseError::BadObservation`], [`PoseError::Geometry`] for collinear
    /// markers.
    pub fn estimate(
        &self,
        t_ns: i64,
        observations: &[MarkerObservation],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseEstimate, PoseError> {
        let mut views = Vec::with_capacity(observations.len());
        for seen in observations.iter().filter(|o| o.t_ns == t_ns) {
            views.push(self.view(seen)?);
        }
        let mut used: Vec<usize> =
            (0..self.markers.len()).filter(|m| views.iter().any(|s| s.marker == *m)).collect();
        let mut left_out = Vec::new();
        let mut solution = self.solve(&views, &used, previous);
        while used.len() > 3 {
            let Some((drop, without)) = self.disagreeing(&views, (&used, &solution), previous) else {
                break;
            };
            used.retain(|m| *m != drop);
            left_out.push(drop);
            solution = Ok(without);
        }
        let own = of_markers(&views, &used);
        let solution = self.bounded_from(&own, solution?);
        self.refuse_misfit(&solution, &used)?;
        self.finished(&own, &solution, (&used, &left_out))
    }

    /// The covariance with which a pose will be measured from observations that are as good as they
    /// claim: what [`PoseEstimator::estimate`] gives where the residuals are as large as expected.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`]; [`PoseError::TooFewMarkers`] and [`PoseError::NotConverged`] for
    /// observations that do not determine the pose; [`PoseError::Geometry`] for a marker behind its
    /// camera.
    pub fn predict(
        &self,
        world_from_body: &Isometry3<f64>,
        views: &[PredictedObservation],
    ) -> Result<PoseEstimate, PoseError> {
        let mut own = Vec::with_capacity(views.len());
        for s in views {
            let (camera, marker) = (s.camera, s.marker);
            let (pixel, covariance_px2) = (Vector2::zeros(), s.covariance_px2);
            let mut view =
                self.view(&MarkerObservation { t_ns: 0, camera, marker, pixel, covariance_px2 })?;
            view.pixel = self.projected(&view, world_from_body)?.pixel;
            own.push(view);
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
        own: &[View],
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

    /// The marker that disagrees most with the body of the others, if one does.
    fn disagreeing(
        &self,
        views: &[View],
        (used, all): (&[usize], &Result<Solution, PoseError>),
        previous: Option<&Isometry3<f64>>,
    ) -> Option<(usize, Solution)> {
        let all_chi_square = all.as_ref().map_or(f64::INFINITY, |s| s.chi_square);
        let coordinates = |m: usize| 2 * views.iter().filter(|s| s.marker == m).count();
        let fewest = used.iter().map(|m| coordinates(*m)).min().unwrap_or(0);
        if all_chi_square <= chi_square_gate(fewest) || matches!(all, Err(PoseError::AmbiguousPose { .. })) {
            return None;
        }
        let mut best: Option<(usize, Solution)> = None;
        for &marker in used {
            let rest: Vec<usize> = used.iter().copied().filter(|m| *m != marker).collect();
            let Ok(without) = self.solve(views, &rest, previous) else { continue };
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
        let claimed = all.as_ref().map_or(1.0, |s| self.claimed_excess(views, used, s));
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
    pub(super) fn claimed_excess(&self, views: &[View], used: &[usize], solution: &Solution) -> f64 {
        let own = of_markers(views, used);
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
