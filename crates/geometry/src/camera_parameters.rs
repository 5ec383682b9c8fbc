//! The sixteen numbers of a camera as an estimator moves them, and the derivatives of an image point by them.

use crate::{Camera, GeometryError};
use nalgebra::{
    Isometry3, Matrix3, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// Number of parameters of a camera: those of a DLT-16.
pub const CAMERA_PARAMETERS: usize = 16;

/// A small change of a camera, or a derivative by it. In order: turn about the camera's own axes (rad, so that
/// points in camera coordinates turn by minus it), displacement of the projection centre in world axes (m), fx, fy,
/// skew, cx, cy (px), k1, k2, p1, p2, k3.
pub type CameraChange = SVector<f64, CAMERA_PARAMETERS>;

/// Where the turn begins in a [`CameraChange`].
pub const TURN: usize = 0;
/// Where the projection centre begins.
pub const CENTRE: usize = 3;
/// Where fx, fy, skew, cx, cy begin.
pub const INTRINSICS: usize = 6;
/// Where k1, k2, p1, p2, k3 begin.
pub const DISTORTION: usize = 11;

impl Camera {
    /// The camera after a change.
    pub fn moved(&self, by: &CameraChange) -> Self {
        let mut out = *self;
        let turn = UnitQuaternion::from_scaled_axis(-by.fixed_rows::<3>(TURN).into_owned());
        let rotation = turn * self.cam_from_world.rotation;
        let centre = self.centre_in_world() + by.fixed_rows::<3>(CENTRE);
        out.cam_from_world = Isometry3::from_parts(Translation3::from(-(rotation * centre)), rotation);
        let k = &mut out.intrinsics;
        for (i, value) in
            [&mut k.fx_px, &mut k.fy_px, &mut k.skew_px, &mut k.cx_px, &mut k.cy_px].into_iter().enumerate()
        {
            *value += by[INTRINSICS + i];
        }
        let d = &mut out.distortion;
        for (i, value) in [&mut d.k1, &mut d.k2, &mut d.p1, &mut d.p2, &mut d.k3].into_iter().enumerate() {
            *value += by[DISTORTION + i];
        }
        out
    }

    /// Derivative of the pixel at which a world point is seen by a [`CameraChange`] at zero.
    ///
    /// It serves a ball's image too: the ball's offset moves a few thousandths of what its centre does.
    ///
    /// # Errors
    /// [`GeometryError::BehindCamera`].
    pub fn d_pixel_d_camera(
        &self,
        point_in_world: &Vector3<f64>,
    ) -> Result<SMatrix<f64, 2, CAMERA_PARAMETERS>, GeometryError> {
        let p = (self.cam_from_world * Point3::from(*point_in_world)).coords;
        let seen = self.project_from_camera(&p)?;
        let rotation: Matrix3<f64> = crate::attitude::matrix_of(&self.cam_from_world.rotation);
        let mut out = SMatrix::<f64, 2, CAMERA_PARAMETERS>::zeros();
        // p' = (1 - [δ]×) R (X - C)
        out.fixed_columns_mut::<3>(TURN).copy_from(&(seen.d_pixel_d_point_in_cam * p.cross_matrix()));
        out.fixed_columns_mut::<3>(CENTRE).copy_from(&(seen.d_pixel_d_point_in_cam * -rotation));
        let n = Vector2::new(p.x / p.z, p.y / p.z);
        let (at, _) = self.distortion.distort(n);
        out[(0, INTRINSICS)] = at.x;
        out[(1, INTRINSICS + 1)] = at.y;
        out[(0, INTRINSICS + 2)] = at.y;
        out[(0, INTRINSICS + 3)] = 1.0;
        out[(1, INTRINSICS + 4)] = 1.0;
        let (x, y, r2) = (n.x, n.y, n.norm_squared());
        let lens = [
            Vector2::new(x * r2, y * r2),
            Vector2::new(x * r2 * r2, y * r2 * r2),
            Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
            Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
            Vector2::new(x * r2.powi(3), y * r2.powi(3)),
        ];
        for (i, d) in lens.iter().enumerate() {
            out[(0, DISTORTION + i)] = self.intrinsics.fx_px * d.x + self.intrinsics.skew_px * d.y;
            out[(1, DISTORTION + i)] = self.intrinsics.fy_px * d.y;
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BrownConrady, ImageSize, Intrinsics};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_derivative_by_the_camera_is_the_numeric_one(x in -1.0..1.0, y in -1.0..1.0, z in 0.0..3.0) {
            let size = ImageSize { width_px: 640, height_px: 480 };
            let mut k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
            k.skew_px = 1.5;
            let mut camera = Camera::looking_at(Vector3::new(4.0, -5.0, 2.0), Vector3::new(0.0, 0.0, 1.5), k, size);
            camera.distortion = BrownConrady { k1: -0.25, k2: 0.08, p1: 1e-3, p2: -2e-3, k3: 0.01 };
            let point = Vector3::new(x, y, z);
            let got = camera.d_pixel_d_camera(&point).unwrap();
            for i in 0..CAMERA_PARAMETERS {
                let mut step = CameraChange::zeros();
                step[i] = 1e-6;
                let at = |by: CameraChange| camera.moved(&by).project(&point).unwrap().pixel;
                let want = (at(step) - at(-step)) / 2e-6;
                prop_assert!((got.column(i) - want).norm() < 1e-6 * (1.0 + want.norm()), "parameter {i}");
            }
        }
    }
}
