//! Identification of simulated flights: what was put in comes out, and what cannot be determined is refused.

mod aircraft;
mod body;
mod clocks;
mod coverage;
mod model_faults;
mod short;
mod tally;

use aircraft::{Coefficients, Flown, PRODUCTS, fly, longitudinal_multisine, multisine};
use mavsight_flight::{FlightError, InputSeries, Vehicle};
use mavsight_identify::{
    Band, Bandwidth, CoefficientTable, EquationFile, Estimator, FitOptions, Identification, IdentifyError,
    Options, choose_structure, coefficients, identify, identify_with,
};
use mavsight_pose::smooth;
use mavsight_random::Random;
use mavsight_simulator::{Maneuver, Scenario};

fn equations_of(text: &str) -> EquationFile {
    EquationFile::parse("equations.toml", text).expect("equations")
}

/// Options without any low-pass, for motion that has passed none.
fn unfiltered(equations: Option<&str>) -> Options {
    let equations = equations.map(equations_of);
    Options { equations, bandwidth: Bandwidth::Smoother, ..Options::default() }
}

fn table_of(flown: &Flown, options: &Options) -> CoefficientTable {
    coefficients(&flown.exact_motion(), &flown.inputs, &flown.vehicle, options).expect("a table")
}

fn value(found: &Identification, output: &str, estimator: Estimator, name: &str) -> f64 {
    let fit = found.fit(output, estimator).expect("the output is fitted");
    let parameter = fit.parameters.iter().find(|p| p.name == name);
    let parameter = parameter.expect("the model has the parameter");
    assert!(parameter.identifiable, "{output},{name}: {}", fit.verdict);
    parameter.value.expect("a value")
}

fn assert_values(found: &Identification, truth: &[(&str, &str, f64)], tolerance: f64) {
    for estimator in [Estimator::LeastSquares, Estimator::TotalLeastSquares] {
        for (output, name, truth) in truth {
            let got = value(found, output, estimator, name);
            let error = (got / truth - 1.0).abs();
            assert!(
                error < tolerance,
                "{estimator:?} {output},{name}: {got:.4e} is not {truth:.4e} ({error:.1e})"
            );
        }
    }
}

#[test]
fn the_papers_manoeuvre_determines_flapping_but_not_thrust() {
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let table = table_of(&flown, &unfiltered(None));
    let names: Vec<&str> = table.outputs.iter().map(|o| o.name.as_str()).collect();
    assert_eq!(names, ["C_X", "C_Z", "C_m"]);
    assert_eq!(table.not_excited, ["C_Y", "C_l", "C_n"]);
    let found = identify(&table).expect("fits");
    let c = Coefficients::of(&flown.vehicle);
    let truth = [
        ("C_X", "alpha_u", c.cx_alpha_u),
        ("C_X", "alpha_l", c.cx_alpha_l),
        ("C_m", "alpha_u", c.cm_alpha_u),
        ("C_m", "alpha_l", c.cm_alpha_l),
    ];
    assert_values(&found, &truth, 2e-3);
    // Damping is a hundredth of the moment: what the cubic between frames misses of a stepped swash-plate
    // shows in it.
    assert_values(&found, &[("C_m", "q", c.cm_q)], 3e-2);
    for output in ["C_X", "C_Z", "C_m"] {
        let fit = found.fit(output, Estimator::TotalLeastSquares).expect("a fit");
        for name in ["0", "T_u", "T_l"] {
            let p = fit.parameters.iter().find(|p| p.name == name).expect("a parameter");
            assert!(!p.identifiable && p.value.is_none(), "{output},{name}");
        }
        assert_eq!(fit.combinations.len(), 1);
        let wanted = format!("{output},0 + 4.6311·{output},T_u + 3.2121·{output},T_l");
        assert_eq!(fit.combinations[0].text, wanted);
        assert!(fit.verdict.contains(&wanted), "{}", fit.verdict);
        assert!(fit.verdict.contains("move omega_l and omega_u, each by itself"), "{}", fit.verdict);
        assert_eq!(fit.verdict.contains("T_u·h_u + hub stiffness"), output == "C_m", "{}", fit.verdict);
    }
    let hover = &found.fit("C_Z", Estimator::LeastSquares).expect("a fit").combinations[0];
    assert!((hover.value / c.cz_hover - 1.0).abs() < 1e-6, "{}", hover.value);
}

/// Where poses are as uncertain as the flight is quiet, total least squares may end further from what was measured than
/// the mean is: intervals of such fits missed each other by tens of standard deviations.
#[test]
fn a_fit_that_is_worse_than_the_mean_determines_nothing() {
    let quiet = fly(&multisine(&[("delta_lon", 0.3)]), Vehicle::paper());
    let mut random = Random::new(52, 0);
    let mut refused = 0;
    for _ in 0..10 {
        let motion = quiet.noisy_motion(&mut random);
        let table =
            coefficients(&motion, &quiet.inputs, &quiet.vehicle, &Options::default()).expect("a table");
        let Ok(found) = identify(&table) else { continue };
        for fit in &found.fits {
            let (own, left_out) = (fit.diagnostics.fit.r2, fit.diagnostics.predicted_r2);
            assert_eq!(fit.explains, own >= 0.0 || own >= left_out, "{}", fit.verdict);
            if fit.explains {
                continue;
            }
            refused += 1;
            assert!(fit.parameters.iter().all(|p| p.value.is_none() && !p.identifiable), "{}", fit.verdict);
            assert!(fit.combinations.is_empty(), "{}", fit.verdict);
            assert!(fit.verdict.starts_with("The model explains nothing of"), "{}", fit.verdict);
            let least_squares_serves = fit.verdict.contains("Least squares (ols)");
            assert_eq!(least_squares_serves, left_out > 0.0, "{}", fit.verdict);
        }
    }
    assert!(refused > 0, "no fit was worse than the mean");
}

#[test]
fn noise_does_not_change_which_thrusts_are_determined() {
    let longitudinal = ["C_X", "C_Z", "C_m"];
    let paper = fly(&Scenario::paper(), Vehicle::paper());
    let multisine = fly(&longitudinal_multisine(), Vehicle::paper());
    let mut random = Random::new(51, 0);
    for _ in 0..5 {
        for (flown, moved) in [(&paper, false), (&multisine, true)] {
            let motion = flown.noisy_motion(&mut random);
            let options = Options::default();
            let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &options).expect("a table");
            let found = identify(&table).expect("fits");
            for fit in found.fits.iter().filter(|f| longitudinal.contains(&f.output.as_str())) {
                for name in ["0", "T_u", "T_l"] {
                    let p = fit.parameters.iter().find(|p| p.name == name).expect("a parameter");
                    assert_eq!(p.identifiable, moved, "{}", fit.verdict);
                }
                assert_eq!(fit.combinations.len(), usize::from(!moved), "{}", fit.verdict);
            }
            // What the paper's flight is asked for, with the noise of its cameras.
            if !moved {
                let fit = |output| found.fit(output, Estimator::TotalLeastSquares).expect("a fit");
                assert!(
                    fit("C_X").diagnostics.fit.r2 > 0.93 && fit("C_m").diagnostics.fit.r2 > 0.97,
                    "{} {}",
                    fit("C_X").diagnostics.fit.r2,
                    fit("C_m").diagnostics.fit.r2
                );
                assert!(fit("C_Z").diagnostics.fit.max < 2e-4, "{}", fit("C_Z").diagnostics.fit.max);
            }
        }
    }
}

#[test]
fn moved_rotor_speeds_determine_thrust_as_well() {
    let flown = fly(&longitudinal_multisine(), Vehicle::paper());
    let c = Coefficients::of(&flown.vehicle);
    let found = identify(&table_of(&flown, &unfiltered(Some(PRODUCTS)))).expect("fits");
    let truth = [
        ("C_X", "kappa_u*alpha_u", c.cx_alpha_u),
        ("C_X", "kappa_l*alpha_l", c.cx_alpha_l),
        ("C_Z", "kappa_u", c.cx_alpha_u),
        ("C_Z", "kappa_l", c.cx_alpha_l),
        ("C_m", "kappa_u*alpha_u", c.cm_alpha_u),
        ("C_m", "kappa_l*alpha_l", c.cm_alpha_l),
    ];
    assert_values(&found, &truth, 1e-3);
    // Equation 3 leaves the products out, which costs as much as speeds move: 2 %.
    let found = identify(&table_of(&flown, &unfiltered(None))).expect("fits");
    for fit in found.fits.iter().filter(|f| ["C_X", "C_Z", "C_m"].contains(&f.output.as_str())) {
        assert_eq!(fit.rank, 7, "{}", fit.verdict);
        assert!(fit.parameters.iter().all(|p| p.identifiable), "{}", fit.verdict);
        assert!(!fit.verdict.contains("cannot distinguish"), "{}", fit.verdict);
    }
    let truth = [
        ("C_X", "alpha_u", c.cx_alpha_u),
        ("C_X", "alpha_l", c.cx_alpha_l),
        ("C_m", "alpha_u", c.cm_alpha_u),
        ("C_m", "alpha_l", c.cm_alpha_l),
    ];
    assert_values(&found, &truth, 0.04);
}

#[test]
fn lateral_axes_come_out_where_they_are_excited() {
    let scenario = multisine(&[("delta_lat", 2.0), ("omega_u", 1.0), ("omega_l", 1.0)]);
    let flown = fly(&scenario, Vehicle::paper());
    let table = table_of(&flown, &unfiltered(None));
    assert!(table.not_excited.is_empty(), "{:?}", table.not_excited);
    let found = identify(&table).expect("fits");
    let v = &flown.vehicle;
    let c = Coefficients::of(v);
    // C_Y mirrors C_X, C_l mirrors C_m; yaw has the rotors' torque, 2 C_Q, and damping.
    let truth = [
        ("C_Y", "beta_u", -c.cx_alpha_u),
        ("C_Y", "beta_l", -c.cx_alpha_l),
        ("C_l", "beta_u", c.cm_alpha_u),
        ("C_l", "beta_l", c.cm_alpha_l),
        ("C_n", "kappa_d", c.cn_l),
    ];
    assert_values(&found, &truth, 0.03);
    // A flight along x alone, seen with the noise of cameras, does not show them.
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let table =
        coefficients(&flown.noisy_motion(&mut Random::new(3, 0)), &flown.inputs, v, &Options::default());
    assert_eq!(table.expect("a table").not_excited, ["C_Y", "C_l", "C_n"]);
}

#[test]
fn every_estimator_finds_the_noisy_flight() {
    let flown = fly(&longitudinal_multisine(), Vehicle::paper());
    let c = Coefficients::of(&flown.vehicle);
    let options = Options { equations: Some(equations_of(PRODUCTS)), ..Options::default() };
    let motion = flown.noisy_motion(&mut Random::new(17, 0));
    let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &options).expect("a table");
    let choice = FitOptions {
        estimators: vec![
            Estimator::LeastSquares,
            Estimator::WeightedLeastSquares,
            Estimator::TotalLeastSquares,
            Estimator::TotalLeastSquaresByRow,
            Estimator::FrequencyDomain,
        ],
        band: Some(Band { low_hz: 0.15, high_hz: 3.5 }),
        held_out_s: Some((7.0, 9.0)),
    };
    let found = identify_with(&table, &choice).expect("fits");
    for estimator in &choice.estimators {
        for (name, truth) in [("kappa_u*alpha_u", c.cm_alpha_u), ("kappa_l*alpha_l", c.cm_alpha_l)] {
            let got = value(&found, "C_m", *estimator, name);
            assert!((got / truth - 1.0).abs() < 0.06, "{estimator:?} {name}: {got} is not {truth}");
        }
        let fit = found.fit("C_m", *estimator).expect("a fit");
        let held = fit.diagnostics.held_out.expect("a prediction");
        assert!(held.count == 61 && held.r2 > 0.95 && held.theil < 0.2, "{estimator:?} {held:?}");
        assert!(fit.verdict.contains("held out"), "{}", fit.verdict);
        assert!(fit.diagnostics.predicted_r2 > 0.9 && fit.diagnostics.predicted_r2 <= 1.0);
        assert_eq!(Estimator::from_name(estimator.name()), Some(*estimator));
    }
    assert_eq!(Estimator::from_name("guess"), None);
}

#[test]
fn known_coefficients_are_kept_and_the_rest_is_fitted() {
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let c = Coefficients::of(&flown.vehicle);
    let text = format!(
        "schema = 1\nname = \"one free\"\n[[output]]\nname = \"C_X\"\nmeasured = \"force_x\"\nscale = \"rotor\"\n\
         regressors = [\"1\", \"alpha_u\", \"alpha_l\"]\nfixed = {{ alpha_l = {} }}",
        c.cx_alpha_l
    );
    let table = table_of(&flown, &unfiltered(Some(&text)));
    let found = identify(&table).expect("fits");
    assert_values(&found, &[("C_X", "alpha_u", c.cx_alpha_u)], 2e-3);
    let fit = found.fit("C_X", Estimator::LeastSquares).expect("a fit");
    assert_eq!(fit.parameters.len(), 2);
    assert!(fit.verdict.contains("Fixed by the model: alpha_l"), "{}", fit.verdict);
}

#[test]
fn structure_is_found_from_the_flight() {
    let flown = fly(&longitudinal_multisine(), Vehicle::paper());
    let motion = flown.noisy_motion(&mut Random::new(23, 0));
    let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &Options::default()).expect("a table");
    let (chosen, structures) = choose_structure(&table).expect("structures");
    let names =
        |k: usize| -> Vec<&str> { chosen.outputs[k].columns.iter().map(|c| c.name.as_str()).collect() };
    for name in ["0", "alpha_u", "alpha_l"] {
        assert!(names(2).contains(&name), "C_m: {:?}", names(2));
    }
    assert!(structures.iter().all(|s| s.predicted_r2 <= 1.0 && !s.chosen.is_empty()));
    // What errors the columns have goes with them: a model of those columns alone is fitted to the same
    // values.
    let found = identify(&chosen).expect("fits");
    let whole = identify(&table).expect("fits");
    for estimator in [Estimator::TotalLeastSquares, Estimator::TotalLeastSquaresByRow] {
        let (few, all) =
            (value(&found, "C_m", estimator, "alpha_u"), value(&whole, "C_m", estimator, "alpha_u"));
        assert!((few / all - 1.0).abs() < 0.01, "{few} is not {all}");
    }
}

#[test]
fn a_gap_in_the_poses_is_left_out() {
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let mut poses = flown.poses(0.4e-3, 1.4e-3, &mut Random::new(31, 0));
    let without = |poses: &mut [mavsight_pose::PoseSample], gap: &std::ops::Range<f64>| {
        for pose in poses.iter_mut().filter(|p| gap.contains(&(p.t_ns as f64 * 1e-9))) {
            pose.estimate = Err(mavsight_pose::PoseError::NotMeasured);
        }
    };
    let gap: std::ops::Range<f64> = 4.0..4.5;
    without(&mut poses, &gap);
    let motion = smooth(&poses, flown.vehicle.environment.gravity_m_s2).expect("a motion");
    let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &Options::default()).expect("a table");
    let rows = table.rows_in_window();
    let left_out = table.t_s.iter().filter(|t| gap.contains(t)).count()
        - rows.iter().filter(|i| gap.contains(&table.t_s[**i])).count();
    assert!(left_out > 10, "{left_out} of 15 instants in the gap are left out");
    assert!(rows.len() > 200, "{} instants are left", rows.len());
    let found = identify(&table).expect("fits");
    let c = Coefficients::of(&flown.vehicle);
    let got = value(&found, "C_m", Estimator::TotalLeastSquares, "alpha_u");
    assert!((got / c.cm_alpha_u - 1.0).abs() < 0.05, "{got}");
    let fit = found.fit("C_m", Estimator::TotalLeastSquares).expect("a fit");
    assert!(fit.verdict.contains("left out"), "{}", fit.verdict);
    // Over a longer one the motion is not known.
    without(&mut poses, &(4.0..5.5));
    let motion = smooth(&poses, flown.vehicle.environment.gravity_m_s2).expect("a motion");
    let refused = coefficients(&motion, &flown.inputs, &flown.vehicle, &Options::default());
    assert!(matches!(refused, Err(IdentifyError::GapInMotion { .. })), "{:?}", refused.err());
}

#[test]
fn a_gap_in_time_is_refused_with_flapping_and_left_out_without() {
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let mut motion = flown.exact_motion();
    let gap = 4.0..5.2;
    motion.samples.retain(|s| !gap.contains(&(s.t_ns as f64 * 1e-9)));
    let with = |text| coefficients(&motion, &flown.inputs, &flown.vehicle, &unfiltered(text));
    let refused = with(None);
    assert!(matches!(refused, Err(IdentifyError::GapInMotion { .. })), "{refused:?}");
    let text = "schema = 1\nname = \"n\"\n[[output]]\nname = \"C_m\"\nmeasured = \"moment_y\"\nscale = \"rotor\"\n\
                regressors = [\"1\", \"q\", \"delta_lon\"]";
    let table = with(Some(text)).expect("a table");
    let near = |t: f64| t > gap.start - 0.4 && t < gap.end + 0.4;
    assert!(table.rows_in_window().iter().all(|i| !near(table.t_s[*i])));
    assert!(table.instants_in_gaps() > 20);
}

#[test]
fn inputs_that_do_not_fit_the_flight_are_refused() {
    let flown = fly(&Scenario::paper(), Vehicle::paper());
    let motion = flown.exact_motion();
    let with = |inputs: &InputSeries, options: &Options| {
        coefficients(&motion, inputs, &flown.vehicle, options).map(|_| ())
    };
    let all = &flown.inputs;
    let some = |rows: std::ops::Range<usize>, factor: f64| {
        let values = rows.clone().flat_map(|k| all.row(k).iter().map(move |v| v * factor)).collect();
        InputSeries::new(all.names(), all.times_s()[rows].to_vec(), values).expect("valid")
    };
    let count = all.times_s().len();
    let short = with(&some(0..500, 1.0), &Options::default());
    assert!(matches!(short, Err(IdentifyError::Flight(FlightError::InputsDoNotCover { .. }))), "{short:?}");
    let late = with(&some(20..count, 1.0), &Options::default());
    assert!(matches!(late, Err(IdentifyError::Flight(FlightError::InputsDoNotCover { .. }))), "{late:?}");
    let stopped = with(&some(0..count, 0.0), &Options::default());
    assert!(matches!(stopped, Err(IdentifyError::ScaleNotPositive { .. })), "{stopped:?}");
    let fewer = all.select(&["omega_u_rad_s", "delta_lon_rad"]).expect("columns");
    let fewer = with(&fewer, &Options::default());
    assert!(matches!(fewer, Err(IdentifyError::Flight(FlightError::MissingInput { .. }))), "{fewer:?}");
    for hz in [0.0, -1.0, f64::NAN] {
        let options = Options { bandwidth: Bandwidth::Hz(hz), ..Options::default() };
        let refused = with(all, &options);
        assert!(matches!(refused, Err(IdentifyError::BadSetting { .. })), "{refused:?}");
    }
    let mut empty = motion.clone();
    empty.samples.clear();
    let refused = coefficients(&empty, &flown.inputs, &flown.vehicle, &Options::default());
    assert!(matches!(refused, Err(IdentifyError::TooFewInstants { found: 0, .. })), "{refused:?}");
}

#[test]
fn flights_that_show_nothing_are_refused_or_said_to() {
    // Hover: nothing but the constant.
    let hover = Scenario { maneuver: vec![], ..Scenario::paper() };
    let flown = fly(&hover, Vehicle::paper());
    let text = "schema = 1\nname = \"n\"\n[[output]]\nname = \"C_X\"\nmeasured = \"force_x\"\nscale = \"rotor\"\n\
                regressors = [\"delta_lon\", \"delta_lat\"]";
    let refused = identify(&table_of(&flown, &unfiltered(Some(text))));
    assert_eq!(refused, Err(IdentifyError::RankZero));
    // Five instants for seven parameters.
    let mut motion = flown.exact_motion();
    motion.samples.truncate(5);
    let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &unfiltered(None)).expect("a table");
    assert!(matches!(identify(&table), Err(IdentifyError::TooFewInstants { parameters: 7, .. })));
    // Both rotors moved together: their sum is seen, not each.
    let both = |channel: &str| Maneuver::Doublet {
        channel: channel.to_owned(),
        start_s: 2.0,
        pulse_s: 1.0,
        amplitude: 3.0,
    };
    let together = Scenario { maneuver: vec![both("omega_u"), both("omega_l")], ..Scenario::paper() };
    let flown = fly(&together, Vehicle::paper());
    let found = identify(&table_of(&flown, &unfiltered(None))).expect("fits");
    let fit = found.fit("C_Z", Estimator::LeastSquares).expect("a fit");
    let lower = fit.parameters.iter().find(|p| p.name == "T_l").expect("a parameter");
    assert!(!lower.identifiable, "{}", fit.verdict);
    assert!(fit.verdict.contains("each by itself"), "{}", fit.verdict);
}
