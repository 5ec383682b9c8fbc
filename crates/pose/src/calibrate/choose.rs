//! The model that the data ask for, and what the others say.

use super::adjust::{Fit, adjust, readjust};
use super::model::CameraModel;
use super::problem::{Choice, Problem};
use super::start::{MIN_POINTS, starts};
use mavsight_geometry::camera_parameters::{CENTRE, DISTORTION, INTRINSICS, TURN};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, CameraChange, GeometryError, ImageSize};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Models less probable than the best by this factor do not enter the uncertainty (Madigan & Raftery 1994).
const OCCAMS_WINDOW: f64 = 20.0;

/// The adjustment under the most probable model, and those under others that are not much less probable.
#[derive(Clone)]
pub(super) struct Chosen {
    pub(super) best: Fit,
    /// With their probabilities relative to the best.
    pub(super) others: Vec<(f64, Fit)>,
}

/// Cameras to start from, by camera; a camera without used sights keeps a neutral one.
///
/// # Errors
/// The camera, and why its points do not make a start.
pub(super) fn start_cameras(
    problem: &Problem,
    choice: &Choice,
) -> Result<Vec<Camera>, (usize, GeometryError)> {
    if let Some(known) = &problem.start {
        return Ok(known.clone());
    }
    let neutral = |size: ImageSize| starting_point(size);
    let mut cameras: Vec<Camera> = problem.sizes.iter().map(|s| neutral(*s)).collect();
    for camera in 0..cameras.len() {
        let control = problem.control(choice, camera);
        let candidates = starts(&control, problem.sizes[camera]).map_err(|e| (camera, e))?;
        let alone = Choice {
            used: choice
                .used
                .iter()
                .zip(&problem.sights)
                .map(|(used, s)| *used && s.camera == camera)
                .collect(),
            place: choice.place.clone(),
        };
        let models = vec![CameraModel::PINHOLE; cameras.len()];
        let fits = candidates.iter().filter_map(|candidate| {
            let mut start = cameras.clone();
            start[camera] = *candidate;
            adjust(problem, &alone, &models, &start)
        });
        let best = fits.min_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence).reverse());
        let undetermined = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
        cameras[camera] = best.ok_or((camera, undetermined))?.cameras[camera];
    }
    Ok(cameras)
}

fn starting_point(size: ImageSize) -> Camera {
    let intrinsics = mavsight_geometry::Intrinsics::from_horizontal_fov(size, 1.0);
    Camera {
        cam_from_world: mavsight_geometry::Isometry3::identity(),
        intrinsics,
        distortion: Default::default(),
        size,
    }
}

/// Whether each camera keeps points enough.
pub(super) fn is_enough(problem: &Problem, choice: &Choice) -> bool {
    (0..problem.sizes.len()).all(|camera| {
        if problem.moved.iter().any(|m| m.is_seen_by(camera)) {
            return true;
        }
        let seen = problem.sights.iter().zip(&choice.used).filter(|(s, used)| **used && s.camera == camera);
        seen.count() >= MIN_POINTS
    })
}

/// Climbs from the pinhole to the most probable model; cameras with images of one size share one.
///
/// A model is judged by its evidence (Kass & Raftery 1995, equation 5): the probability of the data, averaged over what
/// the priors allow, so that freedom which the data do not use costs.
pub(super) fn choose(problem: &Problem, choice: &Choice, start: &[Camera]) -> Option<Chosen> {
    let models = vec![CameraModel::PINHOLE; start.len()];
    let mut best = adjust(problem, choice, &models, start)?;
    let mut tried: Vec<Fit> = Vec::new();
    let mut sizes: Vec<ImageSize> = Vec::new();
    problem.sizes.iter().for_each(|s| {
        if !sizes.contains(s) {
            sizes.push(*s);
        }
    });
    loop {
        let mut better: Option<Fit> = None;
        for size in &sizes {
            let Some(first) = problem.sizes.iter().position(|s| s == size) else { continue };
            for wider in best.models[first].wider() {
                let models: Vec<CameraModel> = problem
                    .sizes
                    .iter()
                    .zip(&best.models)
                    .map(|(s, model)| if s == size { wider } else { *model })
                    .collect();
                // What two steps lead to may have been tried from one step before: each model counts once.
                if tried.iter().chain(&better).any(|fit| fit.models == models) {
                    continue;
                }
                let Some(fit) = readjust(problem, choice, &models, &best) else { continue };
                let ahead = better.as_ref().map_or(best.log_evidence, |b| b.log_evidence);
                if fit.log_evidence > ahead {
                    tried.extend(better.replace(fit));
                } else {
                    tried.push(fit);
                }
            }
        }
        match better {
            Some(next) => tried.push(std::mem::replace(&mut best, next)),
            None => break,
        }
    }
    let others = tried
        .into_iter()
        .map(|fit| ((fit.log_evidence - best.log_evidence).exp(), fit))
        .filter(|(ratio, _)| *ratio > 1.0 / OCCAMS_WINDOW)
        .collect();
    Some(Chosen { best, others })
}

impl Chosen {
    /// Covariance of all cameras: within the models and between them (Hoeting et al. 1999, equation 5), about the best.
    pub(super) fn camera_covariance(&self) -> DMatrix<f64> {
        let total: f64 = 1.0 + self.others.iter().map(|o| o.0).sum::<f64>();
        let mut sum = self.best.camera_covariance() / total;
        for (ratio, fit) in &self.others {
            let mut away = DVector::zeros(CAMERA_PARAMETERS * fit.cameras.len());
            for (k, (from, to)) in self.best.cameras.iter().zip(&fit.cameras).enumerate() {
                away.fixed_rows_mut::<CAMERA_PARAMETERS>(CAMERA_PARAMETERS * k)
                    .copy_from(&change_between(from, to));
            }
            sum += (fit.camera_covariance() + &away * away.transpose()) * (ratio / total);
        }
        sum
    }
}

/// The change that leads from one camera to another.
fn change_between(from: &Camera, to: &Camera) -> CameraChange {
    let mut out = CameraChange::zeros();
    let turn = to.cam_from_world.rotation * from.cam_from_world.rotation.inverse();
    out.fixed_rows_mut::<3>(TURN).copy_from(&-turn.scaled_axis());
    out.fixed_rows_mut::<3>(CENTRE).copy_from(&(to.centre_in_world() - from.centre_in_world()));
    let (a, b) = (&from.intrinsics, &to.intrinsics);
    let k =
        [b.fx_px - a.fx_px, b.fy_px - a.fy_px, b.skew_px - a.skew_px, b.cx_px - a.cx_px, b.cy_px - a.cy_px];
    let (a, b) = (&from.distortion, &to.distortion);
    let d = [b.k1 - a.k1, b.k2 - a.k2, b.p1 - a.p1, b.p2 - a.p2, b.k3 - a.k3];
    for i in 0..5 {
        out[INTRINSICS + i] = k[i];
        out[DISTORTION + i] = d[i];
    }
    out
}

/// U with U Uᵀ the covariance, one column for each direction that it has; scaled first, as its units differ.
pub(super) fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let n = covariance.nrows();
    let scale: Vec<f64> = covariance.diagonal().iter().map(|v| v.max(0.0).sqrt()).collect();
    let unit = DMatrix::from_fn(n, n, |i, j| {
        let size = scale[i] * scale[j];
        if size > 0.0 { covariance[(i, j)] / size } else { 0.0 }
    });
    let eigen = SymmetricEigen::new(unit);
    let mut order: Vec<usize> = (0..n).filter(|k| eigen.eigenvalues[*k] > 1e-12).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    DMatrix::from_fn(n, order.len(), |i, k| {
        scale[i] * eigen.eigenvectors[(i, order[k])] * eigen.eigenvalues[order[k]].sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::cameras;

    #[test]
    fn the_change_between_two_cameras_leads_from_one_to_the_other() {
        let [a, mut b] = cameras();
        b.distortion.k1 = -0.2;
        b.intrinsics.skew_px = 1.0;
        let back = a.moved(&change_between(&a, &b));
        assert!((back.cam_from_world.to_homogeneous() - b.cam_from_world.to_homogeneous()).norm() < 1e-12);
        assert_eq!((back.distortion, back.size), (b.distortion, b.size));
        assert!((back.intrinsics.matrix() - b.intrinsics.matrix()).norm() < 1e-9);
    }

    #[test]
    fn the_root_of_a_covariance_multiplies_back() {
        let spread = DMatrix::from_fn(5, 2, |i, j| ((i * 2 + j) as f64).sin() * 10f64.powi(i as i32 - 2));
        let covariance = &spread * spread.transpose();
        let u = root(&covariance);
        assert_eq!(u.ncols(), 2);
        assert!((&u * u.transpose() - &covariance).amax() < 1e-12 * covariance.amax());
        assert_eq!(root(&DMatrix::zeros(3, 3)).ncols(), 0);
    }
}
