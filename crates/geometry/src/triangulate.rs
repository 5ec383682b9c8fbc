//! A point from its images in two or more cameras.

use crate::linear::whitener;
use crate::{Camera, GeometryError};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// The image of a point in a camera.
#[derive(Debug, Clone, Copy)]
pub struct ImagePoint<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The point in its image.
    pub pixel: Vector2<f64>,
    /// Covariance of that.
    pub covariance_px2: Matrix2<f64>,
}

/// A triangulated point.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulation {
    /// The point in world coordinates.
    pub point_in_world_m: Vector3<f64>,
    /// Covariance of that from the pixels alone: the cameras count as exact.
    pub covariance_m2: Matrix3<f64>,
    /// Root mean square of the reprojection residuals over all coordinates.
    pub residual_px: f64,
}

/// Gauss-Newton steps; the start is within a pixel, three suffice.
const MAX_STEPS: usize = 10;

/// Square of the last step that is none, in standard deviations of the point: a hundredth of one.
const LAST_STEP: f64 = 1e-4;

/// The point whose reprojection residuals are least, each weighted by the inverse of its covariance.
///
/// Starts from the point nearest to the rays and minimises the residuals by Gauss-Newton (Hartley & Sturm
/// 1997).
///
/// # Errors
/// [`GeometryError::TooFewRays`]; [`GeometryError::ParallelRays`] when the largest angle between two rays is
/// no more than three standard deviations of a ray's own direction; [`GeometryError::BehindCamera`];
/// [`GeometryError::NotFinite`]; [`GeometryError::UndistortionDiverged`]; [`GeometryError::TriangulationDiverged`].
pub fn triangulate(images: &[ImagePoint]) -> Result<Triangulation, GeometryError> {
    if images.len() < 2 {
        return Err(GeometryError::TooFewRays { found: images.len() });
    }
    let undetermined = GeometryError::NotFinite { what: "the triangulated point" };
    let not_finite = GeometryError::NotFinite { what: "the inverse of a pixel's covariance" };
    let mut whiteners = Vec::with_capacity(images.len());
    for image in images {
        whiteners.push(whitener(&image.covariance_px2).ok_or_else(|| not_finite.clone())?);
    }
    let mut point = nearest_to_rays(images)?;
    let mut step = 0;
    loop {
        let (mut normal, mut gradient, mut sum_px2) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
        for (image, w) in images.iter().zip(&whiteners) {
            let expected = image.camera.project(&point)?;
            let residual_px = image.pixel - expected.pixel;
            let jacobian = w * expected.d_pixel_d_point_in_world;
            sum_px2 += residual_px.norm_squared();
            normal += jacobian.tr_mul(&jacobian);
            gradient += jacobian.tr_mul(&(w * residual_px));
        }
        let factor = normal.cholesky().ok_or_else(|| undetermined.clone())?;
        let change = factor.solve(&gradient);
        if !change.iter().all(|x| x.is_finite()) {
            return Err(undetermined);
        }
        let has_ended = step == MAX_STEPS;
        if has_ended && change.dot(&gradient) > LAST_STEP {
            return Err(GeometryError::TriangulationDiverged { step_m: change.norm(), steps: MAX_STEPS });
        }
        if has_ended || change.norm() < 1e-12 * (1.0 + point.norm()) {
            let residual_px = (sum_px2 / (2 * images.len()) as f64).sqrt();
            let covariance_m2 = factor.inverse();
            return Ok(Triangulation { point_in_world_m: point, covariance_m2, residual_px });
        }
        point += change;
        step += 1;
    }
}

/// The point of the least sum of squared distances from the rays.
fn nearest_to_rays(images: &[ImagePoint]) -> Result<Vector3<f64>, GeometryError> {
    let (mut rays, mut noise_rad, mut sine) = (Vec::<Vector3<f64>>::new(), 0.0_f64, 0.0_f64);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ImagePoint { camera, pixel, covariance_px2 } in images {
        if !pixel.iter().all(|x| x.is_finite()) {
            return Err(GeometryError::NotFinite { what: "a pixel coordinate" });
        }
        let ray = camera.ray(pixel)?;
        sine = rays.iter().fold(sine, |sine, other| sine.max(other.cross(&ray).norm()));
        rays.push(ray);
        noise_rad = noise_rad.max((covariance_px2.trace() / 2.0).sqrt() / camera.intrinsics.fx_px.abs());
        let across = Matrix3::identity() - ray * ray.transpose();
        normal += across;
        right += across * camera.centre_in_world();
    }
    if sine <= (3.0 * noise_rad).max(1e-6) {
        return Err(GeometryError::ParallelRays { angle_deg: sine.min(1.0).asin().to_degrees() });
    }
    let undetermined = GeometryError::NotFinite { what: "the triangulated point" };
    normal.cholesky().map(|factor| factor.solve(&right)).ok_or(undetermined)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageSize, Intrinsics};
    use proptest::prelude::*;

    fn cameras() -> [Camera; 3] {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
        let target = Vector3::new(0.0, 0.0, 1.5);
        [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5], [0.0, 5.0, 3.0]]
            .map(|c| Camera::looking_at(Vector3::from(c), target, k, size))
    }

    fn image(camera: &Camera, pixel: Vector2<f64>, covariance_px2: Matrix2<f64>) -> ImagePoint<'_> {
        ImagePoint { camera, pixel, covariance_px2 }
    }

    proptest! {
        #[test]
        fn exact_images_give_the_point_back(x in -1.0..1.0, y in -1.0..1.0, z in 0.5..2.5, used in 2usize..=3) {
            let cameras = cameras();
            let truth = Vector3::new(x, y, z);
            let images: Vec<_> = cameras[..used].iter()
                .map(|c| image(c, c.project(&truth).unwrap().pixel, Matrix2::identity() * 0.01)).collect();
            let got = triangulate(&images).unwrap();
            prop_assert!((got.point_in_world_m - truth).norm() < 1e-10);
            prop_assert!(got.residual_px < 1e-9);
        }
    }

    #[test]
    fn covariance_is_the_spread_of_many_trials() {
        let cameras = cameras();
        let truth = Vector3::new(0.3, -0.2, 1.2);
        let std_px = [0.2, 0.4];
        let mut random = mavsight_random::Random::new(7, 0);
        let mut sum = Matrix3::zeros();
        let mut claimed = Matrix3::zeros();
        let trials = 4000;
        for _ in 0..trials {
            let images: Vec<_> = cameras
                .iter()
                .take(2)
                .map(|c| {
                    let noise = Vector2::new(random.normal() * std_px[0], random.normal() * std_px[1]);
                    let covariance =
                        Matrix2::from_diagonal(&Vector2::new(std_px[0].powi(2), std_px[1].powi(2)));
                    image(c, c.project(&truth).unwrap().pixel + noise, covariance)
                })
                .collect();
            let got = triangulate(&images).unwrap();
            let error = got.point_in_world_m - truth;
            sum += error * error.transpose();
            claimed = got.covariance_m2;
        }
        let whitened = claimed.cholesky().unwrap().inverse() * sum / f64::from(trials);
        assert!((whitened - Matrix3::identity()).norm() < 0.12, "{whitened}");
    }

    #[test]
    fn degenerate_rays_are_refused() {
        let cameras = cameras();
        let pixel = Vector2::new(319.5, 239.5);
        let one = [image(&cameras[0], pixel, Matrix2::identity())];
        assert!(matches!(triangulate(&one), Err(GeometryError::TooFewRays { found: 1 })));
        let twice = [one[0], one[0]];
        assert!(matches!(triangulate(&twice), Err(GeometryError::ParallelRays { .. })));
        let nan = [one[0], image(&cameras[1], Vector2::new(f64::NAN, 0.0), Matrix2::identity())];
        assert!(matches!(triangulate(&nan), Err(GeometryError::NotFinite { .. })));
        let no_noise = [one[0], image(&cameras[1], pixel, Matrix2::zeros())];
        assert!(matches!(triangulate(&no_noise), Err(GeometryError::NotFinite { .. })));
    }
}
