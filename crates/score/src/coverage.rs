//! Whether intervals hold the truth: shares inside, normalised errors squared, and their own uncertainty.

use crate::VirtualFlight;
use mavsight_geometry::{Isometry3, Matrix3, Vector3};
use mavsight_pose::NORMAL_95;
use mavsight_simulator::FlightState;
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// The tested quantities, in order.
pub const QUANTITIES: [Quantity; 8] = [
    Quantity { name: "single pose: position", unit: "mm", per_si: 1e3, is_required: true },
    Quantity { name: "single pose: attitude", unit: "°", per_si: DEGREES, is_required: true },
    Quantity { name: "position", unit: "mm", per_si: 1e3, is_required: true },
    Quantity { name: "attitude", unit: "°", per_si: DEGREES, is_required: true },
    Quantity { name: "velocity", unit: "mm/s", per_si: 1e3, is_required: true },
    Quantity { name: "rates", unit: "°/s", per_si: DEGREES, is_required: true },
    Quantity { name: "specific force", unit: "m/s²", per_si: 1.0, is_required: false },
    Quantity { name: "angular acceleration", unit: "rad/s²", per_si: 1.0, is_required: false },
];

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// A vector that is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Name.
    pub name: &'static str,
    /// Unit for people.
    pub unit: &'static str,
    /// That unit's number of one of SI.
    pub per_si: f64,
    /// Whether intervals that are too wide are a failure too; ones that are too narrow always are.
    pub is_required: bool,
}

/// Verdict on a share that is not what it should be, while its interval reaches there.
pub const TOO_FEW: &str = "too few flights to decide";

/// Shares of truths inside 95 % intervals that count as true.
const TRUE_SHARES: std::ops::RangeInclusive<f64> = 0.92..=0.98;

/// Errors of the flights of one laboratory.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    rows: [Vec<OfFlight>; QUANTITIES.len()],
    instants: usize,
    unmeasured: usize,
}

#[derive(Debug, Clone, Copy, Default)]
struct OfFlight {
    vectors: f64,
    inside: f64,
    nees: f64,
    squares: f64,
}

/// Coverage of the intervals of one quantity.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// Name of the quantity.
    pub quantity: &'static str,
    /// Unit of the RMS.
    pub unit: &'static str,
    /// Part of the coordinates whose 95 % interval holds the truth.
    pub share: f64,
    /// 95 % interval of that (Wilson 1927), with as many trials as would be independent.
    pub share_interval: [f64; 2],
    /// Mean normalised error squared of the vectors: 3 is exact.
    pub nees: f64,
    /// Interval of `nees` in 95 % of all self-tests if the covariances are true: chi-square, with as many
    /// vectors as would be independent (Bar-Shalom, Li & Kirubarajan 2001, section 5.4).
    pub nees_interval: [f64; 2],
    /// Root mean square error of the vector's length.
    pub rms: f64,
    /// `true`, `too narrow`, `too wide`, or [`TOO_FEW`].
    pub verdict: &'static str,
    /// Whether the self-test may pass with it: whether it is not refuted.
    pub is_accepted: bool,
}

impl Tally {
    /// Adds a flight: its single poses and its smoothed motion, where they exist.
    pub fn add(&mut self, flight: &VirtualFlight, gravity_m_s2: f64) {
        let mut of_flight = [OfFlight::default(); QUANTITIES.len()];
        let mut samples = flight.motion.samples.iter().peekable();
        for (pose, truth) in flight.tracked.poses.iter().zip(&flight.truth) {
            self.instants += 1;
            if let Ok(single) = &pose.estimate {
                let errors = pose_error(&single.world_from_body, truth);
                for (k, error) in errors.iter().enumerate() {
                    let covariance = single.covariance().fixed_view::<3, 3>(3 * k, 3 * k).into_owned();
                    of_flight[k].add(error, &covariance);
                }
            } else {
                self.unmeasured += 1;
            }
            let Some(sample) = samples.next_if(|s| s.t_ns == pose.t_ns) else { continue };
            for (k, error) in motion_error(sample, truth, gravity_m_s2).iter().enumerate() {
                let covariance = sample.covariance.quantity(k);
                of_flight[2 + k].add(error, &covariance);
            }
        }
        for (row, one) in self.rows.iter_mut().zip(of_flight) {
            row.push(one);
        }
    }

    /// Flights so far.
    pub fn flights(&self) -> usize {
        self.rows[0].len()
    }

    /// Instants so far, and how many of them had no pose of their own.
    pub fn instants(&self) -> (usize, usize) {
        (self.instants, self.unmeasured)
    }

    /// Coverage by quantity; empty without flights.
    pub fn coverage(&self) -> Vec<Coverage> {
        QUANTITIES.iter().zip(&self.rows).filter_map(|(quantity, row)| coverage_of(quantity, row)).collect()
    }
}

impl OfFlight {
    fn add(&mut self, error: &Vector3<f64>, covariance: &Matrix3<f64>) {
        self.vectors += 1.0;
        self.squares += error.norm_squared();
        let held = |k: &usize| error[*k].abs() <= NORMAL_95 * covariance[(*k, *k)].sqrt();
        self.inside += (0..3).filter(held).count() as f64 / 3.0;
        self.nees += covariance.cholesky().map_or(f64::INFINITY, |c| error.dot(&c.solve(error)));
    }
}

fn coverage_of(quantity: &Quantity, row: &[OfFlight]) -> Option<Coverage> {
    let sum = |of: fn(&OfFlight) -> f64| row.iter().map(of).sum::<f64>();
    let vectors = sum(|f| f.vectors);
    if vectors < 1.0 {
        return None;
    }
    let (share, nees) = (sum(|f| f.inside) / vectors, sum(|f| f.nees) / vectors);
    let shares = effective(row, |f| f.inside, share, share * (1.0 - share));
    let vector_count = effective(row, |f| f.nees, nees, 6.0);
    let freedom = 3.0 * vector_count;
    let share_interval = wilson(share, shares);
    let (least, most) = (*TRUE_SHARES.start(), *TRUE_SHARES.end());
    let verdict = match share_interval {
        _ if (least..=most).contains(&share) => "true",
        [_, high] if high < least => "too narrow",
        [low, _] if low > most => "too wide",
        _ => TOO_FEW,
    };
    let is_accepted = verdict != "too narrow" && (verdict != "too wide" || !quantity.is_required);
    Some(Coverage {
        quantity: quantity.name,
        unit: quantity.unit,
        share,
        share_interval,
        nees,
        nees_interval: [0.025, 0.975].map(|p| chi_square_quantile(p, freedom) / vector_count),
        rms: (sum(|f| f.squares) / vectors).sqrt() * quantity.per_si,
        verdict,
        is_accepted,
    })
}

/// How many independent trials of a given variance have a mean as certain as that of these flights (Kish
/// 1965, section 8.2); at least the flights, at most the vectors.
fn effective(row: &[OfFlight], of: fn(&OfFlight) -> f64, mean: f64, variance: f64) -> f64 {
    let (flights, vectors) = (row.len() as f64, row.iter().map(|f| f.vectors).sum::<f64>());
    let away: f64 = row.iter().map(|f| (of(f) - mean * f.vectors).powi(2)).sum();
    let of_mean = away / (vectors * vectors) * flights / (flights - 1.0).max(1.0);
    if row.len() > 1 && of_mean > 0.0 { (variance / of_mean).clamp(flights, vectors) } else { flights }
}

/// Wilson's interval of a share (1927).
fn wilson(share: f64, trials: f64) -> [f64; 2] {
    let z2 = NORMAL_95 * NORMAL_95 / trials;
    let middle = (share + z2 / 2.0) / (1.0 + z2);
    let half = (z2 * (share * (1.0 - share) + z2 / 4.0)).sqrt() / (1.0 + z2);
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

fn chi_square_quantile(probability: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).map_or(f64::NAN, |c| c.inverse_cdf(probability))
}

/// Position in world axes, and the turn from the true to the measured attitude about body axes.
fn pose_error(measured: &Isometry3<f64>, truth: &FlightState) -> [Vector3<f64>; 2] {
    let pose = truth.pose();
    let turn = (pose.rotation.inverse() * measured.rotation).scaled_axis();
    [measured.translation.vector - pose.translation.vector, turn]
}

pub(crate) fn motion_error(
    sample: &mavsight_pose::MotionSample,
    truth: &FlightState,
    gravity_m_s2: f64,
) -> [Vector3<f64>; 6] {
    let [position, turn] = pose_error(&sample.world_from_body, truth);
    let (v, w) = (truth.velocity_in_body_m_s, truth.rates_rad_s);
    let up_in_body = truth.pose().rotation.inverse() * Vector3::z();
    let force = truth.velocity_rate_m_s2 + w.cross(&v) + up_in_body * gravity_m_s2;
    [
        position,
        turn,
        sample.velocity_in_body_m_s - v,
        sample.rates_rad_s - w,
        sample.specific_force_m_s2 - force,
        sample.angular_acceleration_rad_s2 - truth.angular_acceleration_rad_s2,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    #[test]
    fn intervals_are_those_of_the_tables() {
        // Newcombe (1998), table I: 81 of 263 and 15 of 148; chi-square of 10 and 100 degrees, Abramowitz &
        // Stegun 26.8.
        for (hits, trials, low, high) in [(81.0, 263.0, 0.2553, 0.3662), (15.0, 148.0, 0.0624, 0.1605)] {
            let [got_low, got_high] = wilson(hits / trials, trials);
            assert!((got_low - low).abs() < 1e-4 && (got_high - high).abs() < 1e-4, "{got_low} {got_high}");
        }
        for (freedom, low, high) in [(10.0, 3.247, 20.483), (100.0, 74.222, 129.561)] {
            assert!((chi_square_quantile(0.025, freedom) / low - 1.0).abs() < 1e-4);
            assert!((chi_square_quantile(0.975, freedom) / high - 1.0).abs() < 1e-4);
        }
    }

    /// Flights with a partly systematic error, at a stated standard deviation.
    fn row(claim: f64, systematic: f64, seed: u64) -> Vec<OfFlight> {
        let mut random = Random::new(seed, 0);
        let covariance = Matrix3::identity() * claim * claim;
        (0..60)
            .map(|_| {
                let mut one = OfFlight::default();
                let bias = Vector3::from_fn(|_, _| random.normal() * systematic);
                let fresh = (1.0 - systematic * systematic).sqrt();
                for _ in 0..100 {
                    let error = bias + Vector3::from_fn(|_, _| random.normal() * fresh);
                    one.add(&error, &covariance);
                }
                one
            })
            .collect()
    }

    #[test]
    fn true_claims_are_true_and_others_not() {
        let quantity = &QUANTITIES[2];
        for (claim, verdict) in [(1.0, "true"), (0.7, "too narrow"), (1.6, "too wide")] {
            let found = coverage_of(quantity, &row(claim, 0.0, 3)).expect("flights");
            assert_eq!(found.verdict, verdict, "{found:?}");
            assert_eq!(found.is_accepted, verdict == "true");
            let [low, high] = found.nees_interval;
            assert_eq!((low..=high).contains(&found.nees), verdict == "true", "{found:?}");
        }
        assert!(coverage_of(&QUANTITIES[6], &row(1.6, 0.0, 3)).expect("flights").is_accepted);
        assert_eq!(coverage_of(quantity, &[]), None);
    }

    #[test]
    fn intervals_of_the_share_hold_the_true_one_with_systematic_errors_too() {
        for systematic in [0.0, 0.9] {
            let held = (0..100)
                .filter(|seed| {
                    let found = coverage_of(&QUANTITIES[2], &row(1.0, systematic, *seed)).expect("flights");
                    let [low, high] = found.share_interval;
                    (low..=high).contains(&0.95)
                })
                .count();
            // Five standard deviations of 100 trials at 95 %.
            assert!(held >= 84, "systematic {systematic}: {held} of 100");
        }
    }
}
