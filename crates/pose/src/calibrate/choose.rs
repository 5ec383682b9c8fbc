//! The most probable camera model, and those that are nearly as probable.

use super::adjust::{Fit, adjust, readjust};
use super::model::CameraModel;
use super::problem::{Choice, Data, undetermined};
use super::start::{MIN_POINTS, starts};
use crate::PoseError;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, ImageSize, Intrinsics, Isometry3};
use nalgebra::{DMatrix, DVector};

/// Models less probable than the best by this factor do not enter the uncertainty (Madigan & Raftery 1994).
const OCCAMS_WINDOW: f64 = 20.0;

/// The adjustment under the most probable model, and those under others that are not much less probable.
#[derive(Clone)]
pub(super) struct Chosen {
    pub(super) best: Fit,
    /// With their probabilities relative to the best.
    pub(super) others: Vec<(f64, Fit)>,
}

/// Cameras to start from; a camera without used observations keeps a neutral one.
pub(super) fn start_cameras(data: Data) -> Result<Vec<Camera>, PoseError> {
    let Data { problem, .. } = data;
    if let Some(known) = &problem.start {
        return Ok(known.clone());
    }
    (0..problem.sizes.len()).map(|camera| start_camera(data, camera)).collect()
}

/// A camera to start from, by its used control points alone.
pub(super) fn start_camera(data: Data, camera: usize) -> Result<Camera, PoseError> {
    let Data { problem, choice } = data;
    let neutral = |s: &ImageSize| {
        Camera::undistorted(Isometry3::identity(), Intrinsics::from_horizontal_fov(*s, 1.0), *s)
    };
    let cameras: Vec<Camera> = problem.sizes.iter().map(neutral).collect();
    let name = &problem.names[camera];
    let named = |source| PoseError::Calibration { camera: name.clone(), source };
    let candidates = starts(&data.control(camera), problem.sizes[camera]).map_err(named)?;
    let mut alone = Choice { used: vec![false; choice.used.len()], place: choice.place.clone() };
    data.used_by(camera).for_each(|k| alone.used[k] = true);
    let models = vec![CameraModel::PINHOLE; cameras.len()];
    let best = most_probable(candidates.iter().filter_map(|candidate| {
        let mut start = cameras.clone();
        start[camera] = *candidate;
        adjust(problem.with(&alone), &models, &start)
    }));
    Ok(best.ok_or_else(|| undetermined(name))?.state.cameras[camera])
}

pub(super) fn most_probable(fits: impl Iterator<Item = Fit>) -> Option<Fit> {
    fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

pub(super) fn is_enough(data: Data) -> bool {
    (0..data.problem.sizes.len()).all(|camera| {
        data.problem.moved.iter().any(|m| m.is_seen_by(camera)) || data.used_by(camera).count() >= MIN_POINTS
    })
}

/// Climbs from the pinhole to the most probable model; cameras with images of one size share one.
///
/// A model is judged by its evidence (Kass & Raftery 1995, equation 5): the probability of the data, averaged
/// over the priors, so that freedom which the data do not use costs.
pub(super) fn choose(data: Data, start: &[Camera]) -> Option<Chosen> {
    let problem = data.problem;
    let models = vec![CameraModel::PINHOLE; start.len()];
    let mut best = adjust(data, &models, start)?;
    let mut tried: Vec<Fit> = Vec::new();
    loop {
        let before = best.clone();
        for (first, size) in problem.sizes.iter().enumerate() {
            if problem.sizes[..first].contains(size) {
                continue;
            }
            for wider in before.models[first].wider() {
                let own = problem.sizes.iter().zip(&before.models);
                let models: Vec<_> = own.map(|(s, model)| if s == size { wider } else { *model }).collect();
                // A model may have been tried on another way: each counts once.
                if tried.iter().chain([&best]).any(|fit| fit.models == models) {
                    continue;
                }
                let Some(mut fit) = readjust(data, &models, &before) else { continue };
                if fit.log_evidence > best.log_evidence {
                    std::mem::swap(&mut fit, &mut best);
                }
                tried.push(fit);
            }
        }
        if best.models == before.models {
            break;
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
    /// Covariance of all cameras within and between the models (Hoeting et al. 1999, equation 5).
    pub(super) fn camera_covariance(&self) -> DMatrix<f64> {
        let total: f64 = 1.0 + self.others.iter().map(|o| o.0).sum::<f64>();
        let mut sum = self.best.camera_covariance() / total;
        for (ratio, fit) in &self.others {
            let (from, to) = (&self.best.state.cameras, &fit.state.cameras);
            let mut away = DVector::zeros(CAMERA_PARAMETERS * to.len());
            for (k, (from, to)) in from.iter().zip(to).enumerate() {
                away.fixed_rows_mut::<CAMERA_PARAMETERS>(CAMERA_PARAMETERS * k)
                    .copy_from(&from.change_to(to));
            }
            sum += (fit.camera_covariance() + &away * away.transpose()) * (ratio / total);
        }
        sum
    }
}

/// U with U Uᵀ the covariance, one column for each direction that it has; scaled first, as its units differ.
pub(super) fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = covariance.diagonal().map(|v| v.max(0.0).sqrt());
    let inverse = scale.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
    let eigen = covariance.component_mul(&(&inverse * inverse.transpose())).symmetric_eigen();
    let mut order: Vec<usize> = (0..scale.len()).filter(|k| eigen.eigenvalues[*k] > 1e-12).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    DMatrix::from_fn(scale.len(), order.len(), |i, k| {
        scale[i] * eigen.eigenvectors[(i, order[k])] * eigen.eigenvalues[order[k]].sqrt()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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
