//! The direct linear transformation of eleven parameters, its camera, and its fit to control points.

use crate::attitude::rotation_of;
use crate::linear::{centroid_and_spread, whitener};
use crate::svd::jacobi_svd;
use crate::{Camera, GeometryError, ImageSize, Intrinsics};
use nalgebra::{
    DMatrix, Isometry3, Matrix2, Matrix3, Matrix3x4, Matrix4, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// A point of known place and its image.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlPoint {
    /// Its name in messages.
    pub name: String,
    /// Its surveyed place.
    pub point_in_world_m: Vector3<f64>,
    /// The centre of its image.
    pub pixel: Vector2<f64>,
    /// Covariance of that.
    pub pixel_cov_px2: Matrix2<f64>,
}

/// u = (L1 X + L2 Y + L3 Z + L4)/(L9 X + L10 Y + L11 Z + 1), v likewise with L5 to L8 (Abdel-Aziz & Karara
/// 1971).
///
/// X, Y, Z in metres in the world, u, v in pixels. A camera whose focal plane holds the world's origin has
/// none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dlt {
    /// L1 to L11.
    pub l: [f64; 11],
}

/// Points whose spread off their best plane is below this share of their extent count as coplanar: a frame of
/// 3 m would have to be placed to 3 mm, a usual placing error, for that depth to mean anything.
const COPLANAR_RATIO: f64 = 1e-3;

impl Dlt {
    /// The parameters of a projection matrix of any scale.
    ///
    /// # Errors
    /// [`GeometryError::OriginInFocalPlane`] when the last entry is zero to rounding.
    pub fn from_matrix(matrix: &Matrix3x4<f64>) -> Result<Self, GeometryError> {
        let scale = matrix[(2, 3)];
        let relative_depth = scale / matrix.row(2).norm();
        if !relative_depth.is_finite() || relative_depth.abs() <= 1e-9 {
            return Err(GeometryError::OriginInFocalPlane { relative_depth });
        }
        let l = std::array::from_fn(|k| matrix[(k / 4, k % 4)] / scale);
        if l.iter().any(|x: &f64| !x.is_finite()) {
            return Err(GeometryError::NotFinite { what: "a DLT parameter" });
        }
        Ok(Self { l })
    }

    /// The parameters of a camera; its distortion is left out.
    ///
    /// # Errors
    /// [`GeometryError::OriginInFocalPlane`].
    pub fn from_camera(camera: &Camera) -> Result<Self, GeometryError> {
        Self::from_matrix(&camera.matrix())
    }

    /// The projection matrix whose last entry is 1.
    pub fn matrix(&self) -> Matrix3x4<f64> {
        Matrix3x4::from_fn(|i, j| self.l.get(4 * i + j).copied().unwrap_or(1.0))
    }

    /// The image of a world point.
    ///
    /// # Errors
    /// [`GeometryError::BehindCamera`] for a point on the focal plane. The scale of the parameters hides the
    /// sign of the depth, so a point behind the camera has an image here: use [`Camera::project`] where that
    /// matters.
    pub fn project(&self, point_in_world_m: &Vector3<f64>) -> Result<Vector2<f64>, GeometryError> {
        let h = self.matrix() * point_in_world_m.push(1.0);
        let pixel = Vector2::new(h.x / h.z, h.y / h.z);
        if pixel.iter().all(|x| x.is_finite()) {
            Ok(pixel)
        } else {
            Err(GeometryError::BehindCamera { depth_m: h.z })
        }
    }

    /// The camera of the parameters, by RQ decomposition with positive focal lengths; skew is kept.
    ///
    /// Parameters of a mirrored image (table 1 of the paper is one: its u grows leftwards) give the right
    /// centre and focal lengths, but a camera that looks away from the scene: [`Dlt::fit`] refuses such
    /// points.
    ///
    /// # Errors
    /// [`GeometryError::UndeterminedCamera`] when the left 3×3 block is singular, an affine or degenerate view, and
    /// where the camera is too far away for its place to be a number.
    pub fn camera(&self, size: ImageSize) -> Result<Camera, GeometryError> {
        let undetermined = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
        let p = self.matrix();
        let left: Matrix3<f64> = p.fixed_columns::<3>(0).into_owned();
        let (k, rotation) = rq(&(left * left.determinant().signum())).ok_or(undetermined.clone())?;
        let centre = -(left.try_inverse().ok_or(undetermined.clone())? * p.column(3));
        let cam_from_world = Isometry3::from_parts(Translation3::from(-(rotation * centre)), rotation);
        let camera = Camera::undistorted(cam_from_world, Intrinsics::from_matrix(&k), size);
        // Numbers near the largest overflow on the way to and fro.
        let is_finite = camera.centre_in_world().iter().chain(k.iter()).all(|x| x.is_finite());
        if is_finite { Ok(camera) } else { Err(undetermined) }
    }

    /// The linear least-squares fit to six control points or more: the start of a bundle adjustment.
    ///
    /// The null vector, by Jacobi rotations, of the equations in normalised coordinates (Hartley 1997), each
    /// point weighted by the inverse of its pixel's standard deviation.
    ///
    /// # Errors
    /// [`GeometryError::TooFewControlPoints`], [`GeometryError::CoplanarControlPoints`],
    /// [`GeometryError::UndeterminedCamera`], [`GeometryError::OriginInFocalPlane`],
    /// [`GeometryError::NotFinite`]; [`GeometryError::MirroredImage`] and
    /// [`GeometryError::PointsOnBothSides`] for points that no camera sees.
    pub fn fit(control: &[ControlPoint]) -> Result<Self, GeometryError> {
        if control.len() < 6 {
            return Err(GeometryError::TooFewControlPoints { found: control.len(), needed: 6 });
        }
        let finite = control.iter().all(|c| {
            let numbers = c.point_in_world_m.iter().chain(c.pixel.iter()).chain(c.pixel_cov_px2.iter());
            numbers.copied().all(f64::is_finite)
        });
        if !finite {
            return Err(GeometryError::NotFinite { what: "a control point" });
        }
        if control.iter().any(|c| whitener(&c.pixel_cov_px2).is_none()) {
            return Err(GeometryError::NotFinite { what: "the inverse of a control pixel's covariance" });
        }
        refuse_plane(control)?;
        let dlt = Self::from_matrix(&linear(control)?)?;
        refuse_mirror(control, &dlt)?;
        Ok(dlt)
    }
}

/// M = K R with K upper triangular of positive diagonal, for a matrix of positive determinant.
fn rq(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, UnitQuaternion<f64>)> {
    let rows = [m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose()];
    let r3 = rows[2] / rows[2].norm();
    let across = rows[1] - r3 * rows[1].dot(&r3);
    let r2 = (across - r3 * across.dot(&r3)).normalize();
    let rotation = Matrix3::from_rows(&[r2.cross(&r3).transpose(), r2.transpose(), r3.transpose()]);
    let k = (m * rotation.transpose()).upper_triangle();
    let positive = (0..3).all(|i| k[(i, i)] > 0.0 && k[(i, i)].is_finite());
    (positive && rotation.iter().all(|x| x.is_finite())).then(|| (k, rotation_of(rotation)))
}

fn refuse_plane(control: &[ControlPoint]) -> Result<(), GeometryError> {
    let (centre, _) = centroid_and_spread(control.iter().map(|c| c.point_in_world_m));
    let rows = DMatrix::from_fn(control.len(), 3, |i, j| control[i].point_in_world_m[j] - centre[j]);
    let spread_m = jacobi_svd(&rows).singular_values / (control.len() as f64).sqrt();
    if spread_m[2] > COPLANAR_RATIO * spread_m[0] {
        return Ok(());
    }
    let extent_m = 2.0 * spread_m[0];
    let (spread_mm, needed_m) = (spread_m[2] * 1e3, 0.1 * extent_m);
    Err(GeometryError::CoplanarControlPoints { spread_mm, extent_m, needed_m })
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

/// The projection matrix of the null vector.
fn linear(control: &[ControlPoint]) -> Result<Matrix3x4<f64>, GeometryError> {
    let (pixel_mean, pixel_scale) = centroid_and_spread(control.iter().map(|c| c.pixel));
    let (world_mean, world_scale) = centroid_and_spread(control.iter().map(|c| c.point_in_world_m));
    if pixel_scale == 0.0 || world_scale == 0.0 {
        return Err(GeometryError::UndeterminedCamera { condition: f64::INFINITY });
    }
    let stds: Vec<f64> =
        control.iter().map(|c| (c.pixel_cov_px2.trace() / 2.0).sqrt() / pixel_scale).collect();
    let best = stds.iter().copied().fold(f64::MAX, f64::min);
    let mut a = DMatrix::zeros(2 * control.len(), 12);
    for (i, c) in control.iter().enumerate() {
        let pixel = (c.pixel - pixel_mean) / pixel_scale;
        let weighted = ((c.point_in_world_m - world_mean) / world_scale).push(1.0) * (best / stds[i]);
        for k in 0..4 {
            a[(2 * i, k)] = weighted[k];
            a[(2 * i, 8 + k)] = -pixel.x * weighted[k];
            a[(2 * i + 1, 4 + k)] = weighted[k];
            a[(2 * i + 1, 8 + k)] = -pixel.y * weighted[k];
        }
    }
    let svd = jacobi_svd(&a);
    let condition = svd.singular_values[0] / svd.singular_values[10];
    // The noise part of the matrix has entries of this standard deviation; its norm is about that times
    // sqrt(2n).
    let lost_in_noise = svd.singular_values[10] <= 2.0 * best * (a.nrows() as f64).sqrt();
    let last = svd.v[(11, 11)];
    if !condition.is_finite() || condition > 1e8 || lost_in_noise || last.abs() < 1e-9 {
        return Err(GeometryError::UndeterminedCamera { condition });
    }
    let normalised = Matrix3x4::from_fn(|i, j| svd.v[(4 * i + j, 11)] / last);
    let pixel_from_normal =
        Matrix3::new_nonuniform_scaling(&Vector2::repeat(pixel_scale)).append_translation(&pixel_mean);
    let normal_from_world = Matrix4::new_translation(&-world_mean).append_scaling(1.0 / world_scale);
    Ok(pixel_from_normal * normalised * normal_from_world)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use mavsight_random::Random;

    const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };
    /// Table 1 of the paper.
    const TABLE_1: [[f64; 11]; 2] = [
        [
            -106.7667, -35.6386, 0.0880, 320.4361, -26.7309, 26.7541, -100.6446, 391.5768, -0.1110, 0.1109,
            0.0001,
        ],
        [-35.5769, 106.7356, 0.0572, 320.4868, 26.7668, 26.7286, -100.6437, 391.5773, 0.1111, 0.1109, 0.0002],
    ];

    #[test]
    fn table_1_of_the_paper_decomposes_into_its_set_up() {
        let printed = [
            ([4.507, -4.507, 1.495], [641.6, 641.6], [320.8, 240.6], 0.6),
            ([-4.506, -4.505, 1.496], [641.3, 641.4], [320.0, 240.2], 0.1),
        ];
        for (l, (centre, focal, principal, skew)) in TABLE_1.iter().zip(printed) {
            let camera = Dlt { l: *l }.camera(SIZE).unwrap();
            let k = camera.intrinsics;
            for (got, want) in camera.centre_in_world().iter().zip(centre) {
                assert!((got - want).abs() <= 0.001, "centre {got} against {want}");
            }
            for (got, want) in [k.fx_px, k.fy_px, k.cx_px, k.cy_px, k.skew_px.abs()].iter().zip([
                focal[0],
                focal[1],
                principal[0],
                principal[1],
                skew,
            ]) {
                assert!((got - want).abs() <= 0.1, "{got} against {want} px");
            }
            let target = camera.cam_from_world * nalgebra::Point3::new(0.0, 0.0, 1.5);
            assert!((target.z + 6.37).abs() < 0.02, "table 1 counts u leftwards: its images are mirrored");
        }
    }

    /// A coefficient of 1e308 was a camera whose centre is not finite.
    #[test]
    fn a_camera_whose_place_is_no_number_is_refused() {
        let mut random = Random::new(54, 0);
        let mut taken = 0;
        for _ in 0..20_000 {
            let l: [f64; 11] =
                std::array::from_fn(|_| random.normal() * 10f64.powf(random.between(-3.0, 3.0)));
            let far: [f64; 11] = std::array::from_fn(|k| if k % 4 == 3 { 1e305 * l[k] } else { l[k] });
            if let Ok(camera) = (Dlt { l: far }).camera(SIZE) {
                assert!(camera.centre_in_world().iter().all(|x| x.is_finite()), "{far:?}");
                taken += 1;
            }
        }
        assert!((1..20_000).contains(&taken), "{taken} of 20000 cameras");
    }

    #[test]
    fn a_camera_survives_the_round_trip_with_its_skew() {
        let mut k = Intrinsics::from_horizontal_fov(SIZE, 1.0);
        k.skew_px = 1.3;
        k.fy_px *= 1.02;
        let camera = Camera::looking_at(Vector3::new(1.0, -4.0, 2.0), Vector3::new(0.2, 0.0, 1.0), k, SIZE);
        let dlt = Dlt::from_camera(&camera).unwrap();
        let back = dlt.camera(SIZE).unwrap();
        assert_relative_eq!(back.matrix(), camera.matrix(), epsilon = 1e-9);
        let point = Vector3::new(0.3, 0.4, 0.9);
        assert_relative_eq!(
            dlt.project(&point).unwrap(),
            camera.project(&point).unwrap().pixel,
            epsilon = 1e-9
        );
    }

    #[test]
    fn an_origin_behind_the_camera_keeps_the_camera_upright() {
        let k = Intrinsics::from_horizontal_fov(SIZE, 1.0);
        let camera = Camera::looking_at(Vector3::new(1.0, 0.0, 0.0), Vector3::new(5.0, 0.5, 0.0), k, SIZE);
        let back = Dlt::from_camera(&camera).unwrap().camera(SIZE).unwrap();
        assert_relative_eq!(back.matrix(), camera.matrix(), epsilon = 1e-9);
    }

    #[test]
    fn what_has_no_parameters_is_refused() {
        let k = Intrinsics::from_horizontal_fov(SIZE, 1.0);
        let beside = Camera::looking_at(Vector3::new(0.0, -1.0, 0.0), Vector3::new(5.0, -1.0, 0.0), k, SIZE);
        assert!(matches!(Dlt::from_camera(&beside), Err(GeometryError::OriginInFocalPlane { .. })));
        let flat = Dlt { l: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] };
        assert!(matches!(flat.camera(SIZE), Err(GeometryError::UndeterminedCamera { .. })));
        assert!(Dlt { l: [f64::NAN; 11] }.camera(SIZE).is_err());
        assert!(Dlt::from_matrix(&Matrix3x4::zeros()).is_err());
    }

    fn camera() -> Camera {
        let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
        Camera::looking_at(Vector3::new(4.5, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), k, SIZE)
    }

    fn cube(camera: &Camera, std_px: f64, seed: u64) -> Vec<ControlPoint> {
        let (mut out, mut random) = (vec![], Random::new(seed, 0));
        for i in 0..8 {
            let side = |bit: i32| if i >> bit & 1 == 1 { 1.5 } else { -1.5 };
            let point = Vector3::new(side(0), side(1), side(2) + 1.5);
            let pixel = camera.project(&point).unwrap().pixel;
            let noise = Vector2::from(random.normals()) * std_px;
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
        let points = cube(&truth, 0.0, 1);
        let dlt = Dlt::fit(&points).unwrap();
        let got = dlt.camera(SIZE).unwrap();
        assert!((got.centre_in_world() - truth.centre_in_world()).norm() < 1e-9);
        assert!((got.intrinsics.fx_px - truth.intrinsics.fx_px).abs() < 1e-7);
        assert!(points.iter().all(|p| (dlt.project(&p.point_in_world_m).unwrap() - p.pixel).norm() < 1e-9));
    }

    #[test]
    fn a_far_point_of_low_weight_does_not_pull_the_fit() {
        let truth = camera();
        let mut points = cube(&truth, 0.0, 1);
        points[2].pixel += Vector2::new(5.0, -5.0);
        points[2].pixel_cov_px2 = Matrix2::identity() * 1e8;
        let dlt = Dlt::fit(&points).unwrap();
        let centre = dlt.camera(SIZE).unwrap().centre_in_world();
        assert!((centre - truth.centre_in_world()).norm() < 1e-3);
        let residual = points[2].pixel - dlt.project(&points[2].point_in_world_m).unwrap();
        assert!((residual - Vector2::new(5.0, -5.0)).norm() < 1e-2);
    }

    #[test]
    fn a_mirrored_image_is_refused() {
        let mut points = cube(&camera(), 0.1, 9);
        points.iter_mut().for_each(|p| p.pixel.x = 639.0 - p.pixel.x);
        assert_eq!(Dlt::fit(&points), Err(GeometryError::MirroredImage));
    }

    #[test]
    fn what_does_not_determine_a_camera_is_refused() {
        let points = cube(&camera(), 0.1, 5);
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
