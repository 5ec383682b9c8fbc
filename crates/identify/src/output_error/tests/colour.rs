use super::support::{add_slow_errors, flown, multisine, noisy_poses};
use crate::output_error::{
    Extent, FlightModel, Measurements, ModelParameter, OutputErrorFit, OutputErrorOptions, output_error,
};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_random::Random;
use mavsight_simulator::true_values;

fn check(fit: &OutputErrorFit, vehicle: &Vehicle, lag_s: f64) {
    let truth = true_values(vehicle);
    for p in &fit.parameters {
        let true_value = match p.parameter {
            ModelParameter::Parameter(_) => truth[&p.name],
            ModelParameter::InputLag => lag_s,
        };
        let off = (p.value - true_value) / p.std;
        println!("{:12} {:+.5e} ± {:.1e} {off:+.2}", p.name, p.value, p.std);
        assert!(off.abs() < 3.5, "{}: {:.4e} ± {:.1e} is {off:.1} off", p.name, p.value, p.std);
    }
}

#[test]
fn correlated_errors_are_found_and_weighted() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(8.0));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let mut random = Random::new(21, 0);
    let mut samples = noisy_poses(&states, 0.5, &mut random);
    add_slow_errors(&mut samples, 0.5, 2.0, &mut random);
    let fit = output_error(&model, &inputs, &Measurements::States(samples), &OutputErrorOptions::default())
        .expect("a fit");
    let errors = fit.systematic.expect("correlated errors");
    println!("{errors:?}, {} instants", fit.correlated_instants);
    let Extent::Time(time_s) = errors.extent else { panic!("{errors:?}") };
    assert!((0.25..1.0).contains(&time_s), "{errors:?}");
    // 4 of 4.25 parts.
    assert!((0.85..0.99).contains(&errors.share), "{errors:?}");
    assert!(fit.notes.iter().any(|n| n.contains("correlated over about")), "{:?}", fit.notes);
    check(&fit, &vehicle, 0.0);
}

#[test]
fn inputs_by_another_clock_are_found_and_said() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(6.0));
    let lag_s = 0.0173;
    // The recorder runs on, so that the flight is covered.
    let rows = inputs.times_s().len();
    let held = (0..rows).map(|k| (inputs.times_s()[k] - lag_s, inputs.row(k)));
    let before = (-lag_s - 0.1, inputs.row(0));
    let after = (inputs.end_s() - lag_s + 0.1, inputs.row(rows - 1));
    let (times_s, values): (Vec<f64>, Vec<&[f64]>) = [before].into_iter().chain(held).chain([after]).unzip();
    let shifted = InputSeries::new(inputs.names(), times_s, values.concat()).expect("inputs");
    let model = FlightModel::new(&vehicle, &shifted).expect("a model");
    let names: Vec<&str> = model.free().iter().map(|p| model.name(*p)).chain(["input_lag_s"]).collect();
    let model = model.clone().with_free(&names).expect("names");
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(4, 0)));
    let fit = output_error(&model, &shifted, &measured, &OutputErrorOptions::default()).expect("a fit");
    let lag = fit.parameter("input_lag_s").expect("the lag");
    assert!(lag.std < 2e-3, "{}", lag.std);
    assert!(fit.notes.iter().any(|n| n.contains("check the clocks")), "{:?}", fit.notes);
    check(&fit, &vehicle, lag_s);
}
