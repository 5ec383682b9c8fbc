//! The tutorial of `docs/models.md`, with the files of `docs/quadrotor`.

use assert_cmd::Command;
use mavsight::random::Random;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a file")
}

fn mavsight() -> Command {
    Command::new(env!("CARGO_BIN_EXE_mavsight"))
}

fn said(command: &mut Command, code: i32) -> String {
    let assert = command.assert().code(code);
    let output = assert.get_output();
    String::from_utf8_lossy(&[output.stdout.as_slice(), &output.stderr].concat()).into_owned()
}

fn simulate(folder: &Path, code: i32) -> String {
    let mut command = mavsight();
    command.current_dir(folder).args([
        "simulate",
        "--vehicle",
        "vehicle.toml",
        "--scenario",
        "scenario.toml",
    ]);
    said(command.args(["--out", "flight"]), code)
}

/// The poses of a flight, with the noise of a motion-capture system.
fn captured(truth: &str, seed: u64) -> String {
    let mut random = Random::new(seed, 0);
    let mut out = String::from("t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n");
    for line in truth.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        out += &cells[0].to_string();
        for (column, std) in [(1, 3e-4), (2, 3e-4), (3, 3e-4), (7, 9e-4), (8, 9e-4), (9, 9e-4)] {
            out += &format!(",{}", cells[column] + std * random.normal());
        }
        out += "\n";
    }
    out
}

/// Code blocks of the page, in its order.
fn blocks() -> Vec<String> {
    let page = read(&docs().join("models.md"));
    page.split("```text\n")
        .skip(1)
        .map(|rest| rest.split("```").next().expect("a block").to_owned())
        .collect()
}

#[test]
fn the_first_file_has_the_error_that_the_page_prints() {
    let folder = TempDir::new().expect("a folder");
    let blocks = blocks();
    for (name, text) in ["my-quadrotor.toml", "vehicle.toml", "scenario.toml"].into_iter().zip(&blocks) {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    let printed = blocks[3].lines().nth(1).expect("an error");
    assert_eq!(simulate(folder.path(), 2).trim(), printed);
    let path = folder.path().join("my-quadrotor.toml");
    let corrected = blocks[0].replace("omega_1^2 - omega_3)", "omega_1^2 - omega_3^2)");
    std::fs::write(&path, corrected.replace("x = \"arm*k_T", "x = \"arm*kT")).expect("written");
    let page = read(&docs().join("models.md")).replace('\n', " ");
    let refused = simulate(folder.path(), 2);
    let (_, place) = refused.trim().split_once("toml, ").expect("a place");
    assert!(page.contains(place), "the page lacks {place}");
    std::fs::write(&path, corrected).expect("written");
    assert_eq!(simulate(folder.path(), 0), "800 instants of 4.00 s: flight\n");
}

#[test]
fn the_finished_quadrotor_is_found() {
    let folder = TempDir::new().expect("a folder");
    let page = read(&docs().join("models.md"));
    for name in ["my-quadrotor.toml", "vehicle.toml", "scenario.toml", "mocap.awk"] {
        let text = read(&docs().join("quadrotor").join(name));
        // The page names the inputs anew in words.
        let is_shown = |line: &str| line.contains("c_") || page.contains(line);
        assert_eq!(text.lines().find(|line| !is_shown(line)), None, "{name}: a line that the page lacks");
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    simulate(folder.path(), 0);
    let poses = captured(&read(&folder.path().join("flight/truth.csv")), 3);
    std::fs::write(folder.path().join("mocap.csv"), poses).expect("written");
    let mut command = mavsight();
    command.current_dir(folder.path()).args(["identify", "mocap.csv", "--inputs", "flight/inputs.csv"]);
    said(command.args(["--vehicle", "vehicle.toml", "--lag", "0", "--out", "results"]), 0);
    let parameters = read(&folder.path().join("results/parameters.csv"));
    for (name, truth) in [
        ("I_xx", 3.2e-3),
        ("I_yy", 2.9e-3),
        ("k_T", 5.3e-6),
        ("k_Q", 1.2e-7),
        ("tau_m", 0.05),
        ("d_q", -4e-3),
        ("torque over thrust", 1.2e-7 / 5.3e-6),
    ] {
        let row = parameters.lines().find(|row| row.starts_with(&format!("oe,,{name},"))).expect("a row");
        let cells: Vec<&str> = row.split(',').collect();
        let [value, std] = [3, 4].map(|k| cells[k].parse::<f64>().expect("a number"));
        assert!((value - truth).abs() < 4.0 * std && std < 0.02 * truth.abs(), "{row} against {truth}");
    }
}

const SENSORS: &str = r#"
[parameters.bias_q]
unit = "rad/s"
value = 0
free = true
[outputs]
gyro_y = { column = "gyro_y_rad_s", unit = "rad/s", std = 0.003, value = "q + bias_q" }
acc_z = { column = "acc_z_m_s2", unit = "m/s^2", std = 0.05, value = "a_z" }
"#;

/// The finished quadrotor with a gyroscope and an accelerometer on board: their samples narrow the intervals,
/// and show the gyroscope's bias.
#[test]
fn sensors_beside_the_poses_are_taken_in() {
    let folder = TempDir::new().expect("a folder");
    for name in ["my-quadrotor.toml", "vehicle.toml", "scenario.toml"] {
        let text = read(&docs().join("quadrotor").join(name));
        let text = if name == "my-quadrotor.toml" { text + SENSORS } else { text };
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    simulate(folder.path(), 0);
    let truth = read(&folder.path().join("flight/truth.csv"));
    std::fs::write(folder.path().join("mocap.csv"), captured(&truth, 3)).expect("written");
    let mut random = Random::new(8, 0);
    let header: Vec<&str> = truth.lines().next().expect("a header").split(',').collect();
    let place = |name: &str| header.iter().position(|h| *h == name).expect("a column");
    let [u, v, p, q, dw] = ["u_m_s", "v_m_s", "p_rad_s", "q_rad_s", "dw_m_s2"].map(place);
    let exact = read(&folder.path().join("flight/sensors.csv"));
    let mut exact = exact.lines();
    assert_eq!(exact.next(), Some("t_s,gyro_y_rad_s,acc_z_m_s2"));
    let mut imu = String::from("t_s,gyro_y_rad_s,acc_z_m_s2,remark\n");
    for line in truth.lines().skip(1) {
        let x: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        let gravity_m_s2 = 9.81 * x[8].cos() * x[7].cos();
        let acc = x[dw] + x[p] * x[v] - x[q] * x[u] - gravity_m_s2;
        let shown: Vec<f64> =
            exact.next().expect("a row").split(',').map(|cell| cell.parse().expect("a number")).collect();
        assert!((shown[1] - x[q]).abs() < 1e-9 && (shown[2] - acc).abs() < 1e-9, "{shown:?} for {acc}");
        let (gyro, acc) = (x[q] + 0.02 + 0.003 * random.normal(), acc + 0.05 * random.normal());
        imu += &format!("{},{gyro},{acc},ok\n", x[0]);
    }
    std::fs::write(folder.path().join("imu.csv"), &imu).expect("written");
    let wrong = imu.replace("acc_z_m_s2", "acc_z_g");
    std::fs::write(folder.path().join("wrong.csv"), wrong).expect("written");
    let identify = |sensors: &[&str], code: i32| {
        let mut command = mavsight();
        command.current_dir(folder.path()).args(["identify", "mocap.csv", "--inputs", "flight/inputs.csv"]);
        command.args(["--vehicle", "vehicle.toml", "--lag", "0", "--estimator", "oe", "--out", "results"]);
        said(command.args(sensors), code)
    };
    let row = |name: &str| -> Option<[f64; 2]> {
        let parameters = read(&folder.path().join("results/parameters.csv"));
        let row = parameters.lines().find(|row| row.starts_with(&format!("oe,,{name},")))?;
        let cells: Vec<&str> = row.split(',').collect();
        Some([3, 4].map(|k| cells[k].parse::<f64>().expect("a number")))
    };
    assert!(identify(&[], 0).contains("The sensors of the model (gyro_y, acc_z) are not used"));
    assert_eq!(row("bias_q"), None);
    let [_, alone] = row("tau_m").expect("a row");
    let text = identify(&["--sensors", "imu.csv"], 0);
    assert!(!text.contains("are not used"), "{text}");
    for (name, truth) in
        [("bias_q", 0.02), ("k_T", 5.3e-6), ("I_yy", 2.9e-3), ("tau_m", 0.05), ("d_q", -4e-3)]
    {
        let [value, std] = row(name).expect("a row");
        assert!((value - truth).abs() < 4.0 * std && std < 0.02 * truth.abs(), "{name}: {value} ± {std}");
    }
    let [_, with] = row("tau_m").expect("a row");
    assert!(with < 0.8 * alone, "{with} and {alone}");
    let text = identify(&["--sensors", "wrong.csv"], 2);
    assert!(
        text.contains("wrong.csv") && text.contains("no column acc_z_m_s2") && text.contains("acc_z_g"),
        "{text}"
    );
}
