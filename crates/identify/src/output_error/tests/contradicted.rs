use super::support::{flown, multisine, noisy_poses};
use crate::output_error::flight::Estimate;
use crate::output_error::{
    FlightModel, Measurements, OutputErrorFit, OutputErrorOptions, filter_error, output_error,
};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_model::Model;
use mavsight_random::Random;
use mavsight_simulator::true_values;
use std::collections::BTreeMap;
use std::sync::Arc;

struct Flight {
    inputs: InputSeries,
    measured: Measurements,
    truth: BTreeMap<String, f64>,
}

impl Flight {
    fn new(seed: u64) -> Self {
        let vehicle = Vehicle::paper();
        let (inputs, states) = flown(&vehicle, &multisine(4.0));
        let measured = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(seed, 0)));
        Self { inputs, measured, truth: true_values(&vehicle).into_iter().collect() }
    }

    /// A fit whose model has the time constant of the lower disc, in truth 0.05 s, as given.
    fn with_tau_l(&self, given: &str, estimate: Estimate) -> OutputErrorFit {
        let mut vehicle = Vehicle::paper();
        let text = include_str!("../../../../model/shelf/coaxial.toml")
            .replace("value = 0.05, free = true, min = 2e-3", given);
        let text = format!("{text}\n[derived]\ntwice = \"2*tau_l\"\nthrusts = \"C_Z_u + C_Z_l\"\n");
        vehicle.model = Arc::new(Model::parse("given", &text).expect("a model"));
        vehicle.parameters.remove("tau_l");
        let model = FlightModel::new(&vehicle, &self.inputs).expect("a model");
        estimate(&model, &self.inputs, &self.measured, &OutputErrorOptions::default()).expect("a fit")
    }

    /// The parameter called determined that is furthest from the truth, in standard deviations.
    fn worst(&self, fit: &OutputErrorFit) -> f64 {
        let off = |(name, value, std): (&str, f64, f64)| {
            self.truth.get(name).map_or(0.0, |truth| ((value - truth) / std).abs())
        };
        let all = fit.parameters.iter().filter(|p| p.identifiable);
        all.map(|p| off((&p.name, p.value, p.std))).fold(0.0, f64::max)
    }
}

const BOTH: [Estimate; 2] = [output_error, filter_error];

/// Which parameter the notes say that the flight contradicts, if any.
fn contradicted(fit: &OutputErrorFit) -> Option<&str> {
    let said = fit.notes.iter().find_map(|n| n.strip_prefix("The flight contradicts what was given of "));
    said.and_then(|said| said.split_once(':')).map(|(name, _)| name)
}

fn determined(fit: &OutputErrorFit) -> Vec<&str> {
    let derived = fit.derived.iter().filter(|d| d.identifiable).map(|d| d.name.as_str());
    fit.parameters.iter().filter(|p| p.identifiable).map(|p| p.name.as_str()).chain(derived).collect()
}

#[test]
fn a_prior_that_the_flight_contradicts_is_named_and_what_hangs_on_it_is_not_determined() {
    let flight = Flight::new(31);
    for estimate in BOTH {
        let fit = flight.with_tau_l("value = 0.04, prior_std = 5e-4, free = true", estimate);
        assert_eq!(contradicted(&fit), Some("tau_l"), "{:?}", fit.notes);
        let determined = determined(&fit);
        for name in ["tau_l", "tau_f", "C_m,alpha_u", "C_m,alpha_l", "twice"] {
            assert!(!determined.contains(&name), "{name}");
            assert!(
                fit.notes.iter().any(|n| n.starts_with("Not determined, ") && n.contains(name)),
                "{name}"
            );
        }
        for name in ["C_Z,u", "C_n,r", "thrusts"] {
            assert!(determined.contains(&name), "{name}");
        }
        assert!(flight.worst(&fit) < 4.0, "{}", flight.worst(&fit));
    }
}

#[test]
fn a_prior_that_is_right_or_none_is_not_contradicted() {
    let flight = Flight::new(31);
    for given in ["value = 0.051, prior_std = 1e-3, free = true", "value = 0.05, free = true"] {
        for estimate in BOTH {
            let fit = flight.with_tau_l(given, estimate);
            assert_eq!(contradicted(&fit), None, "{:?}", fit.notes);
            assert_eq!(determined(&fit).len(), fit.parameters.len() + fit.derived.len());
            assert!(flight.worst(&fit) < 3.5, "{}", flight.worst(&fit));
        }
    }
}

/// What the flight knows far better than the prior does not hang on it.
#[test]
fn a_wrong_prior_of_little_weight_is_named_and_withholds_nothing() {
    let flight = Flight::new(31);
    let fit = flight.with_tau_l("value = 0.03, prior_std = 5e-3, free = true", output_error);
    assert_eq!(contradicted(&fit), Some("tau_l"), "{:?}", fit.notes);
    assert_eq!(determined(&fit).len(), fit.parameters.len() + fit.derived.len());
    assert!(flight.worst(&fit) < 3.5, "{}", flight.worst(&fit));
}

/// A moment of inertia 8 % above that of the file, which claims to know it to 1 %.
#[test]
fn an_inertia_that_the_flight_contradicts_is_named() {
    let mut vehicle = Vehicle::paper();
    let i_yy = vehicle.inertia_kg_m2[1];
    let mut heavier = vehicle.clone();
    heavier.simulation.insert("I_yy".to_owned(), 1.08 * i_yy);
    vehicle.inertia_std_kg_m2[1] = 0.01 * i_yy;
    let (inputs, states) = flown(&heavier, &multisine(4.0));
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(33, 0)));
    let held = true_values(&vehicle);
    let model = FlightModel::new(&vehicle, &inputs).and_then(|m| m.with_free(&["I_yy", "C_m,0"]));
    let model = held.iter().fold(model.expect("names"), |model, (name, value)| {
        model.clone().with_value(name, *value).unwrap_or(model)
    });
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    assert_eq!(contradicted(&fit), Some("I_yy"), "{:?}", fit.notes);
}

/// What goes with a parameter at its bound was up to 21 standard deviations off, and called determined.
#[test]
fn what_hangs_on_a_bound_is_not_determined() {
    let flight = Flight::new(31);
    for estimate in BOTH {
        let fit = flight.with_tau_l("value = 0.03, free = true, min = 2e-3, max = 0.04", estimate);
        let determined = determined(&fit);
        for name in ["tau_l", "tau_f", "C_m,alpha_u", "C_m,alpha_l", "twice"] {
            assert!(!determined.contains(&name), "{name}");
        }
        for name in ["tau_f", "C_m,alpha_l", "twice"] {
            assert!(
                fit.notes.iter().any(|n| n.starts_with("Not determined, ") && n.contains(name)),
                "{name}"
            );
        }
        for name in ["C_Z,u", "C_n,r", "thrusts"] {
            assert!(determined.contains(&name), "{name}");
        }
        assert!(flight.worst(&fit) < 4.0, "{}", flight.worst(&fit));
    }
}

/// A bound at the truth, beyond which the flight asks by chance alone, by less than a standard deviation.
#[test]
fn a_bound_that_chance_reaches_withholds_nothing_else() {
    let flight = Flight::new(31);
    let fit = flight.with_tau_l("value = 0.045, free = true, min = 2e-3, max = 0.05", output_error);
    let withheld: Vec<&str> =
        fit.parameters.iter().filter(|p| !p.identifiable).map(|p| p.name.as_str()).collect();
    assert_eq!(withheld, ["tau_l"], "{:?}", fit.notes);
    assert!(fit.derived.iter().all(|d| d.identifiable));
    assert!(flight.worst(&fit) < 3.5, "{}", flight.worst(&fit));
}
