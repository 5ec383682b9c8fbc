//! Runs targets on mutated inputs and prints how they ended, the slowest, and the most memory.
//!
//! `cargo run --release -p mavsight-hostile --example mutate -- [--cores N] [TARGET] COUNT [SEED]`
//!
//! Each target has a process of its own, whose end costs one input. An input that ends in a panic, that takes
//! more than a second, or that ends the process is written to a file and named with its number, by which it is
//! drawn again.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_hostile::{Outcome, TARGETS, Target, attempt, input, remember_panics};
use std::io::{BufRead, BufReader};
use std::process::{Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// An input is slow beyond this, and given up beyond ten times this.
const SLOW: Duration = Duration::from_secs(1);

/// Kilobytes that a process may reserve: no input of a few kilobytes needs as much.
const RESERVED_KB: u64 = 4_000_000;

/// Inputs between two lines that say how far a process is.
const STRIDE: u64 = 1000;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let [inner, name, seed, from, to] = &words[..]
        && inner == "--inner"
    {
        let target = target(name).unwrap();
        attack(target, seed.parse().unwrap(), from.parse().unwrap(), to.parse().unwrap());
        return ExitCode::SUCCESS;
    }
    let mut cores = 1;
    let mut rest = &words[..];
    if let [option, count, others @ ..] = rest
        && option == "--cores"
    {
        (cores, rest) = (count.parse().unwrap_or(1), others);
    }
    let targets: Vec<&Target> = match rest.first().and_then(|name| target(name)) {
        Some(one) => vec![one],
        None => TARGETS.iter().collect(),
    };
    let numbers: Vec<u64> = rest.iter().filter_map(|word| word.parse().ok()).collect();
    let (count, seed) = match numbers[..] {
        [count] => (count, 1),
        [count, seed] => (count, seed),
        _ => {
            let names: Vec<&str> = TARGETS.iter().map(|t| t.name).collect();
            eprintln!("mutate [--cores N] [TARGET] COUNT [SEED]; targets: {}", names.join(", "));
            return ExitCode::from(2);
        }
    };
    let (next, faults) = (AtomicUsize::new(0), AtomicU64::new(0));
    let out = Mutex::new(());
    std::thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                while let Some(target) = targets.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let (line, wrong) = campaign(target, seed, count);
                    let _one_at_a_time = out.lock();
                    println!("{line}");
                    faults.fetch_add(wrong, Ordering::Relaxed);
                }
            });
        }
    });
    if faults.into_inner() == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}

/// In a process of its own: prints `panic NUMBER WORDS`, `slow NUMBER`, and how far it is with [`Counts`] at each
/// stride and at the end.
fn attack(target: &'static Target, seed: u64, from: u64, to: u64) {
    static BEGUN: Mutex<Option<(Instant, u64)>> = Mutex::new(None);
    remember_panics();
    let every = if to - from <= STRIDE { 1 } else { STRIDE };
    std::thread::spawn(|| {
        let mut named = u64::MAX;
        loop {
            std::thread::sleep(SLOW / 10);
            let Some((begun, number)) = *BEGUN.lock().unwrap() else { continue };
            if begun.elapsed() > SLOW && named != number {
                println!("slow {number}");
                named = number;
            }
            if begun.elapsed() > 10 * SLOW {
                std::process::exit(3);
            }
        }
    });
    let seeds = (target.seeds)();
    let mut counts = Counts::default();
    for number in from..to {
        if number.is_multiple_of(every) {
            counts.print(number);
        }
        let bytes = input(target, &seeds, seed, number);
        let begun = Instant::now();
        *BEGUN.lock().unwrap() = Some((begun, number));
        match attempt(target, &bytes) {
            Ok(Outcome::Read) => counts.read += 1,
            Ok(Outcome::Refused(_)) => counts.refused += 1,
            Err(words) => println!("panic {number} {}", words.replace('\n', " ")),
        }
        counts.slowest = counts.slowest.max((begun.elapsed().as_micros() as u64, number));
    }
    counts.print(to);
}

/// How a process's inputs ended; what it had counted before it ended is not lost with it.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    read: u64,
    refused: u64,
    /// Microseconds, and the input's number.
    slowest: (u64, u64),
    memory_kb: u64,
}

impl Counts {
    fn print(&self, at: u64) {
        let Self { read, refused, slowest, .. } = self;
        println!("at {at} {read} {refused} {} {} {}", slowest.0, slowest.1, memory_kb());
    }

    fn parsed(words: &str) -> Option<Self> {
        let numbers: Vec<u64> = words.split(' ').filter_map(|n| n.parse().ok()).collect();
        let [read, refused, slowest, number, memory_kb] = numbers[..] else { return None };
        Some(Self { read, refused, slowest: (slowest, number), memory_kb })
    }

    fn with(self, other: Self) -> Self {
        Self {
            read: self.read + other.read,
            refused: self.refused + other.refused,
            slowest: self.slowest.max(other.slowest),
            memory_kb: self.memory_kb.max(other.memory_kb),
        }
    }
}

/// The most memory that the process had, where the system says it.
fn memory_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|peak| peak.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

#[derive(Default)]
struct Found {
    counts: Counts,
    panics: Vec<(u64, String)>,
    slow: Vec<u64>,
    ended: Vec<u64>,
}

/// Runs a target in processes of its own; a line on it, and the number of faults.
fn campaign(target: &Target, seed: u64, count: u64) -> (String, u64) {
    let mut found = Found::default();
    let (mut from, mut to) = (0, count);
    while from < count {
        match process(target, seed, from..to, &mut found) {
            None => (from, to) = (to, count),
            // The process has ended within a stride: its inputs one by one, then the rest.
            Some(at) if to - from > STRIDE => (from, to) = (at, (at + STRIDE).min(to)),
            Some(at) => {
                found.ended.push(at);
                (from, to) = (at + 1, count);
            }
        }
    }
    let Found { counts: Counts { read, refused, slowest, memory_kb }, panics, slow, ended } = &found;
    let mut line = format!(
        "{}: {read} read, {refused} refused, {} panics, {} over 1 s, {} ended the process; slowest {:.1} ms (number {}), at most {:.0} MB; seed {seed}",
        target.name,
        panics.len(),
        slow.len(),
        ended.len(),
        slowest.0 as f64 * 1e-3,
        slowest.1,
        *memory_kb as f64 * 1e-3
    );
    for (number, words) in panics.iter().take(5) {
        line += &format!("\n  panic {}: {words}", file(target, seed, *number));
    }
    for (what, numbers) in [("over 1 s", slow), ("ended the process", ended)] {
        for number in numbers.iter().take(5) {
            line += &format!("\n  {what}: {}", file(target, seed, *number));
        }
    }
    (line, (panics.len() + slow.len() + ended.len()) as u64)
}

/// Writes an input, and names its file.
fn file(target: &Target, seed: u64, number: u64) -> String {
    let name = std::env::temp_dir().join(format!("{}-{seed}-{number}", target.name));
    match std::fs::write(&name, input(target, &(target.seeds)(), seed, number)) {
        Ok(()) => format!("number {number}, {}", name.display()),
        Err(error) => format!("number {number}, not written: {error}"),
    }
}

/// Where the process was when it ended before its time; none where it came to the end.
fn process(target: &Target, seed: u64, numbers: std::ops::Range<u64>, found: &mut Found) -> Option<u64> {
    let program = std::env::current_exe().unwrap();
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {RESERVED_KB}; exec \"$0\" \"$@\"")]).arg(program);
    command.args(["--inner", target.name]);
    command.args([seed, numbers.start, numbers.end].map(|number| number.to_string()));
    // No film of another codec starts a program.
    command.env("MAVSIGHT_FFMPEG", "there-is-no-such-program");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let (mut at, mut counts) = (numbers.start, Counts::default());
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        let mut words = line.splitn(3, ' ');
        let (kind, first) = (words.next().unwrap_or(""), words.next().and_then(|n| n.parse().ok()));
        match (kind, first) {
            ("at", Some(number)) => {
                at = number;
                counts = words.next().and_then(Counts::parsed).unwrap_or(counts);
            }
            ("slow", Some(number)) if !found.slow.contains(&number) => found.slow.push(number),
            ("panic", Some(number)) if found.panics.iter().all(|(known, _)| *known != number) => {
                found.panics.push((number, words.next().unwrap_or("").to_owned()));
            }
            _ => {}
        }
    }
    child.wait().unwrap();
    found.counts = found.counts.with(counts);
    (at < numbers.end).then_some(at)
}
