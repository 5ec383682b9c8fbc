//! The one noise of all control points that leaves a camera as uncertain as their different noises.

use super::adjust::{Fit, expected};
use super::problem::{Choice, Data};
use crate::precision::covariance_of_point;
use mavsight_geometry::Vector3;

/// Half a side's points of the Gauss-Legendre rule for polynomials up to the third power.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// For each camera, the standard deviation of a pixel coordinate that would leave a point in the volume of
/// the control points as uncertain, were all points of the camera alike.
///
/// The covariance of the cameras is formed once more with the mean of the weights for all points, and its
/// effect on a point in the volume is compared. Without one the result is the mean of the weights.
pub(super) fn alike_std_px(data: Data, fit: &Fit) -> Vec<f64> {
    let Data { problem, choice } = data;
    let cameras = 0..problem.sizes.len();
    let means_px2: Vec<f64> =
        cameras.map(|c| mean_weight(data, fit, c).recip() * fit.variance_factor).collect();
    let mut alike = problem.clone();
    let of_objects = alike.moved.iter_mut().flat_map(|m| &mut m.places).flat_map(|p| &mut p.observations);
    for o in alike.observations.iter_mut().chain(of_objects) {
        *o = o.with_variance(means_px2[o.camera]);
    }
    let alike = expected(alike.with(choice), &fit.models, &fit.state.cameras);
    let inside = gauss_points(choice, fit);
    let ratio = open_m2(fit, &inside).zip(alike.and_then(|a| open_m2(&a, &inside)));
    let factor = ratio.map(|(own, alike)| own / alike).filter(|f| f.is_finite() && *f > 0.0);
    means_px2.iter().map(|mean| (mean * factor.unwrap_or(1.0)).sqrt()).collect()
}

/// Mean over the observations of a camera of the inverse of the stated variance of a coordinate.
fn mean_weight(data: Data, fit: &Fit, camera: usize) -> f64 {
    let of_objects = fit.object_residuals(data.problem, camera);
    let used = data.used_by(camera);
    let (n, sum) = used.fold((of_objects.observations, of_objects.information), |(n, sum), k| {
        (n + 1.0, sum + 2.0 / data.problem.observations[k].covariance_px2.trace())
    });
    sum / n
}

/// Places in the box around the surveyed points and the moved objects.
fn gauss_points(choice: &Choice, fit: &Fit) -> Vec<Vector3<f64>> {
    let surveyed = choice.used().map(|k| fit.state.places[choice.place[k]]);
    let moved = fit.state.poses.iter().flatten().map(|pose| pose.translation.vector);
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    surveyed.chain(moved).for_each(|p| (low, high) = (low.inf(&p), high.sup(&p)));
    let side = |corner: usize, axis: usize| if corner >> axis & 1 == 0 { -GAUSS } else { GAUSS };
    let at = |corner| {
        0.5 * (low + high) + Vector3::from_fn(|axis, _| 0.5 * side(corner, axis) * (high[axis] - low[axis]))
    };
    (0..8).map(at).collect()
}

/// Sum over the places of the variance with which the cameras would find them.
fn open_m2(fit: &Fit, places: &[Vector3<f64>]) -> Option<f64> {
    let uncertainty = fit.camera_root()?;
    let of_place = |p| covariance_of_point(fit.state.cameras.iter(), &uncertainty, p, 0.0);
    Some(places.iter().filter_map(of_place).map(|c| c.trace()).sum())
}

#[cfg(test)]
mod tests {
    use super::super::model::CameraModel;
    use super::super::rig::CameraControl;
    use super::super::test_sets::both;
    use super::*;
    use crate::calibrate::predict_calibration;
    use crate::testing::cameras;
    use crate::{Rig, predicted_covariance_m2};
    use mavsight_geometry::Matrix2;
    use mavsight_random::Random;

    const STD_PX: f64 = 0.05;

    fn predicted(controls: &[CameraControl]) -> Rig {
        predict_calibration(&cameras().map(|c| (c, CameraModel::PINHOLE)), controls).unwrap()
    }

    /// Mean variance of places half-way out from the middle of the control frame, from the cameras'
    /// uncertainty.
    fn open_m2(rig: &Rig) -> f64 {
        let sides = [-0.6, 0.6];
        let places = sides
            .iter()
            .flat_map(|x| sides.iter().flat_map(move |y| sides.map(|z| Vector3::new(*x, *y, 1.5 + z))));
        places.map(|p| predicted_covariance_m2(rig, &p, 0.0).unwrap().trace()).sum::<f64>() / 8.0
    }

    #[test]
    fn points_that_are_alike_have_the_noise_that_they_have() {
        for camera in &predicted(&both(STD_PX, &mut Random::new(3, 0))).cameras {
            approx::assert_relative_eq!(camera.sigma_px, STD_PX, max_relative = 1e-6);
        }
    }

    /// Some points have lamps as background: places triangulated by the cameras are as uncertain as after a
    /// calibration by points with the one noise; with the mean of their weights they are not.
    #[test]
    fn one_noise_for_all_points_leaves_the_uncertainty_of_noises_that_differ() {
        let mut controls = both(STD_PX, &mut Random::new(3, 0));
        let bad = [0, 3, 5];
        for control in &mut controls {
            bad.iter().for_each(|k| control.points[*k].pixel_cov_px2 *= 100.0);
        }
        let real = predicted(&controls);
        let with = |std_px: &dyn Fn(usize) -> f64| {
            let mut alike = controls.clone();
            for (k, control) in alike.iter_mut().enumerate() {
                let covariance = Matrix2::identity() * std_px(k).powi(2);
                control.points.iter_mut().for_each(|p| p.pixel_cov_px2 = covariance);
            }
            (open_m2(&predicted(&alike)) / open_m2(&real)).sqrt()
        };
        let by_weights = |k: usize| {
            let points = &controls[k].points;
            let weights = points.iter().map(|p| 2.0 / p.pixel_cov_px2.trace()).sum::<f64>();
            (points.len() as f64 / weights).sqrt()
        };
        let (alike, weighed) = (with(&|k| real.cameras[k].sigma_px), with(&by_weights));
        assert!((0.9..1.1).contains(&alike) && weighed < 0.9, "{alike}, by the mean of weights {weighed}");
    }
}
