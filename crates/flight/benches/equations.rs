//! The coaxial helicopter's equations of motion at one state: as the model file gives them, and written by
//! hand; its 17 rates, and these with all derivatives by states and 25 parameters.

#[path = "../tests/by_hand/mod.rs"]
mod by_hand;

use by_hand::{Airframe, Coefficient, Coefficients, FLIGHT_STATES, HelicopterInput, StateVector};
use criterion::{Criterion, criterion_group, criterion_main};
use mavsight_flight::Vehicle;
use mavsight_model::Dynamics;
use std::hint::black_box;

fn equations(criterion: &mut Criterion) {
    let vehicle = Vehicle::paper();
    let (model, values) = (&vehicle.model, vehicle.values());
    let mut coefficients = Coefficients::default();
    let mut free = Vec::new();
    for which in Coefficient::ALL {
        let place = model.parameter(which.name()).expect("a parameter of the file");
        coefficients.set(which, values[place]);
        free.push(place);
    }
    let airframe = Airframe::of_vehicle(&vehicle);
    let input = HelicopterInput {
        omega_u_rad_s: 205.0,
        omega_l_rad_s: 222.0,
        delta_lon_rad: 0.07,
        delta_lat_rad: -0.04,
    };
    let state: StateVector =
        [0.3, -0.2, 1.5, 0.9, 0.3, -0.2, 0.25, 0.4, -0.1, 0.2, 0.5, -0.7, 0.3, 0.05, -0.02, 0.01, 0.03];
    let dynamics = Dynamics::new(model, &values, &free);
    let start: Vec<f64> = free.iter().map(|place| values[*place]).collect();
    let mut evaluation = dynamics.with(&start);
    evaluation.set_inputs(&[
        input.omega_u_rad_s,
        input.omega_l_rad_s,
        input.delta_lon_rad,
        input.delta_lat_rad,
    ]);
    let mut rates = [0.0; FLIGHT_STATES];
    let mut group = criterion.benchmark_group("17 rates");
    group.bench_function("by hand", |b| {
        b.iter(|| airframe.derivative(&coefficients, black_box(&input), black_box(&state)));
    });
    group.bench_function("model file", |b| {
        b.iter(|| {
            evaluation.rates(black_box(&state), &mut rates);
            black_box(rates)
        });
    });
    group.finish();
    let mut group = criterion.benchmark_group("17 rates with their derivatives");
    group.bench_function("by hand", |b| {
        b.iter(|| {
            let rates = airframe.derivative(&coefficients, black_box(&input), black_box(&state));
            (rates, airframe.linearise(&coefficients, &input, black_box(&state)))
        });
    });
    group.bench_function("model file", |b| {
        b.iter(|| {
            evaluation.linearise(black_box(&state), &mut rates);
            black_box(rates)
        });
    });
    group.finish();
}

criterion_group!(benches, equations);
criterion_main!(benches);
