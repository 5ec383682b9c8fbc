//! What one camera's tracker sees of its frames.

use crate::PipelineError;
use crate::markers::MarkerColors;
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector3;
use mavsight_pose::{Rig, TrackedDetection};
use mavsight_vision::{Frame, Tracker};
use std::sync::Arc;

/// How far beyond the control points' ranges the aircraft may fly, as a factor on its apparent size.
const RANGE_MARGIN: f64 = 2.0;

/// A number to seven digits, as lists of a flight's detections hold it: so a camera that runs and its
/// recording give the same.
pub(crate) fn held(value: f64) -> f64 {
    f64::from(value as f32)
}

/// What a frame is to its camera's tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrackedFrame<'a> {
    /// New: what was seen in it.
    New(&'a [TrackedDetection]),
    /// The frame before once more, sample by sample: it shows nothing new.
    Copy,
    /// Not later than the frame before: it has no time of its own.
    Backward,
}

/// Follows everything that may be a marker in one camera's frames.
#[derive(Debug)]
pub struct CameraTracker {
    camera: usize,
    tracker: Tracker,
    detections: Vec<TrackedDetection>,
    /// The last frame that was new, with its stamp.
    last: Option<(i64, Arc<Frame>)>,
}

impl CameraTracker {
    /// A tracker that expects the apparent diameters that the rig and the ball sizes imply over the
    /// calibrated volume.
    ///
    /// # Errors
    /// Marker colours that cannot be distinguished, balls too small to be measured, no such camera in the
    /// rig.
    pub fn new(rig: &Rig, camera: usize, vehicle: &Vehicle) -> Result<Self, PipelineError> {
        let Some(seen_by) = rig.cameras.get(camera) else {
            return Err(PipelineError::NoFrames { camera: format!("camera number {camera}") });
        };
        let focal_px = (seen_by.camera.intrinsics.fx_px * seen_by.camera.intrinsics.fy_px).abs().sqrt();
        let ranges_m = rig
            .control_points_in_world()
            .into_iter()
            .map(|p: Vector3<f64>| (p - seen_by.camera.centre_in_world()).norm());
        let (near_m, far_m) = ranges_m.fold((f64::MAX, 0.0_f64), |(a, b), d| (a.min(d), b.max(d)));
        let (near_m, far_m) = if far_m > 0.0 { (near_m, far_m) } else { (1.0, 10.0) };
        let smallest_m = vehicle.marker.iter().map(|m| m.diameter_m).fold(f64::MAX, f64::min);
        let largest_m = vehicle.marker.iter().map(|m| m.diameter_m).fold(0.0, f64::max);
        let range =
            focal_px * smallest_m / far_m / RANGE_MARGIN..=focal_px * largest_m / near_m * RANGE_MARGIN;
        let colors = MarkerColors::of(vehicle);
        let tracker = Tracker::new(&colors.balls, range)
            .map_err(|source| PipelineError::Vision { place: seen_by.name.clone(), source })?;
        let tracker = tracker.with_markers(&colors.counts()).with_camera(seen_by.camera);
        Ok(Self { camera, tracker, detections: Vec::new(), last: None })
    }

    /// Looks at the next frame.
    pub fn see(&mut self, stamp_ns: i64, frame: Arc<Frame>) -> TrackedFrame<'_> {
        self.look_around();
        if let Some((last_ns, last)) = &self.last {
            if stamp_ns <= *last_ns {
                return TrackedFrame::Backward;
            }
            // All frames of a camera that is dark may be alike, and are no copies for that.
            if !self.is_dark() && **last == *frame {
                return TrackedFrame::Copy;
            }
        }
        self.detections.clear();
        self.detections.extend(self.tracker.follow(&frame).iter().map(|s| TrackedDetection {
            t_ns: stamp_ns,
            camera: self.camera,
            track_id: s.id,
            color: s.color,
            pixel: s.detection.pixel,
            covariance_px2: s.detection.covariance_px2.map(held),
            diameter_px: held(s.detection.diameter_px),
            is_static: s.is_static,
            is_preferred: s.is_preferred,
        }));
        self.last = Some((stamp_ns, frame));
        TrackedFrame::New(&self.detections)
    }

    /// Looks for newcomers in the frame that was seen last, before the next one comes, and prepares for
    /// that. It is done then if it was not before.
    pub fn look_around(&mut self) {
        if let Some((_, last)) = &self.last {
            self.tracker.look_around(last);
        }
    }

    /// Whether the last frame was dark all over.
    pub fn is_dark(&self) -> bool {
        self.tracker.is_dark()
    }

    /// The tracker itself.
    pub(crate) fn tracker(&self) -> &Tracker {
        &self.tracker
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SIZE, rig};

    #[test]
    fn copied_and_backward_frames_are_recognised() {
        let mut tracker = CameraTracker::new(&rig(), 0, &Vehicle::paper()).unwrap();
        let frame = |shade: u8| Arc::new(Frame::from_rgb(SIZE, vec![shade; 3 * SIZE.area_px()]).unwrap());
        assert_eq!(tracker.see(0, frame(120)), TrackedFrame::New(&[]));
        assert!(!tracker.is_dark());
        assert_eq!(tracker.see(10, frame(120)), TrackedFrame::Copy);
        assert_eq!(tracker.see(20, frame(121)), TrackedFrame::New(&[]));
        assert_eq!(tracker.see(20, frame(122)), TrackedFrame::Backward);
        assert!(CameraTracker::new(&rig(), 9, &Vehicle::paper()).is_err());
    }

    /// All frames of a camera whose shutter is closed are alike: each shows that it is dark.
    #[test]
    fn a_camera_that_remains_dark_is_dark_in_each_frame() {
        let mut tracker = CameraTracker::new(&rig(), 0, &Vehicle::paper()).unwrap();
        let dark = Arc::new(Frame::from_rgb(SIZE, vec![3; 3 * SIZE.area_px()]).unwrap());
        for t_ns in 0..5 {
            assert!(tracker.see(t_ns, Arc::clone(&dark)) == TrackedFrame::New(&[]) && tracker.is_dark());
        }
    }
}
