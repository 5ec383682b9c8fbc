//! The iteration to the pose of one instant, and what systematic errors do to it.

use super::estimator::PoseEstimator;
use super::gates::noise_factor;
use super::sample::MarkerSet;
use crate::PoseError;
use crate::reprojection::{PointObservation, PoseFit, bound2, huber};
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::{GeometryError, Isometry3, Matrix6, Point3, Vector2};
use nalgebra::{Matrix6xX, Vector6};

/// Levenberg-Marquardt steps; from the linear start four or five suffice.
pub(super) const MAX_STEPS: usize = 60;

/// Steps that promise to lower the chi-square by less are the last: a ten-thousandth of a standard deviation,
/// and a thousandth where the influence of residuals is bounded.
const CONVERGED: f64 = 1e-8;
const CONVERGED_BOUNDED: f64 = 1e-6;

impl PoseEstimator {
    pub(super) fn at_pose(
        &self,
        views: &[PointObservation],
        pose: &Isometry3<f64>,
    ) -> Result<PoseFit, GeometryError> {
        self.scene().equations(views, pose, f64::INFINITY)
    }

    pub(super) fn descend(
        &self,
        views: &[PointObservation],
        start: &Isometry3<f64>,
    ) -> Result<PoseFit, PoseError> {
        let fit = self.scene().descend(views, start, f64::INFINITY, CONVERGED, MAX_STEPS)?;
        if fit.is_converged { Ok(fit) } else { Err(fit.not_converged(MAX_STEPS)) }
    }

    /// The pose with bounded influence: long residuals weigh no more than one of the bound's length (Huber
    /// 1981, chapter 7). The scale is that of [`noise_factor`], so that noise larger than was claimed does
    /// not make outliers of half the observations. The chi-square is that of least squares.
    pub(super) fn bounded_from(&self, views: &[PointObservation], least: PoseFit) -> PoseFit {
        let bound2 = bound2(noise_factor(least.chi_square, 0.0, least.redundancy()).max(1.0));
        if least.longest <= bound2 {
            return least;
        }
        let start = &least.world_from_body;
        match self.scene().descend(views, start, bound2, CONVERGED_BOUNDED, MAX_STEPS) {
            Ok(fit) if fit.is_converged => PoseFit { chi_square: least.chi_square, ..fit },
            _ => least,
        }
    }

    /// What one standard deviation along each direction of error of cameras, marker positions and centres
    /// does to the pose, and the mean chi-square that all of them together leave in the residuals. `inverse`
    /// is that of the normal equations.
    pub(super) fn systematic(
        &self,
        views: &[PointObservation],
        fit: &PoseFit,
        inverse: &Matrix6<f64>,
    ) -> (Matrix6xX<f64>, f64) {
        let mut effects = Matrix6xX::zeros(self.errors.columns());
        if effects.is_empty() {
            return (effects, 0.0);
        }
        let turn = matrix_of(&fit.world_from_body.rotation);
        let mut squares = 0.0;
        for o in views {
            let Ok(at) = self.scene().at(o, &fit.world_from_body) else { continue };
            let Ok(by_camera) = self.cameras[o.camera].d_pixel_d_camera(&at.centre_in_world) else {
                continue;
            };
            let weighted = at.by_pose.transpose() * huber(at.whitened.norm_squared(), fit.bound2).0;
            let by_camera = o.whitener * by_camera;
            let by_marker = o.whitener * at.projection.d_pixel_d_point_in_world * turn;
            let hidden_px = match self.errors.bias_px {
                Some(_) => self.hidden_px(o, views, &fit.world_from_body),
                None => Vector2::zeros(),
            };
            self.errors.effects(
                o,
                &by_camera,
                &by_marker,
                &hidden_px,
                |column: usize, effect: Vector2<f64>| {
                    squares += effect.norm_squared();
                    let mut sum = effects.column_mut(column);
                    sum += weighted * effect;
                },
            );
        }
        let mut taken = 0.0;
        for mut column in effects.column_iter_mut() {
            let right: Vector6<f64> = column.clone_owned();
            let effect = inverse * right;
            taken += effect.dot(&right);
            column.copy_from(&effect);
        }
        let left = squares - taken;
        // Rounding may make it less than nothing; NaN is not to become nothing.
        (effects, if left < 0.0 { 0.0 } else { left })
    }

    /// Root mean square distance between some markers of two poses.
    pub(crate) fn apart_m(&self, of: MarkerSet, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let square = |m: usize| {
            let at = Point3::from(self.markers[m].marker_in_body_m);
            (a * at - b * at).norm_squared()
        };
        (of.iter().map(square).sum::<f64>() / of.len().max(1) as f64).sqrt()
    }
}
