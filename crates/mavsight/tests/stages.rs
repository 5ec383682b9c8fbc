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
    // Between the steps the rig, by which balls are expected and judged, has passed through a file of
    // finite digits.
    let (one, other) = (read(&whole, "markers.csv"), read(&steps, "markers.csv"));
    assert_eq!(one.lines().count(), other.lines().count());
    for (a, b) in one.lines().zip(other.lines()).skip(1) {
        let (a, b): (Vec<&str>, Vec<&str>) = (a.split(',').collect(), b.split(',').collect());
        assert_eq!(a[..3], b[..3]);
        for (x, y) in a[3..].iter().zip(&b[3..]) {
            let (x, y): (f64, f64) = (x.parse().expect("a number"), y.parse().expect("a number"));
            assert!((x - y).abs() < 1e-6, "{a:?}\n{b:?}");
        }
    }
    let (one, other) = (read(&whole, "pose.csv"), read(&steps, "pose.csv"));
    assert_eq!(one.lines().count(), other.lines().count());
    for (a, b) in one.lines().zip(other.lines()).skip(1) {
        for (x, y) in a.split(',').zip(b.split(',')).take(7) {
            let (x, y): (f64, f64) = (x.parse().expect("a number"), y.parse().expect("a number"));
            assert!((x - y).abs() < 1e-6, "{a}\n{b}");
        }
    }
    // The noise is read back exactly, so that the smoother does the same; what systematic errors add to the
    // standard deviations is approximated, and stands apart in every second column.
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
    assert!(read(&steps, "report.html").contains("class=\"overlay\"") && steps.join("motion.csv").is_file());
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

/// The body is refined where the session asks for it; where the flight shows no more than the ruler, a note
/// says so.
#[test]
fn markers_are_refined_or_the_reason_is_given() {
    let session = Session::new();
    let text = std::fs::read_to_string(session.path("session.toml")).expect("the session is there");
    for (std_m, refined) in [("0.002", true), ("0.00001", false)] {
        let asks = format!("{text}\n[refine]\nmarkers_std_m = {std_m}\ndiameters = true\n");
        std::fs::write(session.path("session.toml"), asks).expect("the session is written");
        let out = session.path(std_m);
        mavsight().arg("run").arg(session.path("session.toml")).arg("--out").arg(&out).assert().success();
        let summary = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
        assert_eq!(summary.contains("no better than the"), !refined, "{summary}");
        assert_eq!(out.join("body.csv").is_file(), refined);
        if refined {
            let report = std::fs::read_to_string(out.join("report.html")).expect("a report");
            assert!(report.contains("Body as built") && report.contains("red ball, diameter"));
            let body = std::fs::read_to_string(out.join("body.csv")).expect("a table");
            let red: Vec<f64> = body
                .lines()
                .nth(1)
                .expect("a row")
                .split(',')
                .skip(1)
                .map(|c| c.parse().expect("a number"))
                .collect();
            assert!((red[0] - 0.225).abs() < 2e-3 && (1e-5..1.5e-3).contains(&red[3]), "{red:?}");
            assert!((red[6] - 0.05).abs() < 5e-3 && red[7] > 0.0, "{red:?}");
        }
    }
}

/// At heading 0 each camera looks along a diagonal of the square of balls: the near one hides nearly all of
/// the far one.
#[test]
fn a_ball_behind_another_costs_neither_frames_nor_exactness() {
    let session = Session::with_heading(0.0);
    let out = session.path("results");
    mavsight().arg("run").arg(session.path("session.toml")).arg("--out").arg(&out).assert().success();
    let summary = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("an object");
    assert_eq!(summary["poses"]["measured"], summary["poses"]["frames"]);
    let rms_mm = summary["truth"]["poses_position_rms_mm"].as_f64().expect("a figure");
    assert!(rms_mm < 0.8, "{rms_mm} mm");
    let markers = std::fs::read_to_string(out.join("markers.csv")).expect("a table");
    let rows = markers.lines().count() - 1;
    assert!(rows < 8 * 12, "nothing was hidden in this film");
}

/// What a room file asks for, against the table of markers: standard deviations of both coordinates, hardly
/// correlated. Each is distinguished from its like by where it is on the body.
#[test]
fn two_balls_of_one_colour_are_distinguished() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let printed = |what: &str| {
        let run = mavsight().args(["simulate", what]).assert().success();
        String::from_utf8_lossy(&run.get_output().stdout).into_owned()
    };
    let vehicle = printed("--print-vehicle");
    let colors: Vec<&str> = vehicle.lines().filter(|line| line.starts_with("color")).collect();
    std::fs::write(path("vehicle.toml"), vehicle.replace(colors[1], colors[0])).expect("written");
    let scenario = printed("--print-scenario");
    let lasts = scenario.lines().find(|line| line.starts_with("duration_s")).expect("a duration");
    std::fs::write(path("scenario.toml"), scenario.replace(lasts, "duration_s = 0.5")).expect("written");
    let flight = path("flight");
    let steps: [&[&str]; 3] = [
        &["simulate", "--scenario", "scenario.toml", "--vehicle", "vehicle.toml", "--out", "flight"],
        &["film", "flight", "--out", "flight"],
        &["run", "flight/session.toml", "--out", "out", "--equation-error-only"],
    ];
    for step in steps {
        mavsight().args(step).current_dir(folder.path()).assert().success();
    }
    assert!(flight.join("vehicle.toml").is_file());
    let summary = std::fs::read_to_string(path("out/summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    let error_mm = summary["truth"]["poses_position_rms_mm"].as_f64();
    assert!(error_mm.is_some_and(|mm| mm < 0.6), "{error_mm:?} in {summary}");
}

#[test]
fn a_run_says_what_its_centres_are_worth_to_a_plan() {
    let session = Session::new();
    let out = session.path("results");
    mavsight().arg("run").arg(session.path("session.toml")).arg("--out").arg(&out).assert().success();
    let read = |name: &str| std::fs::read_to_string(out.join(name)).expect("a file");
    let mut all_px: Vec<f64> = read("markers.csv")
        .lines()
        .skip(1)
        .map(|row| {
            let std_px = row.rsplit(',').map(|cell| cell.parse::<f64>().expect("a number"));
            std_px.take(2).product::<f64>().sqrt()
        })
        .collect();
    all_px.sort_by(f64::total_cmp);
    let summary: serde_json::Value = serde_json::from_str(&read("summary.json")).expect("an object");
    let plan = &summary["plan"];
    let tenths: Vec<f64> = serde_json::from_value(plan["centre_std_px"].clone()).expect("a list");
    assert!(tenths.len() == 10 && tenths.windows(2).all(|w| w[0] <= w[1]), "{tenths:?}");
    for (part, got) in tenths.iter().enumerate() {
        let want = all_px[((part as f64 + 0.5) / 10.0 * all_px.len() as f64) as usize];
        assert!((got / want - 1.0).abs() < 0.05, "{part}: {got} {want}");
    }
    let figure = |key: &str| plan[key].as_f64().expect("a figure");
    assert!(
        (1e-3..0.3).contains(&figure("control_std_px")) && (0.0..0.3).contains(&figure("centre_bias_px"))
    );
}

/// Parameters were fitted to inputs that had moved nothing.
#[test]
fn what_is_carried_has_no_inputs_nor_those_of_an_earlier_flight() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    for (carried, has_inputs) in [(false, true), (true, false)] {
        let mut simulate = mavsight();
        simulate.args(["simulate", "--out"]).arg(path("flight")).args(carried.then_some("--carried"));
        simulate.assert().success();
        assert_eq!(path("flight/inputs.csv").exists(), has_inputs);
    }
}
