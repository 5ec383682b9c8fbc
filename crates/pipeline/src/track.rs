//! Frames of all cameras into marker observations and poses.

use crate::associate::{Identities, MarkerColors};
use crate::reconstruct::Reconstruction;
use crate::watch::CameraWatch;
use crate::{CameraFeed, PipelineError, Progress, Stage, TimedFrame};
use mavsight_flight::Vehicle;
use mavsight_geometry::{Isometry3, Vector3};
use mavsight_pose::{BodyMarker, MarkerObservation, PoseEstimator, PoseSample, Rig};
use mavsight_session::results::CameraHealth;
use mavsight_vision::{ColorSighting, Tracker};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Frames that may wait between two stages: enough to even out decoding, few enough to stay in the cache.
const QUEUE_FRAMES: usize = 8;

/// How far beyond the control points' ranges the aircraft may fly, as a factor on its apparent size.
const RANGE_MARGIN: f64 = 2.0;

/// What tracking yields.
#[derive(Debug, Clone, Default)]
pub struct Tracked {
    /// Every marker seen, by time, camera and marker.
    pub observations: Vec<MarkerObservation>,
    /// Apparent diameters, one for each observation; none where the observations came from elsewhere.
    pub diameters_px: Vec<f64>,
    /// One sample an instant, empty where it could not be measured.
    pub poses: Vec<PoseSample>,
    /// How well each camera saw the markers; none where the observations came from elsewhere.
    pub health: Vec<CameraHealth>,
    /// What happened to the cameras, for people.
    pub notes: Vec<String>,
}

/// What one camera saw at one time stamp.
type Seen = (i64, Vec<ColorSighting>);

type Sighting = Result<Seen, PipelineError>;

/// Runs every feed through detection and tracking, joins the cameras in time, and estimates one pose an instant.
///
/// Each camera has a thread that fetches frames and one that tracks, joined by queues of bounded length.
///
/// # Errors
/// A source that fails, marker colours that cannot be told apart, cameras of different length or out of step.
pub fn track(
    feeds: Vec<CameraFeed<'_>>,
    rig: &Rig,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<Tracked, PipelineError> {
    let names: Vec<String> = feeds.iter().map(|f| f.name.clone()).collect();
    let trackers = feeds
        .iter()
        .enumerate()
        .map(|(camera, feed)| {
            tracker_for(rig, camera, vehicle)
                .map_err(|source| PipelineError::Vision { place: feed.name.clone(), source })
        })
        .collect::<Result<Vec<_>, _>>()?;
    progress.begin(Stage::Track, feeds.iter().filter_map(|f| f.announced).min().map(|n| n as u64));
    std::thread::scope(|scope| {
        let (sightings, watches): (Vec<Receiver<Sighting>>, Vec<_>) = feeds
            .into_iter()
            .zip(trackers)
            .map(|(feed, tracker)| {
                let (frame_out, frame_in) = sync_channel(QUEUE_FRAMES);
                let (sighting_out, sighting_in) = sync_channel(QUEUE_FRAMES);
                let watch = CameraWatch::new(feed.name.clone());
                scope.spawn(move || fetch(feed, &frame_out));
                let watched = scope.spawn(move || observe(tracker, watch, &frame_in, &sighting_out));
                (sighting_in, watched)
            })
            .unzip();
        let (mut all, identities) = join(&names, &sightings, rig, vehicle, progress)?;
        drop(sightings);
        let ended = |camera: &String| PipelineError::Worker { camera: camera.clone() };
        let watches = (watches.into_iter().zip(&names))
            .map(|(watched, name)| watched.join().map_err(|_| ended(name)))
            .collect::<Result<Vec<_>, _>>()?;
        identities.finish(rig, watches, &mut all.tracked);
        all.finish()
    })
}

fn fetch(feed: CameraFeed<'_>, out: &SyncSender<Result<TimedFrame, PipelineError>>) {
    for frame in feed.frames {
        let failed = frame.is_err();
        if out.send(frame).is_err() || failed {
            return;
        }
    }
}

fn observe(
    mut tracker: Tracker,
    mut watch: CameraWatch,
    frames: &Receiver<Result<TimedFrame, PipelineError>>,
    out: &SyncSender<Sighting>,
) -> CameraWatch {
    for frame in frames {
        let sighting = frame.map(|f| {
            let seen = tracker.candidates(&f.frame).to_vec();
            watch.saw(f.t_ns, &tracker);
            (f.t_ns, seen)
        });
        if out.send(sighting).is_err() {
            break;
        }
    }
    watch.finish(&tracker)
}

/// A tracker that expects the apparent diameters the rig and the ball sizes imply over the calibrated volume.
fn tracker_for(rig: &Rig, camera: usize, vehicle: &Vehicle) -> Result<Tracker, mavsight_vision::VisionError> {
    let seen_by = &rig.cameras[camera];
    let focal_px = (seen_by.camera.intrinsics.fx_px * seen_by.camera.intrinsics.fy_px).abs().sqrt();
    let ranges_m = rig
        .control_points_in_world()
        .into_iter()
        .map(|p: Vector3<f64>| (p - seen_by.camera.centre_in_world()).norm());
    let (near_m, far_m) = ranges_m.fold((f64::MAX, 0.0_f64), |(a, b), d| (a.min(d), b.max(d)));
    let (near_m, far_m) = if far_m > 0.0 { (near_m, far_m) } else { (1.0, 10.0) };
    let smallest_m = vehicle.marker.iter().map(|m| m.diameter_m).fold(f64::MAX, f64::min);
    let largest_m = vehicle.marker.iter().map(|m| m.diameter_m).fold(0.0, f64::max);
    let range = focal_px * smallest_m / far_m / RANGE_MARGIN..=focal_px * largest_m / near_m * RANGE_MARGIN;
    let colors = MarkerColors::of(vehicle);
    Ok(Tracker::new(&colors.balls, range)?.with_markers(&colors.counts()).with_camera(seen_by.camera))
}

fn join(
    names: &[String],
    sightings: &[Receiver<Sighting>],
    rig: &Rig,
    vehicle: &Vehicle,
    progress: &dyn Progress,
) -> Result<(Reconstruction, Identities), PipelineError> {
    let mut all = Reconstruction::new(rig, vehicle);
    let mut identities = Identities::new(rig, vehicle)?;
    let mut interval_ns: Option<i64> = None;
    loop {
        let instant: Vec<Option<Seen>> =
            sightings.iter().map(|s| s.recv().ok().transpose()).collect::<Result<_, _>>()?;
        if instant.iter().all(Option::is_none) {
            break;
        }
        let frame = all.tracked.poses.len();
        let instant = whole_instant(names, instant, sightings, frame)?;
        check_in_step(names, &instant, frame, interval_ns)?;
        let t_ns = instant[0].0;
        if let Some(last) = all.tracked.poses.last() {
            interval_ns = Some(t_ns - last.t_ns);
        }
        identities.add(t_ns, instant.iter().map(|(_, seen)| seen.as_slice()), &mut all.tracked);
        progress.step();
    }
    if all.tracked.poses.is_empty() {
        return Err(PipelineError::NoFrames { camera: names.join(" and ") });
    }
    Ok((all, identities))
}

/// All cameras' sightings of one instant; a camera that has ended before the others is an error with both counts.
fn whole_instant(
    names: &[String],
    instant: Vec<Option<Seen>>,
    sightings: &[Receiver<Sighting>],
    frame: usize,
) -> Result<Vec<Seen>, PipelineError> {
    if let Some(ended) = instant.iter().position(Option::is_none) {
        let longer = instant.iter().position(Option::is_some).unwrap_or(ended);
        let mut longer_frames = frame + 1;
        for sighting in &sightings[longer] {
            sighting?;
            longer_frames += 1;
        }
        if frame == 0 {
            return Err(PipelineError::NoFrames { camera: names[ended].clone() });
        }
        return Err(PipelineError::FrameCounts {
            first: names[ended].clone(),
            first_frames: frame,
            second: names[longer].clone(),
            second_frames: longer_frames,
        });
    }
    Ok(instant.into_iter().flatten().collect())
}

fn check_in_step(
    names: &[String],
    instant: &[Seen],
    frame: usize,
    interval_ns: Option<i64>,
) -> Result<(), PipelineError> {
    let Some(interval_ns) = interval_ns else { return Ok(()) };
    let reference_ns = instant[0].0;
    for (camera, (t_ns, _)) in instant.iter().enumerate() {
        if (t_ns - reference_ns).abs() * 2 > interval_ns {
            return Err(PipelineError::OutOfStep {
                frame,
                first: names[0].clone(),
                first_s: reference_ns as f64 * 1e-9,
                second: names[camera].clone(),
                second_s: *t_ns as f64 * 1e-9,
            });
        }
    }
    Ok(())
}

pub(crate) fn pose_at(
    estimator: &PoseEstimator,
    t_ns: i64,
    seen: &[MarkerObservation],
    previous: Option<&Isometry3<f64>>,
) -> PoseSample {
    match estimator.estimate(t_ns, seen, previous) {
        Ok(estimate) => PoseSample { t_ns, estimate: Some(estimate), reason: None },
        Err(refusal) => PoseSample { t_ns, estimate: None, reason: Some(refusal.to_string()) },
    }
}

/// The vehicle's markers as the pose estimator wants them.
pub(crate) fn body_markers_of(vehicle: &Vehicle) -> Vec<BodyMarker> {
    vehicle
        .marker
        .iter()
        .map(|m| BodyMarker {
            name: m.name.clone(),
            marker_in_body_m: m.position_m.into(),
            radius_m: m.diameter_m / 2.0,
        })
        .collect()
}
