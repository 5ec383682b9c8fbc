//! Means of fast samples.

use mavsight_flight::{FlightError, InputSeries, SensorSeries};

/// A fit steps from sample to sample and holds a kilobyte for each: faster sensors, and inputs, are taken as means over this
/// time T. A lag of time constant τ then counts as longer by (T/τ)²/24, which is one part in a hundred of 20 ms.
pub(crate) const MEANS_S: f64 = 0.01;

/// Inputs whose rows are this far apart on average, or less, are taken as means too: means of fewer than two rows say no less.
pub(crate) const FAST_INPUTS_S: f64 = 0.5 * MEANS_S;

/// Means of each sensor's samples within the same [`MEANS_S`], at the mean of their times.
pub(crate) fn mean_sensors(sensors: &SensorSeries) -> Result<SensorSeries, FlightError> {
    let times_ns = sensors.times_ns();
    let bin = |k: &usize| (times_ns[*k] as f64 * 1e-9 / MEANS_S).floor() as i64;
    let means = |column: usize| -> Vec<(i64, f64)> {
        let rows: Vec<usize> = (0..times_ns.len()).filter(|k| sensors.row(*k)[column].is_finite()).collect();
        let mean = |own: &[usize]| {
            let (first_ns, count) = (times_ns[own[0]], own.len());
            let since_ns: i64 = own.iter().map(|k| times_ns[*k] - first_ns).sum();
            let sum: f64 = own.iter().map(|k| sensors.row(*k)[column]).sum();
            (first_ns + since_ns / count as i64, sum / count as f64)
        };
        rows.chunk_by(|a, b| bin(a) == bin(b)).map(mean).collect()
    };
    let samples: Vec<Vec<(i64, f64)>> = (0..sensors.columns().len()).map(means).collect();
    SensorSeries::of_samples(sensors.columns().to_vec(), &samples)
}

/// Inputs that hold their means over [`MEANS_S`], the last one over what is left, where rows are [`FAST_INPUTS_S`] apart or
/// less on average; others as they are.
pub(crate) fn mean_inputs(inputs: &InputSeries) -> Result<InputSeries, FlightError> {
    let times_s = inputs.times_s();
    let rows = times_s.len();
    let span_s = inputs.end_s() - inputs.start_s();
    if span_s / rows as f64 > FAST_INPUTS_S {
        return Ok(inputs.clone());
    }
    let count = (span_s / MEANS_S).floor() as usize;
    let mut edges_s: Vec<f64> = (0..=count).map(|bin| inputs.start_s() + bin as f64 * MEANS_S).collect();
    edges_s.extend(edges_s.last().is_some_and(|last_s| *last_s < inputs.end_s()).then(|| inputs.end_s()));
    let (mut at, mut times, mut values) = (0, Vec::with_capacity(edges_s.len()), Vec::new());
    for edges in edges_s.windows(2) {
        let (from_s, to_s) = (edges[0], edges[1]);
        let mut mean = vec![0.0; inputs.names().len()];
        let mut now_s = from_s;
        while now_s < to_s {
            while at + 1 < rows && times_s[at + 1] <= now_s {
                at += 1;
            }
            let next_s = times_s.get(at + 1).map_or(to_s, |t| t.min(to_s));
            let share = (next_s - now_s) / (to_s - from_s);
            mean.iter_mut().zip(inputs.row(at)).for_each(|(m, v)| *m += share * v);
            now_s = next_s;
        }
        times.push(from_s);
        values.extend(mean);
    }
    times.extend(edges_s.last());
    values.extend(inputs.row(rows - 1));
    InputSeries::new(inputs.names().to_vec(), times, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Inputs that step every row, so far apart.
    fn inputs(apart_s: f64) -> InputSeries {
        let times: Vec<f64> = (0..101).map(|k| f64::from(k) * apart_s).collect();
        let values = (0..101).map(|k| f64::from(k % 2)).collect();
        InputSeries::new(vec!["u".to_owned()], times, values).expect("inputs")
    }

    /// Sensors of the last bin, or two, were dropped as beyond the inputs.
    #[test]
    fn means_of_fast_inputs_end_where_the_inputs_end() {
        for apart_s in [0.002, 0.0033] {
            let own = inputs(apart_s);
            let means = mean_inputs(&own).expect("means");
            assert!((means.end_s() - own.end_s()).abs() < 1e-9, "{} {}", means.end_s(), own.end_s());
            assert!(means.times_s().windows(2).all(|w| w[1] > w[0]));
        }
    }

    #[test]
    fn fast_inputs_hold_means_and_others_are_as_they_were() {
        let fast = mean_inputs(&inputs(0.0025)).expect("means");
        assert!((fast.times_s()[1] - fast.times_s()[0] - MEANS_S).abs() < 1e-12);
        assert!((0..fast.times_s().len() - 1).all(|k| (fast.row(k)[0] - 0.5).abs() < 1e-9));
        let slow = inputs(1.1 * FAST_INPUTS_S);
        assert_eq!(mean_inputs(&slow).expect("inputs").times_s(), slow.times_s());
    }
}
