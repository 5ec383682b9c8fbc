//! Claims of a row of motion that hold under another noise than that of its flight too.

use crate::{MotionCovariance, MotionSample};

/// Factor on a variance from which on a row is widened: twice the standard deviation. Less than that is in the claim of all
/// rows, as the noise of the flight is estimated with what makes them differ.
pub(crate) const WIDER: f64 = 4.0;

/// What a row claims in the light of its estimate under another noise.
pub(crate) type WiderBy = fn(&MotionSample, &MotionSample) -> MotionCovariance;

/// The claim of an estimate that does not know of jumps, from one that does: that one's own covariance and the square of the
/// difference, where that is clearly more.
pub(crate) fn knowing(sample: &MotionSample, knowing: &MotionSample) -> MotionCovariance {
    widened(sample, knowing.covariance.plus_square(&sample.minus(knowing)))
}

/// The claim of an estimate where another may be right instead: both covariances and the square of the difference, where that
/// is clearly more.
pub(crate) fn differing(sample: &MotionSample, other: &MotionSample) -> MotionCovariance {
    widened(sample, sample.covariance.plus(&other.covariance).plus_square(&sample.minus(other)))
}

fn widened(sample: &MotionSample, covariance: MotionCovariance) -> MotionCovariance {
    let own = sample.covariance;
    let is_wider = (0..12).any(|k| covariance.variance(k) > WIDER * own.variance(k));
    if is_wider { covariance.with_noise_of(&own) } else { own }
}

#[cfg(test)]
mod tests {
    use super::{WIDER, differing, knowing};
    use crate::smooth;
    use crate::smoother::smooth::tests::{GRAVITY, flight, pose};
    use mavsight_geometry::Vector3;

    /// Coordinate of a rate.
    const RATE: usize = 10;

    #[test]
    fn a_row_claims_what_another_estimate_differs_by_where_that_is_clearly_more() {
        let poses: Vec<_> =
            (0..60).map(|k| pose(k * 33_000_000, flight(k as f64 * 0.033), (1e-3, 1e-3))).collect();
        let sample = smooth(&poses, GRAVITY).unwrap().samples[30].clone();
        let own = sample.covariance;
        let away = |stds: f64| {
            let mut other = sample.clone();
            other.rates_rad_s += Vector3::y() * stds * own.variance(RATE).sqrt();
            other
        };
        let ratio = |of: crate::MotionCovariance, k: usize| of.variance(k) / own.variance(k);
        // 1 + 1 + stds², and stds² alone beside a covariance that replaces the own one.
        for stds in [3.0, 10.0] {
            let (other, expected) = (away(stds), stds * stds);
            assert!((ratio(differing(&sample, &other), RATE) - (2.0 + expected)).abs() < 1e-4 * expected);
            assert!((ratio(knowing(&sample, &other), RATE) - (1.0 + expected)).abs() < 1e-4 * expected);
            assert!((ratio(differing(&sample, &other), 0) - 2.0).abs() < 1e-5);
        }
        let little = away((WIDER - 2.01_f64).sqrt());
        assert_eq!((differing(&sample, &little), knowing(&sample, &little)), (own, own));
    }
}
