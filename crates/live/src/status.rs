//! The flight's knowledge of one camera.

use crate::Latencies;
use crate::state::CameraStates;

/// Frames over which a camera's usual lateness is the median.
const LATENESS_FRAMES: usize = 31;

/// The flight's knowledge of one camera.
pub(crate) struct CameraStatus {
    pub(crate) states: CameraStates,
    /// Latest latenesses of its frames, a ring buffer.
    lateness_ns: Vec<i64>,
    next: usize,
    /// Median lateness.
    pub(crate) usual_ns: i64,
    /// Whether the flight goes on without it.
    pub(crate) is_left_out: bool,
    pub(crate) ended: bool,
    /// Since the last report: frames, frames in which each marker was identified, instants, latencies.
    pub(crate) frames: u64,
    pub(crate) markers: Vec<u64>,
    pub(crate) instants: u64,
    pub(crate) latency: Latencies,
    /// When its source was last opened, and interrupted.
    pub(crate) opened_ns: Option<i64>,
    pub(crate) interrupted_ns: i64,
    /// When a jump back of its stamps was last reported.
    pub(crate) went_back_ns: Option<i64>,
    /// Time of its latest frame.
    pub(crate) latest_ns: i64,
}

impl CameraStatus {
    pub(crate) fn new(markers: usize) -> Self {
        Self {
            states: CameraStates::default(),
            lateness_ns: Vec::with_capacity(LATENESS_FRAMES),
            next: 0,
            usual_ns: 0,
            is_left_out: false,
            ended: false,
            frames: 0,
            markers: vec![0; markers],
            instants: 0,
            latency: Latencies::default(),
            opened_ns: None,
            interrupted_ns: i64::MIN,
            went_back_ns: None,
            latest_ns: i64::MIN,
        }
    }

    /// Adds the lateness of a frame.
    pub(crate) fn arrived(&mut self, lateness_ns: i64) {
        if self.lateness_ns.len() < LATENESS_FRAMES {
            self.lateness_ns.push(lateness_ns);
        } else {
            self.lateness_ns[self.next] = lateness_ns;
        }
        self.next = (self.next + 1) % LATENESS_FRAMES;
        let mut sorted = self.lateness_ns.clone();
        let middle = sorted.len() / 2;
        self.usual_ns = *sorted.select_nth_unstable(middle).1;
    }
}
