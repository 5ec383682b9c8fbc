//! Trouble in the middle of a recording is said, with camera and time, and the rest of the flight is
//! measured.

mod common;

use common::{Session, mavsight};

fn frame(session: &Session, camera: &str, number: usize) -> std::path::PathBuf {
    session.path(&format!("{camera}/frame_{number:05}.png"))
}

/// A frame that is missing, one that repeats the one before, one that is damaged, and a camera that ends
/// early, all in one flight.
#[test]
fn faults_are_noted_and_the_flight_goes_on() {
    let session = Session::new();
    std::fs::remove_file(frame(&session, "cam1", 3)).expect("the frame was there");
    std::fs::copy(frame(&session, "cam2", 5), frame(&session, "cam2", 6)).expect("the frame is copied");
    std::fs::write(frame(&session, "cam1", 8), b"not an image").expect("the frame is spoilt");
    for number in [10, 11] {
        std::fs::remove_file(frame(&session, "cam2", number)).expect("the frame was there");
    }
    let out = session.path("results");
    let mut run = mavsight();
    run.arg("run").arg(session.path("session.toml")).arg("--verbose").arg("--out").arg(&out);
    let assert = run.assert().success();
    let text = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    let summary = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("an object");
    let notes = summary["notes"].to_string();
    let report = std::fs::read_to_string(out.join("report.html")).expect("a report");
    for words in [
        "cam1, after 0.067 s: ",
        "frame_00003.png",
        "cam2: 1 frame(s) repeat the one before and are left out, the first at 0.200 s",
        "cam1, after 0.233 s: ",
        "frame_00008.png",
        "cam2 ends at 0.300 s",
    ] {
        assert!(notes.contains(words), "the notes lack {words:?}: {notes}");
        assert!(text.contains(words), "the terminal lacks {words:?}: {text}");
        assert!(report.contains(words), "the report lacks {words:?}");
    }
    // Seven instants have both cameras; the others have one, whose poses are as good as one camera's are.
    let poses = std::fs::read_to_string(out.join("pose.csv")).expect("a table");
    assert_eq!(poses.lines().count(), 13);
    let truth = std::fs::read_to_string(session.path("truth.csv")).expect("a table");
    let cells = |text: &str, row: usize| -> Vec<Option<f64>> {
        text.lines().nth(row + 1).expect("a row").split(',').map(|c| c.parse().ok()).collect()
    };
    for row in [0, 1, 2, 4, 5, 7, 9] {
        let (got, want) = (cells(&poses, row), cells(&truth, row));
        let square: f64 = (1..4).map(|k| (got[k].expect("a pose") - want[k].expect("a row")).powi(2)).sum();
        assert!(square.sqrt() < 2e-3, "row {row}: {} m", square.sqrt());
    }
}

#[test]
fn clocks_that_make_no_sense_are_refused() {
    let session = Session::new();
    let text = std::fs::read_to_string(session.path("session.toml")).expect("the session is there");
    for (key, words) in [
        ("line_time_s = 0.5", "line_time_s"),
        ("line_time_s = \"soon\"", "line_time_s"),
        ("time_offset_std_s = 0.0", "time_offset_std_s"),
        ("interlaced = \"left-first\"", "left-first"),
    ] {
        let spoilt = text.replacen("name = \"cam2\"", &format!("name = \"cam2\"\n{key}"), 1);
        std::fs::write(session.path("session.toml"), spoilt).expect("the session is written");
        session.is_refused(&["session.toml", words]);
    }
}

/// Five centimetres more are in x of a control ball's place: it is left out. `check` said that all was ready.
#[test]
fn a_control_point_that_is_left_out_is_what_check_asks_to_measure_again() {
    let session = Session::new();
    let mut named = String::new();
    session.edit_lines("control_points.csv", |lines| {
        let cells: Vec<String> = lines[1].split(',').map(str::to_owned).collect();
        let x_m: f64 = cells[1].parse().expect("a number");
        named.clone_from(&cells[0]);
        lines[1] = format!("{},{},{}", cells[0], x_m + 0.05, cells[2..].join(","));
    });
    let output = mavsight().arg("check").arg(session.path("session.toml")).output().expect("a check");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(!output.status.success(), "{said}");
    assert!(
        said.contains(&format!("control point {named} was left out")) && said.contains("measure it again"),
        "{said}"
    );
    assert!(!said.contains("its colour is another"), "{said}");
}
