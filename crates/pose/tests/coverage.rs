//! The 95 % intervals hold the truth also where centres are off for good; `mavsight selftest` tests the rest
//! of them.

#[allow(dead_code)]
mod simulated;

use simulated::{ROWS, Random, Tally, rigs};

/// Centres that are off by a constant 0.1 px each shift poses by more than a smoothed pose's noise.
#[test]
fn intervals_hold_the_truth_where_centres_are_off_for_good() {
    let (_, rig) = rigs().into_iter().next().expect("a rig");
    let (mut tally, mut random, mut found) = (Tally::default(), Random::new(13, 0), Vec::new());
    for _ in 0..10 {
        found.push(tally.film_with_bias(&rig, 0.1, &mut random));
    }
    let mean = (found.iter().map(|b| b * b).sum::<f64>() / 10.0).sqrt();
    assert!((0.085..0.115).contains(&mean), "{found:?}");
    for (row, what) in ROWS.iter().enumerate().take(6) {
        let share = tally.share(row);
        assert!((0.88..=0.99).contains(&share), "{what} {share}");
    }
}
