//! A live flight in real time whose cameras fail every ten seconds: which instants are lost, which poses are
//! wrong, what is said of each fault and how soon, and whether memory grows.
//!
//! `cargo run --release -p mavsight --example faulty_live -- MINUTES [SEED] [FAULT]`
//!
//! Two cameras of 640x480 film eight seconds of the virtual room once, which are then played over and over at
//! 30 Hz through the sources, queues, trackers and listeners of a live flight. The truth is this program's
//! alone.

mod camera;
mod faults;
mod film;
mod log;
mod said;
mod spoil;
mod summary;

use crate::faults::{Kind, schedule};
use crate::film::{Film, RATE_HZ};
use crate::log::Log;
use crate::said::{Ear, Heard};
use anyhow::{Context, Result};
use mavsight::live::{FlightClock, Listeners, Pace, Setup, fly};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The allocator of the program.
#[cfg(target_os = "linux")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> Result<()> {
    let mut given = std::env::args().skip(1);
    let minutes: f64 = given.next().context("MINUTES [SEED] [FAULT]")?.parse().context("MINUTES")?;
    let seed: u64 = given.next().map_or(Ok(37), |text| text.parse()).context("SEED")?;
    let only = given.next().map(|words| Kind::of(&words)).transpose()?;
    anyhow::ensure!((0.2..=1e4).contains(&minutes), "{minutes} minutes: give 0.2 to 10000");
    let seconds = 60.0 * minutes;
    let film = Arc::new(Film::new(seed)?);
    let frames = (seconds * RATE_HZ) as u64;
    let (faults, log) = (Arc::new(schedule(seed, frames, only)), Arc::new(Log::new(frames)));
    let heard = Arc::new(Mutex::new(Heard::default()));
    let clock = FlightClock::starting_at(0);
    let names: Vec<String> = film.rig.cameras.iter().map(|c| c.name.clone()).collect();
    let mut listeners = Listeners::default();
    listeners.add(Box::new(Ear {
        clock,
        faults: Arc::clone(&faults),
        names,
        log: Arc::clone(&log),
        heard: Arc::clone(&heard),
        states: vec![None; 2],
    }))?;
    let tracked = Arc::clone(&log);
    let stop = Arc::new(AtomicBool::new(false));
    let memory = std::thread::spawn({
        let (stop, clock) = (Arc::clone(&stop), clock);
        move || resident(clock, seconds, &stop)
    });
    let flown = fly(Setup {
        name: "faulty",
        rig: &film.rig,
        vehicle: &film.vehicle,
        cameras: (0..2).map(|k| camera::setup(k, &film, &faults, &log, seed)).collect(),
        pace: Pace::Own,
        clock,
        noise: None,
        listeners,
        taps: vec![Arc::new(move |camera, stamp_ns, _, _| tracked.tracked(camera, stamp_ns))],
        recorder: Default::default(),
        inputs: None,
        equations: None,
        enough: 0.05,
        stop: Arc::clone(&stop),
        for_ns: Some((seconds * 1e9) as i64),
    })?;
    stop.store(true, Ordering::Relaxed);
    let memory = memory.join().ok().context("the memory was not measured")?;
    let heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
    let entries: Vec<_> = log.entries().collect();
    summary::print(&flown, &entries, &faults, &heard, memory);
    Ok(())
}

/// Resident memory after a minute, or a third of a shorter flight, and at the end; MB.
fn resident(clock: FlightClock, seconds: f64, stop: &AtomicBool) -> Option<(f64, f64)> {
    let after = |from_s: f64| {
        while (clock.now_ns() as f64) < from_s * 1e9 && !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        Some(line.trim().trim_end_matches(" kB").parse::<f64>().ok()? / 1024.0)
    };
    Some((after((seconds / 3.0).min(60.0))?, after(seconds - 0.5)?))
}
