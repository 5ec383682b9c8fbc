//! Control points, and the cameras that a calibration makes of them.

use super::model::{CameraModel, Lens};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, ControlPoint, ImageSize, Matrix3, Vector2, Vector3};
use nalgebra::DMatrix;
use std::fmt;

/// The control points in the image of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraControl {
    /// Camera name.
    pub name: String,
    /// Size of its images.
    pub size: ImageSize,
    /// Points with their images.
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
    /// Name.
    pub name: String,
    /// Surveyed place.
    pub point_in_world_m: Vector3<f64>,
    /// Measured less predicted centre of its image.
    pub residual_px: Vector2<f64>,
    /// Root mean square of the externally studentised residual over its two coordinates: 1 is usual, and its
    /// square is an F ratio with 2 degrees of freedom above. Zero where it cannot be formed.
    pub studentised: f64,
    /// Whether it entered the adjustment.
    pub used: bool,
}

/// One calibrated camera.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Camera name.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// The most probable model.
    pub model: CameraModel,
    /// Standard deviation of the projection centre, world axes; see [`Rig::uncertainty`].
    pub centre_std_m: Vector3<f64>,
    /// Covariance of the projection centre, world axes.
    pub centre_cov_m2: Matrix3<f64>,
    /// Every control point in its image.
    pub points: Vec<ControlResidual>,
    /// Root mean square residual, over all coordinates, of the images that the calibration used: of control points and of
    /// objects that were moved. Of a camera that is refined from the flight, of its control points alone.
    pub residual_rms_px: f64,
    /// Estimated standard deviation of a pixel coordinate of its control points: the one value for all that
    /// would leave a point in their volume as uncertain.
    pub sigma_px: f64,
}

impl RigCamera {
    /// A camera that counts as exact: all that is uncertain is zero, and it has no control points.
    pub fn exact(name: String, camera: Camera, model: CameraModel) -> Self {
        Self {
            name,
            camera,
            model,
            centre_std_m: Vector3::zeros(),
            centre_cov_m2: Matrix3::zeros(),
            points: vec![],
            residual_rms_px: 0.0,
            sigma_px: 0.0,
        }
    }

    /// Whether its lens' distortion is among the parameters.
    pub fn distortion_is_estimated(&self) -> bool {
        self.model.lens != Lens::Straight
    }
}

/// How many images of a moved object entered a calibration, and why others did not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImagesUsed {
    /// Camera name.
    pub camera: String,
    /// The object.
    pub object: String,
    /// Images that were looked at.
    pub images: usize,
    /// Those that were used.
    pub used: usize,
    /// Those that do not show the object.
    pub unseen: usize,
    /// Those that show it where others do better, or too few points of it.
    pub spare: usize,
    /// Those that contradict the others.
    pub contradicting: usize,
    /// How late their time stamps were by the motion of the object; 0 where they are as they came.
    pub late_ns: i64,
}

impl fmt::Display for ImagesUsed {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { camera, object, images, used, .. } = self;
        write!(out, "{camera}: {used} of {images} images of the {object} were used")?;
        for (n, why) in [
            (self.unseen, "do not show it sharp and whole enough"),
            (self.spare, "show nothing that others do not show better"),
            (self.contradicting, "contradict the others"),
        ] {
            if n > 0 {
                write!(out, "; {n} {why}")?;
            }
        }
        if self.late_ns != 0 {
            let (ms, word) =
                (self.late_ns.abs() / 1_000_000, if self.late_ns > 0 { "late" } else { "early" });
            write!(out, "; by the motion of the {object} the film is {ms} ms {word}, and was moved")?;
        }
        out.write_str(".")
    }
}

/// A camera that sees too few control points, calibrated by the flight and the other cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct ByFlight {
    /// Camera name.
    pub camera: String,
    /// Control points that it sees.
    pub points: usize,
    /// Standard deviation of its centre.
    pub centre_std_m: f64,
    /// What that would be without the flight if every camera saw all control points, and how many these are; none
    /// where they would not do either.
    pub instead: Option<(f64, usize)>,
}

impl fmt::Display for ByFlight {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (camera, points, centre_mm) = (&self.camera, self.points, 1e3 * self.centre_std_m);
        write!(
            out,
            "{camera} sees {points} control points, too few for a camera by itself: it is calibrated by the flight and the \
             other cameras, which leaves its centre uncertain by {centre_mm:.1} mm"
        )?;
        match self.instead {
            Some((std_m, all)) => {
                write!(out, "; with all {all} in its still it would be {:.1} mm.", 1e3 * std_m)
            }
            None => out.write_str("."),
        }
    }
}

/// A control point that does not agree with the others.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Name.
    pub name: String,
    /// The camera in which it was left out; `None` for all.
    pub camera: Option<String>,
    /// The reason.
    pub reason: LeftOutReason,
}

/// Why a control point was left out.
#[derive(Debug, Clone, PartialEq)]
pub enum LeftOutReason {
    /// Image and place in the table disagree: wrongly surveyed, moved, or wrongly found in the image.
    Displaced,
    /// It bears the name, or the colour, of another.
    Swapped {
        /// The other.
        with: String,
    },
    /// It or another disagrees with the rest, and the data do not decide which: all of them were left out.
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
            LeftOutReason::Displaced if self.camera.is_some() => out.write_str(
                ": its image there is not where the other cameras and its place in the table put it; look at that image",
            ),
            LeftOutReason::Displaced => {
                out.write_str(": its image is not where its place in the table puts it; measure it again")
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
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rig {
    /// In the order of the session.
    pub cameras: Vec<RigCamera>,
    /// Uncertainty of the cameras: 16 rows a camera ([`mavsight_geometry::CameraChange`]), each column one
    /// standard deviation along an independent direction of error, so that the covariance is U Uᵀ. No
    /// columns: the cameras count as exact.
    ///
    /// It is widened for a noise that is estimated from few residuals, so that the usual 95 % ellipsoid of
    /// three coordinates (chi-square below 7.81) holds the truth in 95 % of all calibrations (Hotelling
    /// 1931).
    pub uncertainty: DMatrix<f64>,
    /// Control points that disagree with the others.
    pub left_out: Vec<LeftOut>,
    /// Use of the images of moved objects.
    pub images: Vec<ImagesUsed>,
    /// Cameras that see too few control points by themselves.
    pub by_flight: Vec<ByFlight>,
    /// Frames of a flight that have refined the cameras: 0 for cameras from control points alone.
    pub frames: usize,
}

impl Rig {
    /// Cameras that count as exact.
    pub fn exact(cameras: Vec<RigCamera>) -> Self {
        let uncertainty = DMatrix::zeros(CAMERA_PARAMETERS * cameras.len(), 0);
        Self { cameras, uncertainty, ..Default::default() }
    }

    /// What is said to people: images that were used or not, cameras that the flight has calibrated.
    pub fn notes(&self) -> impl Iterator<Item = String> + '_ {
        let by_flight = self.by_flight.iter().map(ToString::to_string);
        self.images.iter().map(ToString::to_string).chain(by_flight)
    }

    /// All places of control points, once per camera that saw them.
    pub fn control_points_in_world(&self) -> Vec<Vector3<f64>> {
        self.cameras.iter().flat_map(|c| c.points.iter().map(|p| p.point_in_world_m)).collect()
    }
}
