//! The walls between crates: what estimates never depends on what films or scores.

use std::collections::{BTreeMap, BTreeSet};

fn workspace_dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let crates = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(crates).expect("the crates folder").flatten() {
        let Ok(manifest) = std::fs::read_to_string(entry.path().join("Cargo.toml")) else { continue };
        let manifest: toml::Table = manifest.parse().expect("a manifest");
        let name = manifest["package"]["name"].as_str().expect("a name").to_owned();
        let needs = manifest
            .get("dependencies")
            .and_then(toml::Value::as_table)
            .map(|t| t.keys().filter(|k| k.starts_with("mavsight-")).cloned().collect())
            .unwrap_or_default();
        all.insert(name, needs);
    }
    all
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

#[test]
fn estimators_reach_neither_the_virtual_room_nor_the_scores() {
    let all = workspace_dependencies();
    assert!(all.len() >= 10, "crates found: {:?}", all.keys());
    for estimator in
        ["geometry", "flight", "vision", "pose", "identify", "session", "pipeline", "plan", "link", "live"]
    {
        let reached = reach(&all, &format!("mavsight-{estimator}"));
        for forbidden in ["mavsight-scene", "mavsight-score", "mavsight-report"] {
            assert!(!reached.contains(forbidden), "{estimator} reaches {forbidden}");
        }
    }
}

/// No estimator uses predictions or the simulator: both are checked against estimates.
#[test]
fn estimators_reach_neither_the_plan_nor_the_simulator() {
    let all = workspace_dependencies();
    for estimator in
        ["geometry", "flight", "vision", "pose", "identify", "session", "pipeline", "engine", "link", "live"]
    {
        let reached = reach(&all, &format!("mavsight-{estimator}"));
        for forbidden in ["mavsight-plan", "mavsight-simulator"] {
            assert!(!reached.contains(forbidden), "{estimator} reaches {forbidden}");
        }
    }
    let simulator = reach(&all, "mavsight-simulator");
    assert!(simulator.iter().all(|c| c == "mavsight-flight" || c == "mavsight-geometry"), "{simulator:?}");
}

#[test]
fn the_virtual_room_reaches_no_estimator() {
    let reached = reach(&workspace_dependencies(), "mavsight-scene");
    for forbidden in
        ["mavsight-vision", "mavsight-pose", "mavsight-identify", "mavsight-pipeline", "mavsight-plan"]
    {
        assert!(!reached.contains(forbidden), "scene reaches {forbidden}");
    }
}
