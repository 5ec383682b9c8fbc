//! The 95 % intervals hold 92 to 98 % of the truths: a small sample of what `--example coverage` prints.

#[allow(dead_code)]
mod simulated;

use simulated::{ROWS, Random, Tally, rigs};

#[test]
fn intervals_of_pose_velocity_and_rates_hold_the_truth() {
    for (name, rig) in rigs() {
        let (mut tally, mut random) = (Tally::default(), Random(11));
        (0..10).for_each(|_| tally.film(&rig, &mut random));
        assert_eq!(tally.unmeasured(), 80, "only the frames that were lost");
        for (row, what) in ROWS.iter().enumerate().take(6) {
            let share = tally.share(row);
            // Ten films are ten calibrations: the share of a single one of six rows scatters by two per cent.
            assert!((0.89..=0.985).contains(&share), "{name}: {what} {share}");
        }
    }
}

/// Centres that are off by a constant 0.1 px each shift poses by more than a smoothed pose's noise.
#[test]
fn intervals_hold_the_truth_where_centres_are_off_for_good() {
    let (_, rig) = rigs().into_iter().next().expect("a rig");
    let (mut tally, mut random, mut found) = (Tally::default(), Random(13), Vec::new());
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
