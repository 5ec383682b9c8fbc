use super::support::{flown, multisine, noisy_poses, start_of};
use crate::output_error::{FlightModel, Measurements, ModelParameter, OutputErrorOptions, output_error};
use mavsight_flight::{
    Coefficients, FlightState, InputSample, InputSeries, Vehicle, hover_rotor_speed_rad_s, simulate,
};

/// Rotors below the centre of gravity: the fly-bar, which keeps the upper disc level, drives every tilt further.
fn unstable() -> Vehicle {
    let mut vehicle = Vehicle::paper();
    vehicle.assumption.height_upper_m = -0.06;
    vehicle
}

/// A flight that a pilot, who sees tilt and turn, keeps in the air; his swash-plate is recorded.
fn piloted(vehicle: &Vehicle, duration_s: f64) -> (InputSeries, Vec<FlightState>) {
    let scenario = multisine(duration_s);
    let (plan, _) = flown(&Vehicle::paper(), &scenario);
    let mut at = scenario.start();
    let (mut samples, mut states) = (Vec::<InputSample>::new(), Vec::new());
    for (k, planned) in plan.samples().iter().enumerate() {
        let mut now = *planned;
        let (e, w) = (at.attitude, at.rates_rad_s);
        now.delta_lon_rad += (-2.0 * e.theta_rad - 0.4 * w.y).clamp(-0.3, 0.3);
        now.delta_lat_rad += (-2.0 * e.phi_rad - 0.4 * w.x).clamp(-0.3, 0.3);
        samples.push(now);
        let next_s = (k + 1) as f64 * 0.01;
        let hold = InputSeries::new(vec![now, InputSample { t_s: next_s, ..now }]).expect("inputs");
        let two = simulate(vehicle, &hold, &at, &[now.t_s, next_s]).expect("a flight");
        states.push(two[0]);
        at = start_of(&two[1]);
    }
    (InputSeries::new(samples).expect("inputs"), states.into_iter().step_by(4).collect())
}

#[test]
fn an_unstable_aircraft_is_identified_in_segments_where_one_shot_fails() {
    let vehicle = unstable();
    let (inputs, states) = piloted(&vehicle, 8.0);
    let tilt = states.iter().map(|s| s.attitude.theta_rad.abs().max(s.attitude.phi_rad.abs()));
    assert!(tilt.fold(0.0, f64::max) < 1.0, "the pilot holds it");
    let truth = Coefficients::of_vehicle(&vehicle, hover_rotor_speed_rad_s(&vehicle));
    // From the start that knows nothing of it: hubs above the centre of gravity.
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut 3));
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    println!("{} iterations, {:?}", fit.iterations, fit.variance_factors);
    for p in &fit.parameters {
        let ModelParameter::Coefficient(c) = p.parameter else { continue };
        let off = (p.value - truth.get(c)) / p.std;
        println!("{:12} {:+.5e} ± {:.1e} {off:+.2}", p.name, p.value, p.std);
        assert!(
            off.abs() < 3.0,
            "{}: {:.4e} ± {:.1e} is {off:.1} standard deviations off",
            p.name,
            p.value,
            p.std
        );
    }
    let single = OutputErrorOptions { segment_s: f64::INFINITY, ..Default::default() };
    let shot = output_error(&model, &inputs, &measured, &single);
    println!("{:?}", shot.as_ref().map(|f| (f.iterations, f.reduced_chi_square, f.variance_factors.clone())));
    assert!(shot.is_err() || shot.is_ok_and(|f| f.reduced_chi_square > 1.5));
}
