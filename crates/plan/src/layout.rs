//! Prediction of the measurements of a planned rig.

use crate::{CameraType, Criterion, PlanError, Room};
use mavsight_geometry::{Camera, ControlPoint, Intrinsics, Isometry3, Matrix2, Matrix6, Point3, Vector3};
use mavsight_pipeline::ControlPointRow;
use mavsight_pose::{
    BodyMarker, CameraControl, CameraModel, PoseError, PoseEstimate, PoseEstimator, PredictedObservation,
    Rig, RigCamera, predict_calibration,
};
use nalgebra::DMatrix;
use serde::Serialize;

/// A camera at its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Index of its type in the room file.
    pub kind: usize,
    /// Projection centre, world axes.
    pub centre_m: Vector3<f64>,
    /// Aim point of the optical axis, world axes.
    pub aim_m: Vector3<f64>,
}

/// Why a camera does not see a ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewLimit {
    /// Outside the image.
    OutOfImage,
    /// Image too small.
    TooSmall,
    /// Out of focus.
    OutOfFocus,
    /// Hidden by an obstacle.
    Blocked,
}

impl ViewLimit {
    const ALL: [Self; 4] = [Self::OutOfImage, Self::TooSmall, Self::OutOfFocus, Self::Blocked];

    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            Self::OutOfImage => "lacks some outside the image",
            Self::TooSmall => "has some too small",
            Self::OutOfFocus => "has some out of focus",
            Self::Blocked => "has some hidden by an obstacle",
        }
    }
}

/// Predicted standard deviations of a pose: roots of the traces of the covariances of position and attitude.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PosePrecision {
    /// Position, from all errors.
    pub position_std_mm: f64,
    /// Attitude, from all errors.
    pub attitude_std_deg: f64,
    /// Position, from random errors alone, which average out.
    pub new_position_std_mm: f64,
    /// Attitude, from random errors alone.
    pub new_attitude_std_deg: f64,
}

impl PosePrecision {
    fn of(estimate: &PoseEstimate) -> Self {
        let std = |c: &Matrix6<f64>, at: usize| c.fixed_view::<3, 3>(at, at).trace().max(0.0).sqrt();
        let (all, new) = (estimate.covariance(), estimate.own_covariance());
        Self {
            position_std_mm: 1e3 * std(&all, 0),
            attitude_std_deg: std(&all, 3).to_degrees(),
            new_position_std_mm: 1e3 * std(&new, 0),
            new_attitude_std_deg: std(&new, 3).to_degrees(),
        }
    }

    fn mean(all: &[Self]) -> Self {
        let share = 1.0 / all.len().max(1) as f64;
        let of = |value: fn(&Self) -> f64| all.iter().fold(0.0, |mean, one| mean + share * value(one));
        Self {
            position_std_mm: of(|p| p.position_std_mm),
            attitude_std_deg: of(|p| p.attitude_std_deg),
            new_position_std_mm: of(|p| p.new_position_std_mm),
            new_attitude_std_deg: of(|p| p.new_attitude_std_deg),
        }
    }
}

/// Predicted precision of a placement over the flight volume.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prediction {
    /// Figure that the search minimises: weighted, mean or worst over the volume.
    pub figure: f64,
    /// Mean over all poses at which every marker is seen by two cameras.
    pub mean: PosePrecision,
    /// At the pose of the largest figure.
    pub worst: PosePrecision,
    /// Place of the largest figure.
    pub worst_at_m: [f64; 3],
    /// Part of the poses at which every marker is seen by two cameras or more.
    pub share_seen: f64,
    /// Most frequent reason why a marker is not seen; none if all are seen twice.
    pub limit: Option<ViewLimit>,
    /// Diameter of the smallest image of a marker that counts.
    pub least_diameter_px: f64,
    /// Reason why the cameras cannot be calibrated.
    pub refused: Option<String>,
}

impl Prediction {
    /// Whether all limits are met.
    pub fn is_feasible(&self) -> bool {
        self.refused.is_none() && self.share_seen >= 1.0
    }

    /// The figure, or more than any figure where limits are not met, the more so the less is seen.
    pub(crate) fn cost(&self) -> f64 {
        const BEYOND_ANY_FIGURE: f64 = 1e6;
        let refused = if self.refused.is_some() { 2.0 } else { 0.0 };
        let unseen = 1.0 - self.share_seen;
        let penalty = if self.is_feasible() { 0.0 } else { BEYOND_ANY_FIGURE * (1.0 + refused + unseen) };
        penalty + self.figure.min(BEYOND_ANY_FIGURE)
    }
}

/// What all cameras see of the markers at a pose.
#[derive(Default)]
struct View {
    observations: Vec<PredictedObservation>,
    /// Whether two cameras see each marker.
    is_seen_twice: bool,
    /// Why markers are not seen, one for each camera that does not see a marker.
    limits: Vec<ViewLimit>,
    least_diameter_px: f64,
}

/// Predicts the measurements of camera placements in a room.
#[derive(Debug, Clone)]
pub struct Planner {
    pub(crate) room: Room,
    markers: Vec<BodyMarker>,
    control: Vec<ControlPointRow>,
}

impl Planner {
    /// A planner for a room, the markers of a vehicle and the control points of `room.control`, which are not
    /// looked at where the room has no such section.
    ///
    /// # Errors
    /// [`PlanError::Value`] for a room that is not valid or fewer than three markers.
    pub fn new(
        room: Room,
        markers: Vec<BodyMarker>,
        control: Vec<ControlPointRow>,
    ) -> Result<Self, PlanError> {
        room.validate()?;
        let has_markers = markers.len() >= 3 && markers.iter().all(|m| m.radius_m > 0.0);
        PlanError::unless(has_markers, "vehicle", || {
            format!("has {} markers: a pose needs 3 or more, each with a diameter", markers.len())
        })?;
        PlanError::unless(room.control.is_none() || control.len() >= 5, "control.points", || {
            format!("has {} points: a calibration needs 5 or more", control.len())
        })?;
        Ok(Self { room, markers, control })
    }

    /// The room.
    pub fn room(&self) -> &Room {
        &self.room
    }

    /// The markers.
    pub fn markers(&self) -> &[BodyMarker] {
        &self.markers
    }

    /// The control points.
    pub fn control(&self) -> &[ControlPointRow] {
        &self.control
    }

    /// The camera of a placement.
    pub fn camera(&self, placed: &Placed) -> Camera {
        let kind = &self.room.camera[placed.kind];
        let lens = Intrinsics::from_horizontal_fov(kind.size(), kind.horizontal_fov_deg.to_radians());
        let mut camera = Camera::looking_at(placed.centre_m, placed.aim_m, lens, kind.size());
        (camera.distortion.k1, camera.distortion.k2) = (kind.k1, kind.k2);
        camera
    }

    /// The rig as it will be calibrated, with its uncertainty.
    ///
    /// # Errors
    /// A camera that sees too few control points.
    pub fn rig(&self, placed: &[Placed]) -> Result<Rig, PoseError> {
        let cameras: Vec<(Camera, CameraModel)> =
            placed.iter().map(|p| (self.camera(p), self.room.camera[p.kind].model())).collect();
        let Some(section) = &self.room.control else {
            let exact = cameras.iter().enumerate().map(|(k, c)| RigCamera::exact(self.name(k), c.0, c.1));
            return Ok(Rig::exact(exact.collect()));
        };
        let mut controls = Vec::with_capacity(placed.len());
        for (k, (p, (camera, _))) in placed.iter().zip(&cameras).enumerate() {
            let kind = &self.room.camera[p.kind];
            let mut control = CameraControl::exact(self.name(k), kind.size(), vec![], vec![]);
            for row in &self.control {
                let (place, radius_m) = (Vector3::from(row.position_m), row.diameter_m / 2.0);
                let Ok(diameter_px) = self.seen(kind, camera, &place, radius_m) else { continue };
                let std_px = section.std_px.unwrap_or_else(|| kind.centre_std_px(diameter_px.max(1.0)));
                control.points.push(ControlPoint {
                    name: row.name.clone(),
                    point_in_world_m: place,
                    pixel: camera.project_ball(&place, radius_m)?.pixel,
                    pixel_cov_px2: Matrix2::identity() * std_px * std_px,
                });
                control.ball_radius_m.push(radius_m);
                control.survey_std_m.push(row.std_m);
            }
            controls.push(control);
        }
        predict_calibration(&cameras, &controls)
    }

    /// Name of the k-th camera of a placement, from 0.
    pub fn name(&self, k: usize) -> String {
        format!("cam{}", k + 1)
    }

    /// Diameter of a ball's image, px; a point has none.
    ///
    /// # Errors
    /// Why the ball does not count as seen by a camera of this type.
    pub fn seen(
        &self,
        kind: &CameraType,
        camera: &Camera,
        place: &Vector3<f64>,
        radius_m: f64,
    ) -> Result<f64, ViewLimit> {
        let depth_m = (camera.cam_from_world * Point3::from(*place)).z;
        let seen = camera.project_ball(place, radius_m).map_err(|_| ViewLimit::OutOfImage)?;
        let diameter_px = 2.0 * camera.intrinsics.fx_px * radius_m / depth_m;
        // The rim and the two pixels around it, which its centre is measured against.
        if !camera.size.contains(&seen.pixel, diameter_px / 2.0 + 2.0) {
            return Err(ViewLimit::OutOfImage);
        }
        if radius_m > 0.0 && diameter_px < kind.least_diameter_px {
            return Err(ViewLimit::TooSmall);
        }
        let centre = camera.centre_in_world();
        let distance_m = (place - centre).norm();
        if kind.focus_m.is_some_and(|[near, far]| distance_m < near || distance_m > far) {
            return Err(ViewLimit::OutOfFocus);
        }
        if self.room.block.iter().any(|b| b.blocks(&centre, place)) {
            return Err(ViewLimit::Blocked);
        }
        Ok(diameter_px)
    }

    /// The estimator for a rig, with the systematic errors of markers and centres.
    ///
    /// # Errors
    /// Never for a valid room.
    pub fn estimator(&self, rig: &Rig) -> Result<PoseEstimator, PoseError> {
        let mut out = PoseEstimator::new(rig, &self.markers);
        if self.room.markers_std_m > 0.0 {
            let n = 3 * self.markers.len();
            out = out.with_marker_uncertainty(&(DMatrix::identity(n, n) * self.room.markers_std_m))?;
        }
        if self.room.centre_bias_px > 0.0 {
            out = out.with_centre_bias(self.room.centre_bias_px)?;
        }
        Ok(out)
    }

    fn view(&self, placed: &[Placed], cameras: &[Camera], pose: &Isometry3<f64>) -> View {
        let mut out = View { is_seen_twice: true, least_diameter_px: f64::INFINITY, ..View::default() };
        for (marker, ball) in self.markers.iter().enumerate() {
            let place = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let before = out.observations.len();
            for (camera, view) in cameras.iter().enumerate() {
                let kind = &self.room.camera[placed[camera].kind];
                match self.seen(kind, view, &place, ball.radius_m) {
                    Ok(diameter_px) => {
                        out.least_diameter_px = out.least_diameter_px.min(diameter_px);
                        let variance = kind.centre_std_px_at(diameter_px, &place, camera, marker).powi(2);
                        let covariance_px2 = Matrix2::identity() * variance;
                        out.observations.push(PredictedObservation { camera, marker, covariance_px2 });
                    }
                    Err(limit) => out.limits.push(limit),
                }
            }
            out.is_seen_twice &= out.observations.len() >= before + 2;
        }
        out
    }

    /// Predicted precision of a placement at the given poses; each marker must be seen by two cameras.
    pub fn predict(&self, placed: &[Placed], poses: &[Isometry3<f64>]) -> Prediction {
        let cameras: Vec<Camera> = placed.iter().map(|p| self.camera(p)).collect();
        let estimator = self.rig(placed).and_then(|rig| self.estimator(&rig));
        let (mut all, mut places) = (Vec::new(), Vec::new());
        let (mut seen, mut limits, mut least_diameter_px) = (0, [0; 4], f64::INFINITY);
        for pose in poses {
            let view = self.view(placed, &cameras, pose);
            view.limits.iter().for_each(|limit| limits[*limit as usize] += 1);
            least_diameter_px = f64::min(least_diameter_px, view.least_diameter_px);
            seen += usize::from(view.is_seen_twice);
            let Some(estimator) = estimator.as_ref().ok().filter(|_| view.is_seen_twice) else { continue };
            let Ok(estimate) = estimator.predict(pose, &view.observations) else { continue };
            all.push(PosePrecision::of(&estimate));
            places.push(pose.translation.vector);
        }
        let figures: Vec<f64> = all.iter().map(|one| self.figure(one)).collect();
        let worst = (0..all.len()).max_by(|a, b| figures[*a].total_cmp(&figures[*b]));
        let vague = || "the poses are not determined".to_owned();
        Prediction {
            figure: match self.room.weights.criterion {
                Criterion::Mean => figures.iter().sum::<f64>() / all.len().max(1) as f64,
                Criterion::Worst => worst.map_or(0.0, |k| figures[k]),
            },
            mean: PosePrecision::mean(&all),
            worst: worst.map_or_else(PosePrecision::default, |k| all[k]),
            worst_at_m: worst.map_or_else(|| self.room.middle_m(), |k| places[k]).into(),
            share_seen: seen as f64 / poses.len().max(1) as f64,
            limit: ViewLimit::ALL
                .into_iter()
                .max_by_key(|limit| limits[*limit as usize])
                .filter(|_| seen < poses.len()),
            least_diameter_px,
            refused: match estimator {
                Err(refused) => Some(refused.to_string()),
                Ok(_) => (all.len() < seen).then(vague),
            },
        }
    }

    /// The pose as it will be measured; none where some marker is not seen by two cameras.
    pub(crate) fn expected_pose(
        &self,
        placed: &[Placed],
        cameras: &[Camera],
        estimator: &PoseEstimator,
        pose: &Isometry3<f64>,
    ) -> Option<PoseEstimate> {
        let view = self.view(placed, cameras, pose);
        estimator.predict(pose, &view.observations).ok().filter(|_| view.is_seen_twice)
    }

    fn figure(&self, one: &PosePrecision) -> f64 {
        let w = &self.room.weights;
        (w.per_mm * one.position_std_mm).hypot(w.per_deg * one.attitude_std_deg)
    }

    /// Predicted standard deviation of position at a place, mean over the headings; `None` where some marker
    /// is not seen by two cameras at one of them. The rig is that of [`Planner::rig`].
    pub fn position_std_mm(&self, placed: &[Placed], rig: &Rig, place_m: &Vector3<f64>) -> Option<f64> {
        let cameras: Vec<Camera> = placed.iter().map(|p| self.camera(p)).collect();
        let estimator = self.estimator(rig).ok()?;
        let one = |pose| self.expected_pose(placed, &cameras, &estimator, &pose);
        let all = self.room.poses_at(place_m).map(|pose| Some(PosePrecision::of(&one(pose)?)));
        let all = all.collect::<Option<Vec<_>>>().filter(|all| !all.is_empty())?;
        Some(PosePrecision::mean(&all).position_std_mm)
    }
}
