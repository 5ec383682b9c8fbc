//! What a calibration will leave open, before there is a picture.

use super::adjust::{Fit, expected};
use super::alike::alike_std_px;
use super::problem::Problem;
use super::start::MIN_POINTS;
use super::{CameraControl, CameraModel, ControlResidual, Rig, RigCamera};
use crate::PoseError;
use mavsight_geometry::camera_parameters::CENTRE;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, GeometryError, Matrix3, Vector2};
use nalgebra::DMatrix;

/// The rig that [`super::calibrate`] will make of cameras that stand as given, with the uncertainty that it will have.
///
/// The same equations, priors and elimination as in the adjustment, at the true cameras and at the claimed covariances of
/// the control points' images; their pixels are not looked at. The model of each camera is given: what the data would say
/// between models is not foreseen, nor is the covariance widened for a noise that is estimated.
///
/// # Errors
/// [`PoseError::NoCameras`]; [`PoseError::ControlLengths`]; [`PoseError::Calibration`] names the camera that sees fewer than
/// five points, or whose points do not determine it.
pub fn predict_calibration(
    cameras: &[(Camera, CameraModel)],
    controls: &[CameraControl],
) -> Result<Rig, PoseError> {
    if controls.is_empty() || controls.len() != cameras.len() {
        return Err(PoseError::NoCameras { found: controls.len().min(cameras.len()) });
    }
    let refuse =
        |camera: usize, source| Err(PoseError::Calibration { camera: controls[camera].name.clone(), source });
    if let Some(k) = controls.iter().position(|c| c.points.len() < MIN_POINTS) {
        let found = controls[k].points.len();
        return refuse(k, GeometryError::TooFewControlPoints { found, needed: MIN_POINTS });
    }
    let problem = Problem::new(controls)?;
    let (views, models): (Vec<Camera>, Vec<CameraModel>) = cameras.iter().copied().unzip();
    let undetermined = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
    let fit = expected(&problem, &problem.all(), &models, &views);
    let Some((fit, uncertainty)) = fit.and_then(|f| f.camera_root().map(|root| (f, root))) else {
        return refuse(0, undetermined);
    };
    let sigma_px = alike_std_px(&problem, &problem.all(), &fit);
    let rig_cameras = (0..cameras.len())
        .map(|k| rig_camera(&fit, (k, &controls[k]), (&uncertainty, sigma_px[k])))
        .collect();
    Ok(Rig { cameras: rig_cameras, uncertainty, left_out: Vec::new(), frames: 0 })
}

fn rig_camera(
    fit: &Fit,
    (k, control): (usize, &CameraControl),
    (uncertainty, sigma_px): (&DMatrix<f64>, f64),
) -> RigCamera {
    let centre = uncertainty.rows(CAMERA_PARAMETERS * k + CENTRE, 3);
    let product = centre * centre.transpose();
    let centre_cov_m2 = Matrix3::from_fn(|i, j| product[(i, j)]);
    let points = control.points.iter().map(|p| ControlResidual {
        name: p.name.clone(),
        point_in_world_m: p.point_in_world_m,
        residual_px: Vector2::zeros(),
        studentised: 0.0,
        used: true,
    });
    RigCamera {
        name: control.name.clone(),
        camera: fit.cameras[k],
        model: fit.models[k],
        centre_std_m: centre_cov_m2.diagonal().map(|v| v.max(0.0).sqrt()),
        centre_cov_m2,
        points: points.collect(),
        residual_rms_px: 0.0,
        sigma_px,
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_sets::both;
    use super::*;
    use crate::calibrate;
    use crate::testing::cameras;

    /// The scatter of many calibrations against the prediction: centre and focal length.
    #[test]
    fn many_calibrations_scatter_as_predicted() {
        let (std_px, mut seed, trials) = (0.1, 5, 300);
        let truth = cameras();
        let given = truth.map(|c| (c, CameraModel::PINHOLE));
        let predicted = predict_calibration(&given, &both(std_px, &mut seed)).unwrap();
        let (mut centre_m2, mut focal_px2) = (0.0, 0.0);
        for _ in 0..trials {
            let rig = calibrate(&both(std_px, &mut seed)).unwrap();
            for (got, truth) in rig.cameras.iter().zip(&truth) {
                let off = got.camera.centre_in_world() - truth.centre_in_world();
                centre_m2 += off.norm_squared() / f64::from(2 * trials);
                focal_px2 +=
                    (got.camera.intrinsics.fx_px - truth.intrinsics.fx_px).powi(2) / f64::from(2 * trials);
            }
        }
        let foreseen = predicted.cameras[0].centre_cov_m2.trace();
        let ratio = (foreseen / centre_m2).sqrt();
        assert!((0.85..1.15).contains(&ratio), "predicted over achieved std of the centre {ratio}");
        let focal = predicted.uncertainty.row(mavsight_geometry::camera_parameters::INTRINSICS).norm();
        let ratio = focal / focal_px2.sqrt();
        assert!((0.8..1.2).contains(&ratio), "predicted over achieved std of the focal length {ratio}");
    }

    #[test]
    fn too_few_points_and_no_cameras_are_refused() {
        let mut controls = both(0.1, &mut 3);
        let given = cameras().map(|c| (c, CameraModel::PINHOLE));
        assert!(matches!(predict_calibration(&[], &[]), Err(PoseError::NoCameras { found: 0 })));
        controls[1].points.truncate(4);
        controls[1].ball_radius_m.truncate(4);
        controls[1].survey_std_m.truncate(4);
        let refused = predict_calibration(&given, &controls).unwrap_err();
        assert!(refused.to_string().contains("cam2") && refused.to_string().contains('4'), "{refused}");
        let mut flat = both(0.1, &mut 3);
        flat[0].points.iter_mut().for_each(|p| p.pixel_cov_px2 *= f64::NAN);
        assert!(matches!(predict_calibration(&given, &flat), Err(PoseError::Calibration { .. })));
    }
}
