//! Inputs from logs: which field is which input, at which times, in which unit.

#[path = "../../log/tests/common/crazyflie.rs"]
mod crazyflie;
#[path = "../../log/tests/common/dataflash.rs"]
mod dataflash;
#[path = "../../log/tests/common/ulog.rs"]
mod ulog;

use mavsight_flight::{InputSeries, Interpolation};
use mavsight_geometry::Vector3;
use mavsight_model::{Model, Unit};
use mavsight_session::logs::{
    LogInput, LogSection, Preset, TimeUnit, read_log_gyroscope, read_log_inputs, read_log_sensors,
};
use std::f64::consts::PI;
use std::path::PathBuf;

struct Lab(tempfile::TempDir);

impl Lab {
    fn new() -> Self {
        let lab = Self(tempfile::tempdir().expect("a folder"));
        for (name, bytes) in
            [("a.ulg", ulog::small()), ("a.bin", dataflash::small()), ("log00", crazyflie::small())]
        {
            std::fs::write(lab.0.path().join(name), bytes).expect("written");
        }
        lab
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn section(&self, file: &str, preset: Option<Preset>, input: &[LogInput]) -> LogSection {
        LogSection { file: self.path(file), preset, input: input.to_vec(), ..LogSection::default() }
    }

    fn read(&self, file: &str, preset: Option<Preset>, input: &[LogInput]) -> InputSeries {
        read_log_inputs(&self.section(file, preset, input), &|_| None).expect("inputs").value
    }

    fn refusal(&self, file: &str, preset: Option<Preset>, input: &[LogInput]) -> String {
        read_log_inputs(&self.section(file, preset, input), &|_| None).expect_err("a refusal").to_string()
    }
}

fn input(column: &str, topic: &str, field: &str) -> LogInput {
    let topic = (!topic.is_empty()).then(|| topic.to_owned());
    LogInput { column: column.into(), topic, field: field.into(), ..LogInput::default() }
}

#[test]
fn presets_take_what_the_programs_log() {
    let lab = Lab::new();
    let outputs = lab.read("a.ulg", Some(Preset::Px4Outputs), &[]);
    assert_eq!(outputs.names(), ["output_1", "output_2", "output_3", "output_4"]);
    assert_eq!((outputs.times_s().len(), outputs.row(3)), (40, &[1112.0, 1200.0, 1288.0, 1400.0][..]));
    assert!((outputs.times_s()[3] - 2.0153).abs() < 1e-12);
    let rotors = lab.read("a.ulg", Some(Preset::Px4Esc), &[]);
    assert_eq!(rotors.names(), ["rotor_1_rad_s", "rotor_2_rad_s"]);
    assert!((rotors.row(2)[1] - 5060.0 * PI / 30.0).abs() < 1e-9);
    let rotors = lab.read("a.bin", Some(Preset::ArdupilotEsc), &[]);
    assert!((rotors.row(1)[1] - 6090.0 * PI / 30.0).abs() < 1e-9, "{:?}", rotors.row(1));
    let outputs = lab.read("a.bin", Some(Preset::ArdupilotOutputs), &[]);
    assert_eq!((outputs.names().len(), outputs.row(1)), (4, &[1102.0, 1200.0, 1300.0, 1400.0][..]));
    let motors = lab.read("log00", Some(Preset::Crazyflie), &[]);
    assert!((motors.row(100)[0] - 30_000.0 / 65_535.0).abs() < 1e-12);
    let other = lab.refusal("a.bin", Some(Preset::Px4Motors), &[]);
    assert!(
        other.contains("preset px4-motors") && other.contains("ardupilot-outputs, ardupilot-esc"),
        "{other}"
    );
}

#[test]
fn an_input_of_ones_own_takes_the_place_of_the_presets() {
    let lab = Lab::new();
    let own =
        LogInput { scale: Some(0.5), offset: -1.0, ..input("output_2", "actuator_outputs", "output[0]") };
    let inputs = lab.read("a.ulg", Some(Preset::Px4Outputs), &[own]);
    assert_eq!(inputs.names(), ["output_1", "output_3", "output_4", "output_2"]);
    assert_eq!(inputs.row(3), [1112.0, 1288.0, 1400.0, 555.0]);
}

#[test]
fn fields_of_unlike_rates_are_not_resampled() {
    let lab = Lab::new();
    let line = LogInput {
        instance: Some(0),
        interpolation: Interpolation::Linear,
        ..input("rate_rad_s", "sensor_gyro", "x")
    };
    let inputs = lab.read("a.ulg", None, &[line, input("throttle", "", "output[0]")]);
    let times_s = inputs.times_s();
    // From the first output to the last: outputs 0.3 ms after every fourth sample of the gyroscope.
    assert!((times_s[0] - 2.0003).abs() < 1e-9 && (inputs.end_s() - (2.0003 + 196.0 * 1.25e-3)).abs() < 1e-9);
    let gyro_s = |k: usize| 2.0 + 1.25e-3 * k as f64;
    let gyro = |k: usize| f64::from((k as f32 * 0.1).sin());
    let on_line = |t_s: f64| {
        let k = (((t_s - 2.0) / 1.25e-3) as usize).min(198);
        gyro(k) + (gyro(k + 1) - gyro(k)) * (t_s - gyro_s(k)) / 1.25e-3
    };
    for (k, pair_s) in times_s.windows(2).enumerate() {
        let middle_s = 0.5 * (pair_s[0] + pair_s[1]);
        assert!((inputs.row(k)[0] - on_line(middle_s)).abs() < 1e-6, "{k}");
        let held = (((middle_s - 2.0003) / 5e-3) as usize) * 4;
        let held = if (80..120).contains(&held) { 76 } else { held };
        assert_eq!(inputs.row(k)[1], 1100.0 + held as f64, "{k}");
    }
    assert_eq!(times_s.len(), 40 + 196, "each sample of either, once");
}

/// Two gyroscopes at 800 and 400 Hz.
#[test]
fn sensors_keep_the_times_of_their_own_streams() {
    let lab = Lab::new();
    let text = "schema = 2\nname = \"two\"\nforces = { z = 0 }\noutputs = { \
        a = { unit = \"rad/s\", value = \"p\", std = 1 }, b = { unit = \"rad/s\", value = \"q\", std = 1 } }\n";
    let model = Model::parse("two.toml", text).expect("a model");
    let of = |column: &str, instance: u32| LogInput {
        instance: Some(instance),
        ..input(column, "sensor_gyro", "x")
    };
    let section = lab.section("a.ulg", Some(Preset::Px4Outputs), &[of("a", 0), of("b", 1)]);
    let sensors = read_log_sensors(&section, &model).expect("read").expect("sensors").value;
    assert_eq!((sensors.columns(), sensors.times_ns().len()), (&["a".to_owned(), "b".to_owned()][..], 300));
    let shown = |k: usize| (sensors.times_ns()[k], sensors.row(k)[0], sensors.row(k)[1]);
    let ((t_a, a, no_b), (t_b, no_a, b)) = (shown(0), shown(1));
    assert!(t_a == 2_000_000_000 && a == 0.0 && no_b.is_nan(), "{a} {no_b}");
    assert!(t_b == 2_000_100_000 && no_a.is_nan() && (b - 0.01).abs() < 1e-6, "{no_a} {b}");
    let inputs = section.without_sensors(&model);
    assert!(inputs.input.is_empty() && inputs.has_inputs());
    assert!(read_log_sensors(&inputs, &model).expect("read").is_none());
}

#[test]
fn units_are_converted_or_asked_for() {
    let lab = Lab::new();
    let read = |input: LogInput, unit: &str| {
        let section = lab.section("a.ulg", None, &[input]);
        read_log_inputs(&section, &|_| Unit::parse(unit).ok()).map(|inputs| inputs.value.row(0)[0])
    };
    let speed = || input("omega", "esc_status", "esc[0].esc_rpm");
    assert!((read(speed(), "rad/s").expect("converted") - 5000.0 * PI / 30.0).abs() < 1e-9);
    let refused = read(speed(), "N").expect_err("a refusal").to_string();
    assert!(refused.contains("input omega") && refused.contains("esc[0].esc_rpm is in rpm"), "{refused}");
    let scaled = LogInput { scale: Some(2.0), ..speed() };
    assert_eq!(read(scaled, "N").expect("scaled"), 10_000.0);
    let unsaid = || input("voltage", "esc_status", "esc[0].esc_voltage");
    let refused = read(unsaid(), "V").expect_err("a refusal").to_string();
    assert!(refused.contains("does not say the unit of esc[0].esc_voltage: give its `unit`"), "{refused}");
    let said = LogInput { unit: Some("mV".into()), ..unsaid() };
    assert!((read(said, "V").expect("said") - 0.0115).abs() < 1e-12);
    let odd = LogInput { unit: Some("furlong".into()), ..unsaid() };
    assert!(read(odd, "V").expect_err("a refusal").to_string().contains("no known unit"));
    // Where no model says it, the name of the column may.
    let named = lab.refusal("a.ulg", None, &[input("speed_rad_s", "esc_status", "esc[0].esc_voltage")]);
    assert!(named.contains("the input is in rad/s, and the log does not say"), "{named}");
    // In the unit of the column's name, and not in that of SI.
    assert!(
        (read(input("speed_rpm", "esc_status", "esc[0].esc_rpm"), "?").expect("as it is") - 5000.0).abs()
            < 1e-9
    );
}

#[test]
fn what_is_not_there_is_named_with_what_is_nearest() {
    let lab = Lab::new();
    let topic = lab.refusal("a.ulg", None, &[input("a", "actuator_output", "output[0]")]);
    assert!(topic.contains("input a") && topic.contains("nearest are actuator_outputs"), "{topic}");
    let field = lab.refusal("a.ulg", None, &[input("a", "actuator_outputs", "output[9]")]);
    assert!(field.contains("no field output[9]; the nearest are output[0]"), "{field}");
    let many = lab.refusal("a.ulg", None, &[input("a", "sensor_gyro", "x")]);
    assert!(many.contains("instances 0, 1: say which"), "{many}");
    let nowhere = lab.refusal("a.ulg", None, &[input("a", "", "thrust")]);
    assert!(nowhere.contains("the log has no field thrust"), "{nowhere}");
    let folder = lab.refusal("none.ulg", None, &[input("a", "", "thrust")]);
    assert!(folder.contains("there is no such file"), "{folder}");
}

#[test]
fn a_table_is_a_log_with_a_map_of_its_columns() {
    let lab = Lab::new();
    let text =
        "stamp,left,word,right\n1000000,1,a,\n1010000,2,b,4\n1020000,3,c,6\n1030000,nan,d,8\n1040000,5,e,9\n";
    std::fs::write(lab.path("table.csv"), text).expect("written");
    let map = [input("u1", "", "left"), LogInput { scale: Some(10.0), ..input("u2", "table", "right") }];
    let mut section = lab.section("table.csv", None, &map);
    section.time = Some("stamp".into());
    section.time_unit = TimeUnit::Us;
    let inputs = read_log_inputs(&section, &|_| None).expect("inputs");
    assert_eq!(inputs.value.times_s(), [1.01, 1.02, 1.03, 1.04]);
    assert_eq!(inputs.value.column("u1").expect("it"), [2.0, 3.0, 3.0, 5.0]);
    assert_eq!(inputs.value.column("u2").expect("it"), [40.0, 60.0, 80.0, 90.0]);
    assert!(
        inputs.notes.iter().any(|n| n.contains("u1: 1 of 5 samples are no numbers")),
        "{:?}",
        inputs.notes
    );
    section.time = None;
    assert!(read_log_inputs(&section, &|_| None).expect_err("a refusal").to_string().contains("t_s"));
}

/// Of two gyroscopes the faster one is taken.
#[test]
fn the_gyroscope_of_a_log_is_read() {
    let lab = Lab::new();
    let found = read_log_gyroscope(&lab.section("a.ulg", None, &[])).expect("a log").expect("a gyroscope");
    assert_eq!((found.source.as_str(), found.times_ns.len()), ("sensor_gyro", 200));
    assert_eq!(found.times_ns[4], 2_005_000_000);
    let wave = f64::from(0.4_f32.sin());
    assert!((found.rates_rad_s[4] - Vector3::new(wave, -wave, 0.5 * wave)).norm() < 1e-6);
    // One axis alone is none.
    assert_eq!(read_log_gyroscope(&lab.section("log00", None, &[])).expect("a log"), None);
}

/// The Crazyflie logs degrees a second, of which its gyroscope measures 2000 at most, 34.9 rad/s; in a crash nearly so many.
#[test]
fn rates_in_degrees_are_converted() {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let file = std::env::var_os("MAVSIGHT_DATA").map_or(shared, PathBuf::from).join("crazyflie/log10");
    if !file.is_file() {
        println!("skipped: no {}", file.display());
        return;
    }
    let section = LogSection { file, ..LogSection::default() };
    let found = read_log_gyroscope(&section).expect("a log").expect("a gyroscope");
    let largest = found.rates_rad_s.iter().map(|rate| rate.amax()).fold(0.0, f64::max);
    assert!(found.times_ns.len() > 50_000 && (5.0..34.92).contains(&largest), "{largest} rad/s");
}
