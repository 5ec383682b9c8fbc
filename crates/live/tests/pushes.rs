//! A camera that is pushed so little that the aircraft may have moved as much.

#[allow(dead_code)]
#[path = "flights/common.rs"]
mod common;
#[path = "flights/detections.rs"]
mod detections;

use common::{pose, rig};
use detections::detections;
use mavsight_flight::Vehicle;
use mavsight_geometry::{Isometry3, Vector2};
use mavsight_live::LivePipeline;
use mavsight_pose::PoseError;
use nalgebra::Translation3;

const RATE_HZ: f64 = 30.0;
const PUSHED_AT: i64 = 90;

/// An instant of a flight: which cameras are left out, and how far the pose is from the truth, or why there is none.
struct Flown {
    moved: Vec<usize>,
    away_m: Result<f64, PoseError>,
}

/// A flight along poses, in which images of cameras are shifted; the second camera's arrive first or last.
fn flown(
    at: impl Fn(i64) -> Isometry3<f64>,
    shift_px: impl Fn(usize, i64) -> Vector2<f64>,
    is_first: bool,
) -> Vec<Flown> {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let mut pipeline = LivePipeline::new(&rig, &vehicle, &[]).expect("a pipeline");
    let mut out = Vec::new();
    for k in 0..240 {
        let stamp_ns = (k as f64 / RATE_HZ * 1e9) as i64;
        for camera in if is_first { [1, 0] } else { [0, 1] } {
            let mut seen = detections((&rig, &vehicle), camera, stamp_ns, &at(k));
            seen.iter_mut().for_each(|ball| ball.pixel += shift_px(camera, k));
            pipeline.push(camera, stamp_ns, &seen);
        }
        while let Some(instant) = pipeline.next_instant() {
            let index = (instant.t_ns as f64 * 1e-9 * RATE_HZ).round() as i64;
            let place = |e: &mavsight_pose::PoseEstimate| e.world_from_body.translation.vector;
            let estimate = instant.association.sample.estimate.as_ref();
            let away_m =
                estimate.map(|e| (place(e) - at(index).translation.vector).norm()).map_err(Clone::clone);
            out.push(Flown { moved: instant.moved.iter().map(|m| m.camera).collect(), away_m });
        }
    }
    out
}

/// One camera, pushed once.
fn pushed(camera: usize, at: i64, by_px: Vector2<f64>) -> impl Fn(usize, i64) -> Vector2<f64> {
    move |own, k| if own == camera && k >= at { by_px } else { Vector2::zeros() }
}

fn carried(k: i64) -> Isometry3<f64> {
    pose(k as f64 / RATE_HZ)
}

/// What looked like less than 45 mm of motion passed for it to the end, and poses were as far off.
#[test]
fn a_push_that_looks_like_motion_is_found_within_ten_frames() {
    for by_px in [Vector2::new(1.0, 0.0), Vector2::new(-6.0, 0.0), Vector2::new(3.0, 0.2)] {
        let [flight, other] =
            [true, false].map(|is_first| flown(carried, pushed(1, PUSHED_AT, by_px), is_first));
        let outs = |flight: &[Flown]| flight.iter().position(|f| !f.moved.is_empty());
        let found = outs(&flight).unwrap_or(usize::MAX);
        assert!((90..100).contains(&found), "{by_px}: {found}");
        assert_eq!(outs(&other), Some(found), "whichever image arrives first");
        assert!(flight[found..].iter().all(|f| f.moved == [1]), "{by_px}");
        let away_m =
            flight[found + 2..].iter().map(|f| f.away_m.as_ref().expect("one camera sees four balls"));
        let (count, squares) = away_m.fold((0, 0.0), |(n, sum), away_m| (n + 1, sum + away_m * away_m));
        let rms_m = (squares / f64::from(count)).sqrt();
        assert!(rms_m < 5e-3, "{by_px}: {rms_m}");
    }
}

#[test]
fn an_aircraft_that_is_struck_or_turns_hard_is_no_push() {
    let none = |_, _| Vector2::zeros();
    let struck = |k: i64| Translation3::new(if k >= PUSHED_AT { 0.02 } else { 0.0 }, 0.0, 0.0) * carried(k);
    // 3 g within two frames, half a second later as much the other way.
    let hard = |k: i64| {
        let along_m =
            |t_s: f64| 0.5 * 29.4 * t_s.clamp(0.0, 0.067).powi(2) + 29.4 * 0.067 * (t_s - 0.067).max(0.0);
        let t_s = (k - PUSHED_AT) as f64 / RATE_HZ;
        Translation3::new(along_m(t_s) - along_m(t_s - 0.1), 0.0, 0.0) * carried(k)
    };
    for flight in [flown(carried, none, false), flown(struck, none, false), flown(hard, none, true)] {
        assert!(flight.len() > 200 && flight.iter().all(|f| f.moved.is_empty()));
    }
}

/// "0 of 4 markers seen" was the reason, though both cameras saw them all.
#[test]
fn cameras_that_are_all_left_out_are_the_reason() {
    let one = pushed(1, PUSHED_AT, Vector2::new(3.0, 0.0));
    let other = pushed(0, PUSHED_AT + 60, Vector2::new(-30.0, 0.0));
    let flight = flown(carried, |camera, k| one(camera, k) + other(camera, k), false);
    let last = flight.last().expect("instants");
    assert_eq!((last.moved.len(), &last.away_m), (2, &Err(PoseError::AllLeftOut { cameras: 2 })));
}
