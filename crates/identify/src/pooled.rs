//! One parameter from several flights of one aircraft.

use crate::output_error::{Disagreement, chi_square_tail};
use crate::{IdentifyError, student_quantile_975};

/// An estimate of a parameter from one flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightEstimate {
    /// Value.
    pub value: f64,
    /// Standard deviation of its error within the flight.
    pub std: f64,
    /// 95 % interval of the flight alone, from.
    pub ci_low: f64,
    /// 95 % interval of the flight alone, to.
    pub ci_high: f64,
}

/// The mean of a parameter over flights, by random effects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pooled {
    /// Mean over flights like these.
    pub mean: f64,
    /// Standard deviation of that mean.
    pub std: f64,
    /// 95 % interval of the mean, from.
    pub ci_low: f64,
    /// 95 % interval of the mean, to.
    pub ci_high: f64,
    /// Standard deviation between flights, of what their own standard deviations do not explain; 0 where these do.
    pub between_std: f64,
    /// Whether the flights differ: Cochran's Q, their squared differences from the mean weighted by their own variances,
    /// is a chi-square of one less than their number where all have one value.
    pub heterogeneity: Disagreement,
}

/// Halvings of the interval of the variance between flights, to less than rounding.
const HALVINGS: usize = 200;

/// Pools estimates of one parameter by flights whose errors are independent.
///
/// Each flight has its own value, which varies about the mean with a variance between flights. That variance makes the
/// weighted squares about the mean equal to their expectation, one less than the number of flights (Paule & Mandel
/// 1982). The interval of the mean is Student's with as many degrees of freedom (Hartung & Knapp 2001), and nowhere
/// narrower than the flights' own deviations make it (Röver, Knapp & Friede 2015). It covers what differs from flight to
/// flight, model error included, but not what is wrong alike in all. Two flights have one degree of freedom, and so an
/// interval of 12.7 standard deviations to either side.
///
/// # Errors
/// [`IdentifyError::BadColumn`] for fewer than two estimates, values that are not finite, standard deviations that are
/// not positive.
pub fn pooled(estimates: &[FlightEstimate]) -> Result<Pooled, IdentifyError> {
    let is_sound = |e: &FlightEstimate| e.value.is_finite() && e.std.is_finite() && e.std > 0.0;
    let flights = estimates.len();
    if flights < 2 || !estimates.iter().all(is_sound) {
        return Err(IdentifyError::BadColumn { what: "estimates of flights".to_owned(), rows: flights });
    }
    let degrees = (flights - 1) as f64;
    let chi_square = Weighted::of(estimates, 0.0).squares;
    let largest_std = estimates.iter().map(|e| e.std).fold(0.0, f64::max);
    let value = |e: &FlightEstimate| e.value;
    let spread = estimates.iter().map(value).fold(f64::MIN, f64::max)
        - estimates.iter().map(value).fold(f64::MAX, f64::min);
    // Squares fall as the variance grows; at this one they are below their expectation.
    let (mut low, mut high) = (0.0, flights as f64 * (spread * spread + largest_std * largest_std));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if Weighted::of(estimates, middle).squares > degrees { low = middle } else { high = middle }
    }
    let variance = if chi_square > degrees { 0.5 * (low + high) } else { 0.0 };
    let Weighted { mean, weight, squares } = Weighted::of(estimates, variance);
    let std = ((squares / degrees).max(1.0) / weight).sqrt();
    let reach = student_quantile_975(flights - 1) * std;
    Ok(Pooled {
        mean,
        std,
        ci_low: mean - reach,
        ci_high: mean + reach,
        between_std: variance.sqrt(),
        heterogeneity: Disagreement {
            chi_square,
            degrees: flights - 1,
            p_value: chi_square_tail(chi_square, flights - 1),
        },
    })
}

/// A weighted mean, the sum of its weights, and the weighted squares about it.
struct Weighted {
    mean: f64,
    weight: f64,
    squares: f64,
}

impl Weighted {
    fn of(estimates: &[FlightEstimate], between_variance: f64) -> Self {
        let weighted = || estimates.iter().map(|e| (1.0 / (e.std * e.std + between_variance), e.value));
        let weight: f64 = weighted().map(|(w, _)| w).sum();
        let mean = weighted().map(|(w, value)| w * value).sum::<f64>() / weight;
        let squares = weighted().map(|(w, value)| w * (value - mean).powi(2)).sum();
        Self { mean, weight, squares }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use mavsight_random::Random;

    fn estimate(value: f64, std: f64) -> FlightEstimate {
        FlightEstimate { value, std, ci_low: value - 2.0 * std, ci_high: value + 2.0 * std }
    }

    fn of(pairs: &[(f64, f64)]) -> Pooled {
        let estimates: Vec<FlightEstimate> =
            pairs.iter().map(|(value, std)| estimate(*value, *std)).collect();
        pooled(&estimates).expect("a mean")
    }

    /// With equal variances the mean is the arithmetic one, and its interval Student's of the values.
    #[test]
    fn flights_of_one_precision_are_a_sample() {
        let found = of(&[(1.0, 0.1), (2.0, 0.1), (4.0, 0.1), (5.0, 0.1)]);
        let variance = 10.0 / 3.0;
        assert_relative_eq!(found.mean, 3.0, epsilon = 1e-12);
        assert_relative_eq!(found.between_std, (variance - 0.01_f64).sqrt(), epsilon = 1e-9);
        assert_relative_eq!(found.std, (variance / 4.0_f64).sqrt(), epsilon = 1e-9);
        // Student's quantile of three degrees.
        assert_relative_eq!(found.ci_high - 3.0, 3.182446305 * found.std, epsilon = 1e-8);
        assert_relative_eq!(found.heterogeneity.chi_square, 1000.0, epsilon = 1e-9);
    }

    #[test]
    fn flights_that_agree_have_no_variance_between_them_and_no_narrower_an_interval() {
        let found = of(&[(1.0, 0.1), (1.001, 0.2), (0.999, 0.1)]);
        assert_eq!(found.between_std, 0.0);
        assert_relative_eq!(found.std, (1.0_f64 / (100.0 + 25.0 + 100.0)).sqrt(), epsilon = 1e-12);
    }

    /// Thirteen trials of the BCG vaccine (Colditz et al. 1994), log risk ratios: the variance between trials by Paule &
    /// Mandel's estimator is 0.3181 (package metafor, Viechtbauer 2010).
    #[test]
    fn the_variance_between_trials_of_a_vaccine_is_the_published_one() {
        let trials: [[f64; 4]; 13] = [
            [4.0, 119.0, 11.0, 128.0],
            [6.0, 300.0, 29.0, 274.0],
            [3.0, 228.0, 11.0, 209.0],
            [62.0, 13536.0, 248.0, 12619.0],
            [33.0, 5036.0, 47.0, 5761.0],
            [180.0, 1361.0, 372.0, 1079.0],
            [8.0, 2537.0, 10.0, 619.0],
            [505.0, 87886.0, 499.0, 87892.0],
            [29.0, 7470.0, 45.0, 7232.0],
            [17.0, 1699.0, 65.0, 1600.0],
            [186.0, 50448.0, 141.0, 27197.0],
            [5.0, 2493.0, 3.0, 2338.0],
            [27.0, 16886.0, 29.0, 17825.0],
        ];
        let estimates = trials.map(|[a, b, c, d]| {
            let std = (1.0 / a - 1.0 / (a + b) + 1.0 / c - 1.0 / (c + d)).sqrt();
            ((a * (c + d) / (c * (a + b))).ln(), std)
        });
        let found = of(&estimates);
        assert!((found.between_std.powi(2) - 0.3181).abs() < 1e-4, "{found:?}");
        assert!((found.heterogeneity.chi_square - 152.233).abs() < 1e-3, "{found:?}");
    }

    /// Of flights that differ by no more than they are uncertain the interval is wider than it need be.
    #[test]
    fn intervals_of_the_mean_hold_it() {
        let mut random = Random::new(3, 0);
        for (flights, between_std) in [(3, 0.0), (3, 1.0), (6, 3.0)] {
            let runs = 2000;
            let held = (0..runs).filter(|_| {
                let pairs: Vec<(f64, f64)> = (0..flights)
                    .map(|_| {
                        let std = random.between(0.5, 2.0);
                        (7.0 + between_std * random.normal() + std * random.normal(), std)
                    })
                    .collect();
                let found = of(&pairs);
                (found.ci_low..=found.ci_high).contains(&7.0)
            });
            let share = held.count() as f64 / f64::from(runs);
            let most = if between_std > 2.0 { 0.985 } else { 1.0 };
            assert!((0.93..=most).contains(&share), "{share} of {flights} flights, {between_std}");
        }
    }

    #[test]
    fn one_flight_is_no_sample() {
        let refused = |pairs: &[(f64, f64)]| {
            let estimates: Vec<FlightEstimate> =
                pairs.iter().map(|(value, std)| estimate(*value, *std)).collect();
            pooled(&estimates).is_err()
        };
        assert!(
            refused(&[(1.0, 1.0)])
                && refused(&[(1.0, 1.0), (2.0, 0.0)])
                && refused(&[(f64::NAN, 1.0), (2.0, 1.0)])
        );
    }
}
