//! The stages one by one give what the whole run gives.

mod common;

use common::{Session, mavsight};

#[test]
fn the_chain_in_steps_is_the_chain_in_one() {
    let session = Session::new();
    let (whole, steps) = (session.path("whole"), session.path("steps"));
    let file = session.path("session.toml");
    mavsight().arg("run").arg(&file).arg("--out").arg(&whole).assert().success();
    mavsight().arg("calibrate").arg(&file).arg("--out").arg(&steps).assert().success();
    mavsight().arg("track").arg(&file).arg("--out").arg(&steps).assert().success();
    mavsight()
        .arg("identify")
        .arg(steps.join("pose.csv"))
        .args(["--inputs".as_ref(), session.path("inputs.csv").as_os_str()])
        .args(["--vehicle".as_ref(), session.path("vehicle.toml").as_os_str()])
        .arg("--out")
        .arg(&steps)
        .assert()
        .success();
    mavsight().arg("report").arg(&file).arg("--out").arg(&steps).assert().success();
    let read =
        |folder: &std::path::Path, name: &str| std::fs::read_to_string(folder.join(name)).expect("a table");
    assert!(read(&whole, "markers.csv") == read(&steps, "markers.csv"), "markers.csv differs");
    // Between the steps the rig has passed through a file of finite digits.
    let (one, other) = (read(&whole, "pose.csv"), read(&steps, "pose.csv"));
    assert_eq!(one.lines().count(), other.lines().count());
    for (a, b) in one.lines().zip(other.lines()).skip(1) {
        for (x, y) in a.split(',').zip(b.split(',')).take(7) {
            let (x, y): (f64, f64) = (x.parse().expect("a number"), y.parse().expect("a number"));
            assert!((x - y).abs() < 1e-6, "{a}\n{b}");
        }
    }
    // The noise is read back exactly, so that the smoother does the same; what errors that stay add to the standard
    // deviations is approximated, and stands apart in every second column.
    let (one, other) = (read(&whole, "motion.csv"), read(&steps, "motion.csv"));
    assert_eq!(one.lines().count(), other.lines().count());
    for (a, b) in one.lines().zip(other.lines()).skip(1) {
        for (k, (x, y)) in a.split(',').zip(b.split(',')).enumerate().filter(|(k, _)| k % 2 == 1) {
            let (x, y): (f64, f64) = (x.parse().expect("a number"), y.parse().expect("a number"));
            // Pose, velocity and rates, then accelerations.
            let close = if k < 25 { 1e-4 } else { 1e-2 };
            assert!((x - y).abs() < close, "column {k}: {a}\n{b}");
        }
    }
    assert!(steps.join("report.html").is_file() && steps.join("motion.csv").is_file());
}

#[test]
fn tracking_without_a_rig_says_which_stage_makes_it() {
    let session = Session::new();
    let assert = mavsight()
        .arg("track")
        .arg(session.path("session.toml"))
        .arg("--out")
        .arg(session.path("empty"))
        .assert()
        .code(2);
    let message = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(message.contains("rig.toml") && message.contains("calibrate"), "{message}");
}
