//! A pinhole camera with skew and Brown-Conrady distortion, its projection and the Jacobians of it.

use crate::GeometryError;
use crate::attitude::{matrix_of, rotation_of};
use nalgebra::{Isometry3, Matrix2, Matrix2x3, Matrix2x6, Matrix3, Matrix3x4, Point3, Vector2, Vector3};

/// Width and height of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

impl ImageSize {
    /// Number of pixels.
    pub fn area_px(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }

    /// Whether a point lies on the image by at least `margin_px`.
    pub fn contains(&self, pixel: &Vector2<f64>, margin_px: f64) -> bool {
        pixel.x >= margin_px - 0.5
            && pixel.y >= margin_px - 0.5
            && pixel.x <= f64::from(self.width_px) - 0.5 - margin_px
            && pixel.y <= f64::from(self.height_px) - 0.5 - margin_px
    }
}

/// The affine part of a camera: u = fx x + skew y + cx, v = fy y + cy from the distorted normalised image
/// point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length along u.
    pub fx_px: f64,
    /// Focal length along v.
    pub fy_px: f64,
    /// Principal point, column.
    pub cx_px: f64,
    /// Principal point, row.
    pub cy_px: f64,
    /// Shear of v into u.
    pub skew_px: f64,
}

impl Intrinsics {
    /// Square pixels, centred, with the given angle across the width.
    pub fn from_horizontal_fov(size: ImageSize, fov_rad: f64) -> Self {
        let f = f64::from(size.width_px) / 2.0 / (fov_rad / 2.0).tan();
        Self {
            fx_px: f,
            fy_px: f,
            cx_px: (f64::from(size.width_px) - 1.0) / 2.0,
            cy_px: (f64::from(size.height_px) - 1.0) / 2.0,
            skew_px: 0.0,
        }
    }

    /// The intrinsics of a calibration matrix K of any scale.
    pub fn from_matrix(k: &Matrix3<f64>) -> Self {
        let k = k / k[(2, 2)];
        Self { fx_px: k[(0, 0)], fy_px: k[(1, 1)], cx_px: k[(0, 2)], cy_px: k[(1, 2)], skew_px: k[(0, 1)] }
    }

    /// The calibration matrix K.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.fx_px, self.skew_px, self.cx_px, 0.0, self.fy_px, self.cy_px, 0.0, 0.0, 1.0)
    }

    fn apply(&self, n: Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.fx_px * n.x + self.skew_px * n.y + self.cx_px, self.fy_px * n.y + self.cy_px)
    }

    fn unapply(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        let y = (pixel.y - self.cy_px) / self.fy_px;
        Vector2::new((pixel.x - self.cx_px - self.skew_px * y) / self.fx_px, y)
    }

    fn jacobian(&self) -> Matrix2<f64> {
        Matrix2::new(self.fx_px, self.skew_px, 0.0, self.fy_px)
    }
}

/// Radial and tangential lens distortion (Brown 1971; coefficients as in OpenCV's k1 k2 p1 p2 k3). All zero:
/// none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BrownConrady {
    /// Radial, r².
    pub k1: f64,
    /// Radial, r⁴.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, r⁶.
    pub k3: f64,
}

impl BrownConrady {
    /// Distorted normalised point and its derivative.
    pub fn distort(&self, n: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (n.x, n.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let d_radial = self.k1 + r2 * (2.0 * self.k2 + 3.0 * self.k3 * r2);
        let point = Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        );
        let off = 2.0 * x * y * d_radial + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * x * x * d_radial + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            off,
            off,
            radial + 2.0 * y * y * d_radial + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        );
        (point, jacobian)
    }

    /// Inverse of [`BrownConrady::distort`] by Newton's method; `None` where it does not converge, or only to
    /// a point beyond the fold, where the image would be reversed.
    pub fn undistort(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        if *self == Self::default() {
            return Some(distorted);
        }
        let mut n = distorted;
        for _ in 0..50 {
            let (at, jacobian) = self.distort(n);
            let step = jacobian.try_inverse()? * (distorted - at);
            n += step;
            if step.norm() < 1e-13 {
                let upright = jacobian.determinant() > 0.0 && n.dot(&distorted) >= 0.0;
                return upright.then_some(n);
            }
        }
        None
    }
}

/// A camera in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Takes world coordinates into camera coordinates.
    pub cam_from_world: Isometry3<f64>,
    /// Focal lengths, principal point, skew.
    pub intrinsics: Intrinsics,
    /// Lens distortion.
    pub distortion: BrownConrady,
    /// Size of its images.
    pub size: ImageSize,
}

/// An image point and its derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    /// Where the point is seen.
    pub pixel: Vector2<f64>,
    /// Derivative with respect to the point in camera coordinates, px/m.
    pub d_pixel_d_point_in_cam: Matrix2x3<f64>,
    /// Derivative with respect to the point in world coordinates, px/m.
    pub d_pixel_d_point_in_world: Matrix2x3<f64>,
}

impl Camera {
    /// A camera without distortion.
    pub fn undistorted(cam_from_world: Isometry3<f64>, intrinsics: Intrinsics, size: ImageSize) -> Self {
        Self { cam_from_world, intrinsics, distortion: BrownConrady::default(), size }
    }

    /// A camera at `centre_in_world_m` that looks at a target with the image's top towards world +Z.
    ///
    /// Looking straight up or down, the image's top points to world +Y.
    pub fn looking_at(
        centre_in_world_m: Vector3<f64>,
        target_in_world_m: Vector3<f64>,
        intrinsics: Intrinsics,
        size: ImageSize,
    ) -> Self {
        let forward = (target_in_world_m - centre_in_world_m).normalize();
        let up = if forward.z.abs() > 0.999_999 { Vector3::y() } else { Vector3::z() };
        let right = forward.cross(&up).normalize();
        let down = forward.cross(&right);
        let rows = [right.transpose(), down.transpose(), forward.transpose()];
        let rotation = rotation_of(Matrix3::from_rows(&rows));
        let cam_from_world = Isometry3::from_parts((-(rotation * centre_in_world_m)).into(), rotation);
        Self::undistorted(cam_from_world, intrinsics, size)
    }

    /// The projection centre in world coordinates, metres.
    pub fn centre_in_world(&self) -> Vector3<f64> {
        self.cam_from_world.inverse().translation.vector
    }

    /// The 3×4 projection matrix `K [R | t]`; it leaves distortion out.
    pub fn matrix(&self) -> Matrix3x4<f64> {
        self.intrinsics.matrix() * self.cam_from_world.to_matrix().fixed_rows::<3>(0)
    }

    /// The image of a world point, with derivatives.
    ///
    /// # Errors
    /// [`GeometryError::BehindCamera`] for a point behind the camera or in its focal plane.
    pub fn project(&self, point_in_world: &Vector3<f64>) -> Result<Projection, GeometryError> {
        let point_in_cam = self.cam_from_world * Point3::from(*point_in_world);
        self.project_from_camera(&point_in_cam.coords)
    }

    /// The image of a point in camera coordinates (x right, y down, z forward, metres), with derivatives.
    ///
    /// # Errors
    /// [`GeometryError::BehindCamera`].
    pub fn project_from_camera(&self, p: &Vector3<f64>) -> Result<Projection, GeometryError> {
        self.image_of_ball(*p, 0.0)
    }

    fn image_of_ball(&self, mut p: Vector3<f64>, radius_m: f64) -> Result<Projection, GeometryError> {
        if p.z.is_nan() || p.z <= radius_m.max(1e-6) {
            return Err(GeometryError::BehindCamera { depth_m: p.z });
        }
        let share = (radius_m / p.z).powi(2);
        p.z -= radius_m * radius_m / p.z;
        let inv_z = 1.0 / p.z;
        let n = Vector2::new(p.x * inv_z, p.y * inv_z);
        let (distorted, d_distorted) = self.distortion.distort(n);
        let d_n = Matrix2x3::new(inv_z, 0.0, -n.x * inv_z, 0.0, inv_z, -n.y * inv_z);
        let mut d_cam = self.intrinsics.jacobian() * d_distorted * d_n;
        // d(z - R²/z)/dz
        d_cam.column_mut(2).scale_mut(1.0 + share);
        Ok(Projection {
            pixel: self.intrinsics.apply(distorted),
            d_pixel_d_point_in_cam: d_cam,
            d_pixel_d_point_in_world: d_cam * matrix_of(&self.cam_from_world.rotation),
        })
    }

    /// The centre of the elliptical image of a ball, which is not the image of the ball's centre, with
    /// derivatives.
    ///
    /// The outline of a sphere of radius R at (x, y, z) is the conic whose dual is X Xᵀ - R² I; its centre is
    /// (x z, y z)/(z² - R²), further from the principal point than x/z by the factor z²/(z² - R²)
    /// (Hartley & Zisserman 2004, section 8.6). Distortion is applied at that centre.
    ///
    /// # Errors
    /// [`GeometryError::BehindCamera`] for a ball that reaches behind the camera.
    pub fn project_ball(
        &self,
        centre_in_world: &Vector3<f64>,
        radius_m: f64,
    ) -> Result<Projection, GeometryError> {
        self.image_of_ball((self.cam_from_world * Point3::from(*centre_in_world)).coords, radius_m)
    }

    /// Unit direction in world coordinates of the ray through a pixel.
    ///
    /// # Errors
    /// [`GeometryError::UndistortionDiverged`] outside the field where the distortion can be undone.
    pub fn ray(&self, pixel: &Vector2<f64>) -> Result<Vector3<f64>, GeometryError> {
        let n = self
            .distortion
            .undistort(self.intrinsics.unapply(pixel))
            .ok_or(GeometryError::UndistortionDiverged { u_px: pixel.x, v_px: pixel.y })?;
        Ok(self.cam_from_world.rotation.inverse() * Vector3::new(n.x, n.y, 1.0).normalize())
    }
}

/// Derivative of an image point with respect to a small motion (translation in world axes, rotation in body
/// axes) of the body that carries the point: world_from_body ← (t + δt, R exp(δθ)).
pub fn d_pixel_d_pose(
    projection: &Projection,
    world_from_body: &Isometry3<f64>,
    point_in_body: &Vector3<f64>,
) -> Matrix2x6<f64> {
    let d_world = projection.d_pixel_d_point_in_world;
    let d_turn = -matrix_of(&world_from_body.rotation) * point_in_body.cross_matrix();
    let mut out = Matrix2x6::zeros();
    out.fixed_view_mut::<2, 3>(0, 0).copy_from(&d_world);
    out.fixed_view_mut::<2, 3>(0, 3).copy_from(&(d_world * d_turn));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SVector, UnitQuaternion};
    use proptest::prelude::*;

    const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

    fn camera() -> Camera {
        let mut k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
        k.skew_px = 2.0;
        k.fy_px *= 1.01;
        let mut camera =
            Camera::looking_at(Vector3::new(4.0, -5.0, 2.0), Vector3::new(0.0, 0.0, 1.5), k, SIZE);
        camera.distortion = BrownConrady { k1: -0.25, k2: 0.08, p1: 1e-3, p2: -2e-3, k3: 0.01 };
        camera
    }

    fn numeric<const N: usize>(at: impl Fn(SVector<f64, N>) -> Vector2<f64>) -> nalgebra::SMatrix<f64, 2, N> {
        let h = 1e-6;
        let mut out = nalgebra::SMatrix::<f64, 2, N>::zeros();
        for k in 0..N {
            let mut step = SVector::<f64, N>::zeros();
            step[k] = h;
            out.set_column(k, &((at(step) - at(-step)) / (2.0 * h)));
        }
        out
    }

    proptest! {
        #[test]
        fn derivatives_match_numeric_ones(x in -1.0..1.0, y in -1.0..1.0, z in 0.0..3.0,
            turn in proptest::array::uniform3(-2.0..2.0), marker in proptest::array::uniform3(-0.3..0.3))
        {
            let camera = camera();
            let point = Vector3::new(x, y, z);
            let got = camera.project(&point).unwrap();
            let want = numeric(|d| camera.project(&(point + d)).unwrap().pixel);
            prop_assert!((got.d_pixel_d_point_in_world - want).norm() < 1e-5);
            let ball = camera.project_ball(&point, 0.1).unwrap();
            let want = numeric(|d| camera.project_ball(&(point + d), 0.1).unwrap().pixel);
            prop_assert!((ball.d_pixel_d_point_in_world - want).norm() < 1e-5);
            let pose = Isometry3::from_parts(point.into(), UnitQuaternion::from_scaled_axis(Vector3::from(turn)));
            let marker = Vector3::from(marker);
            let moved = |d: SVector<f64, 6>| {
                let t = pose.translation.vector + d.fixed_rows::<3>(0);
                let r = pose.rotation * UnitQuaternion::from_scaled_axis(d.fixed_rows::<3>(3).into_owned());
                camera.project(&(t + r * marker)).unwrap().pixel
            };
            let seen = camera.project(&(pose * Point3::from(marker)).coords).unwrap();
            prop_assert!((d_pixel_d_pose(&seen, &pose, &marker) - numeric(moved)).norm() < 1e-4);
        }

        #[test]
        fn distortion_has_a_derivative_and_an_inverse(x in -0.5..0.5, y in -0.4..0.4) {
            let lens = camera().distortion;
            let n = Vector2::new(x, y);
            let (point, jacobian) = lens.distort(n);
            let want = numeric(|d: Vector2<f64>| lens.distort(n + d).0);
            prop_assert!((jacobian - want).norm() < 1e-8);
            prop_assert!((lens.undistort(point).unwrap() - n).norm() < 1e-12);
        }

        #[test]
        fn a_ray_leads_back_to_its_pixel(u in 0.0..639.0, v in 0.0..479.0, range in 1.0..10.0) {
            let camera = camera();
            let pixel = Vector2::new(u, v);
            let point = camera.centre_in_world() + camera.ray(&pixel).unwrap() * range;
            prop_assert!((camera.project(&point).unwrap().pixel - pixel).norm() < 1e-8);
        }

        /// The outline of a ball, sampled ray by ray, against the closed form of its centre.
        #[test]
        fn a_ball_is_seen_at_the_centre_of_its_outline(x in -2.0..2.0, y in -1.5..1.5, z in 3.0..6.0, radius in 0.02..0.5) {
            let mut camera = camera();
            camera.distortion = BrownConrady::default();
            let centre = Vector3::new(x, y, z);
            let world = (camera.cam_from_world.inverse() * Point3::from(centre)).coords;
            let sine: f64 = radius / centre.norm();
            let axis = centre.normalize();
            let first = axis.cross(&Vector3::x()).normalize();
            let second = axis.cross(&first);
            let outline = |turn: f64| {
                let across: Vector3<f64> = first * turn.cos() + second * turn.sin();
                let ray = axis * (1.0 - sine * sine).sqrt() + across * sine;
                camera.project_from_camera(&ray).unwrap().pixel
            };
            let dense: Vec<_> = (0..3600).map(|i| outline(f64::from(i) * std::f64::consts::PI / 1800.0)).collect();
            let middle = |axis: usize| {
                let (low, high) = dense.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
                (low + high) / 2.0
            };
            let got = camera.project_ball(&world, radius).unwrap().pixel;
            prop_assert!((got - Vector2::new(middle(0), middle(1))).norm() < 1e-3);
        }
    }

    #[test]
    fn what_lies_behind_has_no_image() {
        let camera = camera();
        let behind = camera.centre_in_world() * 2.0;
        assert!(matches!(camera.project(&behind), Err(GeometryError::BehindCamera { .. })));
        assert!(camera.project_ball(&(camera.centre_in_world() - Vector3::x() * 0.01), 0.1).is_err());
        assert!(camera.project(&Vector3::new(f64::NAN, 0.0, 0.0)).is_err());
        let strong = Camera { distortion: BrownConrady { k1: -2.0, ..Default::default() }, ..camera };
        assert!(strong.ray(&Vector2::new(1e4, 1e4)).is_err());
    }
}
