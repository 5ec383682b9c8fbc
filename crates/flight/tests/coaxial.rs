//! The shelf's coaxial helicopter against the equations written by hand.

mod by_hand;

use by_hand::{
    Airframe, COEFFICIENTS, Coefficient, Coefficients, FLIGHT_STATES, HelicopterInput, StateVector,
};
use mavsight_flight::Vehicle;
use mavsight_model::Dynamics;
use mavsight_random::Random;

#[test]
fn the_file_is_the_model_written_by_hand() {
    let vehicle = Vehicle::paper();
    let model = &vehicle.model;
    let airframe = Airframe::of_vehicle(&vehicle);
    let mut c = Coefficients::default();
    let mut values = vehicle.values();
    let mut free = Vec::new();
    for (k, which) in Coefficient::ALL.into_iter().enumerate() {
        let place = model.parameter(which.name()).unwrap_or_else(|| panic!("{}", which.name()));
        let value = match which {
            Coefficient::TauLower => 0.06,
            Coefficient::TauFlybar => 2.5,
            _ => 0.01 * (k as f64 + 1.0),
        };
        c.set(which, value);
        values[place] = value;
        free.push(place);
    }
    let dynamics = Dynamics::new(model, &values, &free);
    let start: Vec<f64> = free.iter().map(|k| values[*k]).collect();
    let mut evaluation = dynamics.with(&start);
    let mut random = Random::new(1, 0);
    let mut worst: f64 = 0.0;
    for _ in 0..1000 {
        let y: StateVector = std::array::from_fn(|k| if k == 3 { 1.0 } else { 0.0 } + 0.3 * random.normal());
        let input = HelicopterInput {
            omega_u_rad_s: 200.0 + 10.0 * random.normal(),
            omega_l_rad_s: 210.0 + 10.0 * random.normal(),
            delta_lon_rad: 0.1 * random.normal(),
            delta_lat_rad: 0.1 * random.normal(),
        };
        evaluation.set_inputs(&[
            input.omega_u_rad_s,
            input.omega_l_rad_s,
            input.delta_lon_rad,
            input.delta_lat_rad,
        ]);
        let mut out = [0.0; FLIGHT_STATES];
        evaluation.rates(&y, &mut out);
        let want = airframe.derivative(&c, &input, &y);
        let close = |a: f64, b: f64, size: f64| (a - b).abs() / (size + b.abs());
        for (a, b) in out.iter().zip(want) {
            worst = worst.max(close(*a, b, 1.0));
        }
        evaluation.linearise(&y, &mut out);
        let linear = airframe.linearise(&c, &input, &y);
        let mut by_state = [[0.0; FLIGHT_STATES]; FLIGHT_STATES];
        evaluation.by_state().for_each(|s| by_state[s.row][s.column] = s.value);
        let mut by_parameter = [[0.0; COEFFICIENTS]; FLIGHT_STATES];
        evaluation.by_parameter().for_each(|s| by_parameter[s.row][s.column] = s.value);
        let states = by_state.iter().flatten().zip(linear.by_state.iter().flatten());
        let coefficients = by_parameter.iter().flatten().zip(linear.by_coefficient.iter().flatten());
        for (got, want) in states.chain(coefficients) {
            worst = worst.max(close(*got, *want, 1.0));
        }
    }
    assert!(worst < 1e-12, "{worst:e}");
}
