//! Each reader finds what another program's reader finds in the same file: pyulog, pymavlink's DFReader, and
//! for the Crazyflie its documented layout by Python's struct module.
//!
//! The interpreter is MAVSIGHT_PYTHON, or python3; a reader whose package it has not is skipped with a
//! message.

mod common;

use mavsight_log::{Log, LogFormat};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// What the other reader finds; `None` where it is not to be had.
fn other(case: &str, file: &Path) -> Option<Value> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/readers.py");
    let python = std::env::var("MAVSIGHT_PYTHON").unwrap_or_else(|_| "python3".into());
    let Ok(output) = Command::new(&python).args([script, case]).arg(file).output() else {
        println!("skipped: {python} does not start; name one by MAVSIGHT_PYTHON");
        return None;
    };
    let printed = String::from_utf8_lossy(&output.stdout);
    if output.status.code() == Some(77) {
        println!("skipped: {python}: {printed}");
        return None;
    }
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // What a program prints before is none of it.
    let last = printed.lines().last().expect("a line").replace("NaN", "null");
    Some(serde_json::from_str(&last).expect("JSON"))
}

fn is_one(own: f64, others: &Value) -> bool {
    others.as_f64().map_or(own.is_nan(), |other| (own - other).abs() <= 1e-9 * other.abs().max(1e-6))
}

/// Compares a file with another reader; how many topics both have, 0 where there is no other reader.
fn compare(case: &str, format: LogFormat, file: &Path) -> usize {
    let mut source = std::fs::File::open(file).expect("the log");
    let log = Log::read(&mut source, &|_, _, _| true).expect("read");
    assert!(log.format == format && log.notes.iter().all(|note| note.contains("slow")), "{:?}", log.notes);
    let Some(found) = other(case, file) else { return 0 };
    let topics = found["topics"].as_object().expect("topics");
    for (name, other) in topics {
        let (name, instance) = name.split_once(' ').expect("an instance");
        let instance = instance.parse().expect("a number");
        let stream = log.stream(name, Some(instance)).expect("the topic");
        let times: Vec<i64> =
            other["t_ns"].as_array().expect("times").iter().map(|t| t.as_i64().expect("ns")).collect();
        assert_eq!(stream.times_ns, times, "{name}");
        let columns = other["columns"].as_object().expect("columns");
        assert_eq!(columns.len(), stream.columns.len(), "{name}: {:?}", columns.keys());
        for (field, values) in columns {
            let own = stream.column(field).expect("the field");
            let values = values.as_array().expect("values");
            assert_eq!(own.values().count(), values.len(), "{name} {field}");
            let unlike = own.values().zip(values).position(|(own, other)| !is_one(own, other));
            assert_eq!(unlike, None, "{name} {field}");
            if let Some(unit) = other["units"][field].as_str() {
                let own = own.unit.as_deref().unwrap_or("").replace("m/s2", "m/s/s");
                assert!(
                    own == unit
                        || unit == "instance"
                        || unit.ends_with(&own) && own == "deg"
                        || unit.starts_with("deg") && own == "deg",
                    "{name} {field}: {own}, {unit}"
                );
            }
        }
    }
    for (name, value) in found["parameters"].as_object().expect("parameters") {
        let own = log
            .parameters
            .iter()
            .find(|(n, _)| n == name)
            .expect("the parameter")
            .1
            .parse::<f64>()
            .expect("a number");
        assert!((own - value.as_f64().expect("a number")).abs() < 1e-6, "{name}");
    }
    topics.len()
}

fn small(case: &str, format: LogFormat) -> Log {
    let (_, bytes) = common::small_logs().into_iter().find(|(name, _)| *name == case).expect("a log");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join(case);
    std::fs::write(&file, &bytes).expect("written");
    println!("{case}: {} topics are alike", compare(case, format, &file));
    Log::read(&mut &bytes[..], &|_, _, _| true).expect("read")
}

#[test]
fn ulog_is_as_pyulog_reads_it() {
    let log = small("ulog", LogFormat::Ulog);
    let gyro = log.topic("sensor_gyro", Some(0)).expect("the topic");
    assert_eq!((gyro.samples, gyro.gaps, gyro.fields[1].unit.as_deref()), (200, 0, Some("rad/s")));
    assert!((gyro.rate_hz.expect("a rate") - 800.0).abs() < 1e-6);
    let outputs = log.topic("actuator_outputs", None).expect("the topic");
    let gap = outputs.longest_gap.expect("a gap");
    assert_eq!((outputs.gaps, gap.length_ns, gap.at_ns), (1, 55_000_000, 2_095_300_000));
    assert!(log.notes[0].contains("lost data 1 times, 0.020 s"), "{:?}", log.notes);
    assert_eq!(
        log.stream("esc_status", None).expect("the topic").column("esc[1].esc_rpm").expect("it").value(1),
        5080.0
    );
}

#[test]
fn dataflash_is_as_pymavlink_reads_it() {
    let log = small("dataflash", LogFormat::Dataflash);
    let esc = log.stream("ESC", Some(1)).expect("the topic");
    let volt = esc.column("Volt").expect("it");
    assert_eq!((volt.value(0), volt.unit.as_deref()), (11.5, Some("V")));
    let roll = log.stream("ATT", None).expect("the topic").column("Roll").expect("it");
    assert_eq!((roll.value(0), roll.unit.as_deref()), (-12.34, Some("deg")));
}

#[test]
fn usdlog_is_as_its_layout_says() {
    small("crazyflie", LogFormat::Crazyflie);
    let data = std::env::var("MAVSIGHT_DATA").unwrap_or_else(|_| "../../../shared/data".into());
    for name in ["log10", "log16"] {
        let file = Path::new(&data).join("crazyflie").join(name);
        if file.is_file() {
            assert!(compare("crazyflie", LogFormat::Crazyflie, &file) <= 1);
        } else {
            println!("skipped: there is no {}", file.display());
        }
    }
}
