//! Predicted precision of a rig over a volume, before a flight.

use crate::Rig;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Matrix3, Vector3};
use nalgebra::{DMatrix, Matrix3xX};

/// A rectangle in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPlane {
    /// One corner.
    pub corner_in_world_m: Vector3<f64>,
    /// From there along the first side, all of it.
    pub first_side_m: Vector3<f64>,
    /// Along the second side.
    pub second_side_m: Vector3<f64>,
}

/// Predicted standard deviations on a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct PrecisionMap {
    /// The plane.
    pub plane: MapPlane,
    /// Cells along the first side.
    pub columns: usize,
    /// Cells along the second side.
    pub rows: usize,
    /// At the middle of each cell, first side first: root of the trace of a point's covariance, mm; none
    /// where fewer than two cameras see it.
    pub std_mm: Vec<Option<f64>>,
}

/// A box along the world's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// Corner of the least coordinates.
    pub low_m: Vector3<f64>,
    /// Corner of the largest.
    pub high_m: Vector3<f64>,
}

/// Predicted standard deviations (3-D) in a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VolumePrecision {
    /// In the middle; none where fewer than two cameras see it.
    pub centre_mm: Option<f64>,
    /// The largest of a grid of 11 points along each side.
    pub worst_mm: f64,
    /// The place of that.
    pub worst_at_m: Vector3<f64>,
    /// Part of the volume that two cameras see.
    pub share_seen: f64,
}

const VOLUME_STEPS: usize = 11;

/// The box that holds the rig's control points: the volume for which it is calibrated. `None` without control
/// points.
pub fn control_volume(rig: &Rig) -> Option<Volume> {
    let points = rig.control_points_in_world();
    let first = *points.first()?;
    let around = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    Some(Volume { low_m: around.0, high_m: around.1 })
}

impl Volume {
    /// The horizontal rectangle at mid height.
    pub fn horizontal(&self) -> MapPlane {
        self.middle(2, 0, 1)
    }

    /// The upright rectangle along X in the middle of Y.
    pub fn vertical(&self) -> MapPlane {
        self.middle(1, 0, 2)
    }

    /// The rectangle in the middle of one axis, along two others.
    fn middle(&self, across: usize, first: usize, second: usize) -> MapPlane {
        let side_m = self.high_m - self.low_m;
        MapPlane {
            corner_in_world_m: self.low_m + Vector3::ith(across, 0.5 * side_m[across]),
            first_side_m: Vector3::ith(first, side_m[first]),
            second_side_m: Vector3::ith(second, side_m[second]),
        }
    }
}

/// Predicted covariance of a point that the cameras with the point on their image will measure, from the
/// noise of its images and the uncertainty of the cameras.
///
/// Weighted least squares from two rays or more: C = σ² (Σ JᵀJ)⁻¹ from the pixels; an error of the cameras
/// moves the point by G = -(Σ JᵀJ)⁻¹ Σ Jᵀ J_camera times it, to first order (Hartley & Zisserman 2004,
/// section 5.2). `None` where fewer than two cameras see the point or their rays are parallel.
pub fn predicted_covariance_m2(
    rig: &Rig,
    point_in_world_m: &Vector3<f64>,
    pixel_std_px: f64,
) -> Option<Matrix3<f64>> {
    let cameras = rig.cameras.iter().map(|c| &c.camera);
    covariance_of_point(cameras, &rig.uncertainty, point_in_world_m, pixel_std_px)
}

/// [`predicted_covariance_m2`] of cameras with an uncertainty of the form of [`Rig::uncertainty`].
pub(crate) fn covariance_of_point<'a>(
    cameras: impl Iterator<Item = &'a Camera>,
    uncertainty: &DMatrix<f64>,
    point_in_world_m: &Vector3<f64>,
    pixel_std_px: f64,
) -> Option<Matrix3<f64>> {
    let directions = uncertainty.ncols();
    let mut normal = Matrix3::zeros();
    let mut moved: Matrix3xX<f64> = Matrix3xX::zeros(directions);
    let mut seen_by = 0;
    for (k, camera) in cameras.enumerate() {
        let Ok(seen) = camera.project(point_in_world_m) else { continue };
        if !camera.size.contains(&seen.pixel, 0.0) {
            continue;
        }
        let Ok(by_camera) = camera.d_pixel_d_camera(point_in_world_m) else { continue };
        seen_by += 1;
        let jacobian = seen.d_pixel_d_point_in_world;
        normal += jacobian.transpose() * jacobian;
        let own: DMatrix<f64> = uncertainty.rows(CAMERA_PARAMETERS * k, CAMERA_PARAMETERS).into_owned();
        moved -= jacobian.transpose() * (by_camera * own);
    }
    if seen_by < 2 {
        return None;
    }
    let inverse = normal.cholesky()?.inverse();
    let systematic = inverse * moved;
    let covariance = inverse * pixel_std_px.powi(2) + &systematic * systematic.transpose();
    covariance.iter().all(|x| x.is_finite()).then_some(covariance)
}

/// The predicted precision of a single ball's place on a plane, cell by cell.
pub fn precision_map(
    rig: &Rig,
    plane: MapPlane,
    columns: usize,
    rows: usize,
    pixel_std_px: f64,
) -> PrecisionMap {
    let middle = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
    let point = |cell: usize| {
        plane.corner_in_world_m
            + plane.first_side_m * middle(cell % columns, columns)
            + plane.second_side_m * middle(cell / columns, rows)
    };
    let std_mm = (0..columns * rows).map(|cell| std_mm_at(rig, &point(cell), pixel_std_px)).collect();
    PrecisionMap { plane, columns, rows, std_mm }
}

fn std_mm_at(rig: &Rig, point: &Vector3<f64>, pixel_std_px: f64) -> Option<f64> {
    predicted_covariance_m2(rig, point, pixel_std_px).map(|c| 1e3 * c.trace().sqrt())
}

/// The predicted precision of a single ball's place in the middle of a volume, and the worst in it. `None`
/// where no two cameras see any of it.
pub fn volume_precision(rig: &Rig, volume: &Volume, pixel_std_px: f64) -> Option<VolumePrecision> {
    let side = volume.high_m - volume.low_m;
    let steps = VOLUME_STEPS;
    let point = |cell: usize| {
        let at = Vector3::new(cell % steps, cell / steps % steps, cell / steps / steps);
        volume.low_m + side.component_mul(&at.map(|k| k as f64 / (steps - 1) as f64))
    };
    let std_mm = |at: Vector3<f64>| Some((std_mm_at(rig, &at, pixel_std_px)?, at));
    let seen: Vec<_> = (0..steps.pow(3)).filter_map(|cell| std_mm(point(cell))).collect();
    let (worst_mm, worst_at_m) = seen.iter().copied().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    let centre_mm = std_mm_at(rig, &(volume.low_m + side * 0.5), pixel_std_px);
    let share_seen = seen.len() as f64 / steps.pow(3) as f64;
    Some(VolumePrecision { centre_mm, worst_mm, worst_at_m, share_seen })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::test_sets::{Noise, both, seen};
    use crate::testing::{cameras, cube};
    use crate::{Rig, calibrate};
    use mavsight_geometry::{ImagePoint, Matrix2, Vector2, triangulate};
    use mavsight_random::Random;

    /// Calibrations and measurements with noise, many times over, against the prediction.
    #[test]
    fn the_prediction_is_the_spread_of_many_measurements() {
        let (std_px, mut random, trials) = (0.1, Random::new(3, 0), 300);
        let point = Vector3::new(0.6, 0.4, 2.0);
        let (mut sum, mut claimed) = (Matrix3::zeros(), 0.0);
        for _ in 0..trials {
            let rig = calibrate(&both(std_px, &mut random)).unwrap();
            let pixels: Vec<Vector2<f64>> = cameras()
                .iter()
                .map(|c| c.project(&point).unwrap().pixel + Vector2::from(random.normals()) * std_px)
                .collect();
            let images: Vec<_> = rig
                .cameras
                .iter()
                .zip(&pixels)
                .map(|(c, p)| ImagePoint {
                    camera: &c.camera,
                    pixel: *p,
                    covariance_px2: Matrix2::identity() * std_px * std_px,
                })
                .collect();
            let error = triangulate(&images).unwrap().point_in_world_m - point;
            sum += error * error.transpose() / f64::from(trials);
            claimed += predicted_covariance_m2(&rig, &point, std_px).unwrap().trace() / f64::from(trials);
        }
        let ratio = sum.trace() / claimed;
        let exact = Rig::exact(crate::testing::rig().cameras);
        let pixels_alone = predicted_covariance_m2(&exact, &point, std_px).unwrap().trace();
        assert!((0.7..1.15).contains(&ratio), "measured over predicted variance {ratio}");
        assert!(claimed > 1.15 * pixels_alone, "{claimed} m² with the cameras, {pixels_alone} m² without");
    }

    /// Twelve points of only five distinct places fit as well as twelve places, and measure much worse.
    #[test]
    fn a_small_residual_of_few_distinct_points_hides_what_the_map_shows() {
        let mut random = Random::new(8, 0);
        let inner = [[-0.4, -0.3, 1.1], [0.4, -0.3, 1.4], [0.0, 0.4, 1.9], [-0.3, 0.3, 1.0], [0.3, 0.3, 1.6]];
        let inner = inner.map(Vector3::from);
        let few: Vec<Vector3<f64>> = (0..12).map(|k| inner[k % 5]).collect();
        let mut frame = cube();
        frame.extend(&inner[..4]);
        let calibrated = |places: &[Vector3<f64>], random: &mut Random| {
            let ([a, b], noise) = (cameras(), Noise { std_px: 0.1, radius_m: 0.03 });
            calibrate(&[seen("cam1", &a, places, noise, random), seen("cam2", &b, places, noise, random)])
        };
        let volume = Volume { low_m: Vector3::new(-1.5, -1.5, 0.0), high_m: Vector3::new(1.5, 1.5, 3.0) };
        let good = calibrated(&frame, &mut random).unwrap();
        let poor = calibrated(&few, &mut random).unwrap();
        let worst = |rig: &Rig| volume_precision(rig, &volume, 0.1).unwrap().worst_mm;
        let residual = |rig: &Rig| rig.cameras[0].residual_rms_px.max(rig.cameras[1].residual_rms_px);
        assert!(residual(&poor) < 0.2, "{} px", residual(&poor));
        assert!(worst(&good) < 8.0 && worst(&poor) > 5.0 * worst(&good), "{} {}", worst(&good), worst(&poor));
        for (camera, truth) in poor.cameras.iter().zip(cameras()) {
            let error = camera.camera.centre_in_world() - truth.centre_in_world();
            let square = (error.transpose() * camera.centre_cov_m2.try_inverse().unwrap() * error)[0];
            assert!(square < 16.27, "{square}: outside the 99.9 % region");
        }
    }

    #[test]
    fn what_two_cameras_do_not_see_is_not_predicted() {
        let rig = crate::testing::rig();
        assert_eq!(predicted_covariance_m2(&rig, &Vector3::new(0.0, 0.0, 9.0), 0.1), None);
        let one = Rig::exact(rig.cameras[..1].to_vec());
        assert_eq!(predicted_covariance_m2(&one, &Vector3::new(0.0, 0.0, 1.5), 0.1), None);
        let volume = control_volume(&rig).unwrap();
        let map = precision_map(&rig, volume.horizontal(), 4, 3, 0.1);
        assert_eq!(map.std_mm.len(), 12);
        assert!(map.std_mm.iter().all(|s| s.is_some_and(|mm| mm > 0.5 && mm < 10.0)), "{map:?}");
        assert_eq!(control_volume(&Rig::default()), None);
        assert_eq!(volume_precision(&one, &volume, 0.1), None);
    }
}
