//! Calibration of all cameras together, and its prediction.

use super::adjust::{Fit, expected};
use super::alike::alike_std_px;
use super::choose::root;
use super::disagree::hotelling_over_normal;
use super::model::CameraModel;
use super::moved::{Moved, MovedObject};
use super::objects::{ENOUGH_POINTS, with_objects};
use super::problem::{Data, Problem, Surveyed, undetermined};
use super::rig::{ByFlight, CameraControl, ControlResidual, Rig, RigCamera};
use super::snoop::clean;
use super::start::MIN_POINTS;
use crate::PoseError;
use mavsight_geometry::camera_parameters::CENTRE;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, ControlPoint, GeometryError, Matrix2, Vector2};
use nalgebra::DMatrix;

/// Part of the distance from the control points above which a centre's standard deviation is too large.
const UNDETERMINED: f64 = 0.25;

/// Solves for all cameras together from their control points.
///
/// The most probable model of the nested family ([`CameraModel`]) is adjusted by Levenberg-Marquardt to the
/// images of all points, weighted by their covariances; points that are not exact are parameters bound to
/// their survey (bundle adjustment, Triggs et al. 2000). Usual values of lenses and sensors are weak priors.
/// The noise's scale is estimated, with the stated covariances as a prior. Points that disagree with the
/// others beyond chance are left out and named.
///
/// # Errors
/// [`PoseError::Calibration`] names the camera; [`PoseError::ControlLengths`]; [`PoseError::NoCameras`];
/// [`PoseError::SuspectControlPoints`] where a point disagrees but too few others remain to do without it;
/// [`PoseError::ControlMisfit`] where the points as a whole disagree with the table.
pub fn calibrate(controls: &[CameraControl]) -> Result<Rig, PoseError> {
    calibrate_with(controls, &[])
}

/// Solves for all cameras from control points and from objects of known shape that were moved in view of
/// them, by one bundle adjustment as in [`calibrate`] with a pose for each place of an object.
///
/// The world's axes come from the control points: five or more in each camera, or three in all that two
/// cameras see, where the objects link the cameras. Without any they are those of the first camera: x to its
/// right, y forward, z up, origin in its centre. A wand links cameras that see both of its balls at eight
/// places or more, a board those that see it at once.
///
/// # Errors
/// Those of [`calibrate`]; [`PoseError::BadObject`], [`PoseError::BadObservation`]; [`PoseError::NotLinked`];
/// [`PoseError::WorldAxes`]; [`PoseError::ObjectMisfit`]; [`PoseError::FocalUndetermined`].
pub fn calibrate_with(controls: &[CameraControl], objects: &[MovedObject]) -> Result<Rig, PoseError> {
    if controls.is_empty() {
        return Err(PoseError::NoCameras { found: 0 });
    }
    let (problem, cleaned) = if objects.is_empty() {
        let problem = Problem::new(controls)?;
        let cleaned = clean(&problem)?;
        (problem, cleaned)
    } else {
        with_objects(controls, objects)?
    };
    let (data, fit) = (problem.with(&cleaned.choice), &cleaned.chosen.best);
    let widened = hotelling_over_normal(fit.freedom);
    let uncertainty = root(&(cleaned.chosen.camera_covariance() * (widened * widened)));
    let mut rig = rig_of(data, fit, uncertainty);
    for (camera, own) in rig.cameras.iter_mut().enumerate() {
        let distance_m = (own.camera.centre_in_world() - problem.middle_m()).norm();
        let share = own.centre_std_m.norm() / distance_m;
        if share.is_nan() || share > UNDETERMINED {
            return Err(undetermined(&own.name));
        }
        own.points = residuals(data, fit, camera);
        let of_objects = fit.object_residuals(&problem, camera);
        let used = || own.points.iter().filter(|p| p.used);
        let squares_px2 = of_objects.squares_px2 + used().map(|p| p.residual_px.norm_squared()).sum::<f64>();
        let coordinates = 2.0 * (of_objects.observations + used().count() as f64);
        own.residual_rms_px = (squares_px2 / f64::max(coordinates, 1.0)).sqrt();
    }
    rig.left_out = cleaned.left_out;
    let uses =
        objects.iter().zip(&problem.moved).flat_map(|(object, moved)| moved.images(object, &problem.names));
    rig.images = uses.collect();
    rig.by_flight = by_flight(&problem, &rig);
    if !rig.by_flight.is_empty() {
        // The flight must not count twice.
        rig.frames = problem.moved.iter().filter(|m| m.is_free()).map(|m| m.places.len()).sum();
    }
    Ok(rig)
}

/// The rig that [`calibrate`] would make of cameras that stand as given, with its uncertainty, without any
/// image: the adjustment's equations at these cameras and the stated covariances. The model of each camera is
/// given; the choice between models and the estimation of the noise are not predicted.
///
/// # Errors
/// [`PoseError::NoCameras`]; [`PoseError::ControlLengths`]; [`PoseError::Calibration`] names the camera that
/// sees fewer than five points, or whose points do not determine it.
pub fn predict_calibration(
    cameras: &[(Camera, CameraModel)],
    controls: &[CameraControl],
) -> Result<Rig, PoseError> {
    if controls.is_empty() || controls.len() != cameras.len() {
        return Err(PoseError::NoCameras { found: controls.len().min(cameras.len()) });
    }
    if let Some(few) = controls.iter().find(|c| c.points.len() < MIN_POINTS) {
        let source = GeometryError::TooFewControlPoints { found: few.points.len(), needed: MIN_POINTS };
        return Err(PoseError::Calibration { camera: few.name.clone(), source });
    }
    let problem = Problem::new(controls)?;
    let (views, models): (Vec<Camera>, Vec<CameraModel>) = cameras.iter().copied().unzip();
    let choice = problem.all();
    let fit = expected(problem.with(&choice), &models, &views);
    let fit = fit.and_then(|fit| Some((fit.camera_root()?, fit)));
    let (uncertainty, fit) = fit.ok_or_else(|| undetermined(&controls[0].name))?;
    let mut rig = rig_of(problem.with(&choice), &fit, uncertainty);
    for (camera, own) in rig.cameras.iter_mut().enumerate() {
        own.points = residuals(problem.with(&choice), &fit, camera);
    }
    Ok(rig)
}

/// The cameras of a fit with their uncertainty, without residuals.
fn rig_of(data: Data, fit: &Fit, uncertainty: DMatrix<f64>) -> Rig {
    let sigma_px = alike_std_px(data, fit);
    let one = |(k, name): (usize, &String)| {
        let root = uncertainty.fixed_rows::<3>(CAMERA_PARAMETERS * k + CENTRE);
        let centre_cov_m2 = root * root.transpose();
        RigCamera {
            name: name.clone(),
            camera: fit.state.cameras[k],
            model: fit.models[k],
            centre_std_m: centre_cov_m2.diagonal().map(f64::sqrt),
            centre_cov_m2,
            points: Vec::new(),
            residual_rms_px: 0.0,
            sigma_px: sigma_px[k],
        }
    };
    let cameras = data.problem.names.iter().enumerate().map(one).collect();
    Rig { cameras, uncertainty, left_out: Vec::new(), ..Rig::default() }
}

/// Cameras that see too few control points for themselves, where an object is not one that was made to calibrate them.
fn by_flight(problem: &Problem, rig: &Rig) -> Vec<ByFlight> {
    if !problem.moved.iter().any(Moved::is_free) {
        return Vec::new();
    }
    let points = |camera: &RigCamera| camera.points.iter().filter(|p| p.used).count();
    let few = rig.cameras.iter().filter(|camera| points(camera) < ENOUGH_POINTS);
    let cameras: Vec<_> = rig.cameras.iter().map(|c| (c.camera, c.model)).collect();
    let all = rig.cameras.iter().map(|c| seeing_all(problem, c)).collect::<Option<Vec<_>>>();
    let instead = all.and_then(|controls| predict_calibration(&cameras, &controls).ok());
    few.map(|camera| {
        let own = instead.as_ref().and_then(|rig| rig.cameras.iter().find(|c| c.name == camera.name));
        ByFlight {
            camera: camera.name.clone(),
            points: points(camera),
            centre_std_m: camera.centre_std_m.norm(),
            instead: own.map(|c| (c.centre_std_m.norm(), problem.points.len())),
        }
    })
    .collect()
}

/// All control points in the image of a camera, as well as it measures its own; `None` where some are behind it.
fn seeing_all(problem: &Problem, camera: &RigCamera) -> Option<CameraControl> {
    let image = |point: &Surveyed| {
        let seen = camera.camera.project_ball(&point.in_world_m, point.radius_m).ok()?;
        let (name, point_in_world_m) = (point.name.clone(), point.in_world_m);
        let pixel_cov_px2 = Matrix2::identity() * camera.sigma_px.powi(2);
        Some(ControlPoint { name, point_in_world_m, pixel: seen.pixel, pixel_cov_px2 })
    };
    Some(CameraControl {
        name: camera.name.clone(),
        size: camera.camera.size,
        points: problem.points.iter().map(image).collect::<Option<_>>()?,
        ball_radius_m: problem.points.iter().map(|p| p.radius_m).collect(),
        survey_std_m: problem.points.iter().map(|p| p.std_m).collect(),
    })
}

fn residuals(data: Data, fit: &Fit, camera: usize) -> Vec<ControlResidual> {
    let problem = data.problem;
    let own = (0..problem.observations.len()).filter(|k| problem.observations[*k].camera == camera);
    own.map(|k| {
        let point = &problem.points[problem.observations[k].point];
        ControlResidual {
            name: point.name.clone(),
            point_in_world_m: point.in_world_m,
            residual_px: fit.residual_px(data, k).unwrap_or_else(Vector2::zeros),
            studentised: fit.disagreement(data, &[k]).map_or(0.0, |d| d.studentised),
            used: data.choice.used[k],
        }
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_sets::both;
    use super::*;
    use crate::testing::cameras;
    use mavsight_random::Random;

    /// The scatter of many calibrations against the prediction: centre and focal length.
    #[test]
    fn many_calibrations_scatter_as_predicted() {
        let (std_px, mut random, trials) = (0.1, Random::new(5, 0), 300);
        let truth = cameras();
        let given = truth.map(|c| (c, CameraModel::PINHOLE));
        let predicted = predict_calibration(&given, &both(std_px, &mut random)).unwrap();
        let (mut centre_m2, mut focal_px2) = (0.0, 0.0);
        for _ in 0..trials {
            let rig = calibrate(&both(std_px, &mut random)).unwrap();
            for (got, truth) in rig.cameras.iter().zip(&truth) {
                let off = got.camera.centre_in_world() - truth.centre_in_world();
                centre_m2 += off.norm_squared() / f64::from(2 * trials);
                focal_px2 +=
                    (got.camera.intrinsics.fx_px - truth.intrinsics.fx_px).powi(2) / f64::from(2 * trials);
            }
        }
        let expected_m2 = predicted.cameras[0].centre_cov_m2.trace();
        let ratio = (expected_m2 / centre_m2).sqrt();
        assert!((0.85..1.15).contains(&ratio), "predicted over achieved std of the centre {ratio}");
        let focal = predicted.uncertainty.row(mavsight_geometry::camera_parameters::INTRINSICS).norm();
        let ratio = focal / focal_px2.sqrt();
        assert!((0.8..1.2).contains(&ratio), "predicted over achieved std of the focal length {ratio}");
    }

    #[test]
    fn too_few_points_and_no_cameras_are_refused() {
        let mut controls = both(0.1, &mut Random::new(3, 0));
        let given = cameras().map(|c| (c, CameraModel::PINHOLE));
        assert!(matches!(predict_calibration(&[], &[]), Err(PoseError::NoCameras { found: 0 })));
        controls[1].points.truncate(4);
        controls[1].ball_radius_m.truncate(4);
        controls[1].survey_std_m.truncate(4);
        let refused = predict_calibration(&given, &controls).unwrap_err();
        assert!(refused.to_string().contains("cam2") && refused.to_string().contains('4'), "{refused}");
        let mut flat = both(0.1, &mut Random::new(3, 0));
        flat[0].points.iter_mut().for_each(|p| p.pixel_cov_px2 *= f64::NAN);
        assert!(matches!(predict_calibration(&given, &flat), Err(PoseError::Calibration { .. })));
    }
}
