//! The iteration: reprojection error of one instant, its normal equations, and what systematic errors do
//! to it.

use super::estimator::PoseEstimator;
use super::gates::{HUBER_BOUND, noise_factor};
use super::types::BodyMarker;
use super::view::View;
use crate::PoseError;
use crate::moving::moved;
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{GeometryError, Isometry3, Matrix6, Point3, Projection, Vector2, Vector3};
use nalgebra::{Matrix6xX, Vector6};

/// Levenberg-Marquardt steps; from the linear start four or five suffice.
pub(super) const MAX_STEPS: usize = 60;

/// A step that promises to lower the chi-square by less, a ten-thousandth of a standard deviation, is the
/// last: what remains after it is smaller by its square.
const CONVERGED: f64 = 1e-8;

/// A pose at a minimum.
#[derive(Clone)]
pub(super) struct Solution {
    pub(super) world_from_body: Isometry3<f64>,
    /// Σ Jᵀ W J with the weights of the last step.
    pub(super) normal: Matrix6<f64>,
    /// Sum of the squared whitened residuals.
    pub(super) chi_square: f64,
    pub(super) redundancy: usize,
    /// The largest of those squares.
    pub(super) longest: f64,
    pub(super) sum_px2: f64,
    pub(super) coordinates: usize,
    /// Factor on the claimed covariances under which a residual counts as large; none: none is bounded.
    pub(super) bound_scale: Option<f64>,
}

impl Solution {
    pub(super) fn variance_factor(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.chi_square / self.redundancy as f64).max(1.0) }
    }

    pub(super) fn residual_px(&self) -> f64 {
        (self.sum_px2 / self.coordinates.max(1) as f64).sqrt()
    }

    fn not_converged(&self) -> PoseError {
        PoseError::NotConverged { steps: MAX_STEPS, residual_px: self.residual_px() }
    }
}

/// Huber's weight of a squared whitened residual under a factor on the claimed covariances.
pub(crate) fn noise_weight(square: f64, factor: f64) -> f64 {
    let bound = HUBER_BOUND * factor.sqrt();
    if square <= bound * bound { 1.0 } else { bound / square.sqrt() }
}

impl PoseEstimator {
    pub(super) fn projected(&self, s: &View, pose: &Isometry3<f64>) -> Result<Projection, GeometryError> {
        let marker = &self.markers[s.marker];
        let centre = (pose * Point3::from(marker.marker_in_body_m)).coords;
        self.cameras[s.camera].project_ball(&centre, marker.radius_m)
    }

    /// Normal equations at a pose.
    fn equations(
        &self,
        views: &[View],
        pose: &Isometry3<f64>,
        bound_scale: Option<f64>,
    ) -> Result<(Solution, Vector6<f64>), GeometryError> {
        let mut normal = Matrix6::zeros();
        let mut gradient = Vector6::zeros();
        let (mut chi_square, mut longest, mut sum_px2) = (0.0, 0.0_f64, 0.0);
        for s in views {
            let seen = self.projected(s, pose)?;
            let jacobian = s.whitener * d_pixel_d_pose(&seen, pose, &self.markers[s.marker].marker_in_body_m);
            let error = s.pixel - seen.pixel;
            let whitened = s.whitener * error;
            let square = whitened.norm_squared();
            let weight = bound_scale.map_or(1.0, |scale| noise_weight(square, scale));
            longest = longest.max(square);
            let weighted = jacobian.transpose() * weight;
            normal += weighted * jacobian;
            gradient += weighted * whitened;
            chi_square += square;
            sum_px2 += error.norm_squared();
        }
        let coordinates = 2 * views.len();
        let redundancy = coordinates.saturating_sub(6);
        let solution = Solution {
            world_from_body: *pose,
            normal,
            chi_square,
            longest,
            redundancy,
            sum_px2,
            coordinates,
            bound_scale,
        };
        Ok((solution, gradient))
    }

    /// The normal equations at a pose that is known already.
    pub(super) fn at_pose(&self, views: &[View], pose: &Isometry3<f64>) -> Result<Solution, GeometryError> {
        self.equations(views, pose, None).map(|e| e.0)
    }

    /// Least squares from a start (Levenberg 1944; Marquardt 1963).
    pub(super) fn descend(&self, views: &[View], start: &Isometry3<f64>) -> Result<Solution, PoseError> {
        let mut pose = *start;
        let (mut now, mut gradient) = self.equations(views, &pose, None)?;
        let mut damping = 0.0;
        for _ in 0..MAX_STEPS {
            let mut damped = now.normal;
            for k in 0..6 {
                damped[(k, k)] *= 1.0 + damping;
            }
            let step = damped.cholesky().ok_or_else(|| now.not_converged())?.solve(&gradient);
            // The decrement is the drop of the chi-square that the step still promises.
            let decrement = step.dot(&gradient);
            let tried = moved(&pose, &step);
            if decrement < CONVERGED && damping < 1e-3 {
                return Ok(Solution { world_from_body: tried, ..now });
            }
            match self.equations(views, &tried, None) {
                Ok((next, slope)) if next.chi_square <= now.chi_square * (1.0 + 1e-12) + 1e-18 => {
                    pose = tried;
                    (now, gradient) = (next, slope);
                    damping *= 0.1;
                }
                _ if decrement < CONVERGED => return Ok(now),
                _ => damping = if damping == 0.0 { 1e-3 } else { damping * 10.0 },
            }
        }
        Err(now.not_converged())
    }

    /// The same with bounded influence: residuals longer than [`HUBER_BOUND`] weigh no more than one of
    /// that length (Huber 1981, chapter 7, by iterative reweighting). The scale is that of
    /// [`noise_factor`], so that noise larger than was claimed does not make outliers of half the
    /// observations. The chi-square is that of least squares.
    pub(super) fn bounded_from(&self, views: &[View], least: Solution) -> Solution {
        let scale = noise_factor(least.chi_square, 0.0, least.redundancy).max(1.0);
        if least.longest <= HUBER_BOUND.powi(2) * scale {
            return least;
        }
        let mut now = least.clone();
        for _ in 0..MAX_STEPS {
            let Ok((at, gradient)) = self.equations(views, &now.world_from_body, Some(scale)) else {
                return least;
            };
            let Some(step) = at.normal.cholesky().map(|c| c.solve(&gradient)) else { return least };
            now = Solution { world_from_body: moved(&at.world_from_body, &step), ..at };
            if step.dot(&gradient) < 1e-6 {
                return Solution { chi_square: least.chi_square, ..now };
            }
        }
        least
    }

    /// What one standard deviation along each direction of error of cameras, marker positions and centres
    /// does to the pose, and the mean chi-square that all of them together leave in the residuals.
    /// `inverse` is that of the normal equations.
    pub(super) fn systematic(
        &self,
        views: &[View],
        solution: &Solution,
        inverse: &Matrix6<f64>,
    ) -> (Matrix6xX<f64>, f64) {
        let mut effects = Matrix6xX::zeros(self.errors.columns());
        if effects.is_empty() {
            return (effects, 0.0);
        }
        let pose = &solution.world_from_body;
        let turn = matrix_of(&pose.rotation);
        let mut squares = 0.0;
        for s in views {
            let body: &BodyMarker = &self.markers[s.marker];
            let centre = (pose * Point3::from(body.marker_in_body_m)).coords;
            let (Ok(seen), Ok(by_camera)) =
                (self.projected(s, pose), self.cameras[s.camera].d_pixel_d_camera(&centre))
            else {
                continue;
            };
            let jacobian = s.whitener * d_pixel_d_pose(&seen, pose, &body.marker_in_body_m);
            let square = (s.whitener * (s.pixel - seen.pixel)).norm_squared();
            let weight = solution.bound_scale.map_or(1.0, |scale| noise_weight(square, scale));
            let weighted = jacobian.transpose() * weight;
            let by_camera = s.whitener * by_camera;
            let by_marker = s.whitener * seen.d_pixel_d_point_in_world * turn;
            let mut add = |column: usize, effect: Vector2<f64>| {
                squares += effect.norm_squared();
                let mut sum = effects.column_mut(column);
                sum += weighted * effect;
            };
            self.errors.effects((s.camera, s.marker), &by_camera, &by_marker, &s.whitener, &mut add);
        }
        let mut taken = 0.0;
        for mut column in effects.column_iter_mut() {
            let right: Vector6<f64> = column.clone_owned();
            let effect = inverse * right;
            taken += effect.dot(&right);
            column.copy_from(&effect);
        }
        (effects, (squares - taken).max(0.0))
    }

    /// Root mean square distance between the markers of two poses.
    pub(super) fn apart_m(&self, used: &[usize], a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let square = |m: &usize| {
            let at: Vector3<f64> = self.markers[*m].marker_in_body_m;
            ((a * Point3::from(at)) - (b * Point3::from(at))).norm_squared()
        };
        (used.iter().map(square).sum::<f64>() / used.len().max(1) as f64).sqrt()
    }
}
