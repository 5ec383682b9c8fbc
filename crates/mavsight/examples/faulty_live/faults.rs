//! What happens to the cameras, and when.

use crate::film::{RATE_HZ, time_ns};
use anyhow::{Context, Result};
use mavsight::random::Random;
use std::sync::atomic::{AtomicI64, Ordering};

/// What a live camera does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Dropped,
    Late,
    Reordered,
    Duplicated,
    Silent,
    Unplugged,
    Frozen,
    Dark,
    Overexposed,
    Noisy,
    Blurred,
    Hidden,
    ClockStep,
}

impl Kind {
    pub(crate) const ALL: [Self; 13] = [
        Self::Dropped,
        Self::Late,
        Self::Reordered,
        Self::Duplicated,
        Self::Silent,
        Self::Unplugged,
        Self::Frozen,
        Self::Dark,
        Self::Overexposed,
        Self::Noisy,
        Self::Blurred,
        Self::Hidden,
        Self::ClockStep,
    ];

    /// The kind that is called so.
    pub(crate) fn of(words: &str) -> Result<Self> {
        let known = || Self::ALL.map(Self::words).join(", ");
        let found = Self::ALL.into_iter().find(|kind| kind.words() == words);
        found.with_context(|| format!("there is no fault \"{words}\": give one of {}", known()))
    }

    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Dropped => "frames dropped",
            Self::Late => "frames late",
            Self::Reordered => "frames reordered",
            Self::Duplicated => "frames twice",
            Self::Silent => "silent",
            Self::Unplugged => "unplugged",
            Self::Frozen => "frozen",
            Self::Dark => "dark",
            Self::Overexposed => "overexposed",
            Self::Noisy => "noisy",
            Self::Blurred => "blurred",
            Self::Hidden => "balls hidden",
            Self::ClockStep => "clock step",
        }
    }
}

/// Seconds from one fault to the next.
const EVERY_S: f64 = 10.0;
/// Until the cameras run and have been seen well.
const QUIET_S: f64 = 5.0;
const LENGTH_S: (f64, f64) = (0.1, 4.0);
/// Share of the faults that befall both cameras.
const BOTH: f64 = 0.05;

/// One fault.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) kind: Kind,
    pub(crate) cameras: [bool; 2],
    /// First frame, and the first one after it.
    pub(crate) frames: (u64, u64),
    /// From 0 to 1.
    pub(crate) strength: f64,
    /// One of two ways in which it may be.
    pub(crate) is_other_way: bool,
    /// When the first frame was due that it changed; `i64::MAX` before that.
    pub(crate) onset_ns: AtomicI64,
}

impl Fault {
    pub(crate) fn is_at(&self, camera: usize, frame: u64) -> bool {
        self.cameras[camera] && (self.frames.0..self.frames.1).contains(&frame)
    }

    /// Notes that it changes a frame.
    pub(crate) fn begins(&self, frame: u64) {
        self.onset_ns.fetch_min(time_ns(frame), Ordering::Relaxed);
    }

    /// By how much it sets a clock: from 3 ms to half a second, forth or back.
    pub(crate) fn step_ns(&self) -> i64 {
        let by_ns = (3e6 * (500.0_f64 / 3.0).powf(self.strength)) as i64;
        if self.is_other_way { -by_ns } else { by_ns }
    }

    /// Frames whose poses may be of a time that a wrong clock gave.
    pub(crate) fn has_wrong_times(&self, frame: f64) -> bool {
        let beyond = self.step_ns().abs() as f64 * 1e-9 * RATE_HZ + 1.0;
        let (from, to) = (self.frames.0 as f64 - beyond, self.frames.1 as f64 + beyond);
        self.kind == Kind::ClockStep && (from..to).contains(&frame)
    }
}

/// The faults of a flight: of one kind, or each as often as every other in random order.
pub(crate) fn schedule(seed: u64, frames: u64, only: Option<Kind>) -> Vec<Fault> {
    let mut random = Random::new(seed, 0);
    let (mut out, mut left) = (Vec::new(), Vec::new());
    let mut from_s = QUIET_S;
    // The last one is over before the end.
    while (from_s + EVERY_S) * RATE_HZ < frames as f64 {
        if left.is_empty() {
            left = only.map_or_else(|| Kind::ALL.to_vec(), |kind| vec![kind]);
        }
        let kind = left.swap_remove((random.uniform() * left.len() as f64) as usize);
        let begin_s = from_s + random.between(0.0, 2.0);
        let end_s = begin_s + random.between(LENGTH_S.0, LENGTH_S.1);
        let camera = usize::from(random.uniform() < 0.5);
        let both = random.uniform() < BOTH;
        out.push(Fault {
            kind,
            cameras: [both || camera == 0, both || camera == 1],
            frames: ((begin_s * RATE_HZ) as u64, (end_s * RATE_HZ) as u64),
            strength: random.uniform(),
            is_other_way: random.uniform() < 0.5,
            onset_ns: AtomicI64::new(i64::MAX),
        });
        from_s += EVERY_S;
    }
    out
}
