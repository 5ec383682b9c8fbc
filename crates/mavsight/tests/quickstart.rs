//! The example of the facade's documentation, on a filmed flight.

mod common;

#[path = "../examples/quickstart.rs"]
#[allow(dead_code)]
mod example;

#[test]
fn the_quickstart_calibrates_tracks_and_smooths() {
    let session = common::Session::new();
    let results = example::quickstart(&session.path("session.toml")).expect("results");
    assert_eq!(results.rig.expect("cameras").cameras.len(), 2);
    assert!(results.poses.len() == 12 && results.poses.iter().all(|p| p.estimate.is_ok()));
    let x_m = results.motion.expect("a motion").samples[6].world_from_body.translation.x;
    assert!(x_m.abs() < 0.01, "{x_m} m");
    // A hover of 0.4 s has no information on the parameters, and the notes say so.
    assert!(
        results.identification.is_some() || results.notes.iter().any(|n| n.starts_with("No equation error"))
    );
}
