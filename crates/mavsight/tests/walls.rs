//! The walls between crates: what estimates depends on nothing that films, simulates or scores, and cannot
//! name a truth type.

#![allow(clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Crates of which a run on a recorded or running flight consists.
const ESTIMATORS: [&str; 10] =
    ["geometry", "flight", "vision", "pose", "identify", "session", "pipeline", "link", "live", "engine"];

/// Crates that know the truth, or make it.
const TRUTH: [&str; 3] = ["score", "scene", "simulator"];

/// The packages of this workspace, as cargo reads them.
fn packages() -> Vec<serde_json::Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline", "--manifest-path"])
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    all["packages"].as_array().unwrap().clone()
}

/// Dependencies of each crate on others of this workspace, for its library and its build.
fn workspace_dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let own_name = |value: &serde_json::Value| value["name"].as_str().unwrap().replace("mavsight-", "");
    let needs = |package: &serde_json::Value| {
        let all = package["dependencies"].as_array().unwrap().iter();
        all.filter(|d| d["kind"] != "dev" && d["path"].is_string()).map(own_name).collect()
    };
    packages().iter().map(|p| (own_name(p), needs(p))).collect()
}

#[test]
fn each_library_that_is_used_has_its_reason_in_the_documents() {
    let used: BTreeSet<String> = packages()
        .iter()
        .flat_map(|p| p["dependencies"].as_array().unwrap().clone())
        .filter(|d| d["path"].is_null())
        .map(|d| d["name"].as_str().unwrap().to_owned())
        .collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/dependencies.md");
    let text = std::fs::read_to_string(path).unwrap();
    let cells = text.lines().filter(|l| l.starts_with("| `")).filter_map(|l| l.split('|').nth(1));
    let explained: BTreeSet<String> =
        cells.flat_map(|cell| cell.split(',').map(|name| name.trim().trim_matches('`').to_owned())).collect();
    assert_eq!(used, explained);
}

fn reach(all: &BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<String> {
    let mut seen = BTreeSet::new();
    let mut open = vec![from.to_owned()];
    while let Some(next) = open.pop() {
        for need in all.get(&next).into_iter().flatten() {
            if seen.insert(need.clone()) {
                open.push(need.clone());
            }
        }
    }
    seen
}

/// Asserts that none of some crates reaches any of others.
fn assert_apart(from: &[&str], forbidden: &[&str]) {
    let all = workspace_dependencies();
    for name in from {
        assert!(all.contains_key(*name), "{name} is not among {:?}", all.keys());
        let reached = reach(&all, name);
        for other in forbidden {
            assert!(!reached.contains(*other), "{name} reaches {other}");
        }
    }
}

#[test]
fn estimators_reach_neither_the_virtual_room_nor_the_simulator_nor_the_scores_nor_the_report() {
    assert_apart(&ESTIMATORS, &[TRUTH.as_slice(), &["report", "mavsight"]].concat());
}

/// What predicts is used by no estimator: a plan is checked against them, so it may not steer them.
#[test]
fn estimators_do_not_reach_the_plan() {
    assert_apart(&ESTIMATORS, &["plan"]);
}

#[test]
fn a_plan_and_a_scene_reach_no_scores_and_a_scene_reaches_no_estimator() {
    assert_apart(&["plan", "scene"], &["score"]);
    assert_apart(&["scene"], &["vision", "pose", "identify", "pipeline", "engine", "plan"]);
}

/// Whoever wants the pipeline alone gets no readers of files.
#[test]
fn the_pipeline_reaches_no_files() {
    assert_apart(&["flight", "geometry", "vision", "pose", "identify", "pipeline"], &["session", "link"]);
}

/// No request to the page's server leads to the file system: its code does not name it.
#[test]
fn the_page_reaches_no_files() {
    assert_apart(&["page"], &["session"]);
    for (path, code) in sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../page/src")) {
        let found = ["fs::", "std::path", "File::", "OpenOptions", "Command::new"]
            .into_iter()
            .find(|w| code.contains(w));
        assert_eq!(found, None, "{}", path.display());
    }
}

/// Sources of a crate without those of its tests.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name().into_string().unwrap());
        if path.is_dir() && name != "tests" {
            found.extend(sources(&path));
        } else if name.ends_with(".rs") && !["tests.rs", "testing.rs"].contains(&name.as_str()) {
            let text = std::fs::read_to_string(&path).unwrap();
            let until = text.find("#[cfg(test)]\nmod tests").unwrap_or(text.len());
            let code = text[..until].lines().filter(|line| !line.trim_start().starts_with("//"));
            found.push((path, code.collect::<Vec<_>>().join("\n")));
        }
    }
    found
}

/// No estimator can name the truth: neither in its public interface nor anywhere in its code.
#[test]
fn no_estimator_names_a_truth_type_or_the_simulation() {
    let is_forbidden = |word: &&str| {
        word.starts_with("Truth")
            || *word == "Scenario"
            || *word == "simulate"
            || TRUTH.iter().any(|other| *word == format!("mavsight_{other}"))
    };
    for name in ESTIMATORS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name).join("src");
        let all = sources(&folder);
        assert!(!all.is_empty(), "{}", folder.display());
        for (path, code) in all {
            let found = code.split(|c: char| !c.is_alphanumeric() && c != '_').find(is_forbidden);
            assert_eq!(found, None, "{}", path.display());
        }
    }
}
