//! Parameters and biases from a log alone, against a flight that is integrated here by hand.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_engine::{Flight, identify_from_log};
use mavsight_flight::{Vehicle, VehicleFile};
use mavsight_identify::output_error::MotionFits;
use mavsight_pipeline::{IdentifyOptions, NoProgress};
use mavsight_random::Random;
use mavsight_session::RunResults;
use mavsight_session::logs::{LogInput, LogSection, read_log_inputs, read_log_sensors, unit_by_model};

/// Two rotors above each other that lag behind their commands; sensors with biases.
const MODEL: &str = r#"
schema = 2
name = "two rotors"
[inputs]
motor_1 = { unit = "1", min = 0, max = 1, trim = 0.6 }
motor_2 = { unit = "1", min = 0, max = 1, trim = 0.6 }
[parameters]
tau = { unit = "s", value = 0.1, free = true, min = 2e-3, max = 0.5 }
k = { unit = "N", value = 0.5, free = true }
yaw = { unit = "1/kg/m", value = 50, free = true }
yaw_drag = { unit = "1/s", value = 1, free = true }
bias_a = { unit = "m/s^2", value = 0, free = true }
bias_r = { unit = "rad/s", value = 0, free = true }
[states]
m_1 = { unit = "1", derivative = "(motor_1 - m_1)/tau", initial = "motor_1", size = 0.2 }
m_2 = { unit = "1", derivative = "(motor_2 - m_2)/tau", initial = "motor_2", size = 0.2 }
[forces]
z = "-k*(m_1^2 + m_2^2)"
[moments]
z = "I_zz*(yaw*k*(m_1^2 - m_2^2) - yaw_drag*r)"
[outputs]
acc_z = { column = "acc_z_m_s2", unit = "m/s^2", value = "a_z + bias_a", std = 0.5 }
gyro_z = { column = "gyro_z_rad_s", unit = "rad/s", value = "r + bias_r", std = 0.05 }
"#;
const MASS_KG: f64 = 0.03;
const NAMES: [&str; 7] = ["tau", "k", "yaw", "yaw_drag", "bias_a", "bias_r", "input_lag_s"];
const TRUTH: [f64; 7] = [0.06, 0.42, 80.0, 1.8, -0.35, 0.04, LAG_S];
/// From when a command is logged to when the rotors begin to follow it.
const LAG_S: f64 = 0.008;
const ACCELERATION_STD_M_S2: f64 = 0.3;
const RATE_STD_RAD_S: f64 = 0.03;
/// The log's clock at its first row.
const BEGIN_S: f64 = 812.3;
/// Rows follow each other by this; a command holds for twenty.
const STEP_S: f64 = 0.001;
const SECONDS: usize = 12;

fn vehicle() -> Vehicle {
    let mut file = VehicleFile::from(Vehicle::paper());
    (file.model, file.mass_kg) = (Some("rotors.toml".to_owned()), MASS_KG);
    // Alike about x and y: rates that no sensor shows then do not turn it about z.
    file.inertia_kg_m2 = [1.7e-5, 1.7e-5, 2.9e-5];
    file.parameters.clear();
    file.simulation.clear();
    file.vehicle(|_| Ok(MODEL.to_owned())).unwrap()
}

fn commands(t_s: f64) -> [f64; 2] {
    let held_s = (t_s / (20.0 * STEP_S) + 1e-6).floor() * 20.0 * STEP_S;
    let (both, apart) =
        (0.12 * (3.1 * held_s).sin() + 0.08 * (9.7 * held_s).sin(), 0.06 * (5.3 * held_s).sin());
    [0.6 + both + apart, 0.6 + both - apart]
}

/// The table that an autopilot would have logged: rotors by the exact response of first order, the yaw rate by steps of a
/// millisecond, where a straight line is good to 1e-6.
fn table(seed: u64) -> String {
    let [tau, k, yaw, yaw_drag, bias_a, bias_r, lag_s] = TRUTH;
    let mut random = Random::new(seed, 0);
    let (mut m, mut r) = (commands(-lag_s), 0.3);
    let mut out = "t_s,c1,c2,az_g,gz_deg_s\n".to_owned();
    for row in 0..(SECONDS as f64 / STEP_S) as usize {
        let t_s = row as f64 * STEP_S;
        let (logged, own) = (commands(t_s), commands(t_s - lag_s));
        let a_z =
            -k * (m[0] * m[0] + m[1] * m[1]) / MASS_KG + bias_a + ACCELERATION_STD_M_S2 * random.normal();
        let gyro = r + bias_r + RATE_STD_RAD_S * random.normal();
        let (t_s, a_g, gyro_deg_s) = (BEGIN_S + t_s, a_z / 9.80665, gyro.to_degrees());
        out += &format!("{t_s:.6},{},{},{a_g:.9},{gyro_deg_s:.9}\n", logged[0], logged[1]);
        let next = [0, 1].map(|i| own[i] + (m[i] - own[i]) * f64::exp(-STEP_S / tau));
        let torque = |m: [f64; 2]| yaw * k * (m[0] * m[0] - m[1] * m[1]);
        let kept = f64::exp(-STEP_S * yaw_drag);
        r = r * kept + 0.5 * (torque(m) + torque(next)) * (1.0 - kept) / yaw_drag;
        m = next;
    }
    out
}

fn entry(column: &str, field: &str, scale: f64) -> LogInput {
    LogInput { column: column.to_owned(), field: field.to_owned(), scale: Some(scale), ..LogInput::default() }
}

fn identified(seed: u64, fits: MotionFits) -> RunResults {
    let path = std::env::temp_dir().join(format!("mavsight-log-alone-{}-{seed}.csv", std::process::id()));
    std::fs::write(&path, table(seed)).unwrap();
    let input = vec![
        entry("motor_1", "c1", 1.0),
        entry("motor_2", "c2", 1.0),
        entry("acc_z_m_s2", "az_g", 9.80665),
        entry("gyro_z_rad_s", "gz_deg_s", std::f64::consts::PI / 180.0),
    ];
    let section = LogSection { file: path.clone(), input, ..LogSection::default() };
    let vehicle = vehicle();
    let inputs = section.without_sensors(&vehicle.model);
    let inputs = read_log_inputs(&inputs, &unit_by_model(&vehicle.model)).unwrap().value;
    let sensors = read_log_sensors(&section, &vehicle.model).unwrap().unwrap().value;
    std::fs::remove_file(&path).unwrap();
    let flight = Flight {
        name: "log",
        vehicle: &vehicle,
        inputs: Some(&inputs),
        sensors: None,
        gyroscope: None,
        log_sensors: Some(&sensors),
        options: IdentifyOptions { motion_fits: fits, ..IdentifyOptions::default() },
    };
    let mut results = RunResults::default();
    // Two parts with a gap, over which the motion starts anew.
    let parts = [(BEGIN_S, BEGIN_S + 5.0), (BEGIN_S + 7.5, BEGIN_S + 11.5)];
    identify_from_log(&mut results, &parts, &flight, &NoProgress).unwrap();
    results
}

#[test]
fn parameters_and_biases_of_a_simulated_log_are_found() {
    for (seed, filter_error) in [(1, false), (2, true)] {
        let results = identified(seed, MotionFits { output_error: !filter_error, filter_error });
        let fits = &results.output_error;
        let fit =
            fits.poses.as_ref().or(fits.filter.as_ref()).unwrap_or_else(|| panic!("{:?}", results.notes));
        // A tenth of the value; of biases, the noise of one sample; of the lag, a sample.
        let enough = [0.1, 0.1, 0.1, 0.1, ACCELERATION_STD_M_S2, RATE_STD_RAD_S, STEP_S];
        for (k, (name, truth)) in NAMES.iter().zip(TRUTH).enumerate() {
            let p = fit.parameter(name).unwrap();
            println!("{name} {} ± {} ({truth})", p.value, p.std);
            let scale = if k < 4 { truth } else { 1.0 };
            assert!((p.value - truth).abs() < 3.0 * p.std, "{name}: {} ± {}, {truth}", p.value, p.std);
            assert!(p.std < enough[k] * scale && p.identifiable, "{name}: ± {}", p.std);
        }
    }
}
