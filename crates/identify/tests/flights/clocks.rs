//! Clocks that differ between inputs and motion.

use crate::aircraft::{Flown, fly, longitudinal_multisine, multisine};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, InputClock};
use mavsight_identify::{Clocks, IdentifyError, Options, delayed, estimate_lag, far_lag};
use mavsight_random::Random;
use mavsight_simulator::{Maneuver, Scenario};

/// The inputs as a clock that is `late_s` late has stamped them.
fn stamped(flown: &Flown, late_s: f64) -> InputSeries {
    delayed(&flown.inputs, late_s).expect("inputs")
}

fn found(flown: &Flown, late_s: f64, random: &mut Random) -> Clocks {
    let motion = flown.noisy_motion(random);
    estimate_lag(&motion, &stamped(flown, late_s), &flown.vehicle, &Options::default(), 0.5)
        .expect("a search")
}

#[test]
fn a_lag_is_found_with_its_standard_deviation() {
    let mut random = Random::new(41, 0);
    for flown in [fly(&Scenario::paper(), Vehicle::paper()), fly(&longitudinal_multisine(), Vehicle::paper())]
    {
        let mut squares = 0.0;
        let lates = [-0.31, 0.0, 0.12];
        for late_s in lates {
            let clocks = found(&flown, late_s, &mut random);
            let Clocks::Lag(lag) = clocks else { panic!("{clocks:?}") };
            println!("late {late_s}: {lag:?}");
            let error = (lag.lag_s + late_s) / lag.std_s;
            assert!(error.abs() < 4.0, "late {late_s}: {lag:?}");
            assert!(lag.std_s < 0.02, "{lag:?}");
            assert_eq!(lag.significant(), late_s.abs() > 0.01, "{lag:?}");
            let differ = late_s != 0.0;
            assert_eq!(clocks.correction_s(), if differ { lag.lag_s } else { 0.0 });
            assert_eq!(clocks.words().is_some_and(|w| w.contains("clocks differ")), differ);
            squares += error * error;
        }
        let mean = squares / lates.len() as f64;
        assert!((0.1..2.5).contains(&mean), "mean square of errors over their standard deviations {mean}");
    }
}

#[test]
fn a_flight_that_determines_no_lag_is_reported() {
    let hover = Scenario { maneuver: vec![], ..Scenario::paper() };
    let flown = fly(&hover, Vehicle::paper());
    let clocks = found(&flown, 0.1, &mut Random::new(5, 0));
    assert_eq!((clocks, clocks.correction_s()), (Clocks::Undetermined, 0.0));
    assert!(clocks.words().is_some_and(|w| w.contains("too little")));
    // Clocks that are further apart than the reach.
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let motion = flown.noisy_motion(&mut Random::new(6, 0));
    let far = estimate_lag(&motion, &stamped(&flown, 0.45), &flown.vehicle, &Options::default(), 0.2);
    assert_eq!(far, Ok(Clocks::Beyond(0.2)));
    assert!(Clocks::Beyond(0.2).words().is_some_and(|w| w.contains("0.20 s")));
    assert_eq!((Clocks::Known(0.3).correction_s(), Clocks::Known(0.3).words()), (0.3, None));
}

/// Residuals of a short and quiet flight are often least at an end of the search, by chance.
#[test]
fn clocks_that_agree_are_not_said_to_differ_by_more_than_was_searched() {
    let doublet =
        Maneuver::Doublet { channel: "delta_lon".into(), start_s: 2.0, pulse_s: 1.0, amplitude: -0.1 };
    let quiet = Scenario { duration_s: 5.5, maneuver: vec![doublet], ..Scenario::paper() };
    let (flown, mut random) = (fly(&quiet, Vehicle::paper()), Random::new(63, 0));
    let all: Vec<Clocks> = (0..12).map(|_| found(&flown, 0.0, &mut random)).collect();
    println!("{all:?}");
    assert!(!all.iter().any(|clocks| matches!(clocks, Clocks::Beyond(_))), "{all:?}");
}

#[test]
fn ends_are_held_where_a_shift_uncovers_them() {
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let (first, last) = (flown.inputs.start_s(), flown.inputs.end_s());
    for late_s in [-0.2, 0.0, 0.2] {
        let moved = stamped(&flown, late_s);
        assert!(moved.start_s() <= first && moved.end_s() >= last, "{late_s}");
        assert_eq!(flown.inputs.at(3.2), moved.at(3.2 + late_s));
        assert_eq!(moved.names(), flown.inputs.names());
    }
    assert!(matches!(delayed(&flown.inputs, f64::NAN), Err(IdentifyError::BadSetting { .. })));
}

/// White process noise cannot stand for inputs that all act late: filter error was wrong by tens of standard deviations.
#[test]
fn inputs_that_act_late_by_a_clock_that_counts_as_known_leave_nothing_determined() {
    let flown = fly(&multisine(&[("delta_lon", 2.0), ("delta_lat", 2.0)]), Vehicle::paper());
    let poses = flown.poses(0.5e-3, 1e-3, &mut Random::new(53, 0));
    let fits = |recorded: &InputSeries, clock| {
        let options = FlightFitOptions { clock, ..FlightFitOptions::default() };
        FlightFits::of_flight(&flown.vehicle, recorded, &poses, None, &options).expect("fits")
    };
    let determined = |fits: &FlightFits| {
        let all = [&fits.poses, &fits.filter].into_iter().flatten();
        all.flat_map(|f| &f.parameters).filter(|p| p.identifiable).count()
    };
    let early = delayed(&flown.inputs, -0.02).expect("inputs");
    let known = fits(&early, InputClock::Known);
    assert_eq!(determined(&known), 0);
    let notes = &known.filter.as_ref().expect("a fit").notes;
    assert!(notes[0].contains("inputs that act later than they are recorded (about"), "{notes:?}");
    assert!(determined(&fits(&early, InputClock::Free)) > 10);
    assert!(determined(&fits(&flown.inputs, InputClock::Known)) > 10);
}

#[test]
fn a_far_lag_is_found_where_it_explains_more_and_nowhere_else() {
    let mut random = Random::new(62, 0);
    let far = |flown: &Flown, late_s: f64, random: &mut Random| {
        let motion = flown.noisy_motion(random);
        let inputs = flown.inputs.at_times(|t_s| t_s + late_s).expect("inputs");
        // As far as the inputs cover the motion.
        let covered = inputs.covered_range(&motion.samples, |s| s.t_ns);
        let part = mavsight_pose::Motion { samples: motion.samples[covered].to_vec(), ..motion };
        far_lag(&part, &inputs, &flown.vehicle, &Options::default(), 0.5).expect("a search")
    };
    let moving = fly(&longitudinal_multisine(), Vehicle::paper());
    for late_s in [0.9, -2.3] {
        let lag = far(&moving, late_s, &mut random).expect("a lag");
        println!("late {late_s}: {lag:?}");
        assert!((lag.lag_s + late_s).abs() <= 1.5 * lag.std_s, "late {late_s}: {lag:?}");
    }
    for late_s in [0.0, 0.4] {
        assert_eq!(far(&moving, late_s, &mut random), None, "late {late_s}");
    }
    let hover = fly(&Scenario { maneuver: vec![], ..Scenario::paper() }, Vehicle::paper());
    for _ in 0..3 {
        assert_eq!(far(&hover, 0.0, &mut random), None);
    }
}
