//! Reprojection of markers, and what is not quite known of cameras and markers.

use super::propagate::SEEN;
use super::row::{Row, pose_of, whitener};
use crate::IdentifyError;
use mavsight_flight::StateVector;
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Vector2, Vector3};
use mavsight_pose::{BodyMarker, MarkerObservation, PoseEstimator, Rig};
use nalgebra::{Matrix2, Point3};

/// Markers seen by the cameras of a rig over a flight, with nuisances: directions in which all predicted
/// pixels may be off together, each a standard normal number times a displacement of every observation.
///
/// The displacements are taken at the poses of single instants, once: nuisances enter linearly.
#[derive(Debug, Clone)]
pub struct ImageMeasurements {
    cameras: Vec<Camera>,
    markers: Vec<BodyMarker>,
    observations: Vec<MarkerObservation>,
    whiteners: Vec<Matrix2<f64>>,
    /// First observation of each instant, and the number of observations.
    first: Vec<usize>,
    times_ns: Vec<i64>,
    poses: Vec<Option<Isometry3<f64>>>,
    names: Vec<String>,
    /// Rows: two for each observation, whitened. One row after another.
    directions: Vec<f64>,
}

impl ImageMeasurements {
    /// Takes the observations of a flight; those of instants at which no pose can be found remain, but carry
    /// no nuisance.
    ///
    /// # Errors
    /// [`IdentifyError::BadMeasurement`] for a camera or marker that does not exist, numbers that are not
    /// finite, a covariance that is not positive definite; [`IdentifyError::NoStart`] where fewer than four
    /// instants have a pose.
    pub fn new(
        rig: &Rig,
        markers: &[BodyMarker],
        observations: &[MarkerObservation],
    ) -> Result<Self, IdentifyError> {
        let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
        let mut observations = observations.to_vec();
        observations.sort_by_key(|s| (s.t_ns, s.camera, s.marker));
        let mut whiteners = Vec::with_capacity(observations.len());
        for s in &observations {
            let known = s.camera < cameras.len() && s.marker < markers.len();
            let w = whitener(&s.covariance_px2).filter(|_| known && s.pixel.iter().all(|v| v.is_finite()));
            let bad = IdentifyError::BadMeasurement { t_s: s.t_ns as f64 * 1e-9, what: "marker observation" };
            whiteners.push(w.ok_or(bad)?);
        }
        let (mut first, mut times_ns) = (Vec::new(), Vec::new());
        for (k, s) in observations.iter().enumerate() {
            if times_ns.last() != Some(&s.t_ns) {
                times_ns.push(s.t_ns);
                first.push(k);
            }
        }
        first.push(observations.len());
        let estimator = PoseEstimator::new(rig, markers);
        let mut previous: Option<Isometry3<f64>> = None;
        let mut poses = Vec::with_capacity(times_ns.len());
        for (i, t_ns) in times_ns.iter().enumerate() {
            let seen = &observations[first[i]..first[i + 1]];
            let pose = estimator.estimate(*t_ns, seen, previous.as_ref()).ok().map(|e| e.world_from_body);
            previous = pose.or(previous);
            poses.push(pose);
        }
        let known = poses.iter().flatten().count();
        if known < 4 {
            return Err(IdentifyError::NoStart { known });
        }
        let markers = markers.to_vec();
        let (names, directions) = (Vec::new(), Vec::new());
        Ok(Self { cameras, markers, observations, whiteners, first, times_ns, poses, names, directions })
    }

    /// Adds nuisances by a displacement in pixels of each observation: `displacement(camera, marker, pose,
    /// values)` writes one column a name.
    pub fn with_directions(
        mut self,
        names: &[String],
        displacement: impl Fn(&MarkerObservation, &Isometry3<f64>, &mut [Vector2<f64>]),
    ) -> Self {
        let (old, new) = (self.names.len(), names.len());
        let mut wide = vec![0.0; 2 * self.observations.len() * (old + new)];
        let mut columns = vec![Vector2::zeros(); new];
        for (instant, pose) in self.poses.iter().enumerate() {
            for k in self.first[instant]..self.first[instant + 1] {
                columns.fill(Vector2::zeros());
                if let Some(pose) = pose {
                    displacement(&self.observations[k], pose, &mut columns);
                }
                for axis in 0..2 {
                    let row = 2 * k + axis;
                    let out = &mut wide[row * (old + new)..(row + 1) * (old + new)];
                    out[..old].copy_from_slice(&self.directions[row * old..(row + 1) * old]);
                    for (value, column) in out[old..].iter_mut().zip(&columns) {
                        *value = (self.whiteners[k] * column)[axis];
                    }
                }
            }
        }
        self.directions = wide;
        self.names.extend_from_slice(names);
        self
    }

    /// Adds what the calibration left uncertain of the cameras: a nuisance for each column of
    /// [`Rig::uncertainty`].
    ///
    /// # Errors
    /// [`IdentifyError::BadColumn`] for a rig with other cameras or numbers that are not finite.
    pub fn with_cameras(self, rig: &Rig) -> Result<Self, IdentifyError> {
        let rows = CAMERA_PARAMETERS * self.cameras.len();
        let factor = &rig.uncertainty;
        if factor.nrows() != rows || !factor.iter().all(|v| v.is_finite()) {
            return Err(IdentifyError::BadColumn { what: "uncertainty of the cameras".to_owned(), rows });
        }
        let names: Vec<String> = (0..factor.ncols()).map(|k| format!("cameras {k}")).collect();
        let (cameras, markers) = (self.cameras.clone(), self.markers.clone());
        Ok(self.with_directions(&names, |s, pose, columns| {
            let point = (pose * Point3::from(markers[s.marker].marker_in_body_m)).coords;
            // Behind the camera nothing was seen: the fit refuses such an observation by itself.
            if let Ok(by) = cameras[s.camera].d_pixel_d_camera(&point) {
                let part = factor.rows(CAMERA_PARAMETERS * s.camera, CAMERA_PARAMETERS);
                for (k, column) in columns.iter_mut().enumerate() {
                    *column = by * part.column(k);
                }
            }
        }))
    }

    /// Adds the place of every marker on the body, known to `std_m` along each axis.
    pub fn with_marker_positions(self, std_m: f64) -> Self {
        let names: Vec<String> = self
            .markers
            .iter()
            .flat_map(|m| ["x", "y", "z"].map(|axis| format!("{} {axis}", m.name)))
            .collect();
        let (cameras, markers) = (self.cameras.clone(), self.markers.clone());
        self.with_directions(&names, |s, pose, columns| {
            let marker = &markers[s.marker];
            let point = (pose * Point3::from(marker.marker_in_body_m)).coords;
            if let Ok(seen) = cameras[s.camera].project_ball(&point, marker.radius_m) {
                for (axis, column) in columns[3 * s.marker..3 * s.marker + 3].iter_mut().enumerate() {
                    *column = seen.d_pixel_d_point_in_world * (pose.rotation * Vector3::ith(axis, std_m));
                }
            }
        })
    }

    /// Adds an error of each marker's centre in each camera that keeps through the flight, of `std_px` along
    /// each axis, and one that changes with each of three body turns by `std_px` per `turn_rad`: what a
    /// marker's neighbourhood, light and occlusion do to its centre changes with the aspect.
    pub fn with_marker_biases(self, std_px: f64, turn_rad: Option<f64>) -> Self {
        let markers = self.markers.len();
        let channels = 2 * markers * self.cameras.len();
        let per_channel = if turn_rad.is_some() { 4 } else { 1 };
        let names: Vec<String> = self
            .channels()
            .iter()
            .flat_map(|c| (0..per_channel).map(move |k| format!("{c} bias {k}")))
            .collect();
        debug_assert_eq!(names.len(), channels * per_channel);
        let first = self.poses.iter().flatten().next().map_or_else(Default::default, |p| p.rotation);
        self.with_directions(&names, |s, pose, columns| {
            let turn = (first.inverse() * pose.rotation).scaled_axis();
            let first_column = 2 * (s.camera * markers + s.marker) * per_channel;
            let mine = &mut columns[first_column..first_column + 2 * per_channel];
            for (k, column) in mine.iter_mut().enumerate() {
                let (axis, order) = (k / per_channel, k % per_channel);
                let share = match (order, turn_rad) {
                    (0, _) | (_, None) => 1.0,
                    (_, Some(scale_rad)) => turn[order - 1] / scale_rad,
                };
                column[axis] = std_px * share;
            }
        })
    }

    pub(crate) fn times_s(&self) -> Vec<f64> {
        self.times_ns.iter().map(|t| *t as f64 * 1e-9).collect()
    }

    pub(crate) fn channels(&self) -> Vec<String> {
        let markers = &self.markers;
        (0..self.cameras.len())
            .flat_map(|c| {
                markers.iter().flat_map(move |m| ["u", "v"].map(|a| format!("camera {c} {} {a}", m.name)))
            })
            .collect()
    }

    pub(crate) fn nuisances(&self) -> usize {
        self.names.len()
    }

    pub(crate) fn nuisance_row(&self, row: usize) -> &[f64] {
        let k = self.names.len();
        &self.directions[row * k..(row + 1) * k]
    }

    pub(crate) fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        self.poses.iter().enumerate().filter_map(|(i, p)| p.map(|p| (i, p))).collect()
    }

    pub(crate) fn rows(
        &self,
        instant: usize,
        y: &StateVector,
        out: &mut Vec<Row>,
    ) -> Result<(), IdentifyError> {
        let pose = pose_of(y);
        for k in self.first[instant]..self.first[instant + 1] {
            let s = &self.observations[k];
            let marker = &self.markers[s.marker];
            let point = (pose * Point3::from(marker.marker_in_body_m)).coords;
            let seen = self.cameras[s.camera].project_ball(&point, marker.radius_m)?;
            let jacobian = self.whiteners[k] * d_pixel_d_pose(&seen, &pose, &marker.marker_in_body_m);
            let residual = self.whiteners[k] * (s.pixel - seen.pixel);
            for axis in 0..2 {
                let mut row = Row {
                    residual: residual[axis],
                    jacobian: [0.0; SEEN],
                    channel: 2 * (s.camera * self.markers.len() + s.marker) + axis,
                    nuisance: Some(2 * k + axis),
                    pixel: seen.pixel.into(),
                };
                for j in 0..6 {
                    row.jacobian[j] = jacobian[(axis, j)];
                }
                out.push(row);
            }
        }
        Ok(())
    }
}
