//! The shape of a small ball's image: an ellipse, stretched away from the principal point and by the lens.

use crate::{Matrix2, Vector2};
use mavsight_geometry::{Camera, ImageSize, Intrinsics, Vector3};

/// Horizontal field of view of a camera of which nothing is known: webcams and camcorders have 50° to 70°.
const USUAL_FOV_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// Symmetric matrix A of determinant one: a ball of mean radius r has the outline dᵀ A d = r².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outline {
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Outline {
    /// A circle.
    pub(crate) const ROUND: Self = Self { xx: 1.0, xy: 0.0, yy: 1.0 };

    /// The outline at a pixel. To first order in its angular size, a sphere seen through a projection with
    /// Jacobian J has the outline dᵀ (J Jᵀ)⁻¹ d = R² (Hartley & Zisserman 2004, section 8.6, for the exact
    /// conic). A circle where the camera cannot see.
    pub(crate) fn at(camera: &Camera, pixel: &Vector2<f64>) -> Self {
        let seen = camera.ray(pixel).and_then(|ray| camera.project(&(camera.centre_in_world() + ray)));
        let Ok(seen) = seen else { return Self::ROUND };
        let shape = seen.d_pixel_d_point_in_world * seen.d_pixel_d_point_in_world.transpose();
        let Some(inverse) = shape.try_inverse() else { return Self::ROUND };
        let scaled: Matrix2<f64> = inverse * shape.determinant().sqrt();
        if scaled.iter().all(|v| v.is_finite()) {
            Self { xx: scaled[(0, 0)], xy: scaled[(0, 1)], yy: scaled[(1, 1)] }
        } else {
            Self::ROUND
        }
    }

    /// The entries xx, xy and yy of A.
    pub(crate) fn matrix(&self) -> [f64; 3] {
        [self.xx, self.xy, self.yy]
    }
}

/// A camera of usual field of view, for stretching balls where the true one is not known.
pub(crate) fn usual_camera(size: ImageSize) -> Camera {
    let intrinsics = Intrinsics::from_horizontal_fov(size, USUAL_FOV_RAD);
    Camera::looking_at(Vector3::zeros(), Vector3::y(), intrinsics, size)
}

/// The world's upward unit vector in the directions right, down and towards the camera of what is seen at a
/// pixel. None where the camera cannot see.
pub(crate) fn up_as_seen(camera: &Camera, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
    let cam_from_world = &camera.cam_from_world.rotation;
    let ray = cam_from_world * camera.ray(pixel).ok()?;
    let up = cam_from_world * Vector3::z();
    let right = (Vector3::x() - ray * ray.x).try_normalize(1e-6)?;
    let down = ray.cross(&right);
    Some(Vector3::new(up.dot(&right), up.dot(&down), -up.dot(&ray)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// √(dᵀ A d).
    fn measure(outline: &Outline, dx: f64, dy: f64) -> f64 {
        let [xx, xy, yy] = outline.matrix();
        (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy).sqrt()
    }

    const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

    /// A sphere's outline by its tangent rays: where the angle between a pixel's ray and the centre is the
    /// angular radius.
    #[test]
    fn the_outline_is_that_of_the_tangent_cone() {
        let mut camera = usual_camera(SIZE);
        camera.distortion.k1 = -0.2;
        let (distance_m, radius_m) = (6.0, 0.03);
        for place in [Vector2::new(320.0, 240.0), Vector2::new(600.0, 60.0), Vector2::new(100.0, 400.0)] {
            let to_centre = camera.ray(&place).expect("in view") * distance_m;
            let outline = Outline::at(&camera, &place);
            let mut radii = Vec::new();
            for k in 0..12 {
                let (sin, cos) = (f64::from(k) * std::f64::consts::PI / 6.0).sin_cos();
                let angle = |r: f64| {
                    let ray = camera.ray(&(place + Vector2::new(cos, sin) * r)).expect("in view");
                    ray.angle(&to_centre)
                };
                let (mut near, mut far) = (0.1, 20.0);
                for _ in 0..60 {
                    let middle = 0.5 * (near + far);
                    if angle(middle) < (radius_m / distance_m).asin() { near = middle } else { far = middle }
                }
                radii.push(measure(&outline, cos * near, sin * near));
            }
            let mean = radii.iter().sum::<f64>() / 12.0;
            assert!(radii.iter().all(|r| (r / mean - 1.0).abs() < 0.01), "{radii:?}");
        }
    }

    #[test]
    fn up_is_seen_as_the_camera_is_tilted() {
        let looking = |to: Vector3<f64>| Camera {
            cam_from_world: Camera::looking_at(Vector3::zeros(), to, usual_camera(SIZE).intrinsics, SIZE)
                .cam_from_world,
            ..usual_camera(SIZE)
        };
        let middle = Vector2::new(319.5, 239.5);
        let seen = |to| up_as_seen(&looking(to), &middle).expect("in view");
        assert!((seen(Vector3::y()) + Vector3::y()).norm() < 1e-9, "level");
        // Looking down by 30°, up comes towards the camera.
        let down = seen(Vector3::new(3.0_f64.sqrt(), 0.0, -1.0));
        assert!((down - Vector3::new(0.0, -0.75_f64.sqrt(), 0.5)).norm() < 1e-9, "{down}");
        // Away from the middle it is a matter of the ray, not of the axis.
        let camera = looking(Vector3::y());
        let ray = Vector3::new(1.0, 4.0, -1.0);
        let pixel = camera.project(&nalgebra::Point3::from(ray).coords).expect("in view").pixel;
        let up = up_as_seen(&camera, &pixel).expect("in view");
        assert!((up.norm() - 1.0).abs() < 1e-9 && (up.z - 1.0 / 18.0_f64.sqrt()).abs() < 1e-9, "{up}");
    }

    #[test]
    fn in_the_middle_it_is_a_circle() {
        let middle = Vector2::new(319.5, 239.5);
        let radius = measure(&Outline::at(&usual_camera(SIZE), &middle), 3.0, 4.0);
        assert!((radius - 5.0).abs() < 1e-9);
    }
}
