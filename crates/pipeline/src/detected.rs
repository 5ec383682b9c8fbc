//! Detections that were made elsewhere, into observations and poses.

use crate::stream::Stream;
use crate::track::joined;
use crate::tracked::Tracked;
use crate::tracker::held;
use crate::watch::CameraWatch;
use crate::{Instant, PipelineError};
use mavsight_flight::Vehicle;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_pose::{ClockPrior, Rig, TrackedDetection};

/// What a detector saw in one frame of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedFrame {
    /// Middle of the exposure by the camera's own clock.
    pub stamp_ns: i64,
    /// What may be a marker, those followed longest first. Times and cameras are set by where they are.
    pub seen: Vec<TrackedDetection>,
}

/// The frames of one camera as a detector saw them, in the order in which they came.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectionFeed {
    /// Camera name, as in the rig.
    pub name: String,
    /// What is known of the clock behind the time stamps.
    pub clock: ClockPrior,
    /// The frames.
    pub frames: Vec<DetectedFrame>,
}

/// [`crate::track_with`] from what detectors saw, for detections that were made elsewhere or simulated: all that follows
/// detection is the same. A frame that shows what the one before it showed, number by number, is a copy of it. Detections
/// that are no measurement of their image are left out, with a note: numbers that are not finite, a centre outside of the
/// image, a covariance that is not positive or larger than the image.
///
/// # Errors
/// As [`crate::track`], and fewer feeds than the rig has cameras; further ones are not looked at.
pub fn track_detections(
    feeds: Vec<DetectionFeed>,
    rig: &Rig,
    vehicle: &Vehicle,
    each: impl FnMut(&Instant<'_>),
) -> Result<Tracked, PipelineError> {
    if let Some(missing) = rig.cameras.get(feeds.len()) {
        return Err(PipelineError::NoFrames { camera: missing.name.clone() });
    }
    let (mut streams, mut watches) = (Vec::new(), Vec::new());
    for (camera, feed) in feeds.into_iter().enumerate().take(rig.cameras.len()) {
        let (stream, watch) = taken(camera, rig.cameras[camera].camera.size, feed)?;
        streams.push(stream);
        watches.push(watch);
    }
    joined(streams, watches, rig, vehicle, each)
}

fn taken(
    camera: usize,
    size: ImageSize,
    feed: DetectionFeed,
) -> Result<(Stream, CameraWatch), PipelineError> {
    let mut stream = Stream::new(camera, feed.name.clone(), feed.clock, Vector2::y());
    let mut watch = CameraWatch::new(feed.name.clone(), Some(feed.frames.len()));
    let mut last: Option<DetectedFrame> = None;
    for mut frame in feed.frames {
        let all = frame.seen.len();
        frame.seen.retain(|own| is_measurement(own, size));
        stream.add_spoilt(frame.stamp_ns, all - frame.seen.len());
        match &last {
            Some(last) if frame.stamp_ns <= last.stamp_ns => stream.add_backward(frame.stamp_ns),
            Some(last) if is_copy(&frame.seen, &last.seen) => stream.add_copy(frame.stamp_ns),
            _ => {
                stream.add(frame.stamp_ns, &frame.seen, None);
                watch.saw(frame.stamp_ns, false);
                last = Some(frame);
            }
        }
    }
    Ok((stream.checked()?, watch))
}

/// Whether a detection says something of its image, in the seven digits that are kept of it.
fn is_measurement(own: &TrackedDetection, size: ImageSize) -> bool {
    let covariance_px2 = own.covariance_px2.map(held);
    let is_positive = covariance_px2.cholesky().is_some_and(|c| c.determinant() > 0.0);
    let (diameter_px, most_px) = (held(own.diameter_px), f64::from(size.width_px.max(size.height_px)));
    // A ball that the border cuts has its centre outside by half of it at most.
    let is_inside = diameter_px.is_finite() && size.contains(&own.pixel, -0.5 * diameter_px.max(0.0));
    is_inside && is_positive && covariance_px2.trace() < most_px * most_px
}

/// Whether two frames show the same to the last digit, which the noise of an image does not allow of two exposures.
fn is_copy(seen: &[TrackedDetection], before: &[TrackedDetection]) -> bool {
    let is_same = |(a, b): (&TrackedDetection, &TrackedDetection)| {
        (a.pixel, a.covariance_px2, a.color) == (b.pixel, b.covariance_px2, b.color)
    };
    !seen.is_empty() && seen.len() == before.len() && seen.iter().zip(before).all(is_same)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{rig, stream};
    use mavsight_geometry::Matrix2;
    use mavsight_pose::CameraClock;

    fn feeds() -> Vec<DetectionFeed> {
        let feed = |camera: usize| {
            let seen = stream(camera, CameraClock::default(), 30.0, 0..60);
            let frame = |stamp_ns: &i64| DetectedFrame {
                stamp_ns: *stamp_ns,
                seen: seen.detections().filter(|d| d.t_ns == *stamp_ns).collect(),
            };
            let frames = seen.stamps_ns.iter().map(frame).collect();
            DetectionFeed { name: seen.name.clone(), clock: seen.clock, frames }
        };
        (0..3).map(feed).collect()
    }

    fn tracked(feeds: Vec<DetectionFeed>) -> Tracked {
        track_detections(feeds, &rig(), &Vehicle::paper(), |_| {}).unwrap()
    }

    #[test]
    fn what_is_no_measurement_is_left_out_and_said() {
        let sound = tracked(feeds());
        assert_eq!((sound.notes.len(), sound.poses.len()), (0, 60));
        let mut spoilt = feeds();
        for (k, frame) in spoilt[1].frames.iter_mut().enumerate().skip(20).take(6) {
            let own = &mut frame.seen[0];
            match k {
                20 => own.pixel.x = f64::NAN,
                21 => own.pixel.y = f64::MAX,
                22 => own.covariance_px2[(1, 1)] = f64::INFINITY,
                23 => own.covariance_px2 = Matrix2::zeros(),
                24 => own.covariance_px2 = -own.covariance_px2,
                _ => own.diameter_px = f64::NEG_INFINITY,
            }
        }
        let got = tracked(spoilt);
        let [note] = &got.notes[..] else { panic!("{:?}", got.notes) };
        assert!(note.contains("cam2: 6 detection(s) are not finite") && note.contains("0.667 s"), "{note}");
        assert_eq!(got.findings, vec![]);
        for (own, before) in got.poses.iter().zip(&sound.poses) {
            let (own, before) = (own.estimate.as_ref().unwrap(), before.estimate.as_ref().unwrap());
            let apart_m =
                (own.world_from_body.translation.vector - before.world_from_body.translation.vector).norm();
            assert!(apart_m < 2e-3, "{apart_m} m");
        }
    }

    #[test]
    fn frames_that_repeat_or_come_late_are_left_out_and_missing_cameras_are_refused() {
        let mut faulty = feeds();
        faulty[1].frames[30].seen = faulty[1].frames[29].seen.clone();
        faulty[2].frames[40..43].rotate_left(1);
        let notes = tracked(faulty).notes;
        assert!(notes.iter().any(|n| n.contains("cam2: 1 frame(s) repeat the one before")), "{notes:?}");
        assert!(
            notes.iter().any(|n| n.contains("cam3: 1 frame(s) with a time stamp not after")),
            "{notes:?}"
        );
        let two = feeds().into_iter().take(2).collect();
        let refused = track_detections(two, &rig(), &Vehicle::paper(), |_| {}).unwrap_err();
        assert!(refused.to_string().contains("cam3"), "{refused}");
    }
}
