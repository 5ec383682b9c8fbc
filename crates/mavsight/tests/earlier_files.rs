//! Files of schema 1 are read with a note and written anew by `convert`.

use assert_cmd::Command;
use std::path::Path;
use tempfile::TempDir;

const VEHICLE: &str = r##"
# Another helicopter than the paper's.
name = "coaxial of 2024"
mass_kg = 0.7
inertia_kg_m2 = [6e-3, 6e-3, 1e-3]
marker = [
    { name = "red", position_m = [0.2, 0.2, 0.1], diameter_m = 0.05, color = "#db1212" },
    { name = "green", position_m = [0.2, -0.2, 0.1], diameter_m = 0.05, color = "#12a02e" },
    { name = "blue", position_m = [-0.2, -0.2, 0.1], diameter_m = 0.05, color = "#1c38d0" },
]
[rotor]
radius_m = 0.24
thrust_coefficient_upper = 7.0e-3
thrust_coefficient_lower = 5.2e-3
flap_time_lower_s = 0.06
flap_time_flybar_s = 2.5
swashplate_gain = 0.9
flybar_gain = 0.8
[environment]
air_density_kg_m3 = 1.2
gravity_m_s2 = 9.81
[assumption]
height_upper_m = 0.18
drag_n_s_m = 0.1
"##;

const EQUATIONS: &str = r#"
schema = 1
name = "one of each"
[[output]]
name = "C_m"
measured = "moment_y"
scale = "rotor"
regressors = ["1", "q", "delta_lon", "kappa_u*alpha_u"]
fixed = { q = -0.01 }
[[output]]
name = "Z"
measured = "force_z"
scale = "si"
regressors = ["omega_u*omega_u", "omega_l*omega_l"]
when = "excited"
"#;

fn mavsight() -> Command {
    Command::new(env!("CARGO_BIN_EXE_mavsight"))
}

fn put(folder: &TempDir, name: &str, text: &str) -> std::path::PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, text).expect("written");
    path
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a file")
}

fn said(command: &mut Command, code: i32) -> String {
    let assert = command.assert().code(code);
    let output = assert.get_output();
    String::from_utf8_lossy(&[output.stdout.as_slice(), &output.stderr].concat()).into_owned()
}

fn convert(input: &Path, output: &Path, code: i32) -> String {
    said(mavsight().arg("convert").arg(input).arg(output), code)
}

/// The virtual flight of a vehicle file: its inputs and its motion.
fn flown(vehicle: &Path, out: &Path) -> [String; 2] {
    mavsight().arg("simulate").arg("--vehicle").arg(vehicle).arg("--out").arg(out).assert().success();
    ["inputs.csv", "truth.csv"].map(|name| read(&out.join(name)))
}

#[test]
fn a_vehicle_of_schema_1_is_written_anew_and_flies_as_before() {
    let folder = TempDir::new().expect("a folder");
    let earlier = put(&folder, "vehicle.toml", VEHICLE);
    let new = folder.path().join("new.toml");
    let answer = convert(&earlier, &new, 0);
    assert!(answer.contains("coaxial") && answer.contains("[simulation]"), "{answer}");
    let written = read(&new);
    assert!(written.contains("model = \"coaxial\"") && !written.contains("[rotor]"), "{written}");
    let flights = ["earlier", "new"].map(|name| folder.path().join(name));
    let motion = flown(&earlier, &flights[0]);
    assert_eq!(motion, flown(&new, &flights[1]));
    let answer = convert(&new, &folder.path().join("again.toml"), 2);
    assert!(answer.contains("nothing to convert") && !folder.path().join("again.toml").exists(), "{answer}");
}

#[test]
fn equations_of_schema_1_are_those_of_sections_in_a_model_file() {
    let folder = TempDir::new().expect("a folder");
    let earlier = put(&folder, "equations.toml", EQUATIONS);
    let new = folder.path().join("sections.toml");
    let answer = convert(&earlier, &new, 0);
    assert!(answer.contains("flight model"), "{answer}");
    let shelf = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../model/shelf/coaxial.toml"));
    let without = shelf.split("[[equation]]").next().expect("a model");
    let model = put(&folder, "model.toml", &format!("{without}\n{}", read(&new)));
    let vehicle = put(&folder, "vehicle.toml", VEHICLE);
    let flight = folder.path().join("flight");
    flown(&vehicle, &flight);
    let fitted = |model: &Path| {
        let mut command = mavsight();
        command.arg("identify").arg(flight.join("truth.csv")).arg("--model").arg(model);
        command.arg("--inputs").arg(flight.join("inputs.csv")).args(["--estimator", "ols", "--lag", "0"]);
        let answer = said(command.arg("--vehicle").arg(flight.join("vehicle.toml")), 0);
        answer.split_once("Parameters").expect("parameters").1.to_owned()
    };
    let both = [&earlier, &model].map(|file| fitted(file));
    assert_eq!(both[0], both[1]);
    assert!(both[0].contains("C_m,kappa_u*alpha_u") && !both[0].contains("C_m,q"), "{}", both[0]);
}

#[test]
fn results_note_a_vehicle_of_schema_1_once() {
    let folder = TempDir::new().expect("a folder");
    let vehicle = put(&folder, "vehicle.toml", VEHICLE);
    let flight = folder.path().join("flight");
    flown(&vehicle, &flight);
    let notes = |vehicle: &Path| {
        let mut command = mavsight();
        command.arg("identify").arg(flight.join("truth.csv")).arg("--vehicle").arg(vehicle);
        let answer =
            said(command.arg("--inputs").arg(flight.join("inputs.csv")).args(["--estimator", "ols"]), 0);
        answer.matches("schema 1").count()
    };
    assert_eq!(notes(&vehicle), 1);
    assert_eq!(notes(&flight.join("vehicle.toml")), 0);
}
