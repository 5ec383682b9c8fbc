//! Reprojection of markers, and what is not quite known of cameras and markers.

use super::row::{Row, pose_of};
use crate::IdentifyError;
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Vector2, Vector3, whitener};
use mavsight_pose::{BodyMarker, MarkerObservation, PoseEstimator, Rig};
use nalgebra::{DMatrix, Matrix2, Point3};

/// Markers seen by the cameras of a rig over a flight, with nuisances: directions in which all predicted
/// pixels may be off together, each a standard normal number times a displacement of every observation, taken
/// at the poses of single instants.
#[derive(Debug, Clone)]
pub struct ImageMeasurements {
    cameras: Vec<Camera>,
    markers: Vec<BodyMarker>,
    observations: Vec<MarkerObservation>,
    whiteners: Vec<Matrix2<f64>>,
    /// First observation of each instant, and the number of observations.
    first: Vec<usize>,
    poses: Vec<Option<Isometry3<f64>>>,
    /// Of each instant, whether the motion begins anew there.
    anew: Vec<bool>,
    /// What each nuisance does to the two whitened coordinates of each observation: nuisances × coordinates.
    directions: DMatrix<f64>,
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
        let whitener = |s: &MarkerObservation| {
            let known = s.camera < cameras.len() && s.marker < markers.len();
            let w = whitener(&s.covariance_px2).filter(|_| known && s.pixel.iter().all(|v| v.is_finite()));
            let t_s = s.t_ns as f64 * 1e-9;
            w.ok_or(IdentifyError::BadMeasurement { t_s, what: "marker observation" })
        };
        let whiteners = observations.iter().map(whitener).collect::<Result<_, _>>()?;
        let estimator = PoseEstimator::new(rig, markers);
        let (mut first, mut poses) = (vec![0], Vec::<Option<Isometry3<f64>>>::new());
        for seen in observations.chunk_by(|a, b| a.t_ns == b.t_ns) {
            let previous = poses.iter().rev().flatten().next();
            let pose = estimator.estimate(seen[0].t_ns, seen, previous).ok().map(|e| e.world_from_body);
            poses.push(pose);
            first.push(first[first.len() - 1] + seen.len());
        }
        let known = poses.iter().flatten().count();
        if known < 4 {
            return Err(IdentifyError::NoStart(known));
        }
        let directions = DMatrix::zeros(0, 2 * observations.len());
        let (markers, anew) = (markers.to_vec(), vec![false; poses.len()]);
        Ok(Self { cameras, markers, observations, whiteners, first, poses, anew, directions })
    }

    /// Adds so many nuisances by the displacements in pixels that a standard deviation of each makes of an
    /// observation at a pose.
    fn with_directions(
        self,
        count: usize,
        displace: impl Fn(&Self, &MarkerObservation, &Isometry3<f64>, &mut [Vector2<f64>]),
    ) -> Self {
        let old = self.directions.nrows();
        let mut directions = self.directions.clone().resize_vertically(old + count, 0.0);
        let mut columns = vec![Vector2::zeros(); count];
        for (instant, pose) in self.poses.iter().enumerate() {
            let Some(pose) = pose else { continue };
            for k in self.first[instant]..self.first[instant + 1] {
                columns.fill(Vector2::zeros());
                displace(&self, &self.observations[k], pose, &mut columns);
                for (j, column) in columns.iter().enumerate() {
                    let whitened = (self.whiteners[k] * column).transpose();
                    directions.fixed_view_mut::<1, 2>(old + j, 2 * k).copy_from(&whitened);
                }
            }
        }
        Self { directions, ..self }
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
        Ok(self.with_directions(factor.ncols(), |all, s, pose, columns| {
            let point = (pose * Point3::from(all.markers[s.marker].marker_in_body_m)).coords;
            // Behind the camera nothing was seen: the fit refuses such an observation by itself.
            if let Ok(by) = all.cameras[s.camera].d_pixel_d_camera(&point) {
                let part = factor.rows(CAMERA_PARAMETERS * s.camera, CAMERA_PARAMETERS);
                columns.iter_mut().zip(part.column_iter()).for_each(|(column, part)| *column = by * part);
            }
        }))
    }

    /// Adds the place of every marker on the body, known to `std_m` along each axis.
    pub fn with_marker_positions(self, std_m: f64) -> Self {
        let count = 3 * self.markers.len();
        self.with_directions(count, |all, s, pose, columns| {
            let marker = &all.markers[s.marker];
            let point = (pose * Point3::from(marker.marker_in_body_m)).coords;
            if let Ok(seen) = all.cameras[s.camera].project_ball(&point, marker.radius_m) {
                for (axis, column) in columns[3 * s.marker..3 * s.marker + 3].iter_mut().enumerate() {
                    *column = seen.d_pixel_d_point_in_world * (pose.rotation * Vector3::ith(axis, std_m));
                }
            }
        })
    }

    /// Adds an error of each marker's centre in each camera that keeps through the flight, of `std_px` along
    /// each axis.
    pub fn with_marker_biases(self, std_px: f64) -> Self {
        let count = 2 * self.markers.len() * self.cameras.len();
        self.with_directions(count, |all, s, _, columns| {
            let channel = 2 * (s.camera * all.markers.len() + s.marker);
            (0..2).for_each(|axis| columns[channel + axis][axis] = std_px);
        })
    }

    /// The observations of some instants, with the same nuisances.
    pub(crate) fn at(&self, instants: &[usize]) -> Self {
        let own = || instants.iter().flat_map(|i| self.first[*i]..self.first[*i + 1]);
        let columns: Vec<usize> = own().flat_map(|k| [2 * k, 2 * k + 1]).collect();
        let mut first = vec![0];
        first.extend(instants.iter().scan(0, |end, i| {
            *end += self.first[*i + 1] - self.first[*i];
            Some(*end)
        }));
        Self {
            cameras: self.cameras.clone(),
            markers: self.markers.clone(),
            observations: own().map(|k| self.observations[k]).collect(),
            whiteners: own().map(|k| self.whiteners[k]).collect(),
            first,
            poses: instants.iter().map(|i| self.poses[*i]).collect(),
            anew: instants.iter().map(|i| self.anew[*i]).collect(),
            directions: self.directions.select_columns(&columns),
        }
    }

    /// Lets the motion begin anew at the first instant with a pose from each of some times on.
    pub(crate) fn begin_anew(&mut self, from_ns: &[i64]) {
        let Self { observations, first, poses, anew, .. } = self;
        let mut known = (0..poses.len()).filter(|i| poses[*i].is_some());
        for from_ns in from_ns {
            let own = known.by_ref().find(|i| observations[first[*i]].t_ns >= *from_ns);
            own.into_iter().for_each(|i| anew[i] = true);
        }
    }

    pub(crate) fn begins_anew(&self, instant: usize) -> bool {
        self.anew[instant]
    }

    pub(crate) fn times_s(&self) -> Vec<f64> {
        let instants = &self.first[..self.poses.len()];
        instants.iter().map(|k| self.observations[*k].t_ns as f64 * 1e-9).collect()
    }

    pub(crate) fn channels(&self) -> Vec<String> {
        let all = (0..self.cameras.len()).flat_map(|c| self.markers.iter().map(move |m| (c, m)));
        all.flat_map(|(c, m)| ["u", "v"].map(|axis| format!("camera {c} {} {axis}", m.name))).collect()
    }

    pub(crate) fn nuisances(&self) -> usize {
        self.directions.nrows()
    }

    pub(crate) fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        self.poses.iter().enumerate().filter_map(|(i, p)| p.map(|p| (i, p))).collect()
    }

    pub(crate) fn rows(&self, instant: usize, y: &[f64]) -> Result<Vec<Row<'_>>, IdentifyError> {
        let pose = pose_of(y);
        let mut out = Vec::new();
        for k in self.first[instant]..self.first[instant + 1] {
            let s = &self.observations[k];
            let marker = &self.markers[s.marker];
            let point = (pose * Point3::from(marker.marker_in_body_m)).coords;
            let seen = self.cameras[s.camera].project_ball(&point, marker.radius_m)?;
            let by = (self.whiteners[k] * d_pixel_d_pose(&seen, &pose, &marker.marker_in_body_m)).transpose();
            let residual = self.whiteners[k] * (s.pixel - seen.pixel);
            out.extend((0..2).map(|axis| Row {
                residual: residual[axis],
                by_pose: by.column(axis).into_owned(),
                by_rest: Vec::new(),
                by_parameter: Vec::new(),
                instant,
                channel: 2 * (s.camera * self.markers.len() + s.marker) + axis,
                directions: self.directions.column(2 * k + axis).data.into_slice(),
                pixel: seen.pixel.into(),
            }));
        }
        Ok(out)
    }
}
