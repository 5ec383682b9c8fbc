//! The pose of one instant, with the markers that disagree left out.

use super::estimator::PoseEstimator;
use super::gates::{beyond_f_gate, chi_square_gate, noise_factor};
use super::sample::{MarkerSet, PoseEstimate, PredictedObservation};
use super::solve::MAX_STEPS;
use super::start::of_markers;
use crate::reprojection::{PointObservation, PoseFit};
use crate::{MarkerObservation, PoseError};
use mavsight_geometry::{Camera, GeometryError, Isometry3, Matrix6, Point3, Vector2};
use nalgebra::Matrix6xX;
use std::f64::consts::PI;

impl PoseEstimator {
    /// The pose that fits all observations of one instant best; observations of other instants are passed
    /// over.
    ///
    /// Minimises the reprojection error, weighted by the covariances, with the influence of long residuals
    /// bounded (Huber 1981). Starts from a rigid fit to the markers that two cameras saw, or, of fewer than
    /// three, from every pose in which one camera sees three of its markers (Grunert 1841) and its mirror
    /// image. A marker whose removal lowers the chi-square by more than its 99.9 % quantile (of F, where the
    /// rest shows more noise than was claimed) is left out while three remain. Of two likely minima the one
    /// much nearer to `previous` is taken.
    ///
    /// # Errors
    /// [`PoseError::TooFewMarkers`], [`PoseError::AmbiguousPose`], [`PoseError::NotRigid`],
    /// [`PoseError::NotConverged`], [`PoseError::AttitudeUnknown`], [`PoseError::BadObservation`],
    /// [`PoseError::Geometry`] for collinear markers, and for stated errors so large that the covariance is not finite.
    pub fn estimate(
        &self,
        t_ns: i64,
        observations: &[MarkerObservation],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseEstimate, PoseError> {
        self.estimate_views(&self.views(observations.iter().copied().filter(|o| o.t_ns == t_ns))?, previous)
    }

    /// [`Self::estimate`] of observations without the constant errors of their centres.
    pub(crate) fn estimate_views(
        &self,
        views: &[PointObservation],
        previous: Option<&Isometry3<f64>>,
    ) -> Result<PoseEstimate, PoseError> {
        let mut used: MarkerSet = views.iter().map(|s| s.point).collect();
        let all = used;
        let mut fit = self.solve(views, used, previous);
        while used.len() > 3 {
            let Some((drop, without)) = self.disagreeing(views, used, &fit, previous) else { break };
            used = used.without(drop);
            fit = Ok(without);
        }
        let own = of_markers(views, used);
        let fit = self.bounded_from(&own, fit?);
        self.refuse_misfit(&fit, used)?;
        let residual_px = (fit.redundancy() > 0).then(|| fit.residual_px());
        let inverse = fit.normal.cholesky().map(|c| c.inverse());
        let inverse = inverse.ok_or_else(|| fit.not_converged(MAX_STEPS))?;
        let (effects, left_over) = self.systematic(&own, &fit, &inverse);
        let factor = noise_factor(fit.chi_square, left_over, fit.redundancy());
        let estimate = stated(fit.world_from_body, &(inverse * factor), &effects)?;
        let left_out = all.iter().filter(|m| !used.contains(*m)).collect();
        Ok(estimate.by_markers(used, left_out, residual_px))
    }

    /// The covariance with which a pose will be measured from observations that are as good as they claim:
    /// what [`PoseEstimator::estimate`] gives where the residuals are as large as expected.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`]; [`PoseError::TooFewMarkers`], [`PoseError::NotConverged`] and
    /// [`PoseError::AttitudeUnknown`] for observations that do not determine the pose; [`PoseError::Geometry`] for a marker
    /// behind its camera, and for stated errors so large that the covariance is not finite.
    pub fn predict(
        &self,
        world_from_body: &Isometry3<f64>,
        views: &[PredictedObservation],
    ) -> Result<PoseEstimate, PoseError> {
        let (t_ns, pixel) = (0, Vector2::zeros());
        let mut own = self.views(views.iter().map(|v| {
            let PredictedObservation { camera, marker, covariance_px2 } = *v;
            MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 }
        }))?;
        for o in &mut own {
            o.pixel = self.scene().at(o, world_from_body)?.projection.pixel;
        }
        let used: MarkerSet = own.iter().map(|s| s.point).collect();
        if used.len() < 3 {
            return Err(self.too_few(used, own.len()));
        }
        let fit = self.at_pose(&own, world_from_body)?;
        let undetermined = || PoseError::NotConverged { steps: 0, residual_px: 0.0 };
        let new = fit.normal.cholesky().map(|c| c.inverse()).ok_or_else(undetermined)?;
        let (effects, _) = self.systematic(&own, &fit, &new);
        let estimate = stated(*world_from_body, &new, &effects)?;
        Ok(estimate.by_markers(used, MarkerSet::default(), None))
    }

    /// The marker that disagrees most with the body of the others, if one does, and the pose without it.
    fn disagreeing(
        &self,
        views: &[PointObservation],
        used: MarkerSet,
        all: &Result<PoseFit, PoseError>,
        previous: Option<&Isometry3<f64>>,
    ) -> Option<(usize, PoseFit)> {
        let all_chi_square = all.as_ref().map_or(f64::INFINITY, |s| s.chi_square);
        let coordinates = |m: usize| 2 * views.iter().filter(|s| s.point == m).count();
        let fewest = used.iter().map(coordinates).min().unwrap_or(0);
        if all_chi_square <= chi_square_gate(fewest) || matches!(all, Err(PoseError::AmbiguousPose { .. })) {
            return None;
        }
        // Without redundancy the rest agrees with anything.
        let ratio = |fit: &PoseFit| fit.chi_square / fit.redundancy() as f64;
        let (marker, without) = used
            .iter()
            .filter_map(|m| Some((m, self.solve(views, used.without(m), previous).ok()?)))
            .filter(|(_, fit)| fit.redundancy() > 0)
            .reduce(|best, next| if ratio(&next.1) <= ratio(&best.1) { next } else { best })?;
        let own = coordinates(marker);
        let drop = all_chi_square - without.chi_square;
        let claimed = all.as_ref().map_or(1.0, |s| self.claimed_excess(views, used, s));
        let factor = without.variance_factor().max(claimed);
        let beyond_claim = drop > chi_square_gate(own) * claimed;
        // Where all together have no solution, any drop is enough.
        let beyond_rest = all.is_err()
            || factor <= 1.0
            || without.redundancy() < 3
            || beyond_f_gate(drop / own as f64 / factor, own, without.redundancy());
        (beyond_claim && beyond_rest).then_some((marker, without))
    }

    /// Factor by which what is not known of cameras and markers raises the mean chi-square.
    pub(super) fn claimed_excess(&self, views: &[PointObservation], used: MarkerSet, fit: &PoseFit) -> f64 {
        let own = of_markers(views, used);
        let explained = fit.normal.cholesky().map_or(0.0, |c| self.systematic(&own, fit, &c.inverse()).1);
        1.0 + explained / fit.redundancy().max(1) as f64
    }

    /// Markers that miss by more than their own radius are not the body's markers.
    fn refuse_misfit(&self, fit: &PoseFit, used: MarkerSet) -> Result<(), PoseError> {
        let residual_px = fit.residual_px();
        let radius_m = used.iter().map(|m| self.markers[m].radius_m).fold(0.0, f64::max);
        let place = Point3::from(fit.world_from_body.translation.vector);
        let apparent_px = |c: &Camera| c.intrinsics.fx_px * radius_m / (c.cam_from_world * place).z.abs();
        let apparent_px =
            self.cameras.iter().map(apparent_px).filter(|px| px.is_finite()).fold(0.0, f64::max);
        let beyond_noise = fit.chi_square > chi_square_gate(fit.redundancy());
        if radius_m > 0.0 && beyond_noise && residual_px > apparent_px {
            return Err(PoseError::NotRigid { residual_px, times: fit.variance_factor().sqrt() });
        }
        Ok(())
    }
}

/// Variance of an angle of which nothing is known: evenly spread over the circle.
const UNKNOWN_RAD2: f64 = PI * PI / 3.0;

/// A pose with its covariance, which must be finite as it is kept: the systematic columns in single precision.
fn stated(
    world_from_body: Isometry3<f64>,
    own: &Matrix6<f64>,
    effects: &Matrix6xX<f64>,
) -> Result<PoseEstimate, PoseError> {
    let estimate = PoseEstimate::new(world_from_body, own).with_rounded(effects);
    let covariance = estimate.covariance();
    let coordinates = covariance.row_iter().filter(|row| !row.iter().all(|x| x.is_finite())).count();
    if coordinates > 0 {
        return Err(GeometryError::UnboundedCovariance { what: "the pose", coordinates }.into());
    }
    let largest_rad2 = covariance.fixed_view::<3, 3>(3, 3).symmetric_eigenvalues().max();
    if largest_rad2 > UNKNOWN_RAD2 {
        return Err(PoseError::AttitudeUnknown { std_deg: largest_rad2.sqrt().to_degrees() });
    }
    Ok(estimate)
}

/// How far observations lie from where the best pose has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReprojectionFit {
    /// Root mean square residual, all observations counted.
    pub residual_px: f64,
    /// In standard deviations as they are to be expected of centres, cameras and markers: 1 on average.
    pub ratio: f64,
}

impl PoseEstimator {
    /// How well the observations of one instant fit, none left out and none refused; without a number where
    /// no pose was found (`ratio` is infinite then), and `None` for observations that fit anything.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`].
    pub fn reprojection_fit(
        &self,
        observations: &[MarkerObservation],
    ) -> Result<Option<ReprojectionFit>, PoseError> {
        let views = self.views(observations.iter().copied())?;
        let used: MarkerSet = views.iter().map(|s| s.point).collect();
        if used.len() < 3 || 2 * views.len() <= 6 {
            return Ok(None);
        }
        let Ok(fit) = self.solve(&views, used, None) else {
            return Ok(Some(ReprojectionFit { residual_px: f64::INFINITY, ratio: f64::INFINITY }));
        };
        let expected = self.claimed_excess(&views, used, &fit);
        let ratio = (fit.chi_square / fit.redundancy().max(1) as f64 / expected).sqrt();
        Ok(Some(ReprojectionFit { residual_px: fit.residual_px(), ratio }))
    }
}

#[cfg(test)]
mod tests {
    use crate::estimate::tests::{body, seen, truth};
    use crate::testing::rig;
    use crate::{PoseEstimator, ReprojectionFit};
    use mavsight_random::Random;

    #[test]
    fn noise_as_claimed_fits_once_and_a_camera_in_the_place_of_another_does_not() {
        let estimator = PoseEstimator::new(&rig(), &body());
        let (mut random, mut squares, trials) = (Random::new(1, 0), 0.0, 60);
        for _ in 0..trials {
            let mut now = seen(&truth(), 0.1, &mut random);
            let fit = estimator.reprojection_fit(&now).unwrap().unwrap();
            squares += fit.ratio.powi(2) / f64::from(trials);
            assert!(fit.residual_px < 0.2, "{fit:?}");
            now.iter_mut().for_each(|o| o.camera = 1 - o.camera);
            let ReprojectionFit { ratio, .. } = estimator.reprojection_fit(&now).unwrap().unwrap();
            assert!(ratio > 20.0, "{ratio}");
        }
        // Mean of a chi-square over its ten degrees of freedom, sixty ratio.
        assert!((squares - 1.0).abs() < 0.2, "{squares}");
        let few = &seen(&truth(), 0.1, &mut random)[..3];
        assert_eq!(estimator.reprojection_fit(few).unwrap(), None);
    }
}
