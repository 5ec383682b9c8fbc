use super::support::{flown, multisine};
use crate::output_error::model::{Equations, FlightModel, ModelParameter};
use crate::output_error::propagate::{Propagator, Raster, difference, moved};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_simulator::{Scenario, true_values};

fn true_model(vehicle: &Vehicle, inputs: &InputSeries) -> FlightModel {
    let model = FlightModel::new(vehicle, inputs).expect("a model");
    let truth = true_values(vehicle).into_iter();
    truth.fold(model, |model, (name, value)| model.with_value(&name, value).expect("a value"))
}

fn raster<'a>(inputs: &'a InputSeries, times_s: &'a [f64], lag_s: f64) -> Raster<'a> {
    Raster { inputs, lag_s, times_s, longest_s: 0.005 }
}

/// Flies a model to a time, and gives the state and its derivatives.
fn fly(
    model: &FlightModel,
    inputs: &InputSeries,
    y: &[f64],
    end_s: f64,
) -> (Vec<f64>, nalgebra::DMatrix<f64>) {
    let equations = Equations::new(model);
    let values = equations.values(model);
    let mut evaluation = equations.dynamics.with(&values);
    let raster = raster(inputs, &[], model.input_lag_s);
    evaluation.set_inputs(inputs.row(raster.input_at(0.0)));
    let mut flyer = Propagator::new(&equations, y);
    for step in raster.steps(0.0, end_s, 0..0) {
        flyer.step(&mut evaluation, inputs, &step);
    }
    (flyer.y.clone(), flyer.tangent())
}

#[test]
fn fixed_steps_agree_with_the_adaptive_integrator() {
    let vehicle = Vehicle::paper();
    for scenario in [multisine(10.0), Scenario::paper()] {
        let (inputs, states) = flown(&vehicle, &scenario);
        let model = true_model(&vehicle, &inputs).with_free(&[]).expect("no names");
        let times: Vec<f64> = states.iter().map(|s| s.t_s).collect();
        let equations = Equations::new(&model);
        let mut evaluation = equations.dynamics.with(&[]);
        evaluation.set_inputs(inputs.row(0));
        let start = scenario.start(&vehicle).expect("a start").packed();
        let mut flyer = Propagator::new(&equations, &start);
        let (mut worst_m, mut seen) = (0.0_f64, 0);
        let end_s = times[times.len() - 1];
        for step in raster(&inputs, &times, 0.0).steps(0.0, end_s, 1..times.len()) {
            flyer.step(&mut evaluation, &inputs, &step);
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
    let labels = vehicle.model.parameters.iter().map(|p| p.label.as_str());
    // Products of inertia change nothing about a state without rates in their plane, and air acts by its
    // density through the reference speed as well.
    let all: Vec<&str> = labels.chain(["input_lag_s"]).collect();
    let mut model = true_model(&vehicle, &inputs).with_free(&all).expect("names");
    // Off the raster, so that no change of the inputs coincides with the ends.
    model.set(ModelParameter::InputLag, -0.0042);
    let y = moved(
        &scenario.start(&vehicle).expect("a start").packed(),
        &[0.1, 0.0, 0.0, 0.1, -0.2, 0.1, 0.3, 0.2, -0.1, 0.1, 0.2, 0.3, 0.02, 0.01, 0.0, 0.03],
    );
    let end_s = 1.5;
    let (exact, tangent) = fly(&model, &inputs, &y, end_s);
    let freedoms = y.len() - 1;
    let check = |column: usize, ahead: &[f64], behind: &[f64], h: f64, name: &str| {
        let numeric: Vec<f64> = difference(ahead, &exact)
            .iter()
            .zip(difference(behind, &exact))
            .map(|(a, b)| (a - b) / (2.0 * h))
            .collect();
        let size = numeric.iter().fold(1e-3_f64, |m, v| m.max(v.abs()));
        for row in 0..freedoms {
            let got = tangent[(column, row)];
            assert!(
                (got - numeric[row]).abs() < 2e-6 * size,
                "{name}, row {row}: {got} is not {}",
                numeric[row]
            );
        }
    };
    for k in 0..freedoms {
        let mut d = vec![0.0; freedoms];
        d[k] = 1e-5;
        let ahead = fly(&model, &inputs, &moved(&y, &d), end_s).0;
        d[k] = -1e-5;
        let behind = fly(&model, &inputs, &moved(&y, &d), end_s).0;
        check(k, &ahead, &behind, 1e-5, "start");
    }
    for (k, parameter) in model.free().iter().enumerate() {
        let h = match parameter {
            ModelParameter::InputLag => 1e-5,
            ModelParameter::Parameter(_) => 1e-6 * model.value(*parameter).abs().max(1e-2),
        };
        let at = |h: f64| {
            let mut changed = model.clone();
            changed.set(*parameter, model.value(*parameter) + h);
            fly(&changed, &inputs, &y, end_s).0
        };
        check(freedoms + k, &at(h), &at(-h), h, model.name(*parameter));
    }
}
