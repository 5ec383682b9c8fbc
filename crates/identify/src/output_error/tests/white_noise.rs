use super::support::{flown, multisine, noisy_poses};
use crate::output_error::{FlightModel, Measurements, OutputErrorOptions, output_error};
use mavsight_flight::Vehicle;
use mavsight_random::Random;
use mavsight_simulator::true_values;

#[test]
fn poses_with_white_noise_give_the_truth_within_their_intervals() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(6.0));
    let truth = true_values(&vehicle);
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let mut random = Random::new(5, 0);
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut random));
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    assert!(fit.largest_gap_m < 1e-8, "{}", fit.largest_gap_m);
    // 180 residuals each: a standard deviation of 0.11.
    for (name, factor) in &fit.variance_factors[..6] {
        assert!((0.65..1.35).contains(factor), "{name}: {factor}");
    }
    for p in &fit.parameters {
        let Some(truth) = truth.get(&p.name) else { continue };
        let off = (p.value - truth) / p.std;
        assert!(
            off.abs() < 3.5,
            "{}: {:.4e} ± {:.1e} is {off:.1} standard deviations off",
            p.name,
            p.value,
            p.std
        );
        assert!(p.identifiable, "{}", p.name);
    }
}
