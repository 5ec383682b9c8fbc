//! Filter error against dense algebra, and on flights through air that is not at rest.

use crate::IdentifyError;
use crate::inverse::inverse;
use crate::output_error::filter::VELOCITY;
use crate::output_error::fitter::{Fitter, Recorded};
use crate::output_error::innovations::innovations;
use crate::output_error::{
    AskedFor, DerivedQuantity, FlightFitOptions, FlightFits, FlightModel, InputClock, Measurements,
    ModelParameter, NotAdded, OutputErrorFit, OutputErrorOptions, StateMeasurement, TriedTerm, filter_error,
    output_error, predict_ahead,
};
use mavsight_flight::{InputSeries, Vehicle, VehicleFile};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, InitialState, Scenario, simulate};
use nalgebra::DMatrix;

use super::support::{add_slow_errors, flown, multisine, noisy_poses};

/// A body that a force along x pushes through air that may blow.
const PUSHED: &str = r#"
schema = 2
name = "pushed"
[inputs]
push = { column = "push_n", unit = "N" }
gust_x = { column = "gust_x_n", unit = "N" }
gust_y = { column = "gust_y_n", unit = "N" }
gust_z = { column = "gust_z_n", unit = "N" }
[parameters]
gain = { unit = "1", value = 1, free = true }
drag = { unit = "N s/m", value = 0.3, free = true }
lift = { unit = "N", value = 4.9, free = true }
[forces]
x = "gain*push - drag*u + gust_x"
y = "-drag*v + gust_y"
z = "-lift + gust_z"
"#;
const MASS_KG: f64 = 0.5;
const DURATION_S: f64 = 8.0;
const STEP_S: f64 = 0.02;
const GUST_STD_N: f64 = 0.2;
const TRUTH: [(&str, f64); 3] = [("gain", 1.0), ("drag", 0.3), ("lift", 4.9)];

fn pushed() -> Vehicle {
    vehicle(PUSHED)
}

fn vehicle(model: &str) -> Vehicle {
    let mut paper = VehicleFile::from(Vehicle::paper());
    (paper.model, paper.mass_kg) = (Some("pushed.toml".to_owned()), MASS_KG);
    paper.parameters.clear();
    paper.simulation.clear();
    paper.vehicle(|_| Ok(model.to_owned())).expect("a vehicle")
}

/// A flight, and its inputs as a recorder has them: without the gusts.
fn blown(vehicle: &Vehicle, gust_std_n: f64, random: &mut Random) -> (InputSeries, Vec<FlightState>) {
    let times_s: Vec<f64> = (0..=(DURATION_S / STEP_S) as usize + 1).map(|k| STEP_S * k as f64).collect();
    let push = |t_s: f64| (2.0 * t_s).sin() + 0.5 * (5.3 * t_s).cos();
    let row = |t_s: &f64| [push(*t_s), random.normal(), random.normal(), random.normal()];
    let rows: Vec<[f64; 4]> = times_s.iter().map(row).collect();
    let inputs = |gust_n: f64| {
        let values = rows.iter().flat_map(|[push, x, y, z]| [*push, gust_n * x, gust_n * y, gust_n * z]);
        let names: Vec<_> = vehicle.input_columns().iter().map(|n| (*n).to_owned()).collect();
        InputSeries::new(names, times_s.clone(), values.collect()).expect("inputs")
    };
    let start = InitialState::default();
    let frames_s: Vec<f64> = (0..(30.0 * DURATION_S) as usize).map(|k| k as f64 / 30.0).collect();
    let states = simulate(vehicle, &inputs(gust_std_n), &start, &frames_s).expect("a flight");
    (inputs(0.0), states)
}

fn fit(gust_std_n: f64, seed: u64, estimate: Estimate) -> OutputErrorFit {
    let (vehicle, mut random) = (pushed(), Random::new(seed, 0));
    let (inputs, states) = blown(&vehicle, gust_std_n, &mut random);
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut random));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    estimate(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit")
}

type Estimate = fn(
    &FlightModel,
    &InputSeries,
    &Measurements,
    &OutputErrorOptions,
) -> Result<OutputErrorFit, IdentifyError>;

fn holds(fit: &OutputErrorFit) -> usize {
    let inside = |(name, truth): &&(&str, f64)| {
        fit.parameter(name).is_some_and(|p| (p.ci_low..=p.ci_high).contains(truth))
    };
    TRUTH.iter().filter(inside).count()
}

#[test]
fn gusts_are_process_noise_and_intervals_hold() {
    let (flights, mut inside, mut densities) = (12_u64, 0, [0.0; 3]);
    for seed in 0..flights {
        let fit = fit(GUST_STD_N, seed, filter_error);
        inside += holds(&fit);
        for (sum, (_, root)) in densities.iter_mut().zip(&fit.process_noise) {
            *sum += root * root / flights as f64;
        }
    }
    // A force that is new every 0.02 s has the density of its variance times that time.
    let density = (GUST_STD_N / MASS_KG).powi(2) * STEP_S;
    for found in densities {
        assert!((found / density - 1.0).abs() < 0.15, "{found} of {density}");
    }
    // Of 36 intervals of 95 %, 30 or more hold but for one time in three hundred.
    assert!((30..=36).contains(&inside), "{inside} of 36");
}

#[test]
fn output_error_is_sure_and_wrong_where_filter_error_is_not() {
    let inside =
        |estimate: Estimate| (100..106).map(|seed| holds(&fit(GUST_STD_N, seed, estimate))).sum::<usize>();
    let (filter, output) = (inside(filter_error), inside(output_error));
    assert!(filter >= 15 && output <= 13, "{filter} and {output} of 18");
}

/// Errors of poses that last look like forces that the model lacks: filter error called a right model wrong.
#[test]
fn the_criterion_distinguishes_gusts_from_errors_of_poses_that_last() {
    let vehicle = pushed();
    let model = |inputs: &InputSeries| FlightModel::new(&vehicle, inputs).expect("a model");
    for seed in 0..3 {
        for (gust_std_n, slow, filter_is_better) in [(GUST_STD_N, 0.0, true), (0.0, 2.0, false)] {
            let mut random = Random::new(seed, 1);
            let (inputs, states) = blown(&vehicle, gust_std_n, &mut random);
            let mut poses = noisy_poses(&states, 1.0, &mut random);
            add_slow_errors(&mut poses, 0.1, slow, &mut random);
            let measured = Measurements::States(poses);
            let criterion = |estimate: Estimate| {
                let fit = estimate(&model(&inputs), &inputs, &measured, &OutputErrorOptions::default());
                fit.expect("a fit").criterion
            };
            let better_by = criterion(output_error) - criterion(filter_error);
            assert_eq!(better_by > 0.0, filter_is_better, "gusts of {gust_std_n} N: better by {better_by}");
        }
    }
}

/// Of two fits that contradict each other the one is doubted that explains the flight worse; both where that is filter error and
/// the residuals ask for what the model lacks. There output error, seventeen deviations off, was said to be right.
#[test]
fn the_fit_that_explains_the_flight_worse_is_doubted() {
    let mut output = fit(0.0, 3, output_error);
    assert!(output.parameters.iter().all(|p| p.identifiable));
    let (name, unit) = ("drag over mass".to_owned(), "1/s".to_owned());
    let (value, std, ci_low, ci_high) = (1.0, 0.1, 0.8, 1.2);
    output.derived.push(DerivedQuantity { name, unit, value, std, ci_low, ci_high, identifiable: true });
    let term = TriedTerm {
        parameter: ModelParameter::Parameter(0),
        name: "d_z".to_owned(),
        unit: "N s/m".to_owned(),
        explains: "drag".to_owned(),
        test: None,
        reason: NotAdded::NotDistinguished,
    };
    let asked = AskedFor { candidates: vec![term], ..AskedFor::default() };
    let cases = [(-10.0, None, true, false), (10.0, None, false, true), (10.0, Some(Ok(asked)), true, true)];
    for (worse_by, asked, output_is_doubted, filter_is_doubted) in cases {
        let mut filter = output.clone();
        filter.parameters[0].value += 20.0 * filter.parameters[0].std;
        filter.criterion += worse_by;
        let mut fits =
            FlightFits { poses: Some(output.clone()), filter: Some(filter), ..FlightFits::default() };
        fits.doubt(asked);
        assert_eq!(fits.adequacy.contradiction.is_some(), output_is_doubted);
        assert_eq!(fits.adequacy.refuted.is_some(), filter_is_doubted);
        let (poses, filter) = (fits.poses.expect("output error"), fits.filter.expect("filter error"));
        for (fit, is_doubted) in [(poses, output_is_doubted), (filter, filter_is_doubted)] {
            assert!(fit.parameters.iter().all(|p| p.identifiable != is_doubted));
            assert!(fit.derived.iter().all(|d| d.identifiable != is_doubted));
            let says = fit.notes.first().is_some_and(|n| n.starts_with("Do not use its parameters"));
            assert_eq!(says, is_doubted, "{:?}", fit.notes);
        }
    }
}

#[test]
fn without_gusts_filter_error_is_output_error() {
    let (filter, output) = (fit(0.0, 3, filter_error), fit(0.0, 3, output_error));
    for (a, b) in filter.parameters.iter().zip(&output.parameters) {
        assert!((a.value - b.value).abs() < b.std, "{}: {} and {}", a.name, a.value, b.value);
        // Chance leaves some noise, which costs some precision.
        assert!((0.9..2.0).contains(&(a.std / b.std)), "{}: {} and {}", a.name, a.std, b.std);
    }
}

#[test]
fn a_fitted_model_predicts_a_second_ahead_better_than_holding_the_velocity() {
    let (vehicle, mut random) = (pushed(), Random::new(7, 0));
    let (inputs, states) = blown(&vehicle, GUST_STD_N, &mut random);
    let poses = noisy_poses(&states, 1.0, &mut random);
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let options = OutputErrorOptions::default();
    let fit = filter_error(&model, &inputs, &Measurements::States(poses.clone()), &options).expect("a fit");
    let errors = predict_ahead(&model, &fit, &inputs, &poses, 1.0).expect("predicted").expect("long enough");
    assert_eq!(errors.count, 5);
    // After a second of gusts the velocity is off by the root of their density, the position by that over the
    // root of three, each along three axes.
    let expected_m = (GUST_STD_N / MASS_KG) * STEP_S.sqrt();
    let model = errors.model.expect("none ran away");
    assert!(model.position_m < 2.0 * expected_m, "{errors:?}");
    assert!(errors.held.position_m > 3.0 * model.position_m, "{errors:?}");
}

/// The first pose after a gap is no pose a second ahead.
#[test]
fn nothing_is_predicted_across_a_gap() {
    let (vehicle, mut random) = (pushed(), Random::new(7, 0));
    let (inputs, states) = blown(&vehicle, 0.0, &mut random);
    let poses = noisy_poses(&states, 1.0, &mut random);
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let options = OutputErrorOptions::default();
    let fit = output_error(&model, &inputs, &Measurements::States(poses.clone()), &options).expect("a fit");
    let seen: Vec<_> = poses.into_iter().filter(|p| !(3.5..4.9).contains(&p.t_s())).collect();
    let errors = predict_ahead(&model, &fit, &inputs, &seen, 1.0).expect("predicted").expect("long enough");
    // From 2, 5 and 6 s: from 3 s on nothing is seen a second later, and at 4 s nothing has been for half a second.
    assert_eq!((errors.count, errors.ran_away, errors.not_started), (3, 0, 0), "{errors:?}");
}

/// The body's drag is a candidate of the model that it is fitted with.
#[test]
fn a_term_that_the_residuals_ask_for_is_named() {
    let free = "drag = { unit = \"N s/m\", value = 0.3, free = true }";
    let candidate = "drag = { unit = \"N s/m\", value = 0, candidate = \"drag of the box\" }";
    assert!(PUSHED.contains(free));
    let notes = |fitted: &Vehicle| {
        let (flown, mut random) = (pushed(), Random::new(11, 0));
        let (inputs, states) = blown(&flown, 0.0, &mut random);
        let poses = super::image::samples(&states, &mut random);
        let known = FlightFitOptions { clock: InputClock::Known, ..FlightFitOptions::default() };
        let fits = FlightFits::of_flight(fitted, &inputs, &poses, None, &known).expect("fits");
        fits.poses.expect("output error").notes.join(" ")
    };
    let lacking = notes(&vehicle(&PUSHED.replace(free, candidate)));
    assert!(lacking.contains("The residuals ask for drag, drag of the box (chi-square"), "{lacking}");
    let whole = notes(&pushed());
    assert!(!whole.contains("ask for") && !whole.contains("Do not use"), "{whole}");
}

/// The lag of inputs that stand still was "rank zero: fly a manoeuvre", and there was no filter error without it either: neither of
/// a thrown body, which has no inputs.
#[test]
fn inputs_that_stand_still_have_no_lag_and_filter_error_does_without() {
    let vehicle = vehicle(
        &PUSHED
            .replace("gain = { unit = \"1\", value = 1, free = true }", "gain = { unit = \"1\", value = 1 }"),
    );
    let times_s: Vec<f64> = (0..500).map(|k| STEP_S * f64::from(k)).collect();
    let names: Vec<String> = vehicle.input_columns().iter().map(|n| (*n).to_owned()).collect();
    let rows = times_s.iter().flat_map(|_| [1.0, 0.0, 0.0, 0.0]).collect();
    let inputs = InputSeries::new(names, times_s, rows).expect("inputs");
    let frames_s: Vec<f64> = (0..240).map(|k| f64::from(k) / 30.0).collect();
    let states = simulate(&vehicle, &inputs, &InitialState::default(), &frames_s).expect("a flight");
    let poses = super::image::samples(&states, &mut Random::new(3, 0));
    let measured = Measurements::States(StateMeasurement::of_poses(poses.iter()));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model").with_free_lag();
    let refused = filter_error(&model, &inputs, &measured, &OutputErrorOptions::default());
    let Err(IdentifyError::NotDetermined { names, .. }) = refused else { panic!("{refused:?}") };
    assert_eq!(names, ["input_lag_s"]);
    let fits = FlightFits::of_flight(&vehicle, &inputs, &poses, None, &FlightFitOptions::default());
    let filter = fits.expect("fits").filter.expect("filter error");
    assert!(filter.parameter("drag").is_some(), "{filter:?}");
}

/// A fit of the paper's helicopter over half a second, with process noise along every axis.
fn with_fitter(check: impl FnOnce(&Fitter<'_>)) {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &Scenario { duration_s: 0.5, ..multisine(0.6) });
    let measurements = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(5, 0)));
    let model = FlightModel::new(&vehicle, &inputs).and_then(|m| m.with_free(&["C_m,q", "tau_l"]));
    let model = model.expect("names");
    let inputs = model.inputs_of(&inputs).expect("inputs");
    let options = OutputErrorOptions { segment_s: 0.1, ..OutputErrorOptions::default() };
    let recorded = Recorded { inputs: &inputs, measurements: &measurements };
    let mut fitter = Fitter::begin(&model, recorded, &options).expect("a start");
    for k in 0..6 {
        fitter.problem.process_noise[VELOCITY + k] = 0.01 * (k + 1) as f64;
    }
    fitter.stage(false, 0.01).expect("flown");
    check(&fitter);
}

/// The information on start, parameters and all gaps, by the rows of all segments as functions of them.
fn dense(fitter: &Fitter<'_>, tightness: f64) -> DMatrix<f64> {
    let at = &fitter.at;
    let (n, tangent, gaps) = (at.prior.nrows() - 1, at.tangent, at.segments.len() - 1);
    let all = n + gaps * tangent;
    let mut variables = DMatrix::zeros(n, all);
    variables.view_mut((0, 0), (n, n)).fill_with_identity();
    let prior = at.prior.rows(0, n) * at.prior.rows(0, n).transpose();
    let mut out = DMatrix::zeros(all, all);
    out.view_mut((0, 0), (n, n)).copy_from(&prior);
    for (s, segment) in at.segments.iter().enumerate() {
        let by = variables.tr_mul(&segment.rows.rows(0, n));
        out += &by * by.transpose();
        if s < gaps {
            let end = segment.next.columns(0, n) * &variables;
            variables.rows_mut(0, tangent).copy_from(&end);
            let first = n + s * tangent;
            variables.view_mut((0, first), (tangent, tangent)).fill_with_identity();
            for (k, information) in at.gap_information(s, tightness).iter().enumerate() {
                out[(first + k, first + k)] += information;
            }
        }
    }
    out
}

#[test]
fn innovations_and_smoothed_covariances_are_those_of_dense_algebra() {
    with_fitter(|fitter| {
        let tightness = 1e-4;
        let (at, n) = (&fitter.at, fitter.at.prior.nrows() - 1);
        let all = inverse(&dense(fitter, tightness)).expect("regular");
        let known = inverse(&innovations(at, tightness).information()).expect("regular");
        let apart = |a: f64, b: f64| (a / b - 1.0).abs();
        for k in 0..n {
            assert!(apart(known[(k, k)], all[(k, k)]) < 1e-6, "{k}: {} {}", known[(k, k)], all[(k, k)]);
        }
        let condensed = fitter.condensed(tightness, 0.0).expect("condensed");
        let smoothed = condensed.smoothed(at, known);
        assert!(smoothed.len() > 3);
        for (s, segment) in smoothed.iter().enumerate() {
            for (k, variance) in segment.gap.iter().flat_map(|gap| gap.iter().enumerate()) {
                let own = n + s * at.tangent + k;
                assert!(apart(*variance, all[(own, own)]) < 1e-5, "gap {s}, {k}: {variance}");
            }
        }
    });
}
