//! The detections of one instant, and which of them are given to markers.

use crate::{MarkerObservation, TrackedDetection};

/// What all cameras see at one instant.
#[derive(Clone, Copy)]
pub(super) struct Frame<'a> {
    pub(super) t_ns: i64,
    pub(super) seen: &'a [TrackedDetection],
}

/// Indices of detections and of their markers.
pub(super) type Pairs = Vec<(usize, usize)>;

impl Frame<'_> {
    pub(super) fn observations(self, pairs: &Pairs) -> Vec<MarkerObservation> {
        let one = |(k, marker): &(usize, usize)| self.seen[*k].of_marker(*marker);
        pairs.iter().map(one).map(|o| MarkerObservation { t_ns: self.t_ns, ..o }).collect()
    }

    /// Sorts by camera and marker.
    pub(super) fn sort(self, pairs: &mut Pairs) {
        pairs.sort_unstable_by_key(|(k, marker)| (self.seen[*k].camera, *marker));
    }
}
