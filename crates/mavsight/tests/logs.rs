//! `mavsight log`, and inputs of a log by `mavsight convert`.

#[path = "../../log/tests/common/ulog.rs"]
mod ulog;

use assert_cmd::Command;
use std::path::Path;

/// Standard output and standard error of a call that must end with a status.
fn call(folder: &Path, arguments: &str, status: i32) -> (String, String) {
    let mut command = Command::cargo_bin("mavsight").expect("the program");
    let output = command.current_dir(folder).args(arguments.split_whitespace()).output().expect("it starts");
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert_eq!(output.status.code(), Some(status), "{arguments}: {out}{err}");
    (out, err)
}

fn lab() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("a.ulg"), ulog::small()).expect("written");
    folder
}

#[test]
fn a_log_is_listed_with_what_it_can_serve_as() {
    let lab = lab();
    let (out, err) = call(lab.path(), "log a.ulg", 0);
    assert!(out.starts_with("a.ulg: PX4 ULog, 2.000 to 2.249 s on its own clock"), "{out}");
    let row = |start: &str| out.lines().find(|line| line.starts_with(start)).unwrap_or_default();
    let cells: Vec<&str> = row("actuator_outputs").split_whitespace().collect();
    assert_eq!(cells, ["actuator_outputs", "0", "40", "200.00", "1", "0.055", "motor", "outputs"]);
    assert!(out.contains("gyroscope: x, y, z [rad/s]") && out.contains("px4-outputs, px4-esc"), "{out}");
    assert!(err.contains("note: the logger lost data 1 times"), "{err}");
    let (fields, _) = call(lab.path(), "log a.ulg --topic esc_status", 0);
    assert!(fields.contains("esc[1].esc_rpm [rpm]") && !fields.contains("sensor_gyro"), "{fields}");
    let (json, _) = call(lab.path(), "log a.ulg --json", 0);
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&json["format"], &json["parameters"]["SYS_AUTOSTART"]), (&"ulog".into(), &"4001".into()));
    std::fs::write(lab.path().join("t.csv"), "t_s,word,speed_rad_s\n0,a,1\n0.5,b,2\n").expect("written");
    let (table, _) = call(lab.path(), "log t.csv --topic table", 0);
    assert!(
        table.contains("t.csv: table, 0.000 to 0.500 s") && table.contains("speed_rad_s [rad/s]"),
        "{table}"
    );
    let (_, err) = call(lab.path(), "log a.ulg --topic esc_statu", 2);
    assert!(err.contains("no topic esc_statu; the nearest are esc_status"), "{err}");
}

#[test]
fn a_log_becomes_a_table_of_inputs() {
    let lab = lab();
    let (out, _) = call(lab.path(), "convert a.ulg inputs.csv --preset px4-outputs", 0);
    assert_eq!(out, "inputs.csv\n");
    let table = std::fs::read_to_string(lab.path().join("inputs.csv")).expect("it");
    assert!(table.starts_with("t_s,output_1,output_2,output_3,output_4\n2.000300000000,1100."), "{table}");
    assert_eq!(table.lines().count(), 41);
    call(
        lab.path(),
        "convert a.ulg rpm.csv --input w_rad_s=esc_status:esc[0].esc_rpm,interpolation=linear",
        0,
    );
    let table = std::fs::read_to_string(lab.path().join("rpm.csv")).expect("it");
    let value =
        |line: &str| line.split(',').nth(1).and_then(|cell| cell.parse::<f64>().ok()).expect("a number");
    let first = table.lines().nth(1).map(value).expect("a row");
    // Ten steps of 2.5 ms: the first holds the mean of its twentieth of the way.
    assert!((first - (5000.0 - 20.0 * 0.05) * std::f64::consts::PI / 30.0).abs() < 1e-6, "{first}");
    for (arguments, said) in [
        ("convert a.ulg inputs.csv", "which fields are inputs? Give --preset or --input"),
        ("convert a.ulg x.csv --preset crazyflie", "presets of which it has: px4-outputs, px4-esc"),
        ("convert a.ulg x.csv --input a=sensor_gyro:x", "sensor_gyro has instances 0, 1"),
        ("convert a.ulg x.csv --input a", "no field is named"),
        ("convert inputs.csv x.parquet --preset px4-outputs", "add --from log"),
        ("convert a.ulg x.csv --input a=b:c,size=3", "size is none of instance, unit"),
    ] {
        let (_, err) = call(lab.path(), arguments, 2);
        assert!(err.contains(said), "{arguments}: {err}");
        assert!(!lab.path().join("x.csv").exists());
    }
}
