//! A point from its images in two or more cameras.

use crate::{Camera, GeometryError};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};

/// A triangulated point.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulation {
    /// The point in world coordinates.
    pub point_in_world_m: Vector3<f64>,
    /// Its covariance, from those of the pixels alone: the cameras count as exact.
    pub covariance_m2: Matrix3<f64>,
    /// Root mean square of the reprojection errors over all coordinates.
    pub residual_px: f64,
}

/// Steps of Gauss-Newton; the start is within a pixel, three suffice.
const MAX_STEPS: usize = 10;

/// The point whose images fit the measured pixels best, each weighted by the inverse of its covariance.
///
/// Starts from the point nearest to the rays (linear least squares by QR) and minimises the reprojection error by
/// Gauss-Newton (Hartley & Sturm 1997).
///
/// # Errors
/// [`GeometryError::TooFewRays`]; [`GeometryError::ParallelRays`] when the largest angle between two rays is no more
/// than three standard deviations of a ray's own direction; [`GeometryError::BehindCamera`];
/// [`GeometryError::NotFinite`]; [`GeometryError::UndistortionDiverged`].
pub fn triangulate(sights: &[(&Camera, Vector2<f64>, Matrix2<f64>)]) -> Result<Triangulation, GeometryError> {
    if sights.len() < 2 {
        return Err(GeometryError::TooFewRays { found: sights.len() });
    }
    let whiteners: Vec<Matrix2<f64>> =
        sights.iter().map(|(_, _, covariance)| whitener(covariance)).collect::<Result<_, _>>()?;
    let mut point = nearest_to_rays(sights)?;
    let rows = 2 * sights.len();
    let mut covariance_m2 = Matrix3::zeros();
    let mut sum_px2 = 0.0;
    for step in 0..=MAX_STEPS {
        let mut jacobian = DMatrix::zeros(rows, 3);
        let mut residual = DVector::zeros(rows);
        sum_px2 = 0.0;
        for (i, ((camera, pixel, _), w)) in sights.iter().zip(&whiteners).enumerate() {
            let seen = camera.project(&point)?;
            let error = pixel - seen.pixel;
            sum_px2 += error.norm_squared();
            jacobian.fixed_view_mut::<2, 3>(2 * i, 0).copy_from(&(w * seen.d_pixel_d_point_in_world));
            residual.fixed_rows_mut::<2>(2 * i).copy_from(&(w * error));
        }
        let (change, inverse_r) = solve_least_squares(&jacobian, &residual)?;
        let inverse_r = Matrix3::from_fn(|i, j| inverse_r[(i, j)]);
        covariance_m2 = inverse_r * inverse_r.transpose();
        if step == MAX_STEPS || change.norm() < 1e-12 * (1.0 + point.norm()) {
            break;
        }
        point += Vector3::new(change[0], change[1], change[2]);
    }
    Ok(Triangulation { point_in_world_m: point, covariance_m2, residual_px: (sum_px2 / rows as f64).sqrt() })
}

/// W with Wᵀ W = covariance⁻¹.
fn whitener(covariance_px2: &Matrix2<f64>) -> Result<Matrix2<f64>, GeometryError> {
    let not_finite = GeometryError::NotFinite { what: "the inverse of a pixel's covariance" };
    let factor = covariance_px2.cholesky().ok_or(not_finite.clone())?;
    factor.l().try_inverse().filter(|w| w.iter().all(|x| x.is_finite())).ok_or(not_finite)
}

/// Least squares by QR: the solution and R⁻¹, whose product with its transpose is the covariance of unit noise.
fn solve_least_squares(
    a: &DMatrix<f64>,
    b: &DVector<f64>,
) -> Result<(DVector<f64>, DMatrix<f64>), GeometryError> {
    let undetermined = GeometryError::NotFinite { what: "the triangulated point" };
    let qr = a.clone().qr();
    let r = qr.r();
    let n = a.ncols();
    let inverse = r.solve_upper_triangular(&DMatrix::identity(n, n)).ok_or(undetermined.clone())?;
    let x = &inverse * (qr.q().transpose() * b);
    if x.iter().chain(inverse.iter()).all(|v| v.is_finite()) { Ok((x, inverse)) } else { Err(undetermined) }
}

fn nearest_to_rays(sights: &[(&Camera, Vector2<f64>, Matrix2<f64>)]) -> Result<Vector3<f64>, GeometryError> {
    let mut rays = Vec::with_capacity(sights.len());
    let mut noise_rad = 0.0_f64;
    for (camera, pixel, covariance) in sights {
        if !pixel.iter().all(|x| x.is_finite()) {
            return Err(GeometryError::NotFinite { what: "a pixel coordinate" });
        }
        rays.push(camera.ray(pixel)?);
        noise_rad = noise_rad.max((covariance.trace() / 2.0).sqrt() / camera.intrinsics.fx_px.abs());
    }
    let mut sine = 0.0_f64;
    for (i, a) in rays.iter().enumerate() {
        for b in &rays[i + 1..] {
            sine = sine.max(a.cross(b).norm());
        }
    }
    if sine <= (3.0 * noise_rad).max(1e-9) {
        return Err(GeometryError::ParallelRays { angle_deg: sine.min(1.0).asin().to_degrees() });
    }
    let rows = 2 * rays.len();
    let mut a = DMatrix::zeros(rows, 3);
    let mut b = DVector::zeros(rows);
    for (i, (ray, (camera, _, _))) in rays.iter().zip(sights).enumerate() {
        let first = ray.cross(&Vector3::ith(ray.abs().imin(), 1.0)).normalize();
        let second = ray.cross(&first);
        let centre = camera.centre_in_world();
        for (k, across) in [first, second].iter().enumerate() {
            a.set_row(2 * i + k, &across.transpose());
            b[2 * i + k] = across.dot(&centre);
        }
    }
    let (x, _) = solve_least_squares(&a, &b)?;
    Ok(Vector3::new(x[0], x[1], x[2]))
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

    proptest! {
        #[test]
        fn exact_images_give_the_point_back(x in -1.0..1.0, y in -1.0..1.0, z in 0.5..2.5, used in 2usize..=3) {
            let cameras = cameras();
            let truth = Vector3::new(x, y, z);
            let sights: Vec<_> = cameras[..used].iter()
                .map(|c| (c, c.project(&truth).unwrap().pixel, Matrix2::identity() * 0.01)).collect();
            let got = triangulate(&sights).unwrap();
            prop_assert!((got.point_in_world_m - truth).norm() < 1e-10);
            prop_assert!(got.residual_px < 1e-9);
        }
    }

    #[test]
    fn covariance_is_the_spread_of_many_trials() {
        let cameras = cameras();
        let truth = Vector3::new(0.3, -0.2, 1.2);
        let std_px = [0.2, 0.4];
        let mut seed = 7u64;
        let mut sum = Matrix3::zeros();
        let mut claimed = Matrix3::zeros();
        let trials = 4000;
        for _ in 0..trials {
            let sights: Vec<_> = cameras
                .iter()
                .take(2)
                .map(|c| {
                    let noise = Vector2::new(
                        crate::testing::normal(&mut seed) * std_px[0],
                        crate::testing::normal(&mut seed) * std_px[1],
                    );
                    let covariance =
                        Matrix2::from_diagonal(&Vector2::new(std_px[0].powi(2), std_px[1].powi(2)));
                    (c, c.project(&truth).unwrap().pixel + noise, covariance)
                })
                .collect();
            let got = triangulate(&sights).unwrap();
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
        let one = [(&cameras[0], pixel, Matrix2::identity())];
        assert!(matches!(triangulate(&one), Err(GeometryError::TooFewRays { found: 1 })));
        let twice = [one[0], one[0]];
        assert!(matches!(triangulate(&twice), Err(GeometryError::ParallelRays { .. })));
        let nan = [one[0], (&cameras[1], Vector2::new(f64::NAN, 0.0), Matrix2::identity())];
        assert!(matches!(triangulate(&nan), Err(GeometryError::NotFinite { .. })));
        let no_noise = [one[0], (&cameras[1], pixel, Matrix2::zeros())];
        assert!(matches!(triangulate(&no_noise), Err(GeometryError::NotFinite { .. })));
    }
}
