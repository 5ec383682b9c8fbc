//! What is said of a camera that fails, and that nothing wrong is sent meanwhile.

use crate::cameras::{Fate, Observed, STEP_NS, flown, noted};
use crate::common::{film, pose, rig};
use mavsight_link::CameraState;

/// Components of the poses over their standard deviations: the largest.
fn largest_ratio(flown: &Observed) -> f64 {
    let ratios = flown.poses.iter().flat_map(|(t_s, measured)| {
        let (truth, found) = (pose(*t_s), measured.world_from_body);
        let shift = found.translation.vector - truth.translation.vector;
        let turn = (found.rotation.inverse() * truth.rotation).scaled_axis();
        let parts: Vec<f64> = shift.iter().chain(turn.iter()).copied().collect();
        let over = |(k, error): (usize, f64)| error.abs() / measured.covariance[(k, k)].sqrt();
        parts.into_iter().enumerate().map(over).collect::<Vec<_>>()
    });
    ratios.fold(0.0, f64::max)
}

#[test]
fn an_image_that_comes_over_and_over_is_no_cable() {
    let second = |k: u32| if (15..24).contains(&k) { Fate::Shows(14) } else { Fate::Films };
    let flown = flown(32, [|_| Fate::Films, second]);
    let stalled = flown.states.iter().find(|s| s.2 == CameraState::Stalled).expect("a word of it");
    let reason = stalled.3.as_deref().expect("a reason");
    assert!(stalled.1 == 1 && reason.contains("one image comes over and over"), "{stalled:?}");
    assert!(!reason.contains("cable") && stalled.0 < 1.85, "{stalled:?}");
}

/// Its images differ in noise alone: it was said to be moved, and poses were by where the aircraft had been.
#[test]
fn a_camera_whose_balls_stand_still_while_the_aircraft_flies_on_is_frozen() {
    let second = |k: u32| if (15..24).contains(&k) { Fate::Stands(14) } else { Fate::Films };
    // It has to fit for thirty instants.
    let flown = flown(62, [|_| Fate::Films, second]);
    let frozen = flown.states.iter().find(|s| s.2 == CameraState::Frozen).expect("a word of it");
    assert!(frozen.1 == 1 && (1.5..1.85).contains(&frozen.0), "{frozen:?}");
    assert!(flown.states.iter().all(|s| s.2 != CameraState::Moved), "{:?}", flown.states);
    assert!(largest_ratio(&flown) < 6.0, "{}", largest_ratio(&flown));
    let last = flown.states.iter().rfind(|s| s.1 == 1 && s.0 < 6.0).expect("a state");
    assert!(last.2 == CameraState::Running, "{:?}", flown.states);
}

#[test]
fn frames_that_are_missing_twice_or_out_of_order_are_no_clock_that_was_set() {
    let frames = || film(&rig(), 20, 30.0).swap_remove(1);
    let mut missing = frames();
    missing.remove(12);
    let said = noted(missing, None);
    let is_missing =
        |text: &str| text.starts_with("cam2: a frame did not come in its turn") && !text.contains("  ");
    assert!(said.len() == 1 && is_missing(&said[0]), "{said:?}");
    let mut out_of_order = frames();
    out_of_order.swap(10, 11);
    let said = noted(out_of_order, None);
    let is_late = |text: &str| text.starts_with("cam2: frames come out of order");
    assert!(said.len() == 2 && is_missing(&said[0]) && is_late(&said[1]), "{said:?}");
    let mut twice = frames();
    for k in [8, 12] {
        twice.insert(k, twice[k].clone());
    }
    let said = noted(twice, None);
    assert!(said.len() == 1 && said[0].starts_with("cam2: frames come twice"), "{said:?}");
}

/// Ahead and back by more than half an interval, while the other camera goes on.
#[test]
fn while_a_clock_is_set_its_camera_gives_no_pose_and_then_it_does() {
    const BACK_NS: i64 = -5 * STEP_NS / 2;
    let ahead = |k: u32| if (15..22).contains(&k) { Fate::Off(7 * STEP_NS / 4) } else { Fate::Films };
    let back = |k: u32| if (15..22).contains(&k) { Fate::Off(BACK_NS) } else { Fate::Films };
    for (second, words) in [(ahead as fn(u32) -> Fate, "went ahead"), (back, "went back")] {
        let flown = flown(36, [|_| Fate::Films, second]);
        let (t_s, text) = flown.notes.first().expect("a word of it");
        assert!(text.starts_with("cam2") && text.contains(words) && (1.5..1.7).contains(t_s), "{text}");
        assert!(largest_ratio(&flown) < 6.0, "{words}: {}", largest_ratio(&flown));
        let stalled = flown.states.iter().find(|s| s.2 == CameraState::Stalled).expect("a state");
        assert!(stalled.1 == 1 && stalled.3.as_ref().is_some_and(|r| r.contains("clock")), "{stalled:?}");
        assert!(flown.states.iter().all(|s| s.2 != CameraState::Moved), "{:?}", flown.states);
        // Each instant of the other camera has its pose, and at the end both give it again.
        assert!(flown.instants.iter().all(|i| i.1 || i.0 < 0.1), "{:?}", flown.instants);
        let markers =
            |t_s: f64| flown.poses.iter().find(|p| (p.0 - t_s).abs() < 0.01).map(|p| p.1.residual_px);
        assert!(markers(3.0).is_some() && flown.instants.len() >= 33, "{}", flown.instants.len());
        let last = flown.states.iter().rfind(|s| s.1 == 1 && s.0 < 3.4).expect("a state");
        assert!(last.2 == CameraState::Running, "{:?}", flown.states);
    }
}

#[test]
fn a_camera_that_sees_no_ball_is_reported_within_two_frames() {
    let second = |k: u32| if (15..24).contains(&k) { Fate::Empty } else { Fate::Films };
    let flown = flown(30, [|_| Fate::Films, second]);
    let said: Vec<_> = flown.notes.iter().filter(|n| n.1.contains("none of the balls")).collect();
    assert!(said.len() == 1 && said[0].1.starts_with("cam2"), "{:?}", flown.notes);
    assert!((1.6..1.75).contains(&said[0].0), "{said:?}");
}
