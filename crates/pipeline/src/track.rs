//! Frames of all cameras into marker observations and poses.

use crate::associate::{FlightAssociator, Instant};
use crate::markers::{MarkerColors, body_markers};
use crate::misfit::ClockEvidence;
use crate::reconstruct::Reconstruction;
use crate::stream::{Stream, camera_streams, leave_out_still, refuse_one_recording_twice};
use crate::tracked::Tracked;
use crate::tracker::{CameraTracker, TrackedFrame};
use crate::watch::CameraWatch;
use crate::{
    CameraFeed, Finding, PipelineError, Progress, Stage, TimedFrame, clock_start, clock_step, pushed,
    synchronize,
};
use mavsight_flight::Vehicle;
use mavsight_pose::{CameraClock, ClockVerdict, GAP_INTERVALS, Rig, estimate_clocks};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Bytes of frames that may wait between two stages, which are eight frames of 640×480: enough to even out
/// decoding, few enough to be kept in the cache; and the least number of frames.
const QUEUE_BYTES: usize = 8 * 640 * 480 * 3 / 2;
const LEAST_QUEUE_FRAMES: usize = 2;

/// Runs every feed through detection and tracking, sets the cameras' clocks right, brings what they saw to
/// common instants, associates the detections with the markers, and estimates one pose an instant.
///
/// Each camera has a thread that fetches frames and one that tracks, joined by a queue of bounded length.
/// Faults of a recording behind its first frame are noted with camera and time, and the flight goes on with
/// what remains.
///
/// # Errors
/// A camera without frames, marker colours that cannot be distinguished, recordings that share no time.
pub fn track(
    feeds: Vec<CameraFeed<'_>>,
    rig: &Rig,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Tracked, PipelineError> {
    track_with(feeds, rig, vehicle, progress, |_| {})
}

/// [`track`], with each instant as it was first estimated handed to `each`: what a run on live cameras
/// gives then, bit for bit where the cameras are in step. The poses that [`track`] yields are estimated
/// again, with what the whole flight has shown of the centres.
///
/// # Errors
/// As [`track`].
pub fn track_with(
    feeds: Vec<CameraFeed<'_>>,
    rig: &Rig,
    vehicle: &Vehicle,
    progress: &dyn Progress,
    each: impl FnMut(&Instant<'_>),
) -> Result<Tracked, PipelineError> {
    let trackers = (0..feeds.len())
        .map(|camera| CameraTracker::new(rig, camera, vehicle))
        .collect::<Result<Vec<_>, _>>()?;
    progress.begin(Stage::Track, feeds.iter().filter_map(|f| f.announced).min().map(|n| n as u64));
    let seen = std::thread::scope(|scope| {
        let workers: Vec<_> = feeds
            .into_iter()
            .zip(trackers)
            .enumerate()
            .map(|(camera, (feed, tracker))| {
                let frame_bytes = rig.cameras[camera].camera.size.area_px() * 3 / 2;
                let (frame_out, frame_in) =
                    sync_channel((QUEUE_BYTES / frame_bytes.max(1)).clamp(LEAST_QUEUE_FRAMES, 8));
                let watch = CameraWatch::new(feed.name.clone(), feed.announced);
                let mut stream = Stream::new(camera, feed.name.clone(), feed.clock, feed.readout);
                stream.brightness = feed.flash.then(Vec::new);
                stream.clap = feed.clap;
                stream.may_be_reordered = feed.may_be_reordered;
                stream.reserve(feed.announced.unwrap_or(0), vehicle.marker.len());
                scope.spawn(move || fetch(feed, &frame_out));
                let watched = (camera == 0).then_some(progress);
                scope.spawn(move || observe(tracker, stream, watch, &frame_in, watched))
            })
            .collect();
        let ended = |w: std::thread::ScopedJoinHandle<'_, _>| {
            w.join().unwrap_or_else(|_| Err(PipelineError::Worker { camera: "a camera".into() }))
        };
        workers.into_iter().map(ended).collect::<Result<Vec<(Stream, CameraWatch)>, _>>()
    })?;
    let (streams, watches) = seen.into_iter().unzip();
    joined(streams, watches, rig, vehicle, each)
}

fn fetch(feed: CameraFeed<'_>, out: &SyncSender<Result<TimedFrame, PipelineError>>) {
    for frame in feed.frames {
        if out.send(frame).is_err() {
            return;
        }
    }
}

fn observe(
    mut tracker: CameraTracker,
    mut stream: Stream,
    mut watch: CameraWatch,
    frames: &Receiver<Result<TimedFrame, PipelineError>>,
    progress: Option<&dyn Progress>,
) -> Result<(Stream, CameraWatch), PipelineError> {
    for frame in frames {
        match frame {
            Ok(TimedFrame { t_ns, frame }) => {
                watch.looks_at(t_ns, &frame);
                let brightness = stream.brightness.is_some().then(|| clock_start::brightness(&frame));
                match tracker.see(t_ns, Arc::new(frame)) {
                    TrackedFrame::New(seen) => {
                        stream.add(t_ns, seen, brightness);
                        watch.saw(t_ns, tracker.is_dark());
                    }
                    TrackedFrame::Copy => stream.add_copy(t_ns),
                    TrackedFrame::Backward => stream.add_backward(t_ns),
                }
            }
            Err(error) => stream.add_fault(error)?,
        }
        if let Some(progress) = progress {
            progress.step();
        }
    }
    Ok((stream.checked()?, watch.finish(tracker.tracker())))
}

/// Clocks, instants, identities and poses of what the cameras saw.
pub(crate) fn joined(
    mut streams: Vec<Stream>,
    mut watches: Vec<CameraWatch>,
    rig: &Rig,
    vehicle: &Vehicle,
    mut each: impl FnMut(&Instant<'_>),
) -> Result<Tracked, PipelineError> {
    let colors = MarkerColors::of(vehicle);
    let mut notes = clock_start::start_by_flash(&mut streams);
    notes.extend(clock_start::start_by_clap(&mut streams, rig));
    refuse_one_recording_twice(&streams)?;
    let mut found: Vec<Finding> = streams.iter().filter_map(Stream::frozen).collect();
    found.extend(leave_out_still(&mut streams));
    found.extend(pushed::leave_out(&mut streams, &colors));
    let in_order: Vec<String> = streams.iter_mut().filter_map(Stream::set_in_order).collect();
    found.extend(clock_step::set_right(&mut streams, rig, vehicle));
    notes.splice(0..0, streams.iter().flat_map(Stream::notes).chain(in_order));
    let seen = camera_streams(&streams, &colors);
    let clocks = estimate_clocks(rig, &body_markers(vehicle), &seen);
    for (stream, clock) in streams.iter().zip(&clocks) {
        if let ClockVerdict::TooSlow { .. } = clock.verdict {
            notes.push(format!("{}: its clock is {clock}.", stream.name));
        }
    }
    let exact: Vec<CameraClock> = clocks.iter().map(|c| c.clock).collect();
    notes.extend(span_notes(&streams, &exact)?);
    let pictures = std::iter::zip(&mut watches, &exact).filter_map(|(watch, clock)| {
        let TimedFrame { t_ns, frame } = watch.picture.take()?;
        Some(TimedFrame { t_ns: clock.time_ns(t_ns), frame })
    });
    let pictures: Vec<TimedFrame> = pictures.collect();
    let sizes: Vec<_> = rig.cameras.iter().map(|c| c.camera.size).collect();
    let mut all = Reconstruction::new(rig, vehicle);
    all.tracked.may_be_reordered = streams.iter().any(|s| s.may_be_reordered);
    let instants = streams.iter().map(|s| s.stamps_ns.len()).max().unwrap_or(0);
    all.tracked.reserve(instants, streams.len() * vehicle.marker.len());
    let mut associator = FlightAssociator::new(rig, vehicle)?;
    associator.spread_over(instants);
    let intervals_s: Vec<f64> = streams.iter().map(Stream::interval_s).collect();
    synchronize::instants(streams, &sizes, &exact, |t_ns, seen| {
        let association = associator.associate(t_ns, seen);
        each(&Instant { t_ns, seen, association: &association, moved: associator.moved_cameras() });
        all.add_associated(seen, association);
    });
    found.extend(associator.misfit_by_clocks(rig, Some(ClockEvidence { streams: seen }))?);
    all.tracked.findings = found;
    all.leave_out_moved(&associator);
    let watches = watches.into_iter().zip(intervals_s).collect();
    associator.finish(rig, watches, &mut all.tracked);
    all.withhold_what_is_of_another_body();
    let mut tracked = all.finish()?;
    notes.append(&mut tracked.notes);
    (tracked.clocks, tracked.notes, tracked.pictures) = (clocks, notes, pictures);
    Ok(tracked)
}

/// Cameras that begin later or end earlier than others.
fn span_notes(streams: &[Stream], clocks: &[CameraClock]) -> Result<Vec<String>, PipelineError> {
    let time_s =
        |k: usize, stamp_ns: Option<&i64>| stamp_ns.map_or(0.0, |t| clocks[k].time_ns(*t) as f64 * 1e-9);
    let spans: Vec<(f64, f64)> = streams
        .iter()
        .enumerate()
        .map(|(k, s)| (time_s(k, s.stamps_ns.first()), time_s(k, s.stamps_ns.last())))
        .collect();
    let (begin_s, end_s) = spans.iter().fold((f64::MAX, f64::MIN), |(b, e), s| (b.min(s.0), e.max(s.1)));
    let mut notes = Vec::new();
    for (k, (stream, (from_s, to_s))) in streams.iter().zip(&spans).enumerate() {
        let overlaps = |(j, other): (usize, &(f64, f64))| j != k && other.0 <= *to_s && other.1 >= *from_s;
        if streams.len() > 1 && !spans.iter().enumerate().any(overlaps) {
            let (camera, from_s, to_s) = (stream.name.clone(), *from_s, *to_s);
            return Err(PipelineError::NoCommonTime { camera, from_s, to_s });
        }
        let (name, slack_s) = (&stream.name, GAP_INTERVALS * stream.interval_s());
        let (early_s, late_s) = (end_s - to_s, from_s - begin_s);
        if early_s > slack_s {
            notes.push(format!(
                "{name} ends at {to_s:.3} s, {early_s:.3} s before the last camera: from there on poses are by the others."
            ));
        }
        if late_s > slack_s {
            notes.push(format!(
                "{name} begins at {from_s:.3} s, {late_s:.3} s after the one that begins first: until then poses are by the others."
            ));
        }
    }
    Ok(notes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{pose, rig, stream, without_balls};
    use mavsight_pose::ClockPrior;

    fn late(offset_s: f64, drift: f64) -> CameraClock {
        CameraClock { offset_s, drift, line_time_s: 0.0 }
    }

    /// Root mean square position error, mm, and instants with a pose.
    fn errors(tracked: &Tracked) -> (f64, usize) {
        let mut sum = 0.0;
        let mut count = 0;
        for sample in &tracked.poses {
            let Ok(estimate) = &sample.estimate else { continue };
            let true_m = pose(sample.t_ns as f64 * 1e-9).translation.vector;
            sum += (estimate.world_from_body.translation.vector - true_m).norm_squared();
            count += 1;
        }
        (1e3 * f64::sqrt(sum / f64::from(count)), count as usize)
    }

    fn joined_by_rig(streams: Vec<Stream>) -> Result<Tracked, PipelineError> {
        let mut rig = rig();
        rig.cameras.truncate(streams.len());
        rig.uncertainty =
            rig.uncertainty.rows(0, mavsight_geometry::CAMERA_PARAMETERS * streams.len()).into();
        let watch = |s: &Stream| {
            let mut watch = CameraWatch::new(s.name.clone(), None);
            watch.health.frames = s.stamps_ns.len();
            watch
        };
        let watches = streams.iter().map(watch).collect();
        joined(streams, watches, &rig, &Vehicle::paper(), |_| {})
    }

    /// Twice as many frames as there were were said to show a ball, of the slower of two cameras.
    #[test]
    fn a_slow_camera_sees_a_ball_in_no_more_frames_than_it_has() {
        let exact = CameraClock::default();
        let tracked = flown(vec![stream(0, exact, 60.0, 0..240), stream(1, exact, 30.0, 0..120)]);
        let seen = tracked.health.iter().flat_map(|h| &h.markers).map(|m| m.seen);
        assert!(seen.clone().all(|share| (0.9..1.01).contains(&share)), "{:?}", seen.collect::<Vec<_>>());
    }

    fn flown(streams: Vec<Stream>) -> Tracked {
        joined_by_rig(streams).unwrap()
    }

    fn unknown(mut stream: Stream) -> Stream {
        stream.clock = ClockPrior::unknown();
        stream
    }

    #[test]
    fn a_late_and_fast_camera_costs_no_exactness() {
        let exact = late(0.0, 0.0);
        let in_step = flown(vec![stream(0, exact, 30.0, 0..600), unknown(stream(1, exact, 30.0, 0..600))]);
        assert_eq!(in_step.clocks[1].verdict, ClockVerdict::InStep, "{}", in_step.clocks[1]);
        let off = late(13.7e-3, 50e-6);
        let set = flown(vec![stream(0, exact, 30.0, 0..600), unknown(stream(1, off, 30.0, 0..600))]);
        let (got, clock) = (errors(&set), set.clocks[1]);
        println!("{clock}; {:.3} mm over {:.3} mm", got.0, errors(&in_step).0);
        assert_eq!(clock.verdict, ClockVerdict::SetRight);
        // The offset at the middle of the flight, wherever the drift turns about.
        let shown_s = clock.clock.offset_s + 10.0 * clock.clock.drift;
        assert!((shown_s - 13.7e-3 - 10.0 * 50e-6).abs() < 0.3e-3, "{clock}");
        assert!(got.0 < 1.3 * errors(&in_step).0 && got.1 >= 598, "{got:?}");
        assert_eq!(set.notes, Vec::<String>::new());
    }

    /// The edge of a table passed for the yellow ball in one camera: no clock was determined, and poses were 20 mm off.
    #[test]
    fn an_object_of_a_markers_colour_that_stands_does_not_spoil_the_clock() {
        let (exact, off) = (late(0.0, 0.0), late(63.7e-3, 0.0));
        let mut spoilt = unknown(stream(1, off, 30.0, 0..300));
        let table = mavsight_geometry::Vector2::new(400.0, 300.0);
        for (k, detection) in spoilt.detections.iter_mut().enumerate().filter(|(k, _)| k % 4 == 3) {
            detection.pixel = table + mavsight_geometry::Vector2::new(0.02 * (k as f64).sin(), 0.0);
        }
        let tracked = flown(vec![stream(0, exact, 30.0, 0..300), spoilt]);
        let clock = tracked.clocks[1];
        let error_s = clock.clock.offset_s - 63.7e-3;
        assert!(
            clock.verdict == ClockVerdict::SetRight && error_s.abs() < 4.0 * clock.offset_std_s,
            "{clock}"
        );
        assert!(clock.offset_std_s < 0.5e-3 && errors(&tracked).0 < 2.0, "{clock}, {:?}", errors(&tracked));
    }

    /// What is wrong is said with camera and time, and the rest of the flight is as good as ever.
    #[test]
    fn a_camera_that_ends_early_is_named_and_the_others_go_on() {
        let exact = late(0.0, 0.0);
        let whole = |k: usize| stream(k, exact, 30.0, 0..150);
        let sound = errors(&flown(vec![whole(0), whole(1), whole(2)]));
        let tracked = flown(vec![whole(0), stream(1, exact, 30.0, 0..60), whole(2)]);
        let [note] = &tracked.notes[..] else { panic!("{:?}", tracked.notes) };
        assert!(note.contains("cam2 ends at 1.967 s, 3.000 s before"), "{note}");
        let got = errors(&tracked);
        assert!(got.1 == 150 && got.0 < 1.5 * sound.0, "{got:?} against {sound:?}");
        // The first camera may be the one that ends.
        let tracked = flown(vec![stream(0, exact, 30.0, 0..60), whole(1), whole(2)]);
        assert!(errors(&tracked).1 == 150 && tracked.notes[0].contains("cam1 ends"), "{:?}", tracked.notes);
        // One camera alone gives poses of a larger covariance.
        let two = flown(vec![whole(0), stream(1, exact, 30.0, 0..60)]);
        let traces: Vec<f64> = two
            .poses
            .iter()
            .filter_map(|p| p.estimate.as_ref().ok())
            .map(|e| e.covariance().trace())
            .collect();
        assert!(traces.len() > 140 && traces[100] > 10.0 * traces[30], "{}", traces.len());
    }

    /// What froze before an encoder has no two images alike to the last digit: one camera of two went on as if it saw, and
    /// the aircraft was centimetres from where it was said to be.
    #[test]
    fn a_camera_that_froze_before_its_encoder_is_named_and_left_out_of_two() {
        let exact = late(0.0, 0.0);
        let sound = errors(&flown(vec![stream(0, exact, 30.0, 0..60), stream(1, exact, 30.0, 0..60)]));
        for frozen in 0..2 {
            let mut streams = vec![stream(0, exact, 30.0, 0..150), stream(1, exact, 30.0, 0..150)];
            let mut random = mavsight_random::Random::new(3, 0);
            let own = &mut streams[frozen].detections;
            let (before, after) = own.split_at_mut(4 * 60);
            for (k, detection) in after.iter_mut().enumerate() {
                let jitter = mavsight_geometry::Vector2::from(random.normals()) * 2e-3;
                detection.pixel = before[4 * 59 + k % 4].pixel + jitter;
            }
            let tracked = flown(streams);
            let found: Vec<_> = tracked.findings.iter().map(|f| (f.cause(), f.camera)).collect();
            assert_eq!(found, [(Some(crate::Cause::CameraFrozen), Some(frozen))], "{:?}", tracked.findings);
            for sample in &tracked.poses {
                let Ok(estimate) = &sample.estimate else { continue };
                let true_m = pose(sample.t_ns as f64 * 1e-9).translation.vector;
                let error_m = estimate.world_from_body.translation.vector - true_m;
                let spread = estimate.covariance().fixed_view::<3, 3>(0, 0).into_owned();
                let stds = error_m.dot(&spread.cholesky().unwrap().solve(&error_m)).sqrt();
                assert!(
                    stds < 6.0,
                    "camera {frozen} at {} ns: {error_m} m, {stds} (sound: {sound:?})",
                    sample.t_ns
                );
            }
        }
    }

    /// A video whose time stamps have another rate than its camera was said to be of a camera that was moved, as was the other.
    #[test]
    fn a_wrong_frame_rate_of_one_of_two_cameras_is_no_camera_that_was_moved() {
        let quick = stream(1, late(0.0, 30.0 / 25.0 - 1.0), 30.0, 0..100);
        let tracked = flown(vec![stream(0, late(0.0, 0.0), 30.0, 0..300), quick]);
        let causes: Vec<_> = tracked.findings.iter().flat_map(|f| &f.causes).collect();
        assert!(causes.contains(&&crate::Cause::FrameRate), "{:?}", tracked.findings);
        assert!(!causes.contains(&&crate::Cause::CameraMoved), "{:?}", tracked.findings);
    }

    /// Balls of a frozen image that were not found for a while made it another one, and what it had shown before was believed.
    #[test]
    fn a_frozen_image_of_which_some_balls_are_not_found_is_dated_to_its_first_frame() {
        let exact = late(0.0, 0.0);
        let mut frozen = stream(1, exact, 30.0, 0..150);
        let mut random = mavsight_random::Random::new(6, 0);
        let (before, after) = frozen.detections.split_at_mut(4 * 61);
        for (k, detection) in after.iter_mut().enumerate() {
            let jitter = mavsight_geometry::Vector2::from(random.normals()) * 2e-3;
            detection.pixel = before[4 * 60 + k % 4].pixel + jitter;
        }
        let frozen = without_balls(&frozen, 1, |frame, ball| (80..100).contains(&frame) && ball > 0);
        let tracked = flown(vec![stream(0, exact, 30.0, 0..150), frozen]);
        let [one] = &tracked.findings[..] else { panic!("{:?}", tracked.findings) };
        assert_eq!((one.cause(), one.camera), (Some(crate::Cause::CameraFrozen), Some(1)), "{}", one.note);
        assert!(one.note.contains("from 2.000 s"), "{}", one.note);
    }

    /// The one camera that was left repeated its image but for an encoder's noise: it was taken for an aircraft that stands.
    #[test]
    fn a_camera_that_froze_and_outlived_the_other_measures_nothing() {
        let exact = late(0.0, 0.0);
        let mut streams = vec![stream(0, exact, 30.0, 0..61), stream(1, exact, 30.0, 0..150)];
        let mut random = mavsight_random::Random::new(4, 0);
        let (before, after) = streams[1].detections.split_at_mut(4 * 61);
        for (k, detection) in after.iter_mut().enumerate() {
            let jitter = mavsight_geometry::Vector2::from(random.normals()) * 2e-3;
            detection.pixel = before[4 * 60 + k % 4].pixel + jitter;
        }
        let tracked = flown(streams);
        let found: Vec<_> = tracked.findings.iter().map(|f| (f.cause(), f.camera)).collect();
        assert_eq!(found, [(Some(crate::Cause::CameraFrozen), Some(1))], "{:?}", tracked.findings);
        assert!(tracked.poses.iter().all(|p| p.t_ns < 2_100_000_000), "{:?}", tracked.poses.last());
    }

    #[test]
    fn recordings_of_different_times_are_refused() {
        let exact = late(0.0, 0.0);
        let streams = vec![stream(0, exact, 30.0, 0..30), stream(1, exact, 30.0, 600..630)];
        let text = joined_by_rig(streams).unwrap_err().to_string();
        assert!(text.contains("cam1 runs from 0.000 s") && text.contains("time_offset_s"), "{text}");
    }

    #[test]
    fn one_recording_given_for_two_cameras_is_refused() {
        let first = stream(0, late(0.0, 0.0), 30.0, 0..90);
        let mut again = first.clone();
        again.name = "cam2".into();
        let text = joined_by_rig(vec![first, again]).unwrap_err().to_string();
        assert!(text.contains("cam1 and cam2 saw the same"), "{text}");
    }

    #[test]
    fn a_flight_at_rest_leaves_the_clocks_and_says_so() {
        let exact = late(0.0, 0.0);
        let mut streams = vec![stream(0, exact, 30.0, 0..90), unknown(stream(1, exact, 30.0, 0..90))];
        for stream in &mut streams {
            let first: Vec<_> = stream.detections[..4].to_vec();
            for (k, detection) in stream.detections.iter_mut().enumerate() {
                detection.pixel = first[k % 4].pixel + (detection.pixel - first[k % 4].pixel) * 1e-3;
            }
        }
        let tracked = flown(streams);
        assert!(
            tracked.notes.iter().any(|n| n.contains("cam2") && n.contains("too slow")),
            "{:?}",
            tracked.notes
        );
    }
}
