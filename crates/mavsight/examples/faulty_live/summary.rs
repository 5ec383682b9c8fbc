//! The figures of a flight.

use crate::faults::{Fault, Kind};
use crate::film::RATE_HZ;
use crate::log::Entry;
use crate::said::{Errors, Heard, is_wrong};
use mavsight::live::FlightSummary;

/// Frames within which a fault is to be said.
const SOON: f64 = 2.0;
/// Runs of instants that are listed.
const LISTED: usize = 24;

pub(crate) fn print(
    flown: &FlightSummary,
    entries: &[Entry],
    faults: &[Fault],
    heard: &Heard,
    memory: Option<(f64, f64)>,
) {
    instants(entries, faults);
    let errors = |words: &str, e: &Errors| {
        println!(
            "{words}: {} poses, {} beyond 5 standard deviations, {:.1} at most",
            e.poses, e.beyond, e.largest
        );
    };
    errors("clocks right", &heard.well);
    errors("while a clock is wrong", &heard.by_wrong_clock);
    heard.wrong.iter().for_each(|wrong| println!("  beyond at {wrong}"));
    said(entries, faults, heard);
    for (words, times) in &heard.unfounded {
        println!("said of a camera without a fault: {words}, {times} times");
    }
    println!(
        "latency from the last frame in hand to the pose: median {:.2} ms, 99 % {:.2} ms, at most {:.2} ms; tracking 99 % {:.2} ms",
        flown.latency.quantile_ms(0.5),
        flown.latency.quantile_ms(0.99),
        flown.latency.most_ms(),
        flown.tracking.quantile_ms(0.99)
    );
    println!(
        "frames tracked {:?}, dropped {:?}; {} instants not waited for a camera; events unheard {:?}",
        flown.frames, flown.dropped, flown.not_waited, flown.unheard
    );
    if let Some((first_mb, last_mb)) = memory {
        println!(
            "memory: {first_mb:.1} MB after a minute, {last_mb:.1} MB at the end, {:+.1} MB",
            last_mb - first_mb
        );
    }
}

/// Instants that were seen and what came of them.
fn instants(entries: &[Entry], faults: &[Fault]) {
    let all = || entries.iter().enumerate();
    let seen = || all().filter(|(_, e)| e.was_seen_by_both());
    let is_lost = |e: &Entry| !e.has_pose();
    let dropped = |e: &Entry| !(e.was_tracked(0) && e.was_tracked(1));
    let lost: Vec<usize> = seen().filter(|(_, e)| is_lost(e)).map(|(k, _)| k).collect();
    let of_computer = lost.iter().filter(|k| dropped(&entries[**k])).count();
    println!(
        "{} instants; two cameras saw {}; lost {} ({of_computer} of them as a frame was dropped)",
        entries.len(),
        seen().count(),
        lost.len()
    );
    list(&lost, faults);
    let alone = |e: &Entry| e.has_pose() && !(e.used(0) && e.used(1));
    let by_one: Vec<usize> = seen().filter(|(_, e)| alone(e)).map(|(k, _)| k).collect();
    println!("two cameras saw, the pose is by one: {}", by_one.len());
    list(&by_one, faults);
    let one = |e: &&Entry| e.came(0) != e.came(1);
    let with_pose = entries.iter().filter(one).filter(|e| e.has_pose()).count();
    println!("one camera alone saw {}, of these {with_pose} with a pose", entries.iter().filter(one).count());
    println!("longest time without a pose after both are well again: {:.2} s", longest_s(entries));
}

fn list(frames: &[usize], faults: &[Fault]) {
    for (from, count) in runs(frames).into_iter().take(LISTED) {
        println!("  {count} from {:.3} s, {}", from as f64 / RATE_HZ, since(faults, from));
    }
}

/// The last fault before a frame.
fn since(faults: &[Fault], frame: usize) -> String {
    let last = faults.iter().rev().find(|f| f.frames.0 <= frame as u64);
    last.map_or("before any fault".into(), |f| {
        let from = |n: u64| frame as i64 - n as i64;
        format!(
            "{} frames after the beginning of {}, {} after its end",
            from(f.frames.0),
            f.kind.words(),
            from(f.frames.1)
        )
    })
}

/// Frames one after the other: the first, and how many.
fn runs(frames: &[usize]) -> Vec<(usize, usize)> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for k in frames {
        match out.last_mut().filter(|r| r.0 + r.1 == *k) {
            Some(run) => run.1 += 1,
            None => out.push((*k, 1)),
        }
    }
    out
}

/// The longest time from an instant that both see to a pose.
fn longest_s(entries: &[Entry]) -> f64 {
    let (mut without, mut most) = (0_u32, 0);
    for e in entries {
        without = match () {
            () if e.has_pose() => 0,
            () if without > 0 || e.was_seen_by_both() => without + 1,
            () => 0,
        };
        most = most.max(without);
    }
    f64::from(most) / RATE_HZ
}

/// What was said of each kind of fault, and how soon.
fn said(entries: &[Entry], faults: &[Fault], heard: &Heard) {
    println!(
        "\n{:<17} {:>6} {:>8} {:>7} {:>9} {:>9} {:>7} {:>7} {:>9}",
        "fault", "times", "silent", "late", "median", "at most", "pose %", "used %", "track ms"
    );
    for kind in Kind::ALL {
        let own: Vec<usize> = (0..faults.len()).filter(|k| faults[*k].kind == kind).collect();
        let mut after: Vec<f64> = own.iter().filter_map(|k| heard.first.get(k)).copied().collect();
        after.sort_by(f64::total_cmp);
        let late = after.iter().filter(|a| **a > SOON).count();
        let (median, most) = (after.get(after.len() / 2), after.last());
        let frames = |n: Option<&f64>| n.map_or("-".into(), |n| format!("{n:.1}"));
        let Shares { with_pose, used } = shares(entries, faults, kind);
        let tracking_ms = heard.tracking_ms.get(kind.words());
        println!(
            "{:<17} {:>6} {:>8} {late:>7} {:>9} {:>9} {with_pose:>7.1} {used:>7.1} {:>9.1}",
            kind.words(),
            own.len(),
            own.len() - after.len(),
            frames(median),
            frames(most),
            tracking_ms.unwrap_or(&0.0)
        );
        for ((_, words), said) in heard.said.iter().filter(|s| s.0.0 == kind.words()) {
            let first = said.after.iter().copied().fold(f64::INFINITY, f64::min);
            let wrong = if is_wrong(kind, words) { "; WRONG" } else { "" };
            println!("    {words}: {} times, the earliest after {first:.1} frames{wrong}", said.after.len());
        }
    }
    println!(
        "late: said after more than {SOON} frames; median, at most: frames until something is said; pose: share of the \
         instants with a pose;\nused: of all, those to whose pose a camera with the fault contributed; track: longest median of \
         a second\n"
    );
}

/// Parts of the instants of a kind's faults, in percent.
struct Shares {
    with_pose: f64,
    /// To whose pose a camera with the fault contributed.
    used: f64,
}

fn shares(entries: &[Entry], faults: &[Fault], kind: Kind) -> Shares {
    let (mut all, mut with_pose, mut used) = (0_u32, 0_u32, 0_u32);
    for fault in faults.iter().filter(|f| f.kind == kind) {
        for entry in entries.iter().take(fault.frames.1 as usize).skip(fault.frames.0 as usize) {
            all += 1;
            with_pose += u32::from(entry.has_pose());
            used += u32::from((0..2).any(|camera| fault.cameras[camera] && entry.used(camera)));
        }
    }
    let percent = |n: u32| 100.0 * f64::from(n) / f64::from(all.max(1));
    Shares { with_pose: percent(with_pose), used: percent(used) }
}
