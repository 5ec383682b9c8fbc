//! Reads mutated logs, as many of each format as are asked for, and prints how they ended, the slowest, and the
//! most memory that the process had.
//!
//! `cargo run --release -p mavsight-log --example mutate -- 1000000`

#[path = "../tests/common/mod.rs"]
mod common;

use mavsight_log::Log;
use mavsight_random::Random;
use std::time::{Duration, Instant};

fn main() {
    let count: u64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(100_000);
    let mut all_ended = true;
    for (name, log) in common::small_logs() {
        let (mut read, mut refused, mut panics, mut slowest) = (0_u64, 0_u64, 0_u64, Duration::ZERO);
        let mut random = Random::new(1, 0);
        for _ in 0..count {
            let mutated = common::mutated(&log, &mut random);
            let begun = Instant::now();
            match std::panic::catch_unwind(|| Log::read(&mut &mutated[..], &|_, _, _| true).is_ok()) {
                Ok(true) => read += 1,
                Ok(false) => refused += 1,
                Err(_) => panics += 1,
            }
            slowest = slowest.max(begun.elapsed());
        }
        let slowest_ms = slowest.as_secs_f64() * 1e3;
        println!(
            "{name}: {read} read, {refused} refused, {panics} panics, slowest {slowest_ms:.1} ms{}",
            memory()
        );
        all_ended &= panics == 0;
    }
    std::process::exit(i32::from(!all_ended));
}

/// The most memory that the process had, where the system says it.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).map(str::trim);
    peak.map_or(String::new(), |peak| format!(", at most {peak} of memory"))
}
