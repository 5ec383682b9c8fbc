//! `mavsight plan` from the outside.

mod common;

use common::mavsight;

/// The example, on a coarse grid: a table, files, and a session whose only lack is what must be recorded.
#[test]
fn the_papers_room_is_planned() {
    let folder = tempfile::tempdir().expect("a folder");
    let (room, out) = (folder.path().join("room"), folder.path().join("plan"));
    mavsight().args(["plan", "cameras", "--example"]).arg(&room).assert().success();
    let ran = mavsight()
        .args(["plan", "cameras"])
        .arg(room.join("room.toml"))
        .args(["--step", "2.5", "--best", "2", "--study", "--out"])
        .arg(&out)
        .output()
        .expect("the program");
    let printed = String::from_utf8_lossy(&ran.stdout);
    assert_eq!(ran.status.code(), Some(0), "{printed}{}", String::from_utf8_lossy(&ran.stderr));
    assert!(printed.contains("rank") && printed.contains("least error at"), "{printed}");
    let read = |name: &str| std::fs::read_to_string(out.join(name)).expect(name);
    let csv = read("placements.csv");
    let rows: Vec<Vec<&str>> = csv.lines().map(|l| l.split(',').collect()).collect();
    assert!(rows.len() >= 3 && rows.iter().all(|r| r.len() == rows[0].len()), "{csv}");
    let json: serde_json::Value = serde_json::from_str(&read("plan.json")).expect("JSON");
    assert!(
        json["placements"][0]["prediction"]["mean"]["position_std_mm"].as_f64().is_some_and(|mm| mm > 0.0)
    );
    let page = read("plan.html");
    assert!(page.contains("Elevation") && page.contains("cam2") && !page.contains("NaN"));
    let session = mavsight().arg("run").arg(out.join("session/session.toml")).arg("--out").arg(&out).output();
    let said = session.expect("the program");
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("inputs.csv") && said.contains("no such file"), "{said}");
}

#[test]
fn rooms_that_cannot_be_read_are_wrong_calls() {
    let folder = tempfile::tempdir().expect("a folder");
    let room = folder.path().join("room");
    mavsight().args(["plan", "cameras", "--example"]).arg(&room).assert().success();
    let file = room.join("room.toml");
    let good = std::fs::read_to_string(&file).expect("the room");
    let refuse = |text: String, words: &[&str]| {
        std::fs::write(&file, text).expect("written");
        let ran = mavsight().args(["plan", "cameras"]).arg(&file).output().expect("the program");
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert_eq!(ran.status.code(), Some(2), "{said}");
        assert!(words.iter().all(|w| said.contains(w)), "{said}");
    };
    refuse(good.replace("count = 2", "count = 1"), &["room.toml", "camera", "2 to 16"]);
    refuse(good.replace("count = 2", "cuont = 2"), &["room.toml", "line", "cuont"]);
    refuse(good.replace("control_points.csv", "none.csv"), &["none.csv", "no such file"]);
    let ran = mavsight().args(["plan", "cameras", "nowhere.toml"]).output().expect("the program");
    assert_eq!(ran.status.code(), Some(2));
}
