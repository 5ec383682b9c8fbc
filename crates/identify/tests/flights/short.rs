//! Short flights that hardly move: the smoother keeps no more independent samples than there are columns.

use crate::aircraft::{Flown, fly, multisine};
use mavsight_flight::Vehicle;
use mavsight_identify::{CoefficientTable, Identification, Options, coefficients, identify};
use mavsight_pose::smooth;
use mavsight_random::Random;
use mavsight_simulator::Scenario;

fn table(flown: &Flown, seed: u64) -> CoefficientTable {
    let poses = flown.poses(0.3e-3, 0.4e-3, &mut Random::new(seed, 0));
    let motion = smooth(&poses, flown.vehicle.environment.gravity_m_s2).expect("a motion");
    coefficients(&motion, &flown.inputs, &flown.vehicle, &Options::default()).expect("a table")
}

/// Intervals of the longitudinal servo in C_X and C_Z, where in truth it has no part.
fn intervals(found: &Identification) -> Vec<(f64, f64)> {
    let fits = found.fits.iter().filter(|fit| fit.output == "C_X" || fit.output == "C_Z");
    let own = fits.flat_map(|fit| fit.parameters.iter().filter(|p| p.name == "delta_lon" && p.identifiable));
    own.filter_map(|p| p.ci_low.zip(p.ci_high)).collect()
}

/// Of such flights coefficients were given up to 46 standard deviations off, of residuals that vanish.
#[test]
fn no_more_independent_samples_than_columns_determine_nothing() {
    let scenario = Scenario { duration_s: 5.5, ..multisine(&[("delta_lon", 0.02)]) };
    let flown = fly(&scenario, Vehicle::paper());
    let mut fitted = 0;
    for seed in 0..12 {
        let Ok(found) = identify(&table(&flown, seed)) else { continue };
        fitted += 1;
        let wrong = intervals(&found).iter().filter(|(low, high)| *low > 0.0 || *high < 0.0).count();
        assert_eq!(wrong, 0, "flight {seed}");
        for fit in &found.fits {
            assert!(fit.independent_samples < fit.rank as f64 && !fit.explains, "{}", fit.verdict);
            assert!(fit.parameters.iter().all(|p| !p.identifiable && p.value.is_none()), "{}", fit.verdict);
            assert!(fit.combinations.is_empty() && fit.verdict.contains("independent samples for"));
        }
    }
    assert!(fitted > 6, "{fitted}");
}

#[test]
fn a_short_flight_that_moves_has_samples_enough() {
    let scenario = Scenario { duration_s: 5.5, ..multisine(&[("delta_lon", 2.0)]) };
    let flown = fly(&scenario, Vehicle::paper());
    let (mut all, mut held) = (0, 0);
    for seed in 0..12 {
        let found = identify(&table(&flown, seed)).expect("fits");
        assert!(found.fits.iter().all(|fit| fit.explains && fit.independent_samples > 3.0 * fit.rank as f64));
        let intervals = intervals(&found);
        all += intervals.len();
        held += intervals.iter().filter(|(low, high)| (*low..=*high).contains(&0.0)).count();
    }
    assert!(all == 6 * 12 && held >= 60, "{held} of {all}");
}
