use super::support::{flown, multisine, noisy_poses};
use crate::IdentifyError;
use crate::output_error::{FlightModel, Measurements, OutputErrorOptions, filter_error, output_error};
use mavsight_flight::{FlightError, InputSeries, Vehicle};
use mavsight_model::Model;
use mavsight_random::Random;
use mavsight_simulator::Scenario;
use std::sync::Arc;
use std::time::Duration;

fn paper() -> (Vehicle, InputSeries, Measurements) {
    let vehicle = Vehicle::paper();
    let scenario = Scenario { duration_s: 5.0, ..Scenario::paper() };
    let (inputs, states) = flown(&vehicle, &scenario);
    (vehicle, inputs, Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(21, 0))))
}

#[test]
fn thrusts_at_constant_speeds_are_refused_with_their_combination() {
    let (vehicle, inputs, measured) = paper();
    let model = FlightModel::new(&vehicle, &inputs)
        .and_then(|m| m.with_free(&["C_m,alpha_u", "C_m,alpha_l", "C_Z,u", "C_Z,l", "C_n,0", "C_l,0"]))
        .expect("names");
    let refused = output_error(&model, &inputs, &measured, &OutputErrorOptions::default());
    let Err(IdentifyError::NotDetermined { names, combination }) = refused else { panic!("{refused:?}") };
    assert_eq!(names, ["C_Z,u", "C_Z,l"]);
    assert!(combination.contains("C_Z,u +1.0000·C_Z,l is seen"), "{combination}");
}

#[test]
fn a_linkage_and_the_gains_behind_it_are_refused() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(4.0));
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(2, 0)));
    let model = FlightModel::new(&vehicle, &inputs)
        .and_then(|m| m.with_free(&["C_X,alpha_u", "C_m,alpha_u", "C_m,alpha_l", "K_u", "C_m,q", "C_l,p"]))
        .expect("names");
    let refused = output_error(&model, &inputs, &measured, &OutputErrorOptions::default());
    let Err(IdentifyError::NotDetermined { names, .. }) = refused else { panic!("{refused:?}") };
    assert_eq!(names, ["C_X,alpha_u", "C_m,alpha_u", "K_u"]);
}

/// A real flight stopped a moment of inertia at zero and gave it an interval.
#[test]
fn a_parameter_that_its_bound_has_stopped_is_not_determined() {
    let (mut vehicle, inputs, measured) = paper();
    let text = include_str!("../../../../model/shelf/coaxial.toml").replace(
        "value = 0.05, free = true, min = 2e-3",
        "value = 0.03, free = true, min = 2e-3, max = 0.035",
    );
    vehicle.model = Arc::new(Model::parse("bounded", &text).expect("a model"));
    vehicle.parameters.insert("tau_l".to_owned(), 0.03);
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    let stopped = fit.parameter("tau_l").expect("a parameter");
    assert!(!stopped.identifiable && stopped.value <= 0.035, "{stopped:?}");
    assert!(fit.notes.iter().any(|n| n.contains("At a bound") && n.contains(": tau_l.")), "{:?}", fit.notes);
    assert!(fit.parameter("C_m,alpha_l").expect("a parameter").identifiable);
}

#[test]
fn inputs_that_end_early_are_refused() {
    let (vehicle, inputs, measured) = paper();
    let kept = inputs.times_s().iter().filter(|t_s| **t_s < 3.0).count();
    let values = (0..kept).flat_map(|k| inputs.row(k).to_vec()).collect();
    let short = InputSeries::new(inputs.names(), inputs.times_s()[..kept].to_vec(), values).expect("inputs");
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let refused = output_error(&model, &short, &measured, &OutputErrorOptions::default());
    assert!(
        matches!(refused, Err(IdentifyError::Flight(FlightError::InputsDoNotCover { .. }))),
        "{refused:?}"
    );
}

#[test]
fn bad_measurements_are_named() {
    let (vehicle, inputs, measured) = paper();
    let Measurements::States(good) = measured else { panic!() };
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let fit = |samples| {
        output_error(&model, &inputs, &Measurements::States(samples), &OutputErrorOptions::default()).err()
    };
    let mut bad = good.clone();
    bad.swap(3, 4);
    assert!(matches!(fit(bad), Some(IdentifyError::MeasurementTimes { .. })));
    let mut bad = good.clone();
    bad[5].pose.as_mut().expect("a pose").1[(2, 2)] = -1.0;
    assert!(matches!(fit(bad), Some(IdentifyError::BadMeasurement { what: "pose", .. })));
    let mut bad = good.clone();
    bad[5].pose.as_mut().expect("a pose").0.translation.vector.x = f64::NAN;
    assert!(matches!(fit(bad), Some(IdentifyError::BadMeasurement { what: "pose", .. })));
    let mut none = good.clone();
    for s in &mut none[3..] {
        s.pose = None;
    }
    assert_eq!(fit(none), Some(IdentifyError::NoStart(3)));
    assert!(matches!(fit(good[..4].to_vec()), Some(IdentifyError::TooFewInstants { .. })));
}

#[test]
fn bad_models_are_named() {
    let (vehicle, inputs, measured) = paper();
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let unknown = model.clone().with_free(&["C_X,beta"]);
    assert!(matches!(unknown, Err(IdentifyError::UnknownParameter { name, .. }) if name == "C_X,beta"));
    let negative = model.clone().with_value("tau_l", -0.1);
    assert!(
        matches!(negative, Err(IdentifyError::BadParameter { ref name, value: -0.1, .. }) if name == "tau_l"),
        "{negative:?}"
    );
    let nothing = model.with_free(&[]).expect("no names");
    let refused = output_error(&nothing, &inputs, &measured, &OutputErrorOptions::default());
    assert_eq!(refused, Err(IdentifyError::NothingFree));
}

#[test]
fn models_that_cannot_be_flown_are_refused_at_their_place() {
    let (mut vehicle, inputs, measured) = paper();
    (vehicle.parameters, vehicle.simulation) = Default::default();
    let mut refusal = |derivative: &str, force: &str, damping: f64| {
        let text = format!(
            "schema = 2\nname = \"test\"\n[inputs]\na = {{ column = \"delta_lon_rad\" }}\n\
             [parameters]\nk = {{ value = 0.1, free = true }}\nd = {{ value = {damping:e} }}\n\
             [states]\ns = {{ derivative = \"{derivative}\" }}\n[forces]\nx = \"{force} - d*u\"\n"
        );
        vehicle.model = Arc::new(Model::parse("test.toml", &text).expect("a model"));
        let model = FlightModel::new(&vehicle, &inputs).expect("columns");
        let refused = output_error(&model, &inputs, &measured, &OutputErrorOptions::default());
        assert!(matches!(refused, Err(IdentifyError::Flight(FlightError::ModelFile(_)))), "{refused:?}");
        refused.map_or_else(|error| error.to_string(), |_| String::new())
    };
    for (derivative, force, damping, says) in [
        ("(a - s)/1e-5", "k*s", 0.1, "line 9, column 20: s follows with a time constant of 1.00e-5 s"),
        ("(a - s)/0.1", "k*s", 1e5, "line 11, column 5: u follows with a time constant of 8.00e-6 s"),
        ("(a - s)/0.1", "k*log(s - 9)", 0.1, "line 11, column 5: x of [forces] is NaN at the start of the"),
        ("log(a - s - 9)", "k*s", 0.1, "line 9, column 20: the derivative of s is NaN at the start of the"),
        ("(a - s)/0.1", "k*sqrt(s)", 0.1, "line 11, column 5: the slope of x of [forces] over s is inf"),
    ] {
        let found = refusal(derivative, force, damping);
        assert!(found.starts_with(&format!("test.toml, {says}")), "{found}");
    }
}

#[test]
fn a_fit_that_may_not_iterate_says_so() {
    let (vehicle, inputs, measured) = paper();
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let options = OutputErrorOptions { max_iterations: 1, ..Default::default() };
    let refused = output_error(&model, &inputs, &measured, &options);
    assert!(matches!(refused, Err(IdentifyError::FitNotConverged { iterations: 1, .. })), "{refused:?}");
}

#[test]
fn a_fit_without_time_says_how_far_it_came() {
    let (vehicle, inputs, measured) = paper();
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let options = OutputErrorOptions { at_most: Some(Duration::from_nanos(1)), ..Default::default() };
    for estimate in [output_error, filter_error] {
        let Err(error @ IdentifyError::FitNotConverged { iterations: 1, .. }) =
            estimate(&model, &inputs, &measured, &options)
        else {
            panic!("one step is enough");
        };
        let said = error.to_string();
        assert!(said.contains("1 iterations and the ") && said.contains(" s that it was given"), "{said}");
        for parameter in model.free() {
            assert!(said.contains(&format!("{} ", model.name(*parameter))), "{said}");
        }
        assert!(!said.contains("inf") && !said.contains("NaN"), "{said}");
    }
}
