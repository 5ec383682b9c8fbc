//! The sixteen parameters of a camera, small changes of them, and the derivatives of an image point by them.

use crate::{Camera, GeometryError};
use nalgebra::{
    Isometry3, Matrix3, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// Number of parameters of a camera: those of a DLT-16.
pub const CAMERA_PARAMETERS: usize = 16;

/// A small change of a camera, or a derivative by it. In order: turn about the camera's own axes (rad, so
/// that points in camera coordinates turn by minus it), displacement of the projection centre in world axes
/// (m), fx, fy, skew, cx, cy (px), k1, k2, p1, p2, k3.
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
        let (k, d) = (&mut out.intrinsics, &mut out.distortion);
        let lens = [&mut k.fx_px, &mut k.fy_px, &mut k.skew_px, &mut k.cx_px, &mut k.cy_px];
        let lens = lens.into_iter().chain([&mut d.k1, &mut d.k2, &mut d.p1, &mut d.p2, &mut d.k3]);
        lens.zip(&by.as_slice()[INTRINSICS..]).for_each(|(value, change)| *value += change);
        out
    }

    /// The change with which [`Camera::moved`] makes another camera of this one.
    pub fn change_to(&self, other: &Self) -> CameraChange {
        let mut out = CameraChange::zeros();
        let turn = other.cam_from_world.rotation * self.cam_from_world.rotation.inverse();
        out.fixed_rows_mut::<3>(TURN).copy_from(&-turn.scaled_axis());
        out.fixed_rows_mut::<3>(CENTRE).copy_from(&(other.centre_in_world() - self.centre_in_world()));
        out.fixed_rows_mut::<10>(INTRINSICS).copy_from(&(other.lens() - self.lens()));
        out
    }

    /// fx, fy, skew, cx, cy (px), k1, k2, p1, p2, k3: the parameters from [`INTRINSICS`] on.
    pub fn lens(&self) -> SVector<f64, 10> {
        let (k, d) = (&self.intrinsics, &self.distortion);
        SVector::from([k.fx_px, k.fy_px, k.skew_px, k.cx_px, k.cy_px, d.k1, d.k2, d.p1, d.p2, d.k3])
    }

    /// Derivative of the image of a world point by a [`CameraChange`] at zero.
    ///
    /// It is used for a ball's image too: the offset of that from the image of its centre moves a few
    /// thousandths as far.
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

    #[test]
    fn the_change_between_two_cameras_leads_from_one_to_the_other() {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
        let target = Vector3::new(0.0, 0.0, 1.5);
        let [a, mut b] = [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]]
            .map(|c| Camera::looking_at(Vector3::from(c), target, k, size));
        b.distortion.k1 = -0.2;
        b.intrinsics.skew_px = 1.0;
        let back = a.moved(&a.change_to(&b));
        assert!((back.cam_from_world.to_homogeneous() - b.cam_from_world.to_homogeneous()).norm() < 1e-12);
        assert_eq!((back.distortion, back.size), (b.distortion, b.size));
        assert!((back.intrinsics.matrix() - b.intrinsics.matrix()).norm() < 1e-9);
    }
}
