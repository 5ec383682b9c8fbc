//! Frames of a flight that a refinement rests on.

use crate::moving::{Instant, PointSight};
use crate::{BodyMarker, MarkerObservation, Observations, PoseError, PoseEstimator, Rig};
use nalgebra::DMatrix;

/// For so long an error of a centre stays at least: the lags over which [`PoseEstimator::centre_bias_px`] compares residuals.
const STAYS_NS: i64 = 1_000_000_000;

/// Frames needed for what stays to rest on more than the noise of a few.
const NEEDED_FRAMES: usize = 10;

/// Frames that enter, spread over the flight: what is refined stays, and with noise a tenth of that of one frame it is what
/// the control points and the lasting errors leave open that counts.
const MOST_FRAMES: usize = 150;

/// Frames with a pose and redundancy, spread over the flight, by the seconds through which errors of centres stay.
pub(super) fn instants_of(
    observations: &Observations,
    rig: &Rig,
    markers: &[BodyMarker],
    markers_std_m: f64,
) -> Result<Vec<Vec<Instant>>, PoseError> {
    // The prior tells the estimator how far markers may be off before they count as false.
    let unsure = DMatrix::identity(3 * markers.len(), 3 * markers.len()) * markers_std_m;
    let estimator = PoseEstimator::new(rig, markers).with_marker_uncertainty(&unsure)?;
    let times_ns: Vec<i64> = observations.times_ns().collect();
    let (mut out, mut previous, mut measured) = (Vec::<Vec<Instant>>::new(), None, 0);
    let mut second = None;
    let mut own = Vec::new();
    let tried = spread(&times_ns);
    for &t_ns in &tried {
        observations.at(t_ns, &mut own);
        let estimate = match estimator.estimate(t_ns, &own, previous.as_ref()) {
            Ok(estimate) => estimate,
            Err(bad @ PoseError::BadObservation { .. }) => return Err(bad),
            Err(_) => continue,
        };
        previous = Some(estimate.world_from_body);
        let whitened = |o: &MarkerObservation| {
            let whitener = o.covariance_px2.cholesky()?.l().try_inverse()?;
            Some(PointSight { camera: o.camera, point: o.marker, pixel: o.pixel, whitener })
        };
        let used = own.iter().filter(|o| estimate.markers_used.contains(o.marker));
        let sights: Vec<PointSight> = used.filter_map(whitened).collect();
        if sights.len() > 3 {
            let instant = Instant { sights, world_from_body: estimate.world_from_body };
            measured += 1;
            let own_second = Some((t_ns - times_ns[0]) / STAYS_NS);
            match out.last_mut().filter(|_| own_second == second) {
                Some(same) => same.push(instant),
                None => out.push(vec![instant]),
            }
            second = own_second;
        }
    }
    if measured < NEEDED_FRAMES {
        return Err(PoseError::TooFewPoses { measured, samples: tried.len(), needed: NEEDED_FRAMES });
    }
    Ok(out)
}

/// Times that enter, in their order: evenly over the flight, or where that leaves less than two to a second by twos, half a second
/// apart, as a pair shows what stays.
fn spread(times_ns: &[i64]) -> Vec<i64> {
    let tried = MOST_FRAMES.min(times_ns.len());
    let evenly = |n: usize| (0..n).map(move |k| times_ns[(2 * k + 1) * times_ns.len() / (2 * n)]);
    let (Some(first), Some(last)) = (times_ns.first(), times_ns.last()) else { return Vec::new() };
    if last - first < tried as i64 * (STAYS_NS / 2) {
        return evenly(tried).collect();
    }
    let start = |t_ns: i64| t_ns - (t_ns - first) % STAYS_NS;
    let near = |t_ns: i64| times_ns[times_ns.partition_point(|t| *t < t_ns).min(times_ns.len() - 1)];
    let mut out: Vec<i64> =
        evenly(tried / 2).flat_map(|t_ns| [near(start(t_ns)), near(start(t_ns) + STAYS_NS / 2)]).collect();
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
            let second = |t_ns: &i64| t_ns / STAYS_NS;
            let alone = got.chunk_by(|a, b| second(a) == second(b)).filter(|c| c.len() < 2).count();
            assert_eq!(alone, 0, "{seconds} s");
            assert_eq!(pairs, got.iter().all(|t| t % (STAYS_NS / 2) == 0), "{seconds} s");
        }
        assert_eq!(spread(&film(4)[..3]), film(4)[..3]);
        assert_eq!(spread(&[]), [0; 0]);
    }
}
