//! Clocks that are further apart than the search around equal clocks reaches.

use super::{Lag, LagSearch};
use crate::{IdentifyError, Options};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_pose::{Doubts, Motion, MotionSample};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::gamma::digamma;

/// Lags that [`far_lag`] tries, at most, either way: as far as people are out of step who start two recordings.
const FAR_S: f64 = 5.0;

/// Part of a long flight that is searched: it has several manoeuvres of a small aircraft, and is searched in seconds.
const PART_S: f64 = 20.0;

/// The lag beyond `reach_s`, up to 5 s and half of the inputs' record, where it leaves clearly smaller residuals than any
/// within: clocks that are that far apart have a local minimum near equal clocks too, which [`crate::estimate_lag`] finds.
///
/// The lag is that of least residuals on a grid of a sixteenth of a period of the low-pass, and its standard deviation one
/// step of that. It is clearly better where twice the logarithm of the likelihood is larger by more than the 99.9 % quantile
/// of chi-square, with a degree of freedom for each coefficient, is above its mean: that much a fit of noise may gain. Of
/// few rows it gains more by chance, for which the likelihood is corrected (Bartlett 1937).
/// Inputs' ends are held. Of a long flight, the 20 s are searched in which the aircraft turns most.
///
/// # Errors
/// Those of [`crate::coefficients`].
pub fn far_lag(
    motion: &Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    options: &Options,
    reach_s: f64,
) -> Result<Option<Lag>, IdentifyError> {
    let (motion, inputs) = turning_most(motion, inputs)?;
    let search = LagSearch::new(&motion, &inputs, vehicle, options)?;
    let step_s = reach_s / f64::from(search.grid_steps(reach_s));
    let far_s = FAR_S.min(0.5 * (inputs.end_s() - inputs.start_s()));
    let (mut near, mut beyond) = ((f64::INFINITY, 0.0), (f64::INFINITY, 0.0));
    let mut look = |lag_s: f64| {
        let least = if lag_s.abs() <= reach_s { &mut near } else { &mut beyond };
        let misfit = search.weighted_scatter(lag_s, counted)?;
        if misfit < least.0 {
            *least = (misfit, lag_s);
        }
        Ok::<_, IdentifyError>([near.1, beyond.1])
    };
    let count = (far_s / step_s) as i32;
    let mut least_s = [0.0; 2];
    for k in -count..=count {
        least_s = look(step_s * f64::from(k))?;
    }
    // A minimum lies between two lags of the grid.
    for lag_s in least_s {
        for part in [-0.5, -0.25, 0.25, 0.5] {
            look(lag_s + part * step_s)?;
        }
    }
    let coefficients = search.equations.iter().map(|e| e.independent.len()).sum::<usize>().max(1) as f64;
    let by_noise =
        ChiSquared::new(coefficients).map_or(f64::INFINITY, |c| c.inverse_cdf(0.999) - coefficients);
    Ok((near.0 - beyond.0 > by_noise).then_some(Lag { lag_s: beyond.1, std_s: 0.25 * step_s }))
}

/// The weight of an equation's logarithm of squared residuals by which a fit of noise gains as many as it has coefficients,
/// as chi-square has it: RSS over the sum of squares is then beta-distributed. Of many rows it is their number.
fn counted(rows: f64, coefficients: usize) -> f64 {
    let coefficients = coefficients as f64;
    if rows <= coefficients {
        return 0.0;
    }
    coefficients / (digamma(0.5 * rows) - digamma(0.5 * (rows - coefficients)))
}

/// The part of a flight in which the sum of its squared rates is the largest, with the inputs of that time.
fn turning_most(motion: &Motion, inputs: &InputSeries) -> Result<(Motion, InputSeries), IdentifyError> {
    let seconds = |s: &MotionSample| s.t_ns as f64 * 1e-9;
    let part = |from_s: f64| {
        let place = |t_s: f64| motion.samples.partition_point(|s| seconds(s) < t_s);
        &motion.samples[place(from_s)..place(from_s + PART_S)]
    };
    let turned = |from_s: &f64| part(*from_s).iter().map(|s| s.rates_rad_s.norm_squared()).sum::<f64>();
    let [begin_s, end_s] = [motion.samples.first(), motion.samples.last()].map(|s| s.map_or(0.0, seconds));
    let begins = (0..).map(|k| begin_s + 0.25 * PART_S * f64::from(k));
    let begins = begins.take_while(|from_s| *from_s == begin_s || from_s + PART_S <= end_s);
    let from_s = begins.max_by(|a, b| turned(a).total_cmp(&turned(b))).unwrap_or(begin_s);
    // With the row that holds at the beginning.
    let before = |t_s: f64| inputs.times_s().partition_point(|row_s| *row_s <= t_s);
    let rows = before(from_s - FAR_S).saturating_sub(1)..before(from_s + PART_S + FAR_S);
    let times_s = inputs.times_s()[rows.clone()].to_vec();
    let values = rows.flat_map(|k| inputs.row(k)).copied().collect();
    let motion = Motion {
        samples: part(from_s).to_vec(),
        unknown_ns: Vec::new(),
        doubts: Doubts::default(),
        ..*motion
    };
    Ok((motion, InputSeries::new(inputs.names(), times_s, values)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_rows_count_less_than_many() {
        // By ψ(n + 1) = ψ(n) + 1/n: of 4 rows and 2 coefficients 2 / (1/1), of 6 and 2 2 / (1/2).
        assert!((counted(4.0, 2) - 2.0).abs() < 1e-9 && (counted(6.0, 2) - 4.0).abs() < 1e-9);
        assert!((counted(1e5, 3) / 1e5 - 1.0).abs() < 1e-4);
        assert_eq!(counted(2.0, 2), 0.0);
    }
}
