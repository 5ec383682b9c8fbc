//! Identification by itself, on tables from elsewhere.

use assert_cmd::Command;
use mavsight::random::Random;
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const MASS_KG: f64 = 0.5;
const INERTIA_KG_M2: f64 = 3.0e-3;
const GRAVITY_M_S2: f64 = 9.81;
const THRUST_N_S2: f64 = 5.0e-6;
const ARM_M: f64 = 0.2;
const DAMPING_N_M_S: f64 = 4.0e-3;

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/quadrotor").join(name)
}

/// Rotor speeds at a time: hover, and a multisine of its own harmonics of 8 s on each.
fn speeds_rad_s(t_s: f64) -> [f64; 4] {
    let hover = (MASS_KG * GRAVITY_M_S2 / (4.0 * THRUST_N_S2)).sqrt();
    std::array::from_fn(|rotor| {
        let line = |k: usize| {
            let harmonic = (5 + rotor + 4 * k) as f64;
            (2.0 * PI * harmonic * t_s / 8.0 + 1.7 * (k * k + rotor) as f64).sin()
        };
        hover + 4.0 * (0..4).map(line).sum::<f64>()
    })
}

/// A flight in the vertical plane, seen at 200 Hz with a motion-capture system's noise: the tables of poses
/// and inputs.
fn flight(folder: &Path) -> (PathBuf, PathBuf) {
    let (dt_s, mut random) = (1e-3, Random::new(4, 0));
    let (mut x, mut z, mut u, mut w, mut theta, mut q) = (0.0, 1.5, 0.0, 0.0, 0.0_f64, 0.0);
    let mut poses = String::from("t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n");
    let mut inputs = String::from("t_s,omega_1_rad_s,omega_2_rad_s,omega_3_rad_s,omega_4_rad_s,remark\n");
    for step in 0..=8000 {
        let t_s = f64::from(step) * dt_s;
        let omega = speeds_rad_s(t_s);
        if step % 5 == 0 {
            let mut noise = |std: f64| std * random.normal();
            let (x, y, z) = (x + noise(2e-4), noise(2e-4), z + noise(2e-4));
            let (phi, theta, psi) = (noise(5e-4), theta + noise(5e-4), noise(5e-4));
            writeln!(poses, "{t_s},{x},{y},{z},{phi},{theta},{psi}").expect("memory");
        }
        if step % 2 == 0 {
            // What holds until the next row is the mean between.
            let mean = speeds_rad_s(t_s + dt_s);
            let [a, b, c, d] = mean;
            writeln!(inputs, "{t_s},{a},{b},{c},{d},ok").expect("memory");
        }
        let thrust_n: f64 = omega.iter().map(|o| THRUST_N_S2 * o * o).sum();
        let moment = ARM_M * THRUST_N_S2 * (omega[0].powi(2) - omega[2].powi(2)) - DAMPING_N_M_S * q;
        // Trapezoids of rates that hardly change in a millisecond.
        let (was_u, was_w, was_q) = (u, w, q);
        u -= thrust_n * theta.sin() / MASS_KG * dt_s;
        w += (thrust_n * theta.cos() / MASS_KG - GRAVITY_M_S2) * dt_s;
        q += moment / INERTIA_KG_M2 * dt_s;
        x += 0.5 * (u + was_u) * dt_s;
        z += 0.5 * (w + was_w) * dt_s;
        theta += 0.5 * (q + was_q) * dt_s;
    }
    assert!(theta.abs() < 0.6, "the flight is upright: {theta}");
    let paths = (folder.join("mocap.csv"), folder.join("log.csv"));
    std::fs::write(&paths.0, poses).expect("written");
    std::fs::write(&paths.1, inputs).expect("written");
    paths
}

fn identify(table: &Path, inputs: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mavsight"));
    command.arg("identify").arg(table).arg("--inputs").arg(inputs);
    command.arg("--vehicle").arg(example("vehicle.toml"));
    command
}

fn message(command: &mut Command, code: i32) -> String {
    String::from_utf8_lossy(&command.assert().code(code).get_output().stderr).into_owned()
}

#[test]
fn a_quadrotor_before_a_motion_capture_system() {
    let folder = TempDir::new().expect("a folder");
    let (table, inputs) = flight(folder.path());
    let out = folder.path().join("results");
    let mut command = identify(&table, &inputs);
    command.arg("--model").arg(example("equations.toml")).args(["--hold-out", "5..6"]).arg("--out").arg(&out);
    let assert = command.assert().success();
    let text = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(text.contains("predicts the 201 instants held out"), "{text}");
    let parameters = std::fs::read_to_string(out.join("parameters.csv")).expect("parameters");
    let square = |rotor: usize| format!("omega_{rotor}_rad_s*omega_{rotor}_rad_s");
    let moment = ARM_M * THRUST_N_S2;
    let mut truth: Vec<(&str, String, f64)> =
        (1..=4).map(|rotor| ("Z", square(rotor), -THRUST_N_S2)).collect();
    truth.extend([("M", square(1), moment), ("M", square(3), -moment), ("M", "q".into(), -DAMPING_N_M_S)]);
    for estimator in ["ols", "tls", "gtls"] {
        for (output, name, truth) in &truth {
            let begin = format!("{estimator},{output},{name},");
            let row = parameters.lines().find(|l| l.starts_with(&begin)).expect("a row");
            let cells: Vec<&str> = row.split(',').collect();
            let [value, std] = [3, 4].map(|k| cells[k].parse::<f64>().expect("a number"));
            let error = (value - truth).abs();
            assert!(error < 4.0 * std && std < 0.05 * truth.abs(), "{row} against {truth}");
        }
        assert!(!parameters.contains(&format!("{estimator},L,")), "nothing rolled: {parameters}");
    }
}

#[test]
fn rows_that_are_missing_are_left_out_and_said() {
    let folder = TempDir::new().expect("a folder");
    let (table, inputs) = flight(folder.path());
    let text = std::fs::read_to_string(&table).expect("the table");
    let rows: Vec<&str> = text.lines().collect();
    std::fs::write(&table, [&rows[..601], &rows[721..]].concat().join("\n")).expect("written");
    let mut command = identify(&table, &inputs);
    let assert = command.arg("--model").arg(example("equations.toml")).assert().success();
    let text = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(text.contains("1481 of 1601") && text.contains("in gaps of the poses were left out"), "{text}");
}

#[test]
fn a_motion_table_is_taken_as_it_is() {
    let folder = TempDir::new().expect("a folder");
    let (table, inputs) = flight(folder.path());
    let out = folder.path().join("results");
    let run = |table: &Path| {
        let mut command = identify(table, &inputs);
        command.arg("--model").arg(example("equations.toml")).args(["--estimator", "ols", "--lag", "0"]);
        command
    };
    run(&table).arg("--out").arg(&out).assert().success();
    let text = |command: &mut Command| {
        let assert = command.assert().success();
        let text = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
        text.lines().filter(|l| l.trim_start().starts_with("ols")).map(str::to_owned).collect::<Vec<_>>()
    };
    let (poses, motion) = (text(&mut run(&table)), text(&mut run(&out.join("motion.csv"))));
    assert_eq!(poses.len(), 7);
    assert_eq!(poses, motion);
    // Into the folder where the table lies, whose summary says how it was smoothed.
    let summary = out.join("summary.json");
    let another = std::fs::read_to_string(&summary)
        .expect("a summary")
        .replace("\"session\": \"", "\"session\": \"of ");
    std::fs::write(&summary, &another).expect("written");
    run(&out.join("motion.csv")).arg("--out").arg(&out).assert().success();
    assert_eq!(text(&mut run(&out.join("motion.csv"))), motion);
}

#[test]
fn wrong_calls_are_named() {
    let folder = TempDir::new().expect("a folder");
    let (table, inputs) = flight(folder.path());
    let model = folder.path().join("model.toml");
    let text = std::fs::read_to_string(example("equations.toml")).expect("the example");
    std::fs::write(&model, text.replace("\"q\"]", "\"qq\"]")).expect("written");
    let said = message(identify(&table, &inputs).arg("--model").arg(&model), 2);
    assert!(["M", "qq", "1, u, v, w", "omega_4_rad_s"].iter().all(|w| said.contains(w)), "{said}");
    assert!(!said.contains("remark"), "a column of words is no signal: {said}");
    std::fs::write(&model, "schema = 1\nname = \"n\"\noutputs = []").expect("written");
    let said = message(identify(&table, &inputs).arg("--model").arg(&model), 2);
    assert!(said.contains("model.toml") && said.contains("outputs"), "{said}");
    let said = message(identify(&table, &inputs).args(["--estimator", "ols,best"]), 2);
    assert!(said.contains("best") && said.contains("gtls"), "{said}");
    let said = message(identify(&table, &inputs).args(["--estimator", "ols", "--search"]), 2);
    assert!(said.contains("--search") && said.contains("name oe"), "{said}");
    let mut alone = Command::new(env!("CARGO_BIN_EXE_mavsight"));
    alone.args(["identify", "--log", "flight.ulg", "--search", "--vehicle"]).arg(example("vehicle.toml"));
    let said = message(&mut alone, 2);
    assert!(said.contains("--search") && said.contains("pose.csv"), "{said}");
    let mut alone = Command::new(env!("CARGO_BIN_EXE_mavsight"));
    alone.args(["identify", "--log", "flight.ulg", "--stepwise", "--vehicle"]).arg(example("vehicle.toml"));
    let said = message(&mut alone, 2);
    assert!(said.contains("--stepwise") && said.contains("pose.csv"), "{said}");
    let said = message(identify(&table, &inputs).args(["--band", "0.5..3"]), 2);
    assert!(said.contains("add --estimator fd"), "{said}");
    let said = message(identify(&table, &inputs).args(["--preset", "px4-motors"]), 2);
    assert!(said.contains("--preset") && said.contains("add --log FILE"), "{said}");
    for option in ["--band", "--hold-out"] {
        for text in ["3", "2..1", "a..b", "1..nan"] {
            let said = message(identify(&table, &inputs).args([option, text]), 2);
            assert!(said.contains("0.5..3"), "{option} {text}: {said}");
        }
    }
    let said = message(
        identify(&table, &inputs).arg("--model").arg(example("equations.toml")).args([
            "--estimator",
            "fd",
            "--band",
            "1..900",
        ]),
        2,
    );
    assert!(said.contains("900") && said.contains("100.00"), "{said}");
    for lag in ["--lag=1e9", "--lag=-1e300"] {
        let said = message(identify(&table, &inputs).arg(lag), 2);
        assert!(said.contains("some of the inputs are of the flight"), "{said}");
    }
    // The vehicle names no model, hence no equations.
    let output = identify(&table, &inputs).assert().success();
    let said = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(said.contains("No equation error") && said.contains("no equations for regression"), "{said}");
}

/// What was not seen for two seconds is not known: its rows hold their times alone.
#[test]
fn motion_is_not_known_where_nothing_was_seen() {
    let folder = TempDir::new().expect("a folder");
    let (table, inputs) = flight(folder.path());
    let unseen = |line: &str| {
        let t_s = line.split(',').next().and_then(|t| t.parse::<f64>().ok());
        t_s.filter(|t| (3.0..5.0).contains(t)).map_or(line.to_owned(), |t| format!("{t},,,,,,"))
    };
    let text = std::fs::read_to_string(&table).expect("the table");
    std::fs::write(&table, text.lines().map(unseen).collect::<Vec<_>>().join("\n")).expect("written");
    let out = folder.path().join("results");
    let mut command = identify(&table, &inputs);
    command.arg("--model").arg(example("equations.toml")).args(["--estimator", "ols"]).arg("--out").arg(&out);
    command.assert().success();
    let motion = std::fs::read_to_string(out.join("motion.csv")).expect("a motion");
    let rows: Vec<(f64, bool)> = motion
        .lines()
        .skip(1)
        .map(|l| l.split_once(',').expect("cells"))
        .map(|(t, rest)| (t.parse().expect("a time"), rest.chars().all(|c| c == ',')))
        .collect();
    assert_eq!(rows.len(), text.lines().count() - 1);
    assert!(rows.iter().all(|(t_s, empty)| *empty == (3.0..5.0).contains(t_s)));
}

/// A logger that is switched on late and off early costs the parameters of what it did not see, not the
/// motion.
#[test]
fn inputs_that_end_early_give_the_part_that_they_cover() {
    let folder = TempDir::new().expect("a folder");
    let (table, inputs) = flight(folder.path());
    let text = std::fs::read_to_string(&inputs).expect("inputs");
    let lines: Vec<&str> = text.lines().collect();
    let model = example("equations.toml");
    let [whole, part] = ["whole", "part"].map(|name| folder.path().join(name));
    identify(&table, &inputs).arg("--model").arg(&model).arg("--out").arg(&whole).assert().success();
    let kept = [&lines[..1], &lines[300..2000]].concat();
    std::fs::write(&inputs, kept.join("\n")).expect("written");
    let assert =
        identify(&table, &inputs).arg("--model").arg(&model).arg("--out").arg(&part).assert().success();
    let motion = |folder: &Path| std::fs::read_to_string(folder.join("motion.csv")).expect("a motion");
    assert_eq!(motion(&part), motion(&whole));
    let said = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    let note = said.lines().find(|l| l.contains("The inputs cover")).expect("a note");
    assert!(
        note.contains("to 3.99") && note.contains("8.000 s") && !said.contains("No parameters"),
        "{said}"
    );
    // Of another day: nothing is covered.
    let late = |line: &&str| {
        let (t_s, rest) = line.split_once(',').expect("a row");
        format!("{},{rest}", t_s.parse::<f64>().expect("a time") + 100.0)
    };
    let shifted: Vec<String> =
        std::iter::once(lines[0].to_owned()).chain(lines[1..].iter().map(late)).collect();
    std::fs::write(&inputs, shifted.join("\n")).expect("written");
    let said = message(identify(&table, &inputs).arg("--model").arg(&model), 1);
    assert!(said.contains("100.000") && said.contains("record the inputs over the whole flight"), "{said}");
    // Their lag was "must be shorter than the inputs' record", and what they cover was judged without it.
    let known =
        identify(&table, &inputs).arg("--model").arg(&model).args(["--lag", "-100"]).output().expect("ran");
    let said = String::from_utf8_lossy(&known.stdout);
    assert!(known.status.success() && !said.contains("The inputs cover"), "{said}");
}

/// A thrown body has no inputs, and needed a table of them all the same.
#[test]
fn a_model_without_inputs_needs_none() {
    let shelf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/shelf/thrown-body");
    let folder = TempDir::new().expect("a folder");
    let (thrown, table) = (folder.path().join("thrown"), folder.path().join("poses.csv"));
    let mavsight = || Command::new(env!("CARGO_BIN_EXE_mavsight"));
    let mut simulate = mavsight();
    simulate.arg("simulate").arg("--vehicle").arg(shelf.join("vehicle.toml"));
    simulate.arg("--scenario").arg(shelf.join("scenario.toml")).arg("--out").arg(&thrown).assert().success();
    // Time, place and angles of the truth, with a motion capture's noise.
    let truth = std::fs::read_to_string(thrown.join("truth.csv")).expect("read");
    let mut random = Random::new(5, 0);
    let mut poses = String::from("t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n");
    for row in truth.lines().skip(1) {
        let row: Vec<f64> = row.split(',').map(|cell| cell.parse().expect("a number")).collect();
        let mut noisy = |column: usize, std: f64| row[column] + std * random.normal();
        let [x, y, z] = [1, 2, 3].map(|column| noisy(column, 2e-4));
        let [phi, theta, psi] = [7, 8, 9].map(|column| noisy(column, 5e-4));
        writeln!(poses, "{},{x},{y},{z},{phi},{theta},{psi}", row[0]).expect("memory");
    }
    std::fs::write(&table, poses).expect("written");
    let identify = |vehicle: &Path| {
        let mut command = mavsight();
        command.arg("identify").arg(&table).args(["--estimator", "oe"]).arg("--vehicle").arg(vehicle);
        command
    };
    let done = identify(&shelf.join("vehicle.toml")).assert().success();
    let said = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    assert!(said.contains("oe  I_xx") && !said.contains("No equation error"), "{said}");
    assert!(!said.contains("inputs move"), "{said}");
    // Of a model that has some they are asked for by name.
    let said = message(&mut identify(&shelf.join("../quadrotor/vehicle.toml")), 2);
    assert!(said.contains("--inputs") && said.contains("omega_"), "{said}");
}
