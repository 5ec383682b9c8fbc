//! A camera that stands otherwise than it was calibrated, all through the film.

use super::{Alternative, Evidence};
use crate::{Cause, MARKERS_STD_M, PipelineError};
use mavsight_geometry::camera_parameters::{CENTRE, TURN};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, CameraChange, Point3, Vector3};
use mavsight_pose::{FlightPrior, MarkerObservation, Observations, PoseEstimator, Rig, refine_flight};
use nalgebra::{DMatrix, Matrix6, Vector6};

/// How far a camera that was pushed may stand from where it stood: what went further was set up anew.
const MOST_SHIFT_M: f64 = 1.0;
const MOST_TURN_RAD: f64 = 0.5;

/// Gauss-Newton steps of a camera's place.
const STEPS: usize = 12;

impl Evidence<'_> {
    /// What remains with one camera at the place from which it fits the others and the body best.
    pub(super) fn moved_cameras(&self) -> Result<Vec<Alternative>, PipelineError> {
        let mut out = Vec::new();
        for camera in 0..self.rig.cameras.len() {
            out.extend(self.moved_camera(camera)?);
        }
        Ok(out)
    }

    fn moved_camera(&self, camera: usize) -> Result<Option<Alternative>, PipelineError> {
        let given = self.rig.cameras[camera].camera;
        let near = self.by_the_others(camera).unwrap_or(given);
        let all: Observations = self.instants.iter().flatten().collect();
        let markers = self.estimator.markers();
        let prior = FlightPrior { markers_std_m: MARKERS_STD_M, centres_std_px: Some(0.0) };
        let free = rig_with(self.rig, camera, near);
        let refined = refine_flight(&all, &free, markers, prior).map_or(free, |refined| refined.rig);
        // What is left is judged by what the calibration claims: the new place is as good as that.
        let mut found = self.rig.clone();
        found.cameras[camera].camera = refined.cameras[camera].camera;
        let Some(fit) = super::median_fit(&PoseEstimator::new(&found, markers), &self.instants)? else {
            return Ok(None);
        };
        let change = given.change_to(&found.cameras[camera].camera);
        let (turn_rad, shift_m) =
            (change.fixed_rows::<3>(TURN).norm(), change.fixed_rows::<3>(CENTRE).norm());
        if turn_rad > MOST_TURN_RAD || shift_m > MOST_SHIFT_M {
            return Ok(None);
        }
        let words = format!(
            "with {} turned by {:.2}° and shifted by {:.0} mm since its calibration: calibrate again",
            self.rig.cameras[camera].name,
            turn_rad.to_degrees(),
            1e3 * shift_m
        );
        Ok(Some(Alternative { cause: Cause::CameraMoved, camera: Some(camera), fit, words }))
    }

    /// Where a camera stands by the poses that the others see.
    fn by_the_others(&self, camera: usize) -> Option<Camera> {
        let mut images: Vec<(Vector3<f64>, MarkerObservation)> = Vec::new();
        let mut previous = None;
        for seen in &self.instants {
            let Some(first) = seen.first() else { continue };
            let others: Vec<MarkerObservation> =
                seen.iter().copied().filter(|o| o.camera != camera).collect();
            let Ok(estimate) = self.estimator.estimate(first.t_ns, &others, previous.as_ref()) else {
                continue;
            };
            let pose = estimate.world_from_body;
            previous = Some(pose);
            for own in seen.iter().filter(|o| o.camera == camera) {
                let at = self.estimator.markers()[own.marker].marker_in_body_m;
                images.push(((pose * Point3::from(at)).coords, *own));
            }
        }
        let mut found = self.rig.cameras[camera].camera;
        for _ in 0..STEPS {
            let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
            for (at, own) in &images {
                let (Ok(seen), Ok(slopes)) = (found.project(at), found.d_pixel_d_camera(at)) else {
                    continue;
                };
                let slopes = slopes.fixed_columns::<6>(0);
                normal += slopes.transpose() * slopes;
                right += slopes.transpose() * (own.pixel - seen.pixel);
            }
            let step = normal.cholesky()?.solve(&right);
            let mut change = CameraChange::zeros();
            change.fixed_rows_mut::<6>(0).copy_from(&step);
            found = found.moved(&change);
        }
        Some(found)
    }
}

/// The rig with a camera elsewhere, whose place alone is uncertain.
fn rig_with(rig: &Rig, camera: usize, at: Camera) -> Rig {
    let mut out = rig.clone();
    out.cameras[camera].camera = at;
    out.uncertainty = DMatrix::zeros(CAMERA_PARAMETERS * rig.cameras.len(), 6);
    for k in 0..6 {
        let std = if k < CENTRE { MOST_TURN_RAD } else { MOST_SHIFT_M };
        out.uncertainty[(CAMERA_PARAMETERS * camera + k, k)] = std;
    }
    out.frames = 0;
    out
}
