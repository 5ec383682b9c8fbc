//! Least-squares estimation of the eleven DLT parameters.

use crate::svd::jacobi_svd;
use crate::{ControlPoint, Dlt, DltFit, GeometryError};
use nalgebra::{
    DMatrix, DVector, Matrix2, Matrix3, Matrix3x4, Matrix4, SMatrix, SVector, Vector2, Vector3, Vector4,
};

/// Points whose spread off their best plane is below this share of their extent count as coplanar: a frame of 3 m
/// would have to be placed to 3 mm, a usual placing error, for that depth to mean anything.
const COPLANAR_RATIO: f64 = 1e-3;

/// Steps of Levenberg-Marquardt; from the linear start three or four suffice.
const MAX_STEPS: usize = 50;

/// Similarities that bring points to their centroid and unit scale per axis (Hartley 1997).
struct Normalised {
    pixels: Vec<Vector2<f64>>,
    points: Vec<Vector4<f64>>,
    whiteners: Vec<Matrix2<f64>>,
    pixel_from_normal: Matrix3<f64>,
    normal_from_world: Matrix4<f64>,
}

pub(crate) fn linear(control: &[ControlPoint]) -> Result<Dlt, GeometryError> {
    let (normal, start, _) = linear_start(control)?;
    let dlt = Dlt::from_matrix(&(normal.pixel_from_normal * matrix_of(&start) * normal.normal_from_world))?;
    refuse_mirror(control, &dlt)?;
    Ok(dlt)
}

fn linear_start(control: &[ControlPoint]) -> Result<(Normalised, SVector<f64, 11>, f64), GeometryError> {
    if control.len() < 6 {
        return Err(GeometryError::TooFewControlPoints { found: control.len(), needed: 6 });
    }
    let finite = control.iter().all(|c| {
        c.point_in_world_m.iter().chain(c.pixel.iter()).chain(c.pixel_cov_px2.iter()).all(|x| x.is_finite())
    });
    if !finite {
        return Err(GeometryError::NotFinite { what: "a control point" });
    }
    refuse_plane(control)?;
    let normal = normalise(control)?;
    let (start, condition) = null_vector(&normal)?;
    Ok((normal, start, condition))
}

pub(crate) fn fit(control: &[ControlPoint]) -> Result<DltFit, GeometryError> {
    let (normal, start, condition) = linear_start(control)?;
    let (parameters, inverse_r) = refine(&normal, start)?;
    let matrix = normal.pixel_from_normal * matrix_of(&parameters) * normal.normal_from_world;
    let dlt = Dlt::from_matrix(&matrix)?;
    refuse_mirror(control, &dlt)?;
    let to_pixels = jacobian_of_scale(&normal, &matrix);
    let root = to_pixels * inverse_r;
    let mut residuals_px = Vec::with_capacity(control.len());
    for c in control {
        residuals_px.push(c.pixel - dlt.project(&c.point_in_world_m)?);
    }
    let sum: f64 = residuals_px.iter().map(|r| r.norm_squared()).sum();
    let rms_px = (sum / (2 * control.len()) as f64).sqrt();
    Ok(DltFit { dlt, residuals_px, rms_px, condition, covariance: root * root.transpose() })
}

fn refuse_plane(control: &[ControlPoint]) -> Result<(), GeometryError> {
    let n = control.len() as f64;
    let centre = control.iter().map(|c| c.point_in_world_m).sum::<Vector3<f64>>() / n;
    let rows = DMatrix::from_fn(control.len(), 3, |i, j| control[i].point_in_world_m[j] - centre[j]);
    let spread = jacobi_svd(&rows).singular_values / n.sqrt();
    let extent_m = 2.0 * spread[0];
    if spread[2] <= COPLANAR_RATIO * spread[0] {
        return Err(GeometryError::CoplanarControlPoints {
            spread_mm: spread[2] * 1e3,
            extent_m,
            needed_m: 0.1 * extent_m,
        });
    }
    Ok(())
}

/// All points must be on the side of the focal plane towards which a camera of positive focal lengths looks.
fn refuse_mirror(control: &[ControlPoint], dlt: &Dlt) -> Result<(), GeometryError> {
    let p = dlt.matrix();
    let forward = p.fixed_columns::<3>(0).determinant().signum();
    let depths = control.iter().map(|c| forward * (p.row(2) * c.point_in_world_m.push(1.0))[0]);
    let behind = depths.filter(|d| *d <= 0.0).count();
    match behind {
        0 => Ok(()),
        all if all == control.len() => Err(GeometryError::MirroredImage),
        some => Err(GeometryError::PointsOnBothSides { behind: some, points: control.len() }),
    }
}

fn normalise(control: &[ControlPoint]) -> Result<Normalised, GeometryError> {
    let n = control.len() as f64;
    let pixel_mean = control.iter().map(|c| c.pixel).sum::<Vector2<f64>>() / n;
    let world_mean = control.iter().map(|c| c.point_in_world_m).sum::<Vector3<f64>>() / n;
    let pixel_square = control.iter().map(|c| (c.pixel - pixel_mean).norm_squared()).sum::<f64>() / n;
    let world_square =
        control.iter().map(|c| (c.point_in_world_m - world_mean).norm_squared()).sum::<f64>() / n;
    let pixel_scale = (pixel_square / 2.0).sqrt();
    let world_scale = (world_square / 3.0).sqrt();
    if pixel_scale == 0.0 || world_scale == 0.0 {
        return Err(GeometryError::UndeterminedCamera { condition: f64::INFINITY });
    }
    let mut normal_from_world = Matrix4::identity() / world_scale;
    normal_from_world.fixed_view_mut::<3, 1>(0, 3).copy_from(&(-world_mean / world_scale));
    normal_from_world[(3, 3)] = 1.0;
    let whiteners = control
        .iter()
        .map(|c| {
            let covariance = c.pixel_cov_px2 / (pixel_scale * pixel_scale);
            covariance
                .cholesky()
                .and_then(|f| f.l().try_inverse())
                .ok_or(GeometryError::NotFinite { what: "the inverse of a control pixel's covariance" })
        })
        .collect::<Result<_, _>>()?;
    Ok(Normalised {
        pixels: control.iter().map(|c| (c.pixel - pixel_mean) / pixel_scale).collect(),
        points: control.iter().map(|c| ((c.point_in_world_m - world_mean) / world_scale).push(1.0)).collect(),
        whiteners,
        pixel_from_normal: Matrix3::new(
            pixel_scale,
            0.0,
            pixel_mean.x,
            0.0,
            pixel_scale,
            pixel_mean.y,
            0.0,
            0.0,
            1.0,
        ),
        normal_from_world,
    })
}

/// The linear solution, scaled to a last entry of 1 (the depth of the centroid), and the equations' condition.
fn null_vector(normal: &Normalised) -> Result<(SVector<f64, 11>, f64), GeometryError> {
    let n = normal.pixels.len();
    let mut a = DMatrix::zeros(2 * n, 12);
    let stds: Vec<f64> =
        normal.whiteners.iter().map(|w| w.try_inverse().map_or(0.0, |s| s.norm() / 2f64.sqrt())).collect();
    let best = stds.iter().copied().fold(f64::MAX, f64::min);
    for (i, (pixel, point)) in normal.pixels.iter().zip(&normal.points).enumerate() {
        let weighted = point * (best / stds[i]);
        for k in 0..4 {
            a[(2 * i, k)] = weighted[k];
            a[(2 * i, 8 + k)] = -pixel.x * weighted[k];
            a[(2 * i + 1, 4 + k)] = weighted[k];
            a[(2 * i + 1, 8 + k)] = -pixel.y * weighted[k];
        }
    }
    let svd = jacobi_svd(&a);
    let condition = svd.singular_values[0] / svd.singular_values[10];
    // The noise part of the matrix has entries of this standard deviation; its norm is about that times sqrt(2n).
    let lost_in_noise = svd.singular_values[10] <= 2.0 * best * ((2 * n) as f64).sqrt();
    let last = svd.v[(11, 11)];
    if !condition.is_finite() || condition > 1e8 || lost_in_noise || last.abs() < 1e-9 {
        return Err(GeometryError::UndeterminedCamera { condition });
    }
    Ok((SVector::from_fn(|k, _| svd.v[(k, 11)] / last), condition))
}

fn matrix_of(parameters: &SVector<f64, 11>) -> Matrix3x4<f64> {
    Matrix3x4::from_fn(|i, j| parameters.as_slice().get(4 * i + j).copied().unwrap_or(1.0))
}

/// Whitened residuals and their Jacobian; `None` when a point comes to lie on the focal plane.
fn equations(normal: &Normalised, parameters: &SVector<f64, 11>) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let rows = 2 * normal.pixels.len();
    let (mut residual, mut jacobian) = (DVector::zeros(rows), DMatrix::zeros(rows, 11));
    let p = matrix_of(parameters);
    for (i, ((pixel, point), w)) in
        normal.pixels.iter().zip(&normal.points).zip(&normal.whiteners).enumerate()
    {
        let h = p * point;
        let seen = Vector2::new(h.x, h.y) / h.z;
        let mut d = SMatrix::<f64, 2, 11>::zeros();
        for k in 0..4 {
            let x = point[k] / h.z;
            d[(0, k)] = x;
            d[(1, 4 + k)] = x;
            if k < 3 {
                d[(0, 8 + k)] = -seen.x * x;
                d[(1, 8 + k)] = -seen.y * x;
            }
        }
        residual.fixed_rows_mut::<2>(2 * i).copy_from(&(w * (pixel - seen)));
        jacobian.fixed_view_mut::<2, 11>(2 * i, 0).copy_from(&(w * d));
    }
    residual.iter().chain(jacobian.iter()).all(|x| x.is_finite()).then_some((residual, jacobian))
}

/// Levenberg-Marquardt by QR of the augmented Jacobian; yields the parameters and R⁻¹ at the end.
fn refine(
    normal: &Normalised,
    start: SVector<f64, 11>,
) -> Result<(SVector<f64, 11>, SMatrix<f64, 11, 11>), GeometryError> {
    let undetermined = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
    let mut parameters = start;
    let (mut residual, mut jacobian) = equations(normal, &parameters).ok_or(undetermined.clone())?;
    let mut damping = 0.0;
    for _ in 0..MAX_STEPS {
        let step = damped_step(&jacobian, &residual, damping).ok_or(undetermined.clone())?;
        let tried = parameters + step;
        let better = equations(normal, &tried).filter(|(r, _)| r.norm_squared() <= residual.norm_squared());
        if let Some((r, j)) = better {
            parameters = tried;
            (residual, jacobian) = (r, j);
            damping *= 0.1;
        } else {
            damping = if damping == 0.0 { 1e-4 } else { damping * 10.0 };
        }
        if step.norm() <= 1e-13 * parameters.norm() {
            break;
        }
    }
    let r = jacobian.qr().r();
    let inverse = r.solve_upper_triangular(&DMatrix::identity(11, 11)).ok_or(undetermined.clone())?;
    if inverse.iter().all(|x| x.is_finite()) {
        Ok((parameters, SMatrix::from_fn(|i, j| inverse[(i, j)])))
    } else {
        Err(undetermined)
    }
}

fn damped_step(jacobian: &DMatrix<f64>, residual: &DVector<f64>, damping: f64) -> Option<SVector<f64, 11>> {
    let rows = jacobian.nrows();
    let mut a = DMatrix::zeros(rows + 11, 11);
    let mut b = DVector::zeros(rows + 11);
    a.rows_mut(0, rows).copy_from(jacobian);
    b.rows_mut(0, rows).copy_from(residual);
    for k in 0..11 {
        a[(rows + k, k)] = (damping * jacobian.column(k).norm_squared()).sqrt();
    }
    let qr = a.qr();
    let x = qr.r().solve_upper_triangular(&(qr.q().transpose() * b))?;
    x.iter().all(|v| v.is_finite()).then(|| SVector::from_fn(|i, _| x[i]))
}

/// d(L1..L11)/d(normalised parameters): L = P / P34 with P linear in the parameters.
fn jacobian_of_scale(normal: &Normalised, matrix: &Matrix3x4<f64>) -> SMatrix<f64, 11, 11> {
    let scale = matrix[(2, 3)];
    let mut out = SMatrix::zeros();
    for k in 0..11 {
        let mut unit = Matrix3x4::zeros();
        unit[(k / 4, k % 4)] = 1.0;
        let d = normal.pixel_from_normal * unit * normal.normal_from_world;
        for l in 0..11 {
            let at = (l / 4, l % 4);
            out[(l, k)] = (d[at] - matrix[at] / scale * d[(2, 3)]) / scale;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal;
    use crate::{Camera, ImageSize, Intrinsics};

    const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

    fn camera() -> Camera {
        let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
        Camera::looking_at(Vector3::new(4.5, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), k, SIZE)
    }

    fn cube(camera: &Camera, std_px: f64, seed: &mut u64) -> Vec<ControlPoint> {
        let mut out = vec![];
        for i in 0..8 {
            let side = |bit: i32| if i >> bit & 1 == 1 { 1.5 } else { -1.5 };
            let point = Vector3::new(side(0), side(1), side(2) + 1.5);
            let pixel = camera.project(&point).unwrap().pixel;
            let noise = Vector2::new(normal(seed), normal(seed)) * std_px;
            out.push(ControlPoint {
                name: format!("p{i}"),
                point_in_world_m: point,
                pixel: pixel + noise,
                pixel_cov_px2: Matrix2::identity() * std_px.max(1e-3).powi(2),
            });
        }
        out
    }

    #[test]
    fn exact_pixels_give_the_camera_back() {
        let truth = camera();
        let fit = Dlt::fit(&cube(&truth, 0.0, &mut 1)).unwrap();
        let got = fit.dlt.camera(SIZE).unwrap();
        assert!((got.centre_in_world() - truth.centre_in_world()).norm() < 1e-9);
        assert!((got.intrinsics.fx_px - truth.intrinsics.fx_px).abs() < 1e-7);
        assert!(fit.rms_px < 1e-9);
        assert!(fit.condition > 1.0 && fit.condition < 1e3, "{}", fit.condition);
    }

    #[test]
    fn covariance_is_the_spread_of_many_trials() {
        let truth = camera();
        let exact = SVector::<f64, 11>::from(Dlt::from_camera(&truth).unwrap().l);
        let mut seed = 3;
        let (mut nees, mut factor, trials) = (0.0, 0.0, 600);
        for _ in 0..trials {
            let points = cube(&truth, 0.2, &mut seed);
            let fit = Dlt::fit(&points).unwrap();
            let error = SVector::<f64, 11>::from(fit.dlt.l) - exact;
            let scale = fit.covariance.diagonal().map(f64::sqrt);
            let unit = SMatrix::<f64, 11, 11>::from_fn(|i, j| fit.covariance[(i, j)] / scale[i] / scale[j]);
            let error = error.component_div(&scale);
            nees += (error.transpose() * unit.try_inverse().unwrap() * error)[0];
            factor += fit.variance_factor(&points).unwrap();
        }
        let mean = nees / f64::from(trials);
        assert!((mean - 11.0).abs() < 4.0 * (22.0 / f64::from(trials)).sqrt() + 0.2, "mean NEES {mean}");
        let factor = factor / f64::from(trials);
        assert!(
            (factor - 1.0).abs() < 4.0 * (2.0 / 5.0 / f64::from(trials)).sqrt(),
            "variance factor {factor}"
        );
    }

    #[test]
    fn a_far_point_of_low_weight_does_not_pull_the_fit() {
        let truth = camera();
        let mut points = cube(&truth, 0.0, &mut 1);
        points[2].pixel += Vector2::new(5.0, -5.0);
        points[2].pixel_cov_px2 = Matrix2::identity() * 1e8;
        let fit = Dlt::fit(&points).unwrap();
        let centre = fit.dlt.camera(SIZE).unwrap().centre_in_world();
        assert!((centre - truth.centre_in_world()).norm() < 1e-3);
        assert!((fit.residuals_px[2] - Vector2::new(5.0, -5.0)).norm() < 1e-2);
    }

    #[test]
    fn a_mirrored_image_is_refused() {
        let mut points = cube(&camera(), 0.1, &mut 9);
        points.iter_mut().for_each(|p| p.pixel.x = 639.0 - p.pixel.x);
        assert_eq!(Dlt::fit(&points), Err(GeometryError::MirroredImage));
    }

    #[test]
    fn what_does_not_determine_a_camera_is_refused() {
        let points = cube(&camera(), 0.1, &mut 5);
        let few = Dlt::fit(&points[..5]);
        assert!(matches!(few, Err(GeometryError::TooFewControlPoints { found: 5, needed: 6 })));
        let mut flat: Vec<_> = points.iter().chain(&points).cloned().collect();
        for (i, p) in flat.iter_mut().enumerate() {
            p.point_in_world_m = Vector3::new((i as f64).cos(), (i as f64).sin(), 0.3 * i as f64);
            p.point_in_world_m.z = p.point_in_world_m.x - 0.5 * p.point_in_world_m.y;
        }
        assert!(matches!(Dlt::fit(&flat), Err(GeometryError::CoplanarControlPoints { .. })));
        let repeated: Vec<_> = points[..5].iter().chain(&points[..3]).cloned().collect();
        assert!(matches!(Dlt::fit(&repeated), Err(GeometryError::UndeterminedCamera { .. })));
        let mut nan = points.clone();
        nan[0].pixel.x = f64::NAN;
        assert!(matches!(Dlt::fit(&nan), Err(GeometryError::NotFinite { .. })));
        let mut sure = points;
        sure[0].pixel_cov_px2 = Matrix2::zeros();
        assert!(matches!(Dlt::fit(&sure), Err(GeometryError::NotFinite { .. })));
    }
}
