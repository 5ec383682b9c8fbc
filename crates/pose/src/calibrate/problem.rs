//! All observations of all surveyed points and moved objects, as one adjustment.

use super::moved::Moved;
use super::rig::CameraControl;
use crate::PoseError;
use crate::reprojection::PointObservation;
use mavsight_geometry::{Camera, ControlPoint, GeometryError, ImageSize, Vector3};

#[derive(Clone)]
pub(super) struct Surveyed {
    pub(super) name: String,
    pub(super) in_world_m: Vector3<f64>,
    /// Standard deviation of each of its coordinates; 0 for exact.
    pub(super) std_m: f64,
    pub(super) radius_m: f64,
}

#[derive(Clone, Default)]
pub(super) struct Problem {
    pub(super) names: Vec<String>,
    pub(super) sizes: Vec<ImageSize>,
    pub(super) points: Vec<Surveyed>,
    pub(super) observations: Vec<PointObservation>,
    pub(super) moved: Vec<Moved>,
    /// The camera whose axes are the world's, where no control points determine them.
    pub(super) held: Option<usize>,
    /// Cameras to start from, where they are known already.
    pub(super) start: Option<Vec<Camera>>,
}

/// The observations that enter, and the surveyed place of each one's point.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) used: Vec<bool>,
    /// By observation: the row of the table that holds its point's place.
    pub(super) place: Vec<usize>,
}

#[derive(Clone, Copy)]
pub(super) struct Data<'a> {
    pub(super) problem: &'a Problem,
    pub(super) choice: &'a Choice,
}

impl<'a> Data<'a> {
    pub(super) fn used_by(self, camera: usize) -> impl Iterator<Item = usize> + 'a {
        self.choice.used().filter(move |k| self.problem.observations[*k].camera == camera)
    }

    /// The used observations of one camera as control points.
    pub(super) fn control(self, camera: usize) -> Vec<ControlPoint> {
        let Self { problem, choice } = self;
        self.used_by(camera)
            .map(|k| ControlPoint {
                name: problem.points[problem.observations[k].point].name.clone(),
                point_in_world_m: problem.points[choice.place[k]].in_world_m,
                pixel: problem.observations[k].pixel,
                pixel_cov_px2: problem.observations[k].covariance_px2,
            })
            .collect()
    }
}

impl Choice {
    pub(super) fn used(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.used.len()).filter(|k| self.used[*k])
    }
}

impl Problem {
    /// Points of the same name, place and radius are one point.
    pub(super) fn new(controls: &[CameraControl]) -> Result<Self, PoseError> {
        let mut out = Self {
            names: controls.iter().map(|c| c.name.clone()).collect(),
            sizes: controls.iter().map(|c| c.size).collect(),
            ..Default::default()
        };
        for (camera, control) in controls.iter().enumerate() {
            let (name, points) = (&control.name, control.points.len());
            for (what, given) in [("radii", &control.ball_radius_m), ("survey", &control.survey_std_m)] {
                if points != given.len() {
                    let (camera, given) = (name.clone(), given.len());
                    return Err(PoseError::ControlLengths { camera, points, what, given });
                }
            }
            let sizes = control.survey_std_m.iter().zip(&control.ball_radius_m);
            for (point, (std_m, radius_m)) in control.points.iter().zip(sizes) {
                let refused = |what| {
                    let source = GeometryError::NotFinite { what };
                    PoseError::Calibration { camera: name.clone(), source }
                };
                let place = &point.point_in_world_m;
                let is_number = place.iter().chain([radius_m, std_m]).all(|x| x.is_finite());
                if !is_number || *radius_m < 0.0 || *std_m < 0.0 {
                    return Err(refused("a control point, its radius or its standard deviation"));
                }
                let row = out.row_of(&point.name, *place, *std_m, *radius_m);
                let seen = PointObservation::new(camera, row, point.pixel, point.pixel_cov_px2);
                out.observations
                    .push(seen.ok_or_else(|| refused("a control pixel or the inverse of its covariance"))?);
            }
        }
        Ok(out)
    }

    fn row_of(&mut self, name: &str, in_world_m: Vector3<f64>, std_m: f64, radius_m: f64) -> usize {
        let is_same = |p: &Surveyed| p.name == name && p.in_world_m == in_world_m && p.radius_m == radius_m;
        self.points.iter().position(is_same).filter(|_| !name.is_empty()).unwrap_or_else(|| {
            self.points.push(Surveyed { name: name.to_owned(), in_world_m, std_m, radius_m });
            self.points.len() - 1
        })
    }

    /// All observations, all places as in the table.
    pub(super) fn all(&self) -> Choice {
        let place = self.observations.iter().map(|o| o.point).collect();
        Choice { used: vec![true; self.observations.len()], place }
    }

    pub(super) fn with<'a>(&'a self, choice: &'a Choice) -> Data<'a> {
        Data { problem: self, choice }
    }

    /// Mean of the places of points and of moved objects.
    pub(super) fn middle_m(&self) -> Vector3<f64> {
        let moved = self.moved.iter().flat_map(|m| &m.places).map(|p| p.world_from_body.translation.vector);
        let all = self.points.iter().map(|p| p.in_world_m).chain(moved);
        let (sum, n) = all.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p, n + 1.0));
        sum / f64::max(n, 1.0)
    }

    /// Why all cameras together have no answer.
    pub(super) fn undetermined(&self) -> PoseError {
        undetermined(&self.names.join(", "))
    }
}

/// Why a camera has no answer.
pub(super) fn undetermined(camera: &str) -> PoseError {
    let source = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
    PoseError::Calibration { camera: camera.to_owned(), source }
}
