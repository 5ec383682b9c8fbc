//! Flying: the virtual room, its recording, and what is left of that after a kill.

mod common;
#[path = "common/survivors.rs"]
mod survivors;

use common::{Session, mavsight};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn objects(text: &str) -> Vec<Value> {
    // The last line of a log that was cut may be no object.
    text.lines().filter_map(|l| serde_json::from_str(l).ok()).collect()
}

/// What was said of each instant's pose, by its time in nanoseconds.
fn poses(events: &[Value]) -> BTreeMap<i64, [Value; 4]> {
    let of = |e: &Value| {
        let t_ns = (e["t_s"].as_f64()? * 1e9).round() as i64;
        Some((t_ns, ["valid", "position_m", "attitude", "covariance"].map(|k| e[k].clone())))
    };
    events.iter().filter(|e| e["event"] == "pose").filter_map(of).collect()
}

fn replayed(session: &Path) -> Vec<Value> {
    let run = mavsight().arg("live").arg(session).args(["--replay", "--fast", "--json"]).assert().success();
    objects(&String::from_utf8_lossy(&run.get_output().stdout))
}

/// Killed at some moment, the recording is a session that gives the poses that were sent, bit for bit, and
/// that batch runs take.
#[test]
fn a_recording_that_was_killed_gives_the_poses_that_were_sent() {
    let dir = tempfile::TempDir::new().expect("a folder");
    let folder = dir.path().join("flight");
    let mut flight = Command::new(env!("CARGO_BIN_EXE_mavsight"))
        .args(["live", "--virtual", "--fast", "--for", "600", "--rate", "30", "--record"])
        .arg(&folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("a flight");
    let began = Instant::now();
    let log = folder.join("sent.ndjson");
    let lines = || std::fs::read_to_string(&log).map_or(0, |t| t.lines().count());
    while lines() < 40 {
        assert!(began.elapsed() < Duration::from_secs(300), "the flight does not begin");
        std::thread::sleep(Duration::from_millis(50));
    }
    // Some moment: the low digits of the clock.
    std::thread::sleep(Duration::from_micros(u64::from(began.elapsed().subsec_nanos() % 700_000)));
    flight.kill().expect("killed");
    flight.wait().expect("ended");
    let sent = poses(&objects(&std::fs::read_to_string(&log).expect("a log")));
    let session = folder.join("session.toml");
    let again = poses(&replayed(&session));
    assert!(
        sent.len() >= 20 && again.len() + 3 >= sent.len(),
        "{} sent, {} replayed",
        sent.len(),
        again.len()
    );
    assert!(sent.values().filter(|p| p[0] == true).count() >= 15);
    // The last frames of one camera may be lost, not those before them.
    let last = again.keys().rev().nth(2).copied().unwrap_or_default();
    let mut same = 0;
    for (t_ns, pose) in sent.range(..last) {
        assert_eq!(again.get(t_ns), Some(pose), "at {t_ns} ns");
        same += 1;
    }
    assert!(same >= 15, "{same} instants compared");
    let out = dir.path().join("batch");
    mavsight()
        .arg("run")
        .arg(&session)
        .arg("--equation-error-only")
        .arg("--out")
        .arg(&out)
        .assert()
        .success();
    assert!(std::fs::read_to_string(out.join("pose.csv")).expect("poses").lines().count() + 3 >= sent.len());
}

#[test]
fn what_was_announced_as_recorded_survives_kills() {
    let program = Path::new(env!("CARGO_BIN_EXE_mavsight"));
    let mut instants = 0;
    for milliseconds in [700, 1500, 2600] {
        let dir = tempfile::TempDir::new().expect("a folder");
        let folder = dir.path().join("flight");
        let flight = survivors::flight(program, &folder, None);
        let after = Some(Duration::from_millis(milliseconds));
        instants += survivors::survive(flight, program, &folder, after).expect("whole").instants;
    }
    assert!(instants >= 10, "{instants} instants were announced");
}

#[cfg(unix)]
#[test]
fn what_was_announced_as_recorded_is_whole_where_the_disk_ends() {
    let program = Path::new(env!("CARGO_BIN_EXE_mavsight"));
    let dir = tempfile::TempDir::new().expect("a folder");
    let folder = dir.path().join("flight");
    let flight = survivors::flight(program, &folder, Some(32768));
    let survived = survivors::survive(flight, program, &folder, None).expect("whole");
    assert!(survived.instants >= 5 && survived.fault.is_some(), "{survived:?}");
}

#[test]
fn a_session_is_replayed_with_events_and_figures() {
    let session = Session::new();
    let events = replayed(&session.path("session.toml"));
    assert_eq!(events[0]["event"], "scene");
    assert_eq!(events[0]["cameras"].as_array().map(Vec::len), Some(2));
    let poses = poses(&events);
    assert_eq!(poses.len(), 12);
    assert!(poses.values().filter(|p| p[0] == true).count() >= 11);
    assert!(
        events
            .iter()
            .any(|e| e["event"] == "camera" && e["markers"].as_array().is_some_and(|m| m.len() == 4))
    );
    let seen = events.iter().rfind(|e| e["event"] == "detections").expect("detections");
    assert!(seen["seen"].as_array().expect("balls").iter().all(|b| b["residual_px"].is_array()));
    // At its own pace, with a pose for each frame.
    let out = session.path("live");
    let run = mavsight()
        .arg("live")
        .arg(session.path("session.toml"))
        .args(["--replay", "--out"])
        .arg(&out)
        .assert()
        .success();
    assert!(String::from_utf8_lossy(&run.get_output().stdout).contains("instants"));
    let figures: Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("live.json")).expect("figures"))
            .expect("an object");
    assert!(figures["measured"].as_u64().is_some_and(|n| n >= 1), "{figures}");
}

#[test]
fn wrong_calls_are_refused_with_a_remedy() {
    let session = Session::new();
    let refused = |args: &[&str]| {
        let run = mavsight().arg("live").args(args).current_dir(session.path("")).assert().code(2);
        String::from_utf8_lossy(&run.get_output().stderr).into_owned()
    };
    assert!(refused(&["session.toml"]).contains("has no `live`"));
    assert!(refused(&["session.toml", "--fast"]).contains("--replay or --virtual"));
    assert!(refused(&["session.toml", "--replay", "--for", "-1"]).contains("above zero"));
    assert!(refused(&["session.toml", "--virtual"]).contains("cannot be used with"));
    assert!(refused(&["--virtual", "--rate", "0"]).contains("frames a second"));
    assert!(refused(&["session.toml", "--replay", "--rate", "30"]).contains("cannot be used with"));
    refused(&[]);
}
