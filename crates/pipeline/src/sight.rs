//! What one camera's tracker sees of its frames.

use crate::PipelineError;
use crate::associate::MarkerColors;
use mavsight_flight::Vehicle;
use mavsight_geometry::{Matrix2, Vector2, Vector3};
use mavsight_pose::Rig;
use mavsight_vision::{BallHealth, Frame, Tracker};
use std::sync::Arc;

/// How far beyond the control points' ranges the aircraft may fly, as a factor on its apparent size.
const RANGE_MARGIN: f64 = 2.0;

/// One thing of a marker's colour in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Time stamp of the frame, by the camera's clock.
    pub stamp_ns: i64,
    /// The same for the same thing from frame to frame.
    pub id: u32,
    /// Its colour, as the vehicle's markers have them, each once.
    pub color: usize,
    /// Centre.
    pub pixel: Vector2<f64>,
    /// Covariance of that.
    pub covariance_px2: Matrix2<f64>,
    /// Apparent diameter.
    pub diameter_px: f64,
    /// Whether it has long stayed at one place.
    pub stays: bool,
    /// Whether it is the most likely of its colour to be a marker.
    pub leads: bool,
}

/// A number to seven digits, as lists of a flight's sights hold it: so a camera that runs and its recording give the same.
pub(crate) fn held(value: f64) -> f64 {
    f64::from(value as f32)
}

/// What a frame is to its camera's tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrackedFrame<'a> {
    /// New: what was seen in it.
    New(&'a [Sight]),
    /// The frame before once more, sample by sample: it shows nothing new.
    Copy,
    /// Not later than the frame before: it has no time of its own.
    Backward,
}

/// Follows everything that may be a marker in one camera's frames.
#[derive(Debug)]
pub struct CameraTracker {
    tracker: Tracker,
    sights: Vec<Sight>,
    /// The last frame that was new, with its stamp.
    last: Option<(i64, Arc<Frame>)>,
}

impl CameraTracker {
    /// A tracker that expects the apparent diameters that the rig and the ball sizes imply over the calibrated volume.
    ///
    /// # Errors
    /// Marker colours that cannot be told apart, balls too small to be measured, no such camera in the rig.
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
        Ok(Self { tracker, sights: Vec::new(), last: None })
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
        self.sights.clear();
        self.sights.extend(self.tracker.follow(&frame).iter().map(|s| Sight {
            stamp_ns,
            id: s.id,
            color: s.color,
            pixel: s.detection.pixel,
            covariance_px2: s.detection.covariance_px2.map(held),
            diameter_px: held(s.detection.diameter_px),
            stays: s.is_static,
            leads: s.is_preferred,
        }));
        self.last = Some((stamp_ns, frame));
        TrackedFrame::New(&self.sights)
    }

    /// Looks for newcomers in the frame that was seen last, before the next one comes, and makes ready for that. It is
    /// done then if it was not before.
    pub fn look_around(&mut self) {
        if let Some((_, last)) = &self.last {
            self.tracker.look_around(last);
        }
    }

    /// Whether the last frame was dark all over.
    pub fn is_dark(&self) -> bool {
        self.tracker.is_dark()
    }

    /// How well the balls of each colour have been seen so far.
    pub fn health(&self) -> &[BallHealth] {
        self.tracker.health()
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
    fn copied_and_backward_frames_are_told() {
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
    fn a_camera_that_stays_dark_is_dark_in_each_frame() {
        let mut tracker = CameraTracker::new(&rig(), 0, &Vehicle::paper()).unwrap();
        let dark = Arc::new(Frame::from_rgb(SIZE, vec![3; 3 * SIZE.area_px()]).unwrap());
        for t_ns in 0..5 {
            assert!(tracker.see(t_ns, Arc::clone(&dark)) == TrackedFrame::New(&[]) && tracker.is_dark());
        }
    }
}
