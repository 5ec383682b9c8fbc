//! What a listener of the flight hears, set against what was filmed.

use crate::faults::{Fault, Kind};
use crate::film::{INTERVAL_NS, RATE_HZ, largest_ratio};
use crate::log::Log;
use mavsight::link::{CameraState, Event, Fix};
use mavsight::live::{FlightClock, Listener};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

/// Standard deviations beyond which a pose is wrong.
const BEYOND: f64 = 5.0;
/// Wrong poses that are listed.
const LISTED: usize = 24;

/// Errors of poses.
#[derive(Debug, Default, Clone)]
pub(crate) struct Errors {
    pub(crate) poses: u64,
    pub(crate) beyond: u64,
    pub(crate) largest: f64,
}

/// What was said of one kind of fault: how often, and after how many frames for the first time in each fault.
#[derive(Debug, Default)]
pub(crate) struct Words {
    pub(crate) after: Vec<f64>,
}

/// All that was heard.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    pub(crate) well: Errors,
    /// While a clock was wrong.
    pub(crate) by_wrong_clock: Errors,
    /// By kind of fault and what was said.
    pub(crate) said: BTreeMap<(&'static str, String), Words>,
    /// For each fault, after how many frames anything was said.
    pub(crate) first: BTreeMap<usize, f64>,
    /// Longest median of a second of the time that tracking took, by kind of fault, ms.
    pub(crate) tracking_ms: BTreeMap<&'static str, f64>,
    /// What was said of a camera that had no fault.
    pub(crate) unfounded: BTreeMap<String, u64>,
    pub(crate) wrong: Vec<String>,
}

/// A listener.
pub(crate) struct Ear {
    pub(crate) clock: FlightClock,
    pub(crate) faults: Arc<Vec<Fault>>,
    pub(crate) names: Vec<String>,
    pub(crate) log: Arc<Log>,
    pub(crate) heard: Arc<Mutex<Heard>>,
    /// What was last said of each camera.
    pub(crate) states: Vec<Option<String>>,
}

/// In a few words what is said of a camera.
fn in_short(state: CameraState, reason: Option<&String>) -> Option<String> {
    let reason = reason.map_or("", String::as_str);
    let words = match state {
        CameraState::Running => return None,
        CameraState::Stalled if reason.starts_with("no frame for") => "no frame",
        CameraState::Gone => "gone",
        CameraState::Starting => "starting",
        CameraState::Dark if reason.contains("black") => "dark",
        CameraState::Frozen => "frozen",
        CameraState::Moved if reason.contains("clock") => "moved, or its clock was set",
        _ => reason.split([':', ';']).next().unwrap_or("?"),
    };
    Some(words.to_owned())
}

impl Ear {
    /// The fault that began last, if it is of that camera.
    fn fault(&self, camera: usize, now_ns: i64) -> Option<usize> {
        let onset = |f: &Fault| f.onset_ns.load(Ordering::Relaxed);
        let last = self.faults.partition_point(|f| f.frames.0 as f64 / RATE_HZ * 1e9 <= now_ns as f64);
        let last = last.checked_sub(1)?;
        (self.faults[last].cameras[camera] && onset(&self.faults[last]) <= now_ns).then_some(last)
    }

    fn took(&self, camera: usize, latency_ms: f64) {
        let kind = self.fault(camera, self.clock.now_ns()).map_or("", |k| self.faults[k].kind.words());
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        let most = heard.tracking_ms.entry(kind).or_default();
        *most = most.max(latency_ms);
    }

    fn hear(&self, camera: usize, words: String) {
        let now_ns = self.clock.now_ns();
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(number) = self.fault(camera, now_ns) else {
            *heard.unfounded.entry(words).or_default() += 1;
            return;
        };
        let fault = &self.faults[number];
        let onset_ns = fault.onset_ns.load(Ordering::Relaxed);
        let after = (now_ns - onset_ns) as f64 / INTERVAL_NS as f64;
        heard.first.entry(number).or_insert(after);
        heard.said.entry((fault.kind.words(), words)).or_default().after.push(after);
    }
}

impl Listener for Ear {
    fn fix(&mut self, fix: &Fix) {
        let Some(pose) = &fix.measured else { return };
        let t_ns = self.clock.flight_ns(fix.captured_ns);
        self.log.pose(t_ns);
        let ratio = largest_ratio(t_ns as f64 * 1e-9, &pose.world_from_body, &pose.covariance);
        let frame = t_ns as f64 * 1e-9 * RATE_HZ;
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        let has_wrong_time = self.faults.iter().any(|f| f.has_wrong_times(frame));
        let errors = if has_wrong_time { &mut heard.by_wrong_clock } else { &mut heard.well };
        errors.poses += 1;
        errors.largest = errors.largest.max(ratio);
        if ratio.is_nan() || ratio > BEYOND {
            errors.beyond += 1;
            if heard.wrong.len() < LISTED {
                let last = self.faults.iter().rev().find(|f| f.frames.0 as f64 <= frame);
                let after = last.map_or(frame, |f| frame - f.frames.0 as f64);
                let kind = last.map_or("none", |f| f.kind.words());
                heard
                    .wrong
                    .push(format!("{:.3} s: {ratio:.1}, {after:.0} frames after {kind}", frame / RATE_HZ));
            }
        }
    }

    fn event(&mut self, event: &Event) {
        match event {
            Event::Detections { camera, t_s, seen } if seen.iter().any(|ball| ball.marker.is_some()) => {
                self.log.used(*camera, (t_s * 1e9).round() as i64);
            }
            Event::Camera { camera, state, reason, latency_ms, .. } => {
                self.took(*camera, *latency_ms);
                let words = in_short(*state, reason.as_ref());
                if self.states[*camera] != words {
                    self.states[*camera].clone_from(&words);
                    words.into_iter().for_each(|words| self.hear(*camera, words));
                }
            }
            Event::Note { fault: true, text, .. } => {
                let named = self.names.iter().position(|name| text.starts_with(name.as_str()));
                let name = named.map_or("", |k| self.names[k].as_str());
                let words = text.strip_prefix(name).unwrap_or(text).trim_start_matches([':', ' ']);
                // Without its figures.
                let words: String = words.chars().filter(|c| !c.is_ascii_digit()).take(48).collect();
                self.hear(named.unwrap_or(0), format!("\"{words}\""));
            }
            _ => {}
        }
    }
}

/// Whether what is said names another cause than the true one.
pub(crate) fn is_wrong(kind: Kind, words: &str) -> bool {
    use Kind::{Blurred, ClockStep, Dark, Dropped, Duplicated, Frozen, Hidden, Late};
    use Kind::{Noisy, Overexposed, Reordered, Silent, Unplugged};
    let right: &[Kind] = match words {
        "no frame" => &[Dropped, Late, Reordered, Silent, Unplugged],
        // What sends nothing new for long is opened again.
        "gone" | "starting" => &[Silent, Unplugged, Frozen],
        "dark" => &[Dark],
        "frozen" => &[Frozen],
        _ if words.contains("clock") => &[ClockStep],
        _ if words.contains("in its turn") => &[Dropped, Reordered],
        // That is true of the computer that flies, whatever befalls the cameras.
        _ if words.contains("newer ones") => return false,
        _ if words.contains("one image") => &[Frozen, Duplicated],
        _ if words.contains("twice") => &[Duplicated],
        _ if words.contains("order") => &[Reordered],
        _ if words.contains("none of the balls") => &[Dark, Overexposed, Noisy, Blurred, Hidden],
        _ => &[],
    };
    !right.contains(&kind)
}
