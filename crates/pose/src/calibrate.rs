//! From control points to a rig of cameras with their uncertainty.

use crate::PoseError;
use mavsight_geometry::{
    CAMERA_PARAMETERS, Camera, ControlPoint, Dlt, DltFit, ImageSize, Matrix3, Vector2, Vector3,
};
use nalgebra::{DMatrix, SMatrix};

/// What one camera saw of the control frame.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraControl {
    /// Camera name.
    pub name: String,
    /// Size of its images.
    pub size: ImageSize,
    /// Points seen.
    pub points: Vec<ControlPoint>,
    /// Radius of the ball at each point, in their order; 0 for a plain point.
    pub ball_radius_m: Vec<f64>,
}

/// One calibrated camera.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Camera name.
    pub name: String,
    /// What the eleven parameters mean.
    pub camera: Camera,
    /// The fit; its residuals are those of the ball centres.
    pub fit: DltFit,
    /// Standard deviation of the projection centre, world axes.
    pub centre_std_m: Vector3<f64>,
    /// Covariance of the projection centre, world axes.
    pub centre_cov_m2: Matrix3<f64>,
    /// Name and residual of each control point.
    pub points: Vec<(String, Vector2<f64>)>,
    /// Place of each control point.
    pub points_in_world_m: Vec<Vector3<f64>>,
    /// Standard deviation of one pixel coordinate that the residuals show, or the a-priori one without redundancy.
    pub sigma_px: f64,
}

/// Cameras that share one world.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// In the order of the session.
    pub cameras: Vec<RigCamera>,
    /// What is not known of the cameras: 16 rows a camera ([`mavsight_geometry::CameraChange`]), each column one standard
    /// deviation along one of the independent directions of error, so that the covariance of all cameras is U Uᵀ. No
    /// columns: the cameras count as exact.
    pub uncertainty: DMatrix<f64>,
}

impl Default for Rig {
    fn default() -> Self {
        Self { cameras: Vec::new(), uncertainty: DMatrix::zeros(0, 0) }
    }
}

impl Rig {
    /// Cameras that count as exact.
    pub fn exact(cameras: Vec<RigCamera>) -> Self {
        let rows = CAMERA_PARAMETERS * cameras.len();
        Self { cameras, uncertainty: DMatrix::zeros(rows, 0) }
    }

    /// All places of control points, once per camera that saw them.
    pub fn control_points_in_world(&self) -> Vec<Vector3<f64>> {
        self.cameras.iter().flat_map(|c| c.points_in_world_m.iter().copied()).collect()
    }
}

/// Times the ball correction is repeated; it is a few hundredths of a pixel and settles in two.
const BALL_ROUNDS: usize = 3;

/// Solves each camera from its control points.
///
/// The centre of a ball's image is not the image of its centre: the difference is taken from a first fit, subtracted
/// from the measured pixel, and the fit repeated. The covariance of the centre is that of the eleven parameters carried
/// through the decomposition, scaled by the residuals' variance factor where that is above 1.
///
/// # Errors
/// [`PoseError::Calibration`] names the camera; [`PoseError::ControlLengths`]; [`PoseError::NoCameras`].
pub fn calibrate(controls: &[CameraControl]) -> Result<Rig, PoseError> {
    if controls.is_empty() {
        return Err(PoseError::NoCameras { found: 0 });
    }
    let cameras = controls.iter().map(calibrate_one).collect::<Result<_, _>>()?;
    Ok(Rig::exact(cameras))
}

fn calibrate_one(control: &CameraControl) -> Result<RigCamera, PoseError> {
    if control.points.len() != control.ball_radius_m.len() {
        return Err(PoseError::ControlLengths {
            camera: control.name.clone(),
            points: control.points.len(),
            radii: control.ball_radius_m.len(),
        });
    }
    let named = |source| PoseError::Calibration { camera: control.name.clone(), source };
    let mut points = control.points.clone();
    let mut fit = Dlt::fit(&points).map_err(named)?;
    for _ in 0..BALL_ROUNDS {
        let camera = fit.dlt.camera(control.size).map_err(named)?;
        for ((point, measured), radius) in points.iter_mut().zip(&control.points).zip(&control.ball_radius_m)
        {
            let centre = camera.project(&point.point_in_world_m).map_err(named)?.pixel;
            let outline = camera.project_ball(&point.point_in_world_m, *radius).map_err(named)?.pixel;
            point.pixel = measured.pixel + centre - outline;
        }
        fit = Dlt::fit(&points).map_err(named)?;
    }
    let camera = fit.dlt.camera(control.size).map_err(named)?;
    let factor = fit.variance_factor(&points).unwrap_or(1.0);
    let n = points.len() as f64;
    let apriori_px2 = points.iter().map(|p| p.pixel_cov_px2.trace() / 2.0).sum::<f64>() / n;
    let centre_cov_m2 = centre_covariance(&fit, control.size, factor.max(1.0)).map_err(named)?;
    Ok(RigCamera {
        name: control.name.clone(),
        camera,
        centre_std_m: centre_cov_m2.diagonal().map(|v| v.max(0.0).sqrt()),
        centre_cov_m2,
        points: points.iter().map(|p| p.name.clone()).zip(fit.residuals_px.iter().copied()).collect(),
        points_in_world_m: points.iter().map(|p| p.point_in_world_m).collect(),
        sigma_px: (apriori_px2 * factor).sqrt(),
        fit,
    })
}

/// Covariance of the centre: central differences of the decomposition, a thousandth of a standard deviation wide.
fn centre_covariance(
    fit: &DltFit,
    size: ImageSize,
    factor: f64,
) -> Result<Matrix3<f64>, mavsight_geometry::GeometryError> {
    let mut jacobian = SMatrix::<f64, 3, 11>::zeros();
    for k in 0..11 {
        let h = 1e-3 * fit.covariance[(k, k)].max(0.0).sqrt() + 1e-12 * fit.dlt.l[k].abs();
        if h == 0.0 {
            continue;
        }
        let at = |step: f64| {
            let mut moved = fit.dlt;
            moved.l[k] += step;
            moved.camera(size).map(|c| c.centre_in_world())
        };
        jacobian.set_column(k, &((at(h)? - at(-h)?) / (2.0 * h)));
    }
    Ok(jacobian * fit.covariance * jacobian.transpose() * factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SIZE, cameras, cube, normal};
    use mavsight_geometry::{GeometryError, Matrix2};

    fn control(camera: &Camera, std_px: f64, radius_m: f64, seed: &mut u64) -> CameraControl {
        let points: Vec<_> = cube()
            .iter()
            .enumerate()
            .map(|(i, p)| ControlPoint {
                name: format!("p{i}"),
                point_in_world_m: *p,
                pixel: camera.project_ball(p, radius_m).unwrap().pixel
                    + Vector2::new(normal(seed), normal(seed)) * std_px,
                pixel_cov_px2: Matrix2::identity() * std_px.max(1e-4).powi(2),
            })
            .collect();
        CameraControl { name: "cam1".into(), size: SIZE, ball_radius_m: vec![radius_m; points.len()], points }
    }

    #[test]
    fn large_balls_do_not_bias_the_camera() {
        let truth = cameras()[0];
        let control = control(&truth, 0.0, 0.3, &mut 1);
        let rig = calibrate(std::slice::from_ref(&control)).unwrap();
        let error = (rig.cameras[0].camera.centre_in_world() - truth.centre_in_world()).norm();
        let plain = CameraControl { ball_radius_m: vec![0.0; 8], ..control };
        let biased = calibrate(&[plain]).unwrap().cameras[0].camera.centre_in_world();
        assert!(error < 1e-5, "centre off by {error} m");
        assert!((biased - truth.centre_in_world()).norm() > 1e-3, "the correction must matter in this test");
    }

    #[test]
    fn the_centres_covariance_is_the_spread_of_many_trials() {
        let truth = cameras()[0];
        let (mut sum, mut seed, trials) = (0.0, 11, 400);
        for _ in 0..trials {
            let mut control = control(&truth, 0.1, 0.03, &mut seed);
            // Overstated covariances keep the variance factor, which would inflate some trials, below 1.
            control.points.iter_mut().for_each(|p| p.pixel_cov_px2 *= 9.0);
            let camera = &calibrate(&[control]).unwrap().cameras[0];
            let error = camera.camera.centre_in_world() - truth.centre_in_world();
            sum += 9.0 * (error.transpose() * camera.centre_cov_m2.try_inverse().unwrap() * error)[0];
        }
        let mean = sum / f64::from(trials);
        assert!((mean - 3.0).abs() < 4.0 * (6.0 / f64::from(trials)).sqrt() + 0.1, "mean NEES {mean}");
    }

    #[test]
    fn residuals_larger_than_claimed_widen_the_centre() {
        let truth = cameras()[1];
        let mut loud = control(&truth, 1.0, 0.0, &mut 5);
        loud.points.iter_mut().for_each(|p| p.pixel_cov_px2 = Matrix2::identity() * 1e-4);
        let camera = &calibrate(&[loud]).unwrap().cameras[0];
        assert!(camera.sigma_px > 0.3 && camera.sigma_px < 2.0, "{}", camera.sigma_px);
        let error = camera.camera.centre_in_world() - truth.centre_in_world();
        assert!(error.norm() < 5.0 * camera.centre_std_m.norm());
    }

    #[test]
    fn errors_name_the_camera() {
        let mut few = control(&cameras()[0], 0.1, 0.03, &mut 2);
        few.points.truncate(5);
        assert!(matches!(
            calibrate(&[few.clone()]),
            Err(PoseError::ControlLengths { points: 5, radii: 8, .. })
        ));
        few.ball_radius_m.truncate(5);
        let error = calibrate(&[few]).unwrap_err();
        let source = GeometryError::TooFewControlPoints { found: 5, needed: 6 };
        assert_eq!(error, PoseError::Calibration { camera: "cam1".into(), source });
        assert!(error.to_string().starts_with("camera cam1: 5 control points"));
        assert!(matches!(calibrate(&[]), Err(PoseError::NoCameras { found: 0 })));
    }
}
