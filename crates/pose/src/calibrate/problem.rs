//! What all cameras saw of all surveyed points, as one adjustment.

use super::CameraControl;
use super::adjust::Fit;
use super::moved::Moved;
use crate::PoseError;
use mavsight_geometry::{Camera, ControlPoint, GeometryError, ImageSize, Matrix2, Vector2, Vector3};

/// One point seen by one camera.
#[derive(Clone)]
pub(super) struct Sight {
    pub(super) camera: usize,
    pub(super) point: usize,
    pub(super) pixel: Vector2<f64>,
    /// Wᵀ W is the inverse of the claimed covariance.
    pub(super) whitener: Matrix2<f64>,
    pub(super) covariance_px2: Matrix2<f64>,
    pub(super) radius_m: f64,
}

/// A surveyed point.
#[derive(Clone)]
pub(super) struct Surveyed {
    pub(super) name: String,
    pub(super) in_world_m: Vector3<f64>,
    /// Standard deviation of each of its coordinates; 0 for exact.
    pub(super) std_m: f64,
}

#[derive(Clone)]
pub(super) struct Problem {
    pub(super) names: Vec<String>,
    pub(super) sizes: Vec<ImageSize>,
    pub(super) points: Vec<Surveyed>,
    pub(super) sights: Vec<Sight>,
    /// Objects that were moved before the cameras.
    pub(super) moved: Vec<Moved>,
    /// The camera whose axes are the world's, where no control points say it.
    pub(super) held: Option<usize>,
    /// Cameras to start from, where they are known already.
    pub(super) start: Option<Vec<Camera>>,
}

/// Which sights enter, and which surveyed place belongs to each point.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    /// By sight.
    pub(super) used: Vec<bool>,
    /// By sight: the row of the table that holds its point's place.
    pub(super) place: Vec<usize>,
}

impl Problem {
    /// Points of the same name and place are one point.
    pub(super) fn new(controls: &[CameraControl]) -> Result<Self, PoseError> {
        let mut out = Self {
            names: vec![],
            sizes: vec![],
            points: vec![],
            sights: vec![],
            moved: vec![],
            held: None,
            start: None,
        };
        for (camera, control) in controls.iter().enumerate() {
            out.names.push(control.name.clone());
            out.sizes.push(control.size);
            let n = control.points.len();
            for (what, given) in
                [("radii", control.ball_radius_m.len()), ("survey", control.survey_std_m.len())]
            {
                if n != given {
                    let camera = control.name.clone();
                    return Err(PoseError::ControlLengths { camera, points: n, what, given });
                }
            }
            for (k, point) in control.points.iter().enumerate() {
                let named = |source| PoseError::Calibration { camera: control.name.clone(), source };
                let (radius_m, std_m) = (control.ball_radius_m[k], control.survey_std_m[k]);
                let sight = sight_of(point, camera, radius_m, std_m).map_err(named)?;
                let index = out.index_of(point, std_m);
                out.sights.push(Sight { point: index, ..sight });
            }
        }
        Ok(out)
    }

    fn index_of(&mut self, point: &ControlPoint, std_m: f64) -> usize {
        let known = self.points.iter().position(|p| {
            p.name == point.name && p.in_world_m == point.point_in_world_m && !p.name.is_empty()
        });
        known.unwrap_or_else(|| {
            self.points.push(Surveyed {
                name: point.name.clone(),
                in_world_m: point.point_in_world_m,
                std_m,
            });
            self.points.len() - 1
        })
    }

    /// All sights, all places as in the table.
    pub(super) fn all(&self) -> Choice {
        Choice { used: vec![true; self.sights.len()], place: self.sights.iter().map(|s| s.point).collect() }
    }

    /// The used sights of one camera as control points.
    pub(super) fn control(&self, choice: &Choice, camera: usize) -> Vec<ControlPoint> {
        let of_camera = |k: &usize| choice.used[*k] && self.sights[*k].camera == camera;
        (0..self.sights.len())
            .filter(of_camera)
            .map(|k| ControlPoint {
                name: self.points[self.sights[k].point].name.clone(),
                point_in_world_m: self.points[choice.place[k]].in_world_m,
                pixel: self.sights[k].pixel,
                pixel_cov_px2: self.sights[k].covariance_px2,
            })
            .collect()
    }

    /// Mean of the places of points and of moved objects.
    pub(super) fn middle_m(&self) -> Vector3<f64> {
        let moved = self.moved.iter().flat_map(|m| m.start.iter().map(|pose| pose.translation.vector));
        let all = self.points.iter().map(|p| p.in_world_m).chain(moved);
        let (sum, n) = all.fold((Vector3::zeros(), 0.0), |(sum, n), p| (sum + p, n + 1.0));
        sum / f64::max(n, 1.0)
    }

    /// Of the moved objects in one camera: sum of the squared residuals, sights, and sum of the inverse claimed variances of
    /// a coordinate.
    pub(super) fn moved_residuals(&self, fit: &Fit, camera: usize) -> (f64, f64, f64) {
        let (mut squares_px2, mut sights, mut information) = (0.0, 0.0, 0.0);
        for (k, object) in self.moved.iter().enumerate() {
            let shared = object.shared(&fit.cameras, fit.scales[k]);
            for (place, pose) in object.sights.iter().zip(&fit.poses[k]) {
                for s in place.iter().filter(|s| s.camera == camera) {
                    let (Some(residual), Some(covariance)) =
                        (shared.residual_px(s, pose), s.covariance_px2())
                    else {
                        continue;
                    };
                    squares_px2 += residual.norm_squared();
                    sights += 1.0;
                    information += 2.0 / covariance.trace();
                }
            }
        }
        (squares_px2, sights, information)
    }
}

fn sight_of(point: &ControlPoint, camera: usize, radius_m: f64, std_m: f64) -> Result<Sight, GeometryError> {
    let numbers = point.point_in_world_m.iter().chain(point.pixel.iter()).chain(point.pixel_cov_px2.iter());
    if !numbers.chain([&radius_m, &std_m]).all(|x| x.is_finite()) || radius_m < 0.0 || std_m < 0.0 {
        return Err(GeometryError::NotFinite {
            what: "a control point, its radius or its standard deviation",
        });
    }
    let whitener = point
        .pixel_cov_px2
        .cholesky()
        .and_then(|c| c.l().try_inverse())
        .filter(|w| w.iter().all(|x| x.is_finite()))
        .ok_or(GeometryError::NotFinite { what: "the inverse of a control pixel's covariance" })?;
    Ok(Sight {
        camera,
        point: 0,
        pixel: point.pixel,
        whitener,
        covariance_px2: point.pixel_cov_px2,
        radius_m,
    })
}
