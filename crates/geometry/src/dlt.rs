//! The direct linear transformation of eleven parameters, and the camera that it means.

use crate::{BrownConrady, Camera, GeometryError, ImageSize, Intrinsics};
use nalgebra::{
    Isometry3, Matrix2, Matrix3, Matrix3x4, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector2,
    Vector3,
};

/// A point of known place and its image.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlPoint {
    /// Its name in messages.
    pub name: String,
    /// Where it is.
    pub point_in_world_m: Vector3<f64>,
    /// Where it is seen.
    pub pixel: Vector2<f64>,
    /// Covariance of that.
    pub pixel_cov_px2: Matrix2<f64>,
}

/// u = (L1 X + L2 Y + L3 Z + L4)/(L9 X + L10 Y + L11 Z + 1), v likewise with L5 to L8 (Abdel-Aziz & Karara 1971).
///
/// X, Y, Z in metres in the world, u, v in pixels. A camera whose focal plane holds the world's origin has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dlt {
    /// L1 to L11.
    pub l: [f64; 11],
}

/// A least-squares DLT.
#[derive(Debug, Clone, PartialEq)]
pub struct DltFit {
    /// The parameters.
    pub dlt: Dlt,
    /// Measured less fitted pixel of each control point, in their order.
    pub residuals_px: Vec<Vector2<f64>>,
    /// Root mean square of the residuals over all coordinates.
    pub rms_px: f64,
    /// Largest over second smallest singular value of the normalised equations: above 1e4 the points barely
    /// determine the camera.
    pub condition: f64,
    /// Covariance of L1 to L11 from the pixels' own covariances, in the parameters' units.
    pub covariance: SMatrix<f64, 11, 11>,
}

impl DltFit {
    /// Weighted sum of squared residuals over the redundancy 2n - 11, or `None` when there is none.
    ///
    /// One when the pixels' covariances are right, to within sqrt(2 / redundancy).
    pub fn variance_factor(&self, points: &[ControlPoint]) -> Option<f64> {
        let redundancy = 2 * self.residuals_px.len() as i64 - 11;
        if redundancy <= 0 {
            return None;
        }
        let sum: f64 = points
            .iter()
            .zip(&self.residuals_px)
            .filter_map(|(p, r)| Some((r.transpose() * p.pixel_cov_px2.try_inverse()? * r)[0]))
            .sum();
        Some(sum / redundancy as f64)
    }
}

impl Dlt {
    /// The parameters of a projection matrix of any scale.
    ///
    /// # Errors
    /// [`GeometryError::OriginInFocalPlane`] when the last entry is zero to rounding.
    pub fn from_matrix(matrix: &Matrix3x4<f64>) -> Result<Self, GeometryError> {
        let scale = matrix[(2, 3)];
        let depth_size = matrix.row(2).norm();
        if !scale.is_finite()
            || !depth_size.is_finite()
            || scale.abs() <= 1e-9 * depth_size
            || depth_size == 0.0
        {
            return Err(GeometryError::OriginInFocalPlane { relative_depth: scale / depth_size });
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

    /// Where a world point is seen.
    ///
    /// # Errors
    /// [`GeometryError::BehindCamera`] for a point on the focal plane. The scale of the parameters hides the sign of
    /// the depth, so a point behind the camera is seen here through it: ask [`Camera::project`] where that matters.
    pub fn project(&self, point_in_world_m: &Vector3<f64>) -> Result<Vector2<f64>, GeometryError> {
        let h = self.matrix() * point_in_world_m.push(1.0);
        let pixel = Vector2::new(h.x / h.z, h.y / h.z);
        if pixel.iter().all(|x| x.is_finite()) {
            Ok(pixel)
        } else {
            Err(GeometryError::BehindCamera { depth_m: h.z })
        }
    }

    /// The camera that the parameters mean, by RQ decomposition with positive focal lengths; skew is kept.
    ///
    /// Parameters of a mirrored image (table 1 of the paper is one: its u grows leftwards) give the right centre and
    /// focal lengths, but a camera that looks away from the scene: [`Dlt::fit`] refuses such points.
    ///
    /// # Errors
    /// [`GeometryError::UndeterminedCamera`] when the left 3×3 block is singular: an affine or degenerate view.
    pub fn camera(&self, size: ImageSize) -> Result<Camera, GeometryError> {
        let p = self.matrix();
        let left: Matrix3<f64> = p.fixed_columns::<3>(0).into_owned();
        let sign = left.determinant().signum();
        let (k, rotation) = rq(&(left * sign))?;
        let inverse =
            left.try_inverse().ok_or(GeometryError::UndeterminedCamera { condition: f64::INFINITY })?;
        let centre = -(inverse * p.column(3));
        let translation = -(rotation * centre);
        let k = k / k[(2, 2)];
        let intrinsics = Intrinsics {
            fx_px: k[(0, 0)],
            fy_px: k[(1, 1)],
            cx_px: k[(0, 2)],
            cy_px: k[(1, 2)],
            skew_px: k[(0, 1)],
        };
        let camera = Camera {
            cam_from_world: Isometry3::from_parts(Translation3::from(translation), rotation),
            intrinsics,
            distortion: BrownConrady::default(),
            size,
        };
        let finite = centre.iter().all(|x| x.is_finite()) && k.iter().all(|x| x.is_finite());
        if finite { Ok(camera) } else { Err(GeometryError::UndeterminedCamera { condition: f64::INFINITY }) }
    }

    /// The parameters that fit the control points best; see [`DltFit`].
    ///
    /// Normalised coordinates (Hartley 1997), null vector by Jacobi rotations, then Gauss-Newton on the reprojection
    /// error weighted by the pixels' covariances.
    ///
    /// # Errors
    /// [`GeometryError::TooFewControlPoints`], [`GeometryError::CoplanarControlPoints`],
    /// [`GeometryError::UndeterminedCamera`], [`GeometryError::OriginInFocalPlane`], [`GeometryError::NotFinite`].
    pub fn fit(points: &[ControlPoint]) -> Result<DltFit, GeometryError> {
        crate::dlt_fit::fit(points)
    }

    /// The linear start of [`Dlt::fit`] alone: quick, for judging many assignments of points to pixels.
    ///
    /// # Errors
    /// Those of [`Dlt::fit`].
    pub fn fit_linear(points: &[ControlPoint]) -> Result<Self, GeometryError> {
        crate::dlt_fit::linear(points)
    }
}

/// M = K R with K upper triangular of positive diagonal, for a matrix of positive determinant.
fn rq(m: &Matrix3<f64>) -> Result<(Matrix3<f64>, UnitQuaternion<f64>), GeometryError> {
    let rows = [m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose()];
    let r3 = rows[2] / rows[2].norm();
    let across = rows[1] - r3 * rows[1].dot(&r3);
    let r2 = (across - r3 * across.dot(&r3)).normalize();
    let r1 = r2.cross(&r3);
    let rotation = Matrix3::from_rows(&[r1.transpose(), r2.transpose(), r3.transpose()]);
    let k = m * rotation.transpose();
    let k = Matrix3::new(k[(0, 0)], k[(0, 1)], k[(0, 2)], 0.0, k[(1, 1)], k[(1, 2)], 0.0, 0.0, k[(2, 2)]);
    let positive = (0..3).all(|i| k[(i, i)] > 0.0 && k[(i, i)].is_finite());
    if !positive || !rotation.iter().all(|x| x.is_finite()) {
        return Err(GeometryError::UndeterminedCamera { condition: f64::INFINITY });
    }
    Ok((k, UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

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
}
