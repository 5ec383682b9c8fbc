//! Low-passes of series at times of their own.

use crate::IdentifyError;
use mavsight_flight::response::interpolate;
use mavsight_pose::{lowpass_like, median};

/// A series at other times, by straight lines.
pub(crate) fn read(times_s: &[f64], series: &[f64], at_s: &[f64]) -> Result<Vec<f64>, IdentifyError> {
    at_s.iter().map(|t_s| Ok(interpolate(times_s, series, *t_s)?)).collect()
}

/// Means over `step_s` around each point of a grid of a series that holds from each time to the next, and
/// beyond both ends.
pub(crate) fn means_of_held(times_s: &[f64], series: &[f64], grid_s: &[f64], step_s: f64) -> Vec<f64> {
    let mut integrals = vec![0.0; series.len()];
    for k in 1..series.len() {
        integrals[k] = integrals[k - 1] + series[k - 1] * (times_s[k] - times_s[k - 1]);
    }
    let integral = |t_s: f64| {
        let k = times_s.partition_point(|t| *t <= t_s).max(1) - 1;
        integrals[k] + series[k] * (t_s - times_s[k])
    };
    grid_s.iter().map(|t_s| (integral(t_s + 0.5 * step_s) - integral(t_s - 0.5 * step_s)) / step_s).collect()
}

/// Low-pass of a series at times that may be unevenly spaced: on a grid of their median interval, and back.
pub(crate) fn lowpass_at(t_s: &[f64], values: &[f64], bandwidth_hz: f64) -> Vec<f64> {
    let intervals: Vec<f64> = t_s.windows(2).map(|w| w[1] - w[0]).collect();
    let step_s = median(intervals.clone()).unwrap_or(0.0);
    if step_s <= 0.0 {
        return values.to_vec();
    }
    if intervals.iter().all(|s| (s - step_s).abs() < 0.01 * step_s) {
        return lowpass_like(values, step_s, bandwidth_hz);
    }
    let (start_s, end_s) = (t_s[0], t_s[t_s.len() - 1]);
    let count = ((end_s - start_s) / step_s).round().max(1.0) as usize;
    let step_s = (end_s - start_s) / count as f64;
    let grid_s: Vec<f64> = (0..=count).map(|k| start_s + step_s * k as f64).collect();
    let smooth = read(t_s, values, &grid_s).map(|series| lowpass_like(&series, step_s, bandwidth_hz));
    let back = smooth.and_then(|series| read(&grid_s, &series, t_s));
    // Both reads lie inside their grids; were they not, the series would be returned as it is.
    back.unwrap_or_else(|_| values.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn held_series_have_the_mean_of_their_steps() {
        let times_s = [0.0, 1.0, 1.5, 3.0];
        let got = means_of_held(&times_s, &[2.0, 4.0, -2.0, 6.0], &[0.0, 1.0, 1.3, 3.0], 1.0);
        for (got, exact) in got.iter().zip([2.0, 3.0, 0.2 * 2.0 + 0.5 * 4.0 - 0.3 * 2.0, 2.0]) {
            assert!((got - exact).abs() < 1e-12, "{got} is not {exact}");
        }
    }
}
