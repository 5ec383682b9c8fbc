//! `mavsight selftest` from the outside.

mod common;

use common::{Session, mavsight};

#[test]
fn a_self_test_prints_writes_and_judges() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |seed: &str| {
        let ran = mavsight()
            .args(["selftest", "--rig", "paper", "--flights", "8", "--seed", seed, "--out"])
            .arg(folder.path())
            .output()
            .expect("the program");
        let csv = std::fs::read_to_string(folder.path().join("selftest.csv")).expect("a table");
        (ran, csv)
    };
    let (ran, csv) = run("5");
    let printed = String::from_utf8_lossy(&ran.stdout);
    assert!(printed.contains("8 flights") && printed.contains("angular acceleration"), "{printed}");
    let rows: Vec<Vec<&str>> = csv.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), 9);
    assert!(rows.iter().all(|r| r.len() == rows[0].len()));
    let accepted = rows[1..].iter().all(|r| r[r.len() - 1] == "true");
    assert_eq!(ran.status.code(), Some(i32::from(!accepted)), "{printed}");
    let summary = std::fs::read_to_string(folder.path().join("selftest.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(summary["flights"], 8);
    assert_eq!(summary["quantities"].as_array().map(Vec::len), Some(8));
    assert_eq!(run("5").1, csv, "the same seed gives the same table");
    assert_ne!(run("6").1, csv);
}

#[test]
fn a_session_is_tested_with_its_own_rig() {
    let session = Session::new();
    let ran = mavsight()
        .arg("selftest")
        .arg(session.path("session.toml"))
        .args(["--flights", "2"])
        .output()
        .expect("the program");
    let printed = String::from_utf8_lossy(&ran.stdout);
    assert!(printed.contains("2 flights") && printed.contains("px systematic"), "{printed}");
    assert!(matches!(ran.status.code(), Some(0 | 1)));
}

#[test]
fn wrong_calls_are_refused() {
    let wrong = [
        vec!["selftest"],
        vec!["selftest", "nowhere.toml"],
        vec!["selftest", "--rig", "unknown"],
        vec!["selftest", "--rig", "paper", "session.toml"],
        vec!["selftest", "--rig", "paper", "--flights", "0"],
    ];
    for call in wrong {
        mavsight().args(&call).assert().code(2);
    }
}
