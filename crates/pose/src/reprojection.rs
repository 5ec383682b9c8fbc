//! Reprojection residuals of a rigid body in all cameras, and the pose of which they are least.

use crate::{BodyMarker, MarkerObservation, PoseError};
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{
    Camera, GeometryError, ImagePoint, Isometry3, Matrix2, Matrix6, Point3, Projection, UnitQuaternion,
    Vector2, Vector3, whitener,
};
use nalgebra::{Matrix2x6, Translation3, Vector6};

/// Huber's bound for the length of a whitened residual in the plane: 95 % efficient where the noise is
/// normal. From (E[ψ'/2 + ψ/2r])² / (E[ψ²]/2) = 0.95 with r of a Rayleigh distribution (Huber 1981, section
/// 8).
pub(crate) const HUBER_BOUND: f64 = 1.501;

/// Mean of half a squared whitened residual in the plane as Huber's weights with that bound leave it, where
/// the noise is normal: a scale estimated from them is divided by it (Huber 1981, section 6.4).
pub(crate) const HUBER_MEAN: f64 = 0.801;

/// Added to the information on a body's turn, of its largest: points on one line do not show a turn about it.
const NO_TURN: f64 = 1e-9;

/// A point of a body in the image of a camera.
#[derive(Clone, Copy)]
pub(crate) struct PointObservation {
    pub(crate) camera: usize,
    pub(crate) point: usize,
    pub(crate) pixel: Vector2<f64>,
    /// As it is stated.
    pub(crate) covariance_px2: Matrix2<f64>,
    /// Wᵀ W is the inverse of the covariance.
    pub(crate) whitener: Matrix2<f64>,
    /// Velocity of the image, by which it moves where its camera is not in step; zero where it is.
    pub(crate) velocity_px_s: Vector2<f64>,
}

impl PointObservation {
    /// `None` for a pixel that is not finite, or a covariance that is not positive definite.
    pub(crate) fn new(
        camera: usize,
        point: usize,
        pixel: Vector2<f64>,
        covariance_px2: Matrix2<f64>,
    ) -> Option<Self> {
        let whitener = whitener(&covariance_px2).filter(|_| pixel.iter().all(|x| x.is_finite()))?;
        let velocity_px_s = Vector2::zeros();
        Some(Self { camera, point, pixel, covariance_px2, whitener, velocity_px_s })
    }

    /// The observation of a marker by one of `cameras` cameras, of a body with `points` points.
    pub(crate) fn of(o: &MarkerObservation, cameras: usize, points: usize) -> Result<Self, PoseError> {
        let bad = |reason| PoseError::BadObservation { camera: o.camera, marker: o.marker, reason };
        if o.camera >= cameras {
            return Err(bad("the rig has no such camera"));
        }
        if o.marker >= points {
            return Err(bad("the body has no such point (an aircraft has 64 markers at most)"));
        }
        Self::new(o.camera, o.marker, o.pixel, o.covariance_px2)
            .ok_or(bad("it is not finite, or its covariance not positive definite"))
    }

    /// The observation as a point in its camera's image.
    pub(crate) fn in_image<'a>(&self, camera: &'a Camera) -> ImagePoint<'a> {
        ImagePoint { camera, pixel: self.pixel, covariance_px2: self.covariance_px2 }
    }

    /// This observation with a factor on its covariance.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        let (covariance_px2, whitener) = (self.covariance_px2 * factor, self.whitener / factor.sqrt());
        Self { covariance_px2, whitener, ..*self }
    }

    /// This pixel with independent coordinates of a variance.
    pub(crate) fn with_variance(&self, variance_px2: f64) -> Self {
        let unit = Matrix2::identity();
        Self { covariance_px2: unit * variance_px2, whitener: unit / variance_px2.sqrt(), ..*self }
    }
}

/// Square of the length beyond which a residual's influence is bounded, under a factor on covariances.
pub(crate) fn bound2(factor: f64) -> f64 {
    HUBER_BOUND * HUBER_BOUND * factor
}

/// Huber's weight of a squared whitened residual, and its loss in units of half its square.
pub(crate) fn huber(square: f64, bound2: f64) -> (f64, f64) {
    if square <= bound2 {
        return (1.0, square);
    }
    let weight = (bound2 / square).sqrt();
    (weight, square * weight * (2.0 - weight))
}

/// The pose after a small motion: position in world axes, turn about body axes.
pub(crate) fn moved(pose: &Isometry3<f64>, by: &Vector6<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + by.fixed_rows::<3>(0)),
        pose.rotation * UnitQuaternion::from_scaled_axis(Vector3::from(by.fixed_rows::<3>(3))),
    )
}

/// Points on one line do not show a turn about it: it keeps its value.
pub(crate) fn determine_turn(normal: &mut Matrix6<f64>) {
    let turning = NO_TURN * normal.diagonal().fixed_rows::<3>(3).max();
    (3..6).for_each(|k| normal[(k, k)] += turning);
}

#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) cameras: &'a [Camera],
    pub(crate) points: &'a [BodyMarker],
}

/// The predicted image of a point, and what is measured beyond it.
pub(crate) struct Reprojection {
    pub(crate) centre_in_world: Vector3<f64>,
    pub(crate) projection: Projection,
    /// Measured less predicted.
    pub(crate) residual_px: Vector2<f64>,
    pub(crate) whitened: Vector2<f64>,
    /// Whitened derivative of the prediction by the pose.
    pub(crate) by_pose: Matrix2x6<f64>,
}

/// A pose with its normal equations, or one of least loss.
#[derive(Clone, Default)]
pub(crate) struct PoseFit {
    pub(crate) world_from_body: Isometry3<f64>,
    /// Σ Jᵀ w J and Σ Jᵀ w r of the whitened residuals with Huber's weights.
    pub(crate) normal: Matrix6<f64>,
    pub(crate) gradient: Vector6<f64>,
    pub(crate) bound2: f64,
    pub(crate) loss: f64,
    /// Sum of the squared whitened residuals, and the largest of those.
    pub(crate) chi_square: f64,
    pub(crate) longest: f64,
    pub(crate) sum_px2: f64,
    pub(crate) coordinates: usize,
    /// Whether the iteration came to a minimum.
    pub(crate) is_converged: bool,
}

impl PoseFit {
    pub(crate) fn redundancy(&self) -> usize {
        self.coordinates.saturating_sub(6)
    }

    pub(crate) fn variance_factor(&self) -> f64 {
        if self.redundancy() == 0 { 1.0 } else { (self.chi_square / self.redundancy() as f64).max(1.0) }
    }

    pub(crate) fn residual_px(&self) -> f64 {
        (self.sum_px2 / self.coordinates.max(1) as f64).sqrt()
    }

    pub(crate) fn not_converged(&self, steps: usize) -> PoseError {
        PoseError::NotConverged { steps, residual_px: self.residual_px() }
    }
}

impl Scene<'_> {
    pub(crate) fn at(
        self,
        o: &PointObservation,
        pose: &Isometry3<f64>,
    ) -> Result<Reprojection, GeometryError> {
        let BodyMarker { marker_in_body_m, radius_m, .. } = &self.points[o.point];
        let centre_in_world = (pose * Point3::from(*marker_in_body_m)).coords;
        let projection = self.cameras[o.camera].project_ball(&centre_in_world, *radius_m)?;
        let residual_px = o.pixel - projection.pixel;
        Ok(Reprojection {
            centre_in_world,
            projection,
            residual_px,
            whitened: o.whitener * residual_px,
            by_pose: o.whitener * d_pixel_d_pose(&projection, pose, marker_in_body_m),
        })
    }

    /// The normal equations at a pose, with the influence of residuals beyond a bound ([`bound2`]) bounded.
    pub(crate) fn equations(
        self,
        observations: &[PointObservation],
        pose: &Isometry3<f64>,
        bound2: f64,
    ) -> Result<PoseFit, GeometryError> {
        let coordinates = 2 * observations.len();
        let mut out = PoseFit { world_from_body: *pose, bound2, coordinates, ..Default::default() };
        for o in observations {
            let at = self.at(o, pose)?;
            let square = at.whitened.norm_squared();
            let (weight, loss) = huber(square, bound2);
            let weighted = at.by_pose.transpose() * weight;
            out.normal += weighted * at.by_pose;
            out.gradient += weighted * at.whitened;
            out.loss += loss;
            out.chi_square += square;
            out.longest = out.longest.max(square);
            out.sum_px2 += at.residual_px.norm_squared();
        }
        Ok(out)
    }

    /// The pose of least loss, from one near (Levenberg 1944; Marquardt 1963). The step that promises to
    /// lower the loss by less than `converged` is the last: what remains after it is smaller by its square.
    pub(crate) fn descend(
        self,
        observations: &[PointObservation],
        start: &Isometry3<f64>,
        bound2: f64,
        converged: f64,
        most_steps: usize,
    ) -> Result<PoseFit, PoseError> {
        let mut now = self.equations(observations, start, bound2)?;
        let mut damping = 0.0;
        for steps in 0..most_steps {
            let mut damped = now.normal;
            damped.set_diagonal(&(damped.diagonal() * (1.0 + damping)));
            determine_turn(&mut damped);
            let factor = damped.cholesky().ok_or_else(|| now.not_converged(steps))?;
            let step = factor.solve(&now.gradient);
            let decrement = step.dot(&now.gradient);
            let tried = moved(&now.world_from_body, &step);
            if decrement < converged && damping < 1e-3 {
                return Ok(PoseFit { world_from_body: tried, is_converged: true, ..now });
            }
            match self.equations(observations, &tried, bound2) {
                Ok(next) if next.loss <= now.loss * (1.0 + 1e-12) + 1e-18 => {
                    now = next;
                    damping *= 0.1;
                }
                _ if decrement < converged => return Ok(PoseFit { is_converged: true, ..now }),
                _ => damping = f64::max(1e-3, damping * 10.0),
            }
        }
        Ok(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_under_the_bound_is_that_of_a_rayleigh_distribution() {
        let (step, mut mean) = (1e-4, 0.0);
        for k in 0..100_000 {
            let r = (f64::from(k) + 0.5) * step;
            mean += 0.5 * (r * r).min(HUBER_BOUND * r) * r * (-0.5 * r * r).exp() * step;
        }
        assert!((mean - HUBER_MEAN).abs() < 5e-4, "{mean}");
    }
}
