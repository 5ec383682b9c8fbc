//! Frames that have exchanged their time stamps with their neighbours.
//!
//! A ball that flies from left to right steps back and forth in its image where two frames have come in the other's place. Six
//! frames around the two say where it is by their fifth difference, which is zero for any motion of the fourth order: what is left of it
//! in one order and in the other says which of them happened.

use super::{StoredDetection, Stream};
use crate::clock_step::{DECISIVE, OUT_OF_BEAT};
use mavsight_geometry::Vector2;
use mavsight_pose::median;
use std::collections::BTreeMap;

/// Weights of the fifth difference, whose squares add up to 252.
const FIFTH: [f64; 6] = [1.0, -5.0, 10.0, -10.0, 5.0, -1.0];
const FIFTH_SQUARES: f64 = 252.0;

/// Frames before the two.
const BEFORE: usize = 2;

impl Stream {
    /// Gives neighbouring frames each other's time stamps where that brings the balls' images onto smooth paths decidedly, and
    /// says in how many places.
    pub(crate) fn set_in_order(&mut self) -> Option<String> {
        let mut frames: Vec<Vec<StoredDetection>> = self.frames().map(|(_, own)| own.to_vec()).collect();
        if frames.len() < FIFTH.len() {
            return None;
        }
        let usual = self.usual_excess(&frames);
        let mut is_moved = vec![false; frames.len()];
        let mut gains: Vec<f64> = (0..frames.len()).map(|k| self.gain(&frames, k, usual)).collect();
        let mut exchanged = Vec::new();
        // By chance any of the pairs may seem exchanged.
        let decisive = DECISIVE + 2.0 * (frames.len() as f64).ln();
        // The most decided first: what is exchanged beside it, it hides no more.
        loop {
            let is_free = |k: &usize| gains[*k] >= decisive && !is_moved[*k] && !is_moved[*k + 1];
            let free = (0..frames.len().saturating_sub(1)).filter(is_free);
            let Some(best) = free.max_by(|a, b| gains[*a].total_cmp(&gains[*b])) else { break };
            frames.swap(best, best + 1);
            (is_moved[best], is_moved[best + 1]) = (true, true);
            exchanged.push(best);
            let from = best.saturating_sub(FIFTH.len());
            for (k, gain) in gains.iter_mut().enumerate().skip(from).take(2 * FIFTH.len()) {
                *gain = self.gain(&frames, k, usual);
            }
        }
        // Where the balls do not fly smoothly in that order either, something else has happened, as a sudden turn.
        let (sound, others): (Vec<_>, Vec<_>) =
            exchanged.into_iter().partition(|k| self.is_smooth(&frames, *k, usual));
        others.iter().for_each(|k| frames.swap(*k, k + 1));
        let first_s = self.stamps_ns[*sound.iter().min()?] as f64 * 1e-9;
        self.counts = frames.iter().map(|own| own.len() as u16).collect();
        self.detections = frames.into_iter().flatten().collect();
        let (name, pairs) = (&self.name, sound.len());
        Some(format!(
            "{name}: {pairs} pair(s) of neighbouring frames have exchanged their time stamps, the first at {first_s:.3} s: in the \
             other order the balls fly smoothly, and so they are taken. The camera or a converter puts frames out of order."
        ))
    }
}

impl Stream {
    /// Twice the logarithm of the odds that a frame and the next have each other's time stamp.
    fn gain(&self, frames: &[Vec<StoredDetection>], at: usize, usual: f64) -> f64 {
        let Some(shown) = self.window(frames, at) else { return 0.0 };
        let mut other = shown;
        other.swap(BEFORE, BEFORE + 1);
        (rest(shown).0 - rest(other).0) / usual
    }

    /// Whether what is left of the fifth differences about a frame and the next is chance: within four standard deviations of
    /// the mean of chi-square.
    fn is_smooth(&self, frames: &[Vec<StoredDetection>], at: usize, usual: f64) -> bool {
        self.window(frames, at).map(rest).is_some_and(|(sum, count)| {
            let mean = count as f64;
            sum <= usual * (mean + 4.0 * (2.0 * mean).sqrt())
        })
    }

    /// What a square of a fifth difference is of what the noise of the centres makes of it, in the middle of the film; one at least.
    fn usual_excess(&self, frames: &[Vec<StoredDetection>]) -> f64 {
        let ratio = |at| {
            let (sum, count) = rest(self.window(frames, at)?);
            (count > 0).then(|| sum / count as f64)
        };
        median((0..frames.len()).filter_map(ratio).collect()).map_or(1.0, |usual| usual.max(1.0))
    }

    /// The frames about one and the next, where none of them is missing.
    fn window<'a>(
        &self,
        frames: &'a [Vec<StoredDetection>],
        at: usize,
    ) -> Option<[&'a [StoredDetection]; 6]> {
        let from = at.checked_sub(BEFORE)?;
        let stamps_ns = self.stamps_ns.get(from..from + FIFTH.len())?;
        let interval_ns = self.interval_s() * 1e9;
        let is_next = |w: &[i64]| ((w[1] - w[0]) as f64 / interval_ns - 1.0).abs() < OUT_OF_BEAT;
        let all = frames.get(from..from + FIFTH.len())?;
        stamps_ns.windows(2).all(is_next).then(|| std::array::from_fn(|k| &all[k][..]))
    }
}

/// Sum of the squares of the fifth differences over their variances, of the balls that are followed through all frames, and how
/// many there are.
fn rest(frames: [&[StoredDetection]; 6]) -> (f64, usize) {
    let mut balls: BTreeMap<u32, (usize, Vector2<f64>, f64)> = BTreeMap::new();
    for (own, weight) in frames.iter().zip(FIFTH) {
        for ball in own.iter().filter(|ball| ball.is_preferred) {
            let (count, sum_px, variance_px2) = balls.entry(ball.track_id).or_default();
            *count += 1;
            *sum_px += ball.pixel * weight;
            *variance_px2 += ball.variance_px2() / FIFTH.len() as f64;
        }
    }
    let whole = balls.values().filter(|(count, ..)| *count == FIFTH.len());
    let squares =
        whole.map(|(_, sum_px, variance_px2)| sum_px.norm_squared() / (FIFTH_SQUARES * variance_px2));
    let (sum, count) = squares.fold((0.0, 0), |(sum, count), square| (sum + square, count + 2));
    (sum, count)
}

#[cfg(test)]
mod tests {
    use crate::testing::stream;
    use mavsight_pose::CameraClock;

    /// Frames that had exchanged their time stamps were taken as they came: velocities lay ten of their standard deviations off.
    #[test]
    fn frames_that_have_exchanged_their_stamps_are_set_in_order_and_no_others() {
        let sound = stream(1, CameraClock::default(), 30.0, 0..120);
        let mut same = sound.clone();
        assert_eq!(same.set_in_order(), None);
        for pairs in [vec![50], vec![40, 42, 44, 46, 48, 50], vec![40, 42, 48, 51]] {
            let mut spoilt = sound.clone();
            for k in &pairs {
                let (first, second) = spoilt.detections.split_at_mut(4 * (k + 1));
                first[4 * k..].swap_with_slice(&mut second[..4]);
            }
            let note = spoilt.set_in_order().expect("a note");
            assert!(note.contains(&format!("{} pair(s)", pairs.len())), "{pairs:?}: {note}");
            let is_right =
                std::iter::zip(&spoilt.detections, &sound.detections).all(|(a, b)| a.pixel == b.pixel);
            assert!(is_right, "{pairs:?}");
        }
    }

    /// Two frames are moved as by an exchange, but by six tenths of it.
    #[test]
    fn frames_that_are_smooth_in_neither_order_keep_their_stamps() {
        let sound = stream(1, CameraClock::default(), 30.0, 0..120);
        let mut shaken = sound.clone();
        for ball in 0..4 {
            let (first, second) = (4 * 50 + ball, 4 * 51 + ball);
            let by = (sound.detections[second].pixel - sound.detections[first].pixel) * 0.6;
            shaken.detections[first].pixel += by;
            shaken.detections[second].pixel -= by;
        }
        let before: Vec<_> = shaken.detections.iter().map(|d| d.pixel).collect();
        assert_eq!(shaken.set_in_order(), None);
        assert!(shaken.detections.iter().zip(&before).all(|(d, at)| d.pixel == *at));
    }
}
