//! The noise of control points that are all alike and leave as much open of a camera.

use super::adjust::{Fit, expected};
use super::problem::{Choice, Problem};
use crate::precision::covariance_of_point;
use mavsight_geometry::{Matrix2, Vector3};

/// Gauss and Legendre's two points, of half a side: their mean is that over the side of what changes up to the third power.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// For each camera, the standard deviation of a pixel coordinate with which the points, were all of a camera's alike, would leave as
/// much open of where a point is in the volume that they take up.
///
/// Neither the mean of variances nor that of weights says that: what one bad centre tells, others tell only in part, and the more
/// parameters there are the less so. The covariance of the cameras is formed once more with the mean of the weights for all, and what
/// it does to the variance of a point in the volume that two cameras see is compared. Where none is, it is the mean of the weights.
pub(super) fn alike_std_px(problem: &Problem, choice: &Choice, fit: &Fit) -> Vec<f64> {
    let cameras = 0..fit.cameras.len();
    let means_px2: Vec<f64> =
        cameras.map(|c| mean_weight(problem, choice, fit, c).recip() * fit.variance_factor).collect();
    let alike = expected(&with_noise(problem, &means_px2), choice, &fit.models, &fit.cameras);
    let inside = gauss_points(problem, choice, fit);
    let ratio = open_m2(fit, &inside).zip(alike.and_then(|a| open_m2(&a, &inside)));
    let factor = ratio.map(|(own, alike)| own / alike).filter(|f| f.is_finite() && *f > 0.0);
    means_px2.iter().map(|mean| (mean * factor.unwrap_or(1.0)).sqrt()).collect()
}

/// Mean over the sights of a camera of the inverse of the claimed variance of a coordinate.
fn mean_weight(problem: &Problem, choice: &Choice, fit: &Fit, camera: usize) -> f64 {
    let (_, moved, of_moved) = problem.moved_residuals(fit, camera);
    let used = problem.sights.iter().zip(&choice.used).filter(|(s, used)| **used && s.camera == camera);
    let (n, sum) =
        used.fold((moved, of_moved), |(n, sum), (s, _)| (n + 1.0, sum + 2.0 / s.covariance_px2.trace()));
    sum / n
}

/// The same sights with a variance for each camera.
fn with_noise(problem: &Problem, variances_px2: &[f64]) -> Problem {
    let mut out = problem.clone();
    let whitener = |camera: usize| Matrix2::identity() / variances_px2[camera].sqrt();
    for s in &mut out.sights {
        s.covariance_px2 = Matrix2::identity() * variances_px2[s.camera];
        s.whitener = whitener(s.camera);
    }
    let moved = out.moved.iter_mut().flat_map(|m| m.sights.iter_mut().flatten());
    moved.for_each(|s| s.whitener = whitener(s.camera));
    out
}

/// Places in the box that the surveyed points and the moved objects take up.
fn gauss_points(problem: &Problem, choice: &Choice, fit: &Fit) -> Vec<Vector3<f64>> {
    let used = (0..problem.sights.len()).filter(|k| choice.used[*k]);
    let surveyed = used.map(|k| fit.places[choice.place[k]]);
    let moved = fit.poses.iter().flatten().map(|pose| pose.translation.vector);
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
    let of_place = |p| covariance_of_point((fit.cameras.iter(), &uncertainty), p, 0.0);
    Some(places.iter().filter_map(of_place).map(|c| c.trace()).sum())
}

#[cfg(test)]
mod tests {
    use super::super::test_sets::both;
    use super::super::{CameraControl, CameraModel, predict_calibration};
    use super::*;
    use crate::testing::cameras;
    use crate::{Rig, predicted_covariance_m2};

    const STD_PX: f64 = 0.05;

    fn predicted(controls: &[CameraControl]) -> Rig {
        predict_calibration(&cameras().map(|c| (c, CameraModel::PINHOLE)), controls).unwrap()
    }

    /// Mean variance of places half-way out from the middle of the control frame, by what calibration leaves open.
    fn open_m2(rig: &Rig) -> f64 {
        let sides = [-0.6, 0.6];
        let places = sides
            .iter()
            .flat_map(|x| sides.iter().flat_map(move |y| sides.map(|z| Vector3::new(*x, *y, 1.5 + z))));
        places.map(|p| predicted_covariance_m2(rig, &p, 0.0).unwrap().trace()).sum::<f64>() / 8.0
    }

    #[test]
    fn points_that_are_alike_have_the_noise_that_they_have() {
        for camera in &predicted(&both(STD_PX, &mut 3)).cameras {
            approx::assert_relative_eq!(camera.sigma_px, STD_PX, max_relative = 1e-6);
        }
    }

    /// Points of which some lie before lamps: places triangulated by the cameras are as uncertain as after a calibration by points
    /// with the one noise; with the mean of their weights they are not.
    #[test]
    fn the_one_noise_leaves_as_much_open_as_noises_that_differ() {
        let mut controls = both(STD_PX, &mut 3);
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
