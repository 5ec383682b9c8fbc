//! Since when a camera was moved that was found to be, by all that it saw before.

use super::associator::{Associator, DECISIVE_LOG_ODDS};
use super::frame::Frame;
use super::history::{Belief, MovedCamera};
use crate::{MarkerObservation, Observations, PoseSample, TrackedDetection};

impl Associator {
    /// The earliest time at which a camera may have been moved: what it saw from there on fits the shift that was found within
    /// odds of 999 to 1 of the time that fits best, and what hid the body before that may have hidden the move. That is the
    /// onset of a shift of known size by the ratio of likelihoods (Page 1954), with its interval.
    pub fn shifted_since_ns(&self, moved: &MovedCamera, seen: &Observations, poses: &[PoseSample]) -> i64 {
        let times_ns: Vec<i64> = seen.times_ns().take_while(|t| *t < moved.t_ns).collect();
        let (mut odds, mut best, mut since_ns) = (0.0, 0.0, moved.t_ns);
        let mut own = Vec::new();
        for t_ns in times_ns.into_iter().rev() {
            seen.at(t_ns, &mut own);
            let near = poses.binary_search_by_key(&t_ns, |p| p.t_ns).ok().map(|k| &poses[k]);
            odds += self.log_odds_of_shift(moved, (t_ns, &own), near).unwrap_or(0.0);
            best = f64::max(best, odds);
            if odds < best - 10.0 * DECISIVE_LOG_ODDS {
                break;
            }
            if odds >= best - DECISIVE_LOG_ODDS {
                since_ns = t_ns;
            }
        }
        since_ns
    }

    /// Logarithm of the odds that a camera's view of the body was shifted as it was found later, against none; `None` where it
    /// cannot be compared with that of the others.
    fn log_odds_of_shift(
        &self,
        moved: &MovedCamera,
        (t_ns, seen): (i64, &[MarkerObservation]),
        near: Option<&PoseSample>,
    ) -> Option<f64> {
        let others: Vec<MarkerObservation> =
            seen.iter().filter(|o| o.camera != moved.camera).copied().collect();
        let near = near.and_then(|p| p.estimate.as_ref().ok()).map(|e| e.world_from_body);
        let by_others = self.estimator.estimate(t_ns, &others, near.as_ref()).ok()?;
        let own = seen.iter().filter(|o| o.camera == moved.camera);
        let candidates: Vec<TrackedDetection> = own.map(|o| self.candidate(o)).collect();
        let shift = self.shift(moved.camera, Frame { t_ns, seen: &candidates }, &Belief::of(&by_others))?;
        let expected = shift.information * moved.shift_px;
        Some(expected.dot(&shift.mean_px) - 0.5 * expected.dot(&moved.shift_px))
    }

    /// An observation as what it was taken from.
    fn candidate(&self, o: &MarkerObservation) -> TrackedDetection {
        TrackedDetection {
            t_ns: o.t_ns,
            camera: o.camera,
            track_id: o.marker as u32,
            color: self.colors[o.marker],
            pixel: o.pixel,
            covariance_px2: o.covariance_px2,
            diameter_px: 0.0,
            is_static: false,
            is_preferred: true,
        }
    }
}
