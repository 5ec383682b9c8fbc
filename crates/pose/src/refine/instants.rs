//! Frames of a flight that a refinement rests on.

use crate::moving::Instant;
use crate::{BodyMarker, Observations, PoseError, PoseEstimator, Rig};
use nalgebra::DMatrix;

/// Least time that a systematic error of a centre lasts, as in [`PoseEstimator::centre_bias_px`].
const SECOND_NS: i64 = 1_000_000_000;

/// Frames needed for an estimate of systematic errors beyond the noise of a few.
const NEEDED_FRAMES: usize = 10;

/// Frames that enter: they reduce noise to a tenth of one frame's, and systematic errors limit the rest.
const MOST_FRAMES: usize = 150;

/// Frames with a pose and redundancy, spread over the flight, by seconds.
pub(super) fn instants_of(
    observations: &Observations,
    rig: &Rig,
    markers: &[BodyMarker],
    markers_std_m: f64,
) -> Result<Vec<Vec<Instant>>, PoseError> {
    // By the prior the estimator judges how far a marker may be off before it counts as false.
    let unsure = DMatrix::identity(3 * markers.len(), 3 * markers.len()) * markers_std_m;
    let estimator = PoseEstimator::new(rig, markers).with_marker_uncertainty(&unsure)?;
    let times_ns: Vec<i64> = observations.times_ns().collect();
    let (mut found, mut previous, mut own) = (Vec::<(i64, Instant)>::new(), None, Vec::new());
    let tried = spread(&times_ns);
    for &t_ns in &tried {
        observations.at(t_ns, &mut own);
        let estimate = match estimator.estimate(t_ns, &own, previous.as_ref()) {
            Ok(estimate) => estimate,
            Err(bad @ PoseError::BadObservation { .. }) => return Err(bad),
            Err(_) => continue,
        };
        let world_from_body = estimate.world_from_body;
        previous = Some(world_from_body);
        let observations = estimator.views_of(&own, &estimate)?;
        if observations.len() > 3 {
            found.push(((t_ns - times_ns[0]) / SECOND_NS, Instant { observations, world_from_body }));
        }
    }
    if found.len() < NEEDED_FRAMES {
        let (measured, samples) = (found.len(), tried.len());
        return Err(PoseError::TooFewPoses { measured, samples, needed: NEEDED_FRAMES });
    }
    let seconds = found.chunk_by(|a, b| a.0 == b.0);
    Ok(seconds.map(|own| own.iter().map(|(_, instant)| instant.clone()).collect()).collect())
}

/// Times that enter, in their order: evenly over the flight, or in pairs half a second apart where that
/// leaves fewer than two in a second, as a pair shows a systematic error.
fn spread(times_ns: &[i64]) -> Vec<i64> {
    let tried = MOST_FRAMES.min(times_ns.len());
    let evenly = |n: usize| (0..n).map(move |k| times_ns[(2 * k + 1) * times_ns.len() / (2 * n)]);
    let (Some(first), Some(last)) = (times_ns.first(), times_ns.last()) else { return Vec::new() };
    if last - first < tried as i64 * (SECOND_NS / 2) {
        return evenly(tried).collect();
    }
    let start = |t_ns: i64| t_ns - (t_ns - first) % SECOND_NS;
    let near = |t_ns: i64| times_ns[times_ns.partition_point(|t| *t < t_ns).min(times_ns.len() - 1)];
    let mut out: Vec<i64> =
        evenly(tried / 2).flat_map(|t_ns| [near(start(t_ns)), near(start(t_ns) + SECOND_NS / 2)]).collect();
    out.sort_unstable();
    out.dedup();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_and_those_of_long_flights_come_by_twos() {
        let film = |seconds: i64| (0..50 * seconds).map(|k| k * 20_000_000).collect::<Vec<i64>>();
        for (seconds, pairs) in [(4, false), (60, false), (600, true)] {
            let got = spread(&film(seconds));
            assert!((140..=MOST_FRAMES).contains(&got.len()) && got.is_sorted(), "{}", got.len());
            assert!(got[0] < seconds * 10_000_000 && got[got.len() - 1] > seconds * 980_000_000);
            let second = |t_ns: &i64| t_ns / SECOND_NS;
            let alone = got.chunk_by(|a, b| second(a) == second(b)).filter(|c| c.len() < 2).count();
            assert_eq!(alone, 0, "{seconds} s");
            assert_eq!(pairs, got.iter().all(|t| t % (SECOND_NS / 2) == 0), "{seconds} s");
        }
        assert_eq!(spread(&film(4)[..3]), film(4)[..3]);
        assert_eq!(spread(&[]), [0; 0]);
    }
}
