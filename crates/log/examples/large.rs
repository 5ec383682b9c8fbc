//! Writes a ULog of so many megabytes, as PX4 logs at high rates, and reads the motor outputs of it: time and
//! memory.
//!
//! `cargo run --release -p mavsight-log --example large -- large.ulg 1000`

#[path = "../tests/common/ulog.rs"]
#[allow(dead_code)] // The small log is for tests.
mod ulog;

use mavsight_log::Log;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::time::Instant;
use ulog::Ulog;

/// Topics with their instances, the length of a sample without its time, and how many samples there are
/// between two.
const TOPICS: [(&str, u8, usize, u64); 7] = [
    ("sensor_combined", 0, 40, 1),
    ("vehicle_angular_velocity", 0, 32, 1),
    ("vehicle_attitude", 0, 44, 2),
    ("actuator_outputs", 0, 68, 2),
    ("actuator_motors", 0, 60, 2),
    ("vehicle_local_position", 0, 160, 8),
    ("esc_status", 0, 120, 8),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or_else(|| "large.ulg".to_owned());
    let megabytes: u64 = arguments.next().map_or(Ok(1000), |text| text.parse())?;
    let mut log = Ulog::new();
    for (number, (name, instance, length, _)) in TOPICS.iter().enumerate() {
        let floats = (length - 4) / 4;
        let field = if *name == "actuator_outputs" { "output" } else { "value" };
        log.format(&format!("{name}:uint64_t timestamp;uint32_t count;float[{floats}] {field};"));
        log.subscribe(number as u16, *instance, name);
    }
    let mut out = BufWriter::new(File::create(&path)?);
    let (mut written, mut k) = (0, 0_u64);
    while written < megabytes * 1_000_000 {
        for (number, (_, _, length, each)) in TOPICS.iter().enumerate() {
            if k.is_multiple_of(*each) {
                let value = (1000.0 + (k % 1000) as f32).to_le_bytes();
                // Four outputs are used.
                let mut sample: Vec<u8> = value.iter().copied().cycle().take((*length).min(20)).collect();
                sample.resize(*length, 0);
                log.sample(number as u16, 1250 * k, &sample);
            }
        }
        k += 1;
        written += log.0.len() as u64;
        out.write_all(&log.0)?;
        log.0.clear();
    }
    out.into_inner()?.sync_all()?;
    for (what, wanted) in [("listed", ""), ("motor outputs", "actuator_outputs")] {
        let begun = Instant::now();
        let log = Log::read(&mut File::open(&path)?, &|topic, _, field| {
            topic == wanted && ["output[0]", "output[1]", "output[2]", "output[3]"].contains(&field)
        })?;
        let samples: u64 = log.topics.iter().map(|t| t.samples).sum();
        println!(
            "{what}: {written} bytes, {samples} samples in {:.2} s{}",
            begun.elapsed().as_secs_f64(),
            memory()
        );
    }
    Ok(())
}

/// The most memory that the process had, where the system says it.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).map(str::trim);
    peak.map_or(String::new(), |peak| format!(", at most {peak} of memory"))
}
