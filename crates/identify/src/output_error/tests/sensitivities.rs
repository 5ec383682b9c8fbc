use super::support::{flown, multisine};
use crate::output_error::model::{FlightModel, ModelParameter};
use crate::output_error::propagate::{Propagator, Raster, TANGENT, difference, moved};
use mavsight_flight::{Coefficient, HelicopterInput, InputSeries, StateVector, Vehicle};
use mavsight_simulator::{Scenario, true_coefficients};

fn true_model(vehicle: &Vehicle, inputs: &InputSeries) -> FlightModel {
    let mut model = FlightModel::new(vehicle, inputs).expect("a model");
    model.coefficients = true_coefficients(vehicle, model.airframe.reference_speed_rad_s());
    model
}

fn start(scenario: &Scenario) -> StateVector {
    let s = scenario.start();
    let (p, q) = (s.position_in_world_m, s.attitude.level_from_body());
    let mut y = [0.0; 17];
    y[..7].copy_from_slice(&[p.x, p.y, p.z, q.w, q.i, q.j, q.k]);
    y
}

fn raster<'a>(inputs: &'a [HelicopterInput], times_s: &'a [f64]) -> Raster<'a> {
    Raster { inputs, times_s, longest_s: 0.005 }
}

fn fly(model: &FlightModel, inputs: &[HelicopterInput], y: &StateVector, end_s: f64) -> Propagator {
    let mut flyer = Propagator::new(model.free(), y);
    for step in raster(inputs, &[]).steps(0.0, end_s, model, 0..0) {
        flyer.step(model, inputs, &step);
    }
    flyer
}

#[test]
fn fixed_steps_agree_with_the_adaptive_integrator() {
    let vehicle = Vehicle::paper();
    for scenario in [multisine(10.0), Scenario::paper()] {
        let (inputs, states) = flown(&vehicle, &scenario);
        let model = true_model(&vehicle, &inputs);
        let series = HelicopterInput::series(&inputs).expect("all columns");
        let times: Vec<f64> = states.iter().map(|s| s.t_s).collect();
        let mut flyer = Propagator::new(&[], &start(&scenario));
        let (mut worst_m, mut seen) = (0.0_f64, 0);
        let end_s = times[times.len() - 1];
        for step in raster(&series, &times).steps(0.0, end_s, &model, 1..times.len()) {
            flyer.step(&model, &series, &step);
            if let Some(k) = step.instant {
                let p = states[k].position_in_world_m;
                let off = (flyer.y[0] - p.x).hypot(flyer.y[1] - p.y).hypot(flyer.y[2] - p.z);
                worst_m = worst_m.max(off);
                seen += 1;
            }
        }
        println!("worst position {worst_m:.1e} m");
        assert_eq!(seen, times.len() - 1);
        assert!(worst_m < 1e-6, "{worst_m}");
    }
}

#[test]
fn sensitivities_match_numeric_ones() {
    let vehicle = Vehicle::paper();
    let scenario = multisine(3.0);
    let (inputs, _) = flown(&vehicle, &scenario);
    let all: Vec<&str> = Coefficient::ALL.iter().map(|c| c.name()).chain(["input_lag_s"]).collect();
    let series = HelicopterInput::series(&inputs).expect("all columns");
    let mut model = true_model(&vehicle, &inputs).with_free(&all).expect("names");
    // Off the raster, so that no change of the inputs coincides with the ends.
    model.set(ModelParameter::InputLag, -0.0042);
    let y = moved(
        &start(&scenario),
        &[0.1, 0.0, 0.0, 0.1, -0.2, 0.1, 0.3, 0.2, -0.1, 0.1, 0.2, 0.3, 0.02, 0.01, 0.0, 0.03],
    );
    let end_s = 1.5;
    let exact = fly(&model, &series, &y, end_s);
    let tangent = exact.tangent();
    let check = |column: usize, ahead: &StateVector, behind: &StateVector, h: f64, name: &str| {
        let numeric: Vec<f64> = difference(ahead, &exact.y)
            .iter()
            .zip(difference(behind, &exact.y))
            .map(|(a, b)| (a - b) / (2.0 * h))
            .collect();
        let size = numeric.iter().fold(1e-3_f64, |m, v| m.max(v.abs()));
        for row in 0..TANGENT {
            let got = tangent[(column, row)];
            assert!(
                (got - numeric[row]).abs() < 2e-6 * size,
                "{name}, row {row}: {got} is not {}",
                numeric[row]
            );
        }
    };
    for k in 0..TANGENT {
        let mut d = [0.0; TANGENT];
        d[k] = 1e-5;
        let ahead = fly(&model, &series, &moved(&y, &d), end_s).y;
        d[k] = -1e-5;
        let behind = fly(&model, &series, &moved(&y, &d), end_s).y;
        check(k, &ahead, &behind, 1e-5, "start");
    }
    for (k, parameter) in model.free().iter().enumerate() {
        let h = match parameter {
            ModelParameter::InputLag => 1e-5,
            ModelParameter::Coefficient(_) => 1e-6 * model.value(*parameter).abs().max(1e-2),
        };
        let at = |h: f64| {
            let mut changed = model.clone();
            changed.set(*parameter, model.value(*parameter) + h);
            fly(&changed, &series, &y, end_s).y
        };
        check(TANGENT + k, &at(h), &at(-h), h, parameter.name());
    }
}
