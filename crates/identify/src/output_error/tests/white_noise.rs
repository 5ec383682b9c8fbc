use super::support::{flown, multisine, noisy_poses};
use crate::output_error::{FlightModel, Measurements, OutputErrorOptions, output_error};
use mavsight_flight::{Coefficients, Vehicle, hover_rotor_speed_rad_s};

#[test]
fn poses_with_white_noise_give_the_truth_within_their_intervals() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(6.0));
    let truth = Coefficients::of_vehicle(&vehicle, hover_rotor_speed_rad_s(&vehicle));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let mut seed = 5;
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut seed));
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    println!(
        "{} iterations, factors {:?}, lag {}, gap {:.1e}",
        fit.iterations, fit.variance_factors, fit.correlated_instants, fit.largest_gap_m
    );
    for p in &fit.parameters {
        let crate::output_error::ModelParameter::Coefficient(c) = p.parameter else { continue };
        println!(
            "{:14} {:+.6e} ± {:.1e}  truth {:+.6e}  {:+.2}σ {}",
            p.name,
            p.value,
            p.std,
            truth.get(c),
            (p.value - truth.get(c)) / p.std,
            p.identifiable
        );
    }
}
