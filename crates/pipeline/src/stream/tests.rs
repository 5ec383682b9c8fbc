//! What a camera's frames and their faults are noted as.

use super::*;
use crate::Cause;
use mavsight_pose::CameraClock;

fn stream(stamps: &[(f64, u8)]) -> Stream {
    let mut stream = Stream::new(1, "cam2".into(), ClockPrior::known(CameraClock::default()), Vector2::y());
    let mut last = None;
    for (k, shade) in stamps {
        let stamp_ns = (k / 30.0 * 1e9).round() as i64;
        match last {
            Some((last_ns, _)) if stamp_ns <= last_ns => stream.add_backward(stamp_ns),
            Some((_, before)) if before == *shade => stream.add_copy(stamp_ns),
            _ => {
                stream.add(stamp_ns, &[], None);
                last = Some((stamp_ns, *shade));
            }
        }
    }
    stream
}

#[test]
fn stored_detections_come_out_frame_by_frame_and_take_forty_bytes() {
    let seen = |stamp_ns: i64, count: usize| -> Vec<TrackedDetection> {
        let one = |k: usize| TrackedDetection {
            t_ns: stamp_ns,
            camera: 0,
            track_id: k as u32,
            color: k % 3,
            pixel: Vector2::new(stamp_ns as f64 / 3.0, k as f64 / 7.0),
            covariance_px2: Matrix2::new(0.5, 0.125, 0.125, 0.25),
            diameter_px: 6.5,
            is_static: k == 1,
            is_preferred: k != 1,
        };
        (0..count).map(one).collect()
    };
    let mut stream = Stream::new(0, "cam1".into(), ClockPrior::known(CameraClock::default()), Vector2::y());
    let frames = [(10, seen(10, 2)), (20, vec![]), (30, seen(30, 3))];
    frames.iter().for_each(|(stamp_ns, own)| stream.add(*stamp_ns, own, None));
    let all: Vec<TrackedDetection> = frames.iter().flat_map(|f| f.1.clone()).collect();
    assert_eq!(stream.detections().collect::<Vec<_>>(), all);
    let mut out = stream.into_frames();
    for (stamp_ns, own) in &frames {
        assert_eq!(out.peek(), Some(*stamp_ns));
        assert_eq!(out.next(), Some((*stamp_ns, own.as_slice())));
    }
    assert_eq!(out.next(), None);
    assert_eq!((out.peek(), size_of::<StoredDetection>()), (None, 40));
}

#[test]
fn whole_recordings_have_no_notes() {
    let whole: Vec<(f64, u8)> = (0..20).map(|k| (f64::from(k), k)).collect();
    let stream = stream(&whole);
    assert_eq!(stream.notes(), Vec::<String>::new());
    assert!((stream.interval_s() - 1.0 / 30.0).abs() < 1e-9);
}

#[test]
fn copied_backward_and_missing_frames_are_noted_with_camera_and_time() {
    let copied = stream(&[(0.0, 0), (1.0, 1), (2.0, 1), (3.0, 3), (4.0, 4)]);
    assert_eq!(copied.stamps_ns.len(), 4);
    let [note] = &copied.notes()[..] else { panic!("{:?}", copied.notes()) };
    assert!(note.contains("cam2: 1 frame(s) repeat") && note.contains("0.067 s"), "{note}");
    let backward = stream(&[(0.0, 0), (1.0, 1), (0.5, 2), (2.0, 3)]);
    let [note] = &backward.notes()[..] else { panic!("{:?}", backward.notes()) };
    assert!(note.contains("cam2: 1 frame(s) with a time stamp") && note.contains("0.017 s"), "{note}");
    let missing = stream(&[(0.0, 0), (1.0, 1), (2.0, 2), (5.0, 3), (6.0, 4), (8.0, 5), (9.0, 6)]);
    let [note] = &missing.notes()[..] else { panic!("{:?}", missing.notes()) };
    assert!(note.contains("cam2: 3 frame(s) are missing in 2 places, the first after 0.067 s (2"), "{note}");
}

/// A ramp of slow motion was "270 frame(s) are missing in 90 places", and its speeds were believed.
#[test]
fn frames_that_come_more_slowly_for_a_while_are_not_missing() {
    let ramp = |k: u8| {
        if k < 40 { f64::from(k) } else { 39.0 + 4.0 * f64::from(k.min(60) - 39) + f64::from(k.max(60) - 60) }
    };
    let stamps: Vec<(f64, u8)> = (0..100).map(|k| (ramp(k), k)).collect();
    let [note] = &stream(&stamps).notes()[..] else { panic!("{:?}", stream(&stamps).notes()) };
    assert!(note.contains("from 1.300 to 4.100 s its frames are 4.0 times as far apart"), "{note}");
}

#[test]
fn a_long_run_of_copies_is_a_frozen_camera_and_not_a_converters() {
    let shades = |k: u8| match k {
        6..=12 => 5,
        15 => 14,
        _ => k,
    };
    let frozen = stream(&(0..20).map(|k| (f64::from(k), shades(k))).collect::<Vec<_>>());
    let found = frozen.frozen().expect("seven copies in a row");
    assert_eq!((found.cause(), found.camera), (Some(Cause::CameraFrozen), Some(1)));
    assert!(found.note.contains("0.200 s to 0.400 s") && found.note.contains("7 frame(s)"), "{}", found.note);
    let [note] = &frozen.notes()[..] else { panic!("{:?}", frozen.notes()) };
    assert!(note.contains("1 frame(s) repeat"), "{note}");
    let doubled = stream(&(0..40).map(|k| (f64::from(k), k / 2)).collect::<Vec<_>>());
    assert_eq!(doubled.frozen(), None);
}

#[test]
fn an_error_before_the_first_frame_ends_all_and_one_after_it_is_noted() {
    let mut empty = stream(&[]);
    let error = || PipelineError::NoFrames { camera: "cam2".into() };
    assert!(empty.add_fault(error()).is_err());
    let mut some = stream(&[(0.0, 0), (1.0, 1)]);
    (0..5).for_each(|_| some.add_fault(error()).unwrap());
    let notes = some.notes();
    assert!(notes.len() == 4 && notes[0].contains("cam2, after 0.033 s: "), "{notes:?}");
    assert!(notes[3].contains("2 more"), "{notes:?}");
}
