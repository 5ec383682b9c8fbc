//! What came of each frame and instant, in memory that does not grow.

use crate::film::{INTERVAL_NS, RATE_HZ, time_ns};
use std::sync::atomic::{AtomicU8, Ordering};

/// Of a frame of a camera, two bits of each camera's: came well and in time; and was tracked.
const CAME: [u8; 2] = [1, 2];
const TRACKED: [u8; 2] = [4, 8];
/// The computer was late to hand over a frame.
const OVERSLEPT: u8 = 16;
const POSE: u8 = 32;
/// A camera took part in the pose.
const USED: [u8; 2] = [64, 128];

/// One byte for each instant.
#[derive(Debug)]
pub(crate) struct Log(Vec<AtomicU8>);

/// What is known of an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry(u8);

impl Entry {
    pub(crate) fn came(self, camera: usize) -> bool {
        self.0 & CAME[camera] != 0
    }

    pub(crate) fn was_tracked(self, camera: usize) -> bool {
        self.0 & TRACKED[camera] != 0
    }

    pub(crate) fn used(self, camera: usize) -> bool {
        self.0 & USED[camera] != 0
    }

    pub(crate) fn has_pose(self) -> bool {
        self.0 & POSE != 0
    }

    /// Whether both cameras saw it well, and the computer handed both frames over when they were due.
    pub(crate) fn was_seen_by_both(self) -> bool {
        self.came(0) && self.came(1) && self.0 & OVERSLEPT == 0
    }
}

impl Log {
    pub(crate) fn new(frames: u64) -> Self {
        Self((0..frames).map(|_| AtomicU8::new(0)).collect())
    }

    fn set(&self, frame: u64, bits: u8) {
        if let Some(entry) = usize::try_from(frame).ok().and_then(|k| self.0.get(k)) {
            entry.fetch_or(bits, Ordering::Relaxed);
        }
    }

    pub(crate) fn arrived(&self, camera: usize, frame: u64, is_due: bool) {
        self.set(frame, CAME[camera] | if is_due { 0 } else { OVERSLEPT });
    }

    pub(crate) fn tracked(&self, camera: usize, stamp_ns: i64) {
        self.at(stamp_ns).into_iter().for_each(|frame| self.set(frame, TRACKED[camera]));
    }

    pub(crate) fn pose(&self, t_ns: i64) {
        self.at(t_ns).into_iter().for_each(|frame| self.set(frame, POSE));
    }

    pub(crate) fn used(&self, camera: usize, t_ns: i64) {
        self.at(t_ns).into_iter().for_each(|frame| self.set(frame, USED[camera]));
    }

    /// The frame of a time; none between frames.
    fn at(&self, t_ns: i64) -> Option<u64> {
        let frame = (t_ns as f64 * 1e-9 * RATE_HZ).round();
        let near = (time_ns(frame as u64) - t_ns).abs() < INTERVAL_NS / 1000;
        (near && frame >= 0.0).then_some(frame as u64)
    }

    pub(crate) fn entries(&self) -> impl Iterator<Item = Entry> {
        self.0.iter().map(|e| Entry(e.load(Ordering::Relaxed)))
    }
}
