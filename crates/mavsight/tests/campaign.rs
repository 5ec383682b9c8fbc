//! `mavsight campaign` from the outside.

mod common;

use common::mavsight;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const CAMPAIGN: &str = r#"
schema = 1
seed = 3
flights = 200

[[rig]]
name = "right angle"
room = "room.toml"
camera = [
    { type = "camcorder", centre_m = [4.5, -4.5, 1.5] },
    { type = "camcorder", centre_m = [-4.5, -4.5, 1.5] },
]

[[noise]]
name = "fine"
centre_std_px = 0.05
centre_bias_px = 0.0

[[noise]]
name = "coarse"
centre_std_px = 0.2
centre_bias_px = 0.0

[[manoeuvre]]
name = "doublet"
scenario = "doublet.toml"
"#;

const DOUBLET: &str = include_str!("../../score/tests/doublet.toml");

fn written(folder: &Path) -> std::path::PathBuf {
    mavsight().args(["plan", "cameras", "--example"]).arg(folder).assert().success();
    std::fs::write(folder.join("doublet.toml"), DOUBLET).expect("written");
    let file = folder.join("campaign.toml");
    std::fs::write(&file, CAMPAIGN).expect("written");
    file
}

fn flown(file: &Path, out: &Path, more: &[&str]) -> (String, String) {
    let ran =
        mavsight().arg("campaign").arg(file).arg("--out").arg(out).args(more).output().expect("the program");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let table = std::fs::read_to_string(out.join("flights.csv")).expect("a table");
    (table, String::from_utf8_lossy(&ran.stdout).into_owned())
}

/// Killed ten times at various moments and resumed, by another number of threads: the table of an
/// uninterrupted campaign.
#[test]
fn a_killed_campaign_ends_with_the_same_table() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = written(folder.path());
    let (whole, printed) = flown(&file, &folder.path().join("whole"), &[]);
    assert!(printed.contains("400 flights") && printed.contains("ratio"), "{printed}");
    let out = folder.path().join("killed");
    let mut sizes = vec![0];
    for k in 0..10_u64 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_mavsight"))
            .arg("campaign")
            .arg(&file)
            .arg("--out")
            .arg(&out)
            .args(["--threads", "2"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program");
        // At once, after some milliseconds, and whenever so much more has been written.
        let enough = sizes[sizes.len() - 1] + 1 + 3001 * (7 * k % 4);
        let written = || std::fs::metadata(out.join("flights.part")).map_or(0, |m| m.len());
        let patience = if k < 2 { 17 * k } else { 20_000 };
        let begin = std::time::Instant::now();
        while begin.elapsed() < Duration::from_millis(patience) && written() < enough {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().expect("killed");
        child.wait().expect("ended");
        sizes.push(std::fs::metadata(out.join("flights.part")).map_or(0, |m| m.len()));
    }
    assert!(
        sizes.windows(2).filter(|w| w[1] > w[0]).count() >= 3,
        "kills came too early or too late: {sizes:?}"
    );
    let (resumed, _) = flown(&file, &out, &["--threads", "1"]);
    assert!(resumed == whole, "the tables differ; sizes after each kill {sizes:?}");
    let rows: Vec<&str> = whole.lines().collect();
    let width = rows[0].split(',').count();
    assert!(rows.len() > 400 * 10 && rows.iter().all(|r| r.split(',').count() == width));
}

/// Four times the noise, four times the scatter; and predictions that hold, in a campaign of 200 flights of
/// each.
#[test]
fn predictions_hold_and_another_campaign_is_not_mixed_in() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = written(folder.path());
    let out = folder.path().join("out");
    flown(&file, &out, &[]);
    let summary = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    let cells = summary["cells"].as_array().expect("cells");
    let of = |noise: &str, parameter: &str| {
        let found =
            cells.iter().find(|c| c["cell"][1] == noise && c["parameter"] == parameter).expect("a cell");
        ["predicted_std", "achieved_std"].map(|k| found[k].as_f64().expect("a number"))
    };
    // Offsets of forces and moments are what an error of the cameras looks like.
    for parameter in ["C_m,alpha_u", "C_m,alpha_l", "C_m,q", "C_X,alpha_l", "C_X,0", "C_l,0"] {
        let (fine, coarse) = (of("fine", parameter), of("coarse", parameter));
        assert!((coarse[0] / fine[0] - 4.0).abs() < 0.01, "{parameter}: {fine:?} {coarse:?}");
        assert!((0.85..1.15).contains(&(fine[0] / fine[1])), "{parameter}: {fine:?}");
    }
    let other = CAMPAIGN.replace("seed = 3", "seed = 4");
    std::fs::write(&file, other).expect("written");
    let ran = mavsight().arg("campaign").arg(&file).arg("--out").arg(&out).output().expect("the program");
    assert_eq!(ran.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&ran.stderr).contains("another campaign"));
}

#[test]
fn campaigns_that_make_no_sense_are_wrong_calls() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = written(folder.path());
    for (from, to, word) in [
        ("flights = 200", "flights = 0", "flights"),
        ("schema = 1", "schema = 2", "schema"),
        ("type = \"camcorder\", centre_m = [4.5", "type = \"phone\", centre_m = [4.5", "phone"),
        ("doublet.toml", "none.toml", "none.toml"),
        ("name = \"fine\"", "nam = \"fine\"", "nam"),
        ("name = \"fine\"", "name = \"fine, by day\"", "commas"),
        ("[[noise]]", "[[noise]]\nname = \"fine\"\n\n[[noise]]", "twice"),
    ] {
        std::fs::write(&file, CAMPAIGN.replace(from, to)).expect("written");
        let ran = mavsight().arg("campaign").arg(&file).arg("--out").arg(folder.path()).output();
        let ran = ran.expect("the program");
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert_eq!(ran.status.code(), Some(2), "{said}");
        assert!(said.contains(word), "{said}");
    }
}
