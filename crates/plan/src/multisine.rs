//! Optimised multisines.

use crate::{FlightPlanner, PlanError, PlannedManoeuvre};
use mavsight_random::Random;
use mavsight_simulator::{Maneuver, Scenario, Sine};
use rayon::prelude::*;

/// Criterion that a multisine minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Optimality {
    /// The determinant of the covariance: the volume of the ellipsoid of confidence.
    D,
    /// The sum of the relative variances.
    A,
}

/// Options of the optimisation.
#[derive(Debug, Clone, PartialEq)]
pub struct MultisineOptions {
    /// Names of the inputs that are moved.
    pub channels: Vec<String>,
    /// Harmonics of one over the length; all inputs have all of them.
    pub harmonics: Vec<u32>,
    /// Beginning; it ends with the scenario.
    pub start_s: f64,
    /// Names of the parameters that count.
    pub parameters: Vec<String>,
    /// Criterion.
    pub optimality: Optimality,
    /// Rounds of the search.
    pub generations: usize,
    /// Seed of the search.
    pub seed: u64,
}

const OFFSPRING: usize = 6;
/// First step, of the length of all amplitudes; a success lengthens it and a failure shortens it so that one
/// in five succeeds (Rechenberg 1973; Kern et al. 2004).
const FIRST_STEP: f64 = 0.5;
const LONGER: f64 = 1.5;
const SHORTER: f64 = 0.9;

impl FlightPlanner<'_> {
    /// The multisine within the limits that makes the criterion least, by an evolution strategy of one parent
    /// and six offspring on cosine and sine amplitudes, from Schroeder's phases (1970). Local: a better one
    /// may exist. `base` gives duration, rates and heading; its manoeuvres are replaced.
    ///
    /// # Errors
    /// No harmonics, channels or parameters; no flight within limits and view.
    pub fn optimise(
        &self,
        base: &Scenario,
        options: &MultisineOptions,
    ) -> Result<PlannedManoeuvre, PlanError> {
        let n = options.harmonics.len() * options.channels.len();
        if n == 0 || options.harmonics.contains(&0) || options.parameters.is_empty() {
            let detail = "needs channels, harmonics of 1 or more, and parameters that count";
            return Err(PlanError::value("multisine", detail));
        }
        let mut random = Random::new(options.seed, 0);
        let mut parent: Vec<f64> =
            (0..n).flat_map(|k| schroeder(k % options.harmonics.len(), options)).collect();
        let mut plan = self.of(base, options, &parent).ok();
        let mut best = plan.as_ref().map_or(f64::INFINITY, |plan| self.cost(plan, options));
        let (mut step, mut refused) = (FIRST_STEP, None);
        for _ in 0..options.generations {
            let length = parent.iter().map(|x| x * x).sum::<f64>().sqrt() / (2.0 * n as f64).sqrt();
            let children: Vec<Vec<f64>> = (0..OFFSPRING)
                .map(|_| parent.iter().map(|x| x + step * length * random.normal()).collect())
                .collect();
            let flown: Vec<_> = children.into_par_iter().map(|x| (self.of(base, options, &x), x)).collect();
            let before = best;
            for (tried, x) in flown {
                match tried {
                    Ok(tried) => {
                        let cost = self.cost(&tried, options);
                        if cost < best {
                            (best, plan, parent) = (cost, Some(tried), x);
                        }
                    }
                    Err(error) => refused = Some(error),
                }
            }
            step *= if best < before { LONGER } else { SHORTER };
        }
        let none = || PlanError::value("multisine", "no flight was tried: give a generation or more");
        plan.ok_or_else(|| refused.unwrap_or_else(none))
    }

    fn of(
        &self,
        base: &Scenario,
        options: &MultisineOptions,
        x: &[f64],
    ) -> Result<PlannedManoeuvre, PlanError> {
        let length_s = base.duration_s - options.start_s;
        let per_channel = 2 * options.harmonics.len();
        let maneuver = options.channels.iter().zip(x.chunks_exact(per_channel)).map(|(channel, own)| {
            let sine = options.harmonics.iter().zip(own.chunks_exact(2)).map(|(harmonic, cs)| Sine {
                harmonic: *harmonic,
                amplitude: cs[0].hypot(cs[1]),
                phase_rad: cs[0].atan2(cs[1]),
            });
            Maneuver::Sines {
                channel: channel.clone(),
                start_s: options.start_s,
                length_s,
                sine: sine.collect(),
            }
        });
        self.predict(&Scenario { maneuver: maneuver.collect(), ..base.clone() }, true)
    }

    fn cost(&self, plan: &PlannedManoeuvre, options: &MultisineOptions) -> f64 {
        let names: Vec<&str> = options.parameters.iter().map(String::as_str).collect();
        let cost = match options.optimality {
            Optimality::D => plan.fit.log_generalised_variance(&names),
            Optimality::A => {
                let own = plan.fit.parameters.iter().filter(|p| names.contains(&p.name.as_str()));
                Some(own.map(|p| (p.std / p.value.abs().max(f64::MIN_POSITIVE)).powi(2)).sum())
            }
        };
        cost.filter(|c: &f64| c.is_finite()).unwrap_or(f64::INFINITY)
    }
}

/// Cosine and sine part of a harmonic with the phase after Schroeder.
fn schroeder(k: usize, options: &MultisineOptions) -> [f64; 2] {
    let n = options.harmonics.len() as f64;
    let phase = -std::f64::consts::PI * (k as f64) * (k as f64 + 1.0) / n;
    [phase.sin(), phase.cos()]
}
