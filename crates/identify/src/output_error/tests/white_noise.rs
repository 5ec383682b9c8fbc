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

/// A sum and a ratio of parameters: the interval of the sum follows from both variances and their covariance.
#[test]
fn derived_quantities_have_the_intervals_of_their_parameters() {
    let mut vehicle = Vehicle::paper();
    let text = format!(
        "{}\n[derived]\nthrusts = \"C_Z_u + C_Z_l\"\nscaled = {{ unit = \"s\", value = \"2*tau_l\" }}\nradius = \"R\"\n",
        vehicle.model.definition
    );
    vehicle.model =
        std::sync::Arc::new(mavsight_model::Model::parse("derived.toml", &text).expect("a model"));
    let (inputs, states) = flown(&vehicle, &multisine(4.0));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(6, 0)));
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    let names: Vec<&str> = fit.derived.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(names, ["thrusts", "scaled"], "what no free parameter changes is left out");
    let place = |name: &str| fit.parameters.iter().position(|p| p.name == name).expect("a parameter");
    let (u, l, tau) = (place("C_Z,u"), place("C_Z,l"), place("tau_l"));
    let variance = fit.covariance[(u, u)] + fit.covariance[(l, l)] + 2.0 * fit.covariance[(u, l)];
    let (sum, double) = (&fit.derived[0], &fit.derived[1]);
    assert!((sum.value - fit.parameters[u].value - fit.parameters[l].value).abs() < 1e-12);
    assert!((sum.std / variance.sqrt() - 1.0).abs() < 1e-9 && sum.std < 0.1 * fit.parameters[u].std);
    assert!((double.std / (2.0 * fit.parameters[tau].std) - 1.0).abs() < 1e-9 && double.unit == "s");
}

/// To a time of day a lag was added in steps of 0.2 µs: the free lag found no slope, the fit did not end, and one with the lag held
/// took its place without a word.
#[test]
fn times_of_day_give_the_fit_of_times_from_zero() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(4.0));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model").with_free_lag();
    let poses = noisy_poses(&states, 1.0, &mut Random::new(8, 0));
    let fits = [0, 1_764_400_000].map(|day_s: i64| {
        let inputs = inputs.at_times(|t_s| t_s + day_s as f64).expect("inputs");
        let mut poses = poses.clone();
        poses.iter_mut().for_each(|pose| pose.t_ns += day_s * 1_000_000_000);
        let measured = Measurements::States(poses);
        output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit")
    });
    assert!(fits[0].parameter("input_lag_s").is_some_and(|lag| lag.std < 2e-3));
    for (a, b) in fits[0].parameters.iter().zip(&fits[1].parameters) {
        // Times of day are known to 0.2 µs.
        assert!(
            (a.value - b.value).abs() < 0.01 * a.std,
            "{}: {} and {} ± {}",
            a.name,
            a.value,
            b.value,
            a.std
        );
        assert!((a.std / b.std - 1.0).abs() < 0.01, "{}", a.name);
    }
}
