//! What a flight keeps of each camera.

use crate::{CameraStates, Latencies};

/// Frames over which a camera's usual lateness is the median.
pub(crate) const LATENESS_FRAMES: usize = 31;

/// What the flight keeps of one camera.
pub(crate) struct Seat {
    pub(crate) states: CameraStates,
    /// Latest latenesses of its frames, and where the next goes.
    pub(crate) lateness_ns: Vec<i64>,
    pub(crate) next: usize,
    pub(crate) usual_ns: i64,
    /// Whether the chain goes on without it.
    pub(crate) is_left: bool,
    pub(crate) ended: bool,
    /// Since the last telling: frames, those in which each marker was told, latencies.
    pub(crate) frames: u64,
    pub(crate) markers: Vec<u64>,
    pub(crate) instants: u64,
    pub(crate) latency: Latencies,
    /// When its source was last opened, and made to end.
    pub(crate) opened_ns: Option<i64>,
    pub(crate) interrupted_ns: i64,
    /// When it was last told that its stamps went back.
    pub(crate) went_back_ns: Option<i64>,
    /// Its latest frame's own time.
    pub(crate) latest_ns: i64,
}

impl Seat {
    pub(crate) fn new(markers: usize) -> Self {
        Self {
            states: CameraStates::default(),
            lateness_ns: Vec::with_capacity(LATENESS_FRAMES),
            next: 0,
            usual_ns: 0,
            is_left: false,
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

    pub(crate) fn came(&mut self, lateness_ns: i64, scratch: &mut Vec<i64>) {
        if self.lateness_ns.len() < LATENESS_FRAMES {
            self.lateness_ns.push(lateness_ns);
        } else {
            self.lateness_ns[self.next] = lateness_ns;
        }
        self.next = (self.next + 1) % LATENESS_FRAMES;
        scratch.clear();
        scratch.extend_from_slice(&self.lateness_ns);
        let middle = scratch.len() / 2;
        self.usual_ns = *scratch.select_nth_unstable(middle).1;
    }
}
