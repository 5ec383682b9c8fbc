//! What estimates claim where mass and inertia are known with a standard deviation.

use crate::aircraft::{Flown, PRODUCTS, longitudinal_multisine, multisine_truth};
use mavsight_flight::Vehicle;
use mavsight_identify::output_error::{
    FlightModel, Measurements, OutputErrorFit, OutputErrorOptions, StateMeasurement, output_error,
};
use mavsight_identify::{EquationFile, Estimator, Options, coefficients, identify};
use mavsight_random::Random;
use mavsight_simulator::{simulate, true_values};

/// A flight of an aircraft whose mass and moments of inertia are 8 % above those of its file, which says that they are
/// known to 10 % or, with `exact`, nothing of that.
fn flown(exact: bool) -> Flown {
    let mut vehicle = Vehicle::paper();
    let mut heavier = vehicle.clone();
    let [xx, yy, zz] = vehicle.inertia_kg_m2;
    let own = [("mass", vehicle.mass_kg), ("I_xx", xx), ("I_yy", yy), ("I_zz", zz)];
    heavier.simulation.extend(own.map(|(name, value)| (name.to_owned(), 1.08 * value)));
    if !exact {
        vehicle.mass_std_kg = 0.1 * vehicle.mass_kg;
        vehicle.inertia_std_kg_m2 = vehicle.inertia_kg_m2.map(|i| 0.1 * i);
    }
    let scenario = longitudinal_multisine();
    let inputs = scenario.inputs(&heavier).expect("inputs");
    let start = scenario.start(&heavier).expect("a start");
    let states = simulate(&heavier, &inputs, &start, &scenario.frame_times_s()).expect("a flight");
    Flown { vehicle, inputs, states }
}

fn is_inside(low: f64, high: f64, truth: f64) -> bool {
    (low..=high).contains(&truth)
}

#[test]
fn output_error_allows_for_what_is_known_of_the_body() {
    let fit = |exact: bool| {
        let flown = flown(exact);
        let model = FlightModel::new(&flown.vehicle, &flown.inputs).expect("a model");
        let poses = flown.poses(0.5e-3, 1e-3, &mut Random::new(55, 0));
        let measured = Measurements::States(StateMeasurement::of_poses(poses.iter()));
        output_error(&model, &flown.inputs, &measured, &OutputErrorOptions::default()).expect("a fit")
    };
    let truth = true_values(&Vehicle::paper());
    let (exact, known) = (fit(true), fit(false));
    let holds = |name: &str, fit: &OutputErrorFit| {
        let p = fit.parameter(name).expect("free");
        is_inside(p.ci_low, p.ci_high, truth[name])
    };
    for name in ["C_m,alpha_l", "C_X,alpha_u"] {
        assert!(
            !holds(name, &exact) && holds(name, &known),
            "{name}: {:?} {:?}",
            exact.parameter(name),
            known.parameter(name)
        );
    }
    let (inertia, before) = (known.parameter("I_yy").expect("free"), Vehicle::paper().inertia_kg_m2[1]);
    assert!(
        is_inside(inertia.ci_low, inertia.ci_high, 1.08 * before) && inertia.std < 0.1 * before,
        "{inertia:?}"
    );
}

#[test]
fn equation_error_allows_for_what_is_known_of_the_body() {
    let truths = multisine_truth(&Vehicle::paper());
    let held = |exact: bool| {
        let flown = flown(exact);
        let equations = EquationFile::parse("products.toml", PRODUCTS).expect("equations");
        let options = Options { equations: Some(equations), ..Options::default() };
        let table =
            coefficients(&flown.exact_motion(), &flown.inputs, &flown.vehicle, &options).expect("a table");
        let identified = identify(&table).expect("fits");
        let holds = |(output, name, truth): &&(&str, &str, f64)| {
            let fit = identified.fit(output, Estimator::LeastSquares).expect("a fit");
            let p = fit.parameters.iter().find(|p| p.name == *name).expect("a parameter");
            is_inside(p.ci_low.expect("a bound"), p.ci_high.expect("a bound"), *truth)
        };
        truths.iter().filter(holds).count()
    };
    assert_eq!(held(false), truths.len());
    assert!(held(true) < 3);
}
