//! From control points to a rig of cameras with their uncertainty.

mod adjust;
mod alike;
mod choose;
mod disagree;
mod expected;
#[cfg(test)]
mod fault_tests;
mod layout;
mod link;
mod model;
mod moved;
mod normal;
#[cfg(test)]
mod object_tests;
mod objects;
mod pair;
mod plane;
mod problem;
mod snoop;
mod start;
#[cfg(test)]
pub(crate) mod test_sets;
#[cfg(test)]
mod tests;

pub use expected::predict_calibration;
pub use model::{CameraModel, Lens, Pixels};
pub use moved::MovedObject;

use crate::PoseError;
use alike::alike_std_px;
use choose::root;
use disagree::hotelling_over_normal;
use mavsight_geometry::camera_parameters::CENTRE;
use mavsight_geometry::{
    CAMERA_PARAMETERS, Camera, ControlPoint, GeometryError, ImageSize, Matrix3, Vector2, Vector3,
};
use nalgebra::DMatrix;
use objects::with_objects;
use problem::Problem;
use snoop::{Cleaned, clean};
use std::fmt;

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
    /// Standard deviation of each coordinate of each point's surveyed place; 0 for exact.
    pub survey_std_m: Vec<f64>,
}

impl CameraControl {
    /// Points whose places count as exact.
    pub fn exact(name: String, size: ImageSize, points: Vec<ControlPoint>, ball_radius_m: Vec<f64>) -> Self {
        let survey_std_m = vec![0.0; points.len()];
        Self { name, size, points, ball_radius_m, survey_std_m }
    }
}

/// A control point in one camera, after calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlResidual {
    /// Its name.
    pub name: String,
    /// Its surveyed place.
    pub point_in_world_m: Vector3<f64>,
    /// Measured less expected centre of its image.
    pub residual_px: Vector2<f64>,
    /// Root mean square of the externally studentised residual over its two coordinates: 1 is usual. The probability
    /// of more is that of an F ratio with 2 degrees of freedom above. Zero where it cannot be had.
    pub studentised: f64,
    /// Whether it entered.
    pub used: bool,
}

/// One calibrated camera.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Camera name.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// The model that the data asked for.
    pub model: CameraModel,
    /// Standard deviation of the projection centre, world axes; see [`Rig::uncertainty`] for what it means.
    pub centre_std_m: Vector3<f64>,
    /// Covariance of the projection centre, world axes.
    pub centre_cov_m2: Matrix3<f64>,
    /// Every control point that it saw.
    pub points: Vec<ControlResidual>,
    /// Root mean square residual of the points used, over all coordinates.
    pub residual_rms_px: f64,
    /// Estimated standard deviation of one pixel coordinate of its control points: that with which they, all alike, would leave as
    /// much open of where a point is in the volume that they take up.
    pub sigma_px: f64,
}

impl RigCamera {
    /// Whether its lens' distortion is among the parameters.
    pub fn distortion_is_estimated(&self) -> bool {
        self.model.lens != Lens::Straight
    }
}

/// A control point that does not agree with the others.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Its name.
    pub name: String,
    /// The camera in which it was left out; all of them, where none is named.
    pub camera: Option<String>,
    /// Why.
    pub reason: LeftOutReason,
}

/// Why a control point was left out.
#[derive(Debug, Clone, PartialEq)]
pub enum LeftOutReason {
    /// It is not where the table says: wrongly surveyed, moved, or wrongly found in the image.
    Displaced,
    /// It bears the name, or the colour, of another.
    Swapped {
        /// The other.
        with: String,
    },
    /// It or another does not agree with the rest, and which cannot be told: all of them were left out.
    Doubtful {
        /// The others.
        with: String,
    },
}

impl fmt::Display for LeftOut {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "control point {} was left out", self.name)?;
        if let Some(camera) = &self.camera {
            write!(out, " of {camera}")?;
        }
        match &self.reason {
            LeftOutReason::Displaced => {
                out.write_str(": it is not seen where its place in the table says; measure it again")
            }
            LeftOutReason::Swapped { with } => {
                write!(out, ": it and {with} are seen in each other's place; exchange them in the table")
            }
            LeftOutReason::Doubtful { with } => {
                write!(out, ": it or {with} does not agree with the others; measure them again")
            }
        }
    }
}

/// Cameras that share one world.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// In the order of the session.
    pub cameras: Vec<RigCamera>,
    /// What is not known of the cameras: 16 rows a camera ([`mavsight_geometry::CameraChange`]), each column one standard
    /// deviation along one of the independent directions of error, so that the covariance of all cameras is U Uᵀ. No
    /// columns: the cameras count as exact.
    ///
    /// The noise is estimated from few residuals. The covariance is widened so that the usual 95 % ellipsoid of three
    /// coordinates (chi-square below 7.81) holds the truth in 95 % of all calibrations all the same (Hotelling 1931);
    /// intervals of ±1.96 standard deviations of single coordinates hold a little more.
    pub uncertainty: DMatrix<f64>,
    /// Control points that disagree with the others.
    pub left_out: Vec<LeftOut>,
    /// Frames of a flight that have refined the cameras: 0 where they are as the control points have left them.
    pub frames: usize,
}

impl Default for Rig {
    fn default() -> Self {
        Self::exact(Vec::new())
    }
}

impl Rig {
    /// Cameras that count as exact.
    pub fn exact(cameras: Vec<RigCamera>) -> Self {
        let rows = CAMERA_PARAMETERS * cameras.len();
        Self { cameras, uncertainty: DMatrix::zeros(rows, 0), left_out: Vec::new(), frames: 0 }
    }

    /// All places of control points, once per camera that saw them.
    pub fn control_points_in_world(&self) -> Vec<Vector3<f64>> {
        self.cameras.iter().flat_map(|c| c.points.iter().map(|p| p.point_in_world_m)).collect()
    }
}

/// A centre less certain than this part of its distance from the control points is none.
const UNDETERMINED: f64 = 0.25;

/// Solves for all cameras together from their control points.
///
/// The most probable model of the nested family ([`CameraModel`]) is adjusted by Levenberg-Marquardt to the images of
/// all points, weighted by their covariances, with points that are not exact as parameters bound to their survey
/// (bundle adjustment, Triggs et al. 2000). A ball is expected at the centre of its elliptical image. What lenses and
/// sensors usually are enters as weak priors. The noise's scale is estimated from the residuals of all cameras, with the
/// claimed covariances as a prior. Points that disagree with the others beyond chance are left out and named.
///
/// # Errors
/// [`PoseError::Calibration`] names the camera; [`PoseError::ControlLengths`]; [`PoseError::NoCameras`];
/// [`PoseError::SuspectControlPoints`] where a point disagrees but too few others remain to do without it;
/// [`PoseError::ControlMisfit`] where the points as a whole are not seen as the table says.
pub fn calibrate(controls: &[CameraControl]) -> Result<Rig, PoseError> {
    calibrate_with(controls, &[])
}

/// The same with objects of known shape that were moved before the cameras, in one bundle adjustment: each place of an object is
/// a pose of its own, which is eliminated. Intrinsics come from both, extrinsics and the world's axes from the control
/// points: five or more in each camera, or three in all that two cameras see, where the objects link the cameras. Without any
/// control point the world's axes are those of the first camera: x to its right, y forward, z up, origin in its centre.
///
/// A wand links cameras that see both of its balls at eight places or more, a board those that see it at once.
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
    let widened = hotelling_over_normal(cleaned.chosen.best.freedom);
    let covariance = cleaned.chosen.camera_covariance() * (widened * widened);
    let sigma_px = alike_std_px(&problem, &cleaned.choice, &cleaned.chosen.best);
    let cameras = controls
        .iter()
        .enumerate()
        .map(|(camera, control)| {
            rig_camera(&problem, &cleaned, (camera, control), (&covariance, sigma_px[camera]))
        })
        .collect::<Result<_, _>>()?;
    Ok(Rig { cameras, uncertainty: root(&covariance), left_out: cleaned.left_out, frames: 0 })
}

fn rig_camera(
    problem: &Problem,
    cleaned: &Cleaned,
    (camera, control): (usize, &CameraControl),
    (covariance, sigma_px): (&DMatrix<f64>, f64),
) -> Result<RigCamera, PoseError> {
    let (fit, choice) = (&cleaned.chosen.best, &cleaned.choice);
    let at = CAMERA_PARAMETERS * camera + CENTRE;
    let centre_cov_m2: Matrix3<f64> = covariance.fixed_view::<3, 3>(at, at).into_owned();
    let centre_std_m = centre_cov_m2.diagonal().map(|v| v.max(0.0).sqrt());
    let distance_m = (fit.cameras[camera].centre_in_world() - problem.middle_m()).norm();
    if centre_std_m.norm().partial_cmp(&(UNDETERMINED * distance_m)).is_none_or(|order| order.is_gt()) {
        let source = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
        return Err(PoseError::Calibration { camera: control.name.clone(), source });
    }
    let (moved_px2, mut used, _) = problem.moved_residuals(fit, camera);
    let (mut points, mut sum_px2) = (vec![], moved_px2 / 2.0);
    for k in (0..problem.sights.len()).filter(|k| problem.sights[*k].camera == camera) {
        let sight = &problem.sights[k];
        let residual_px = fit.residual_px(problem, choice, k).unwrap_or_else(Vector2::zeros);
        let studentised = fit.disagreement(problem, choice, &[k]).map_or(0.0, |d| d.studentised);
        if choice.used[k] {
            sum_px2 += residual_px.norm_squared() / 2.0;
            used += 1.0;
        }
        let point = &problem.points[sight.point];
        points.push(ControlResidual {
            name: point.name.clone(),
            point_in_world_m: point.in_world_m,
            residual_px,
            studentised,
            used: choice.used[k],
        });
    }
    Ok(RigCamera {
        name: control.name.clone(),
        camera: fit.cameras[camera],
        model: fit.models[camera],
        centre_std_m,
        centre_cov_m2,
        points,
        residual_rms_px: (sum_px2 / f64::max(used, 1.0)).sqrt(),
        sigma_px,
    })
}
