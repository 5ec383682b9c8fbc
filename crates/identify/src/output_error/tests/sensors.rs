//! Sensors beside poses: derivatives, and flights whose intervals hold and are those of the bound.

use super::support::{POSITION_STD_M, TURN_STD_RAD, noisy_poses};
use crate::inverse::inverse;
use crate::output_error::fitter::{Fitter, Recorded};
use crate::output_error::shooting::Point;
use crate::output_error::structure::terms_asked_for;
use crate::output_error::{
    FlightFits, FlightModel, Measurements, OutputErrorFit, OutputErrorOptions, filter_error, output_error,
    search_structure,
};
use mavsight_flight::{InputSeries, SensorSeries, Vehicle, VehicleFile};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, InitialState, simulate};
use nalgebra::{DMatrix, DVector};

/// A rotor that lags behind its command, on a body that is pushed and turned.
const SENSED: &str = r#"
schema = 2
name = "sensed"
[inputs]
push = { unit = "N" }
spin = { unit = "rad/s" }
twist = { unit = "1" }
[parameters]
drag = { unit = "N s/m", value = 0.3, free = true }
k = { unit = "N s^2", value = 1e-3, free = true, min = 0 }
lead = { unit = "1/s^2", value = 10, free = true }
damp = { unit = "1/s", value = 2, free = true }
tau = { unit = "s", value = 0.08, free = true, min = 0.01, max = 1 }
[states]
omega = { unit = "rad/s", derivative = "(spin - omega)/tau", initial = "spin", size = 5 }
[forces]
x = "push - drag*u"
y = "-drag*v"
z = "-k*omega^2"
[moments]
y = "I_yy*(lead*twist - damp*q)"
"#;
const OUTPUTS: &str = r#"
[parameters.out]
unit = "m"
value = 0.05
[parameters.bias]
unit = "rad/s"
value = 0
free = true
[outputs]
acc_x = { column = "acc_x_m_s2", unit = "m/s^2", std = 0.05, value = "a_x - out*(q^2 + r^2)" }
acc_z = { column = "acc_z_m_s2", unit = "m/s^2", std = 0.05, value = "a_z + out*(p*r - q_dot)" }
gyro = { unit = "rad/s", std = 0.005, value = "q + bias" }
rotor = { unit = "rad/s", std = 0.3, value = "omega" }
"#;
const STDS: [f64; 4] = [0.05, 0.05, 0.005, 0.3];
/// Poses are worse by this than they say: 5 mm and 0.5°.
const WORSE: f64 = 10.0;
const MASS_KG: f64 = 0.5;
const OUT_M: f64 = 0.05;
const NAMES: [&str; 6] = ["drag", "k", "lead", "damp", "tau", "bias"];
const TRUTH: [f64; 6] = [0.35, 1.1e-3, 11.0, 2.3, 0.06, 0.05];
const DURATION_S: f64 = 3.0;

fn vehicle(outputs: &str) -> Vehicle {
    let mut paper = VehicleFile::from(Vehicle::paper());
    (paper.model, paper.mass_kg) = (Some("sensed.toml".to_owned()), MASS_KG);
    paper.parameters.clear();
    paper.simulation.clear();
    paper.vehicle(|_| Ok(format!("{SENSED}{outputs}"))).expect("a vehicle")
}

fn inputs() -> InputSeries {
    let times_s: Vec<f64> = (0..=(DURATION_S / 0.02) as usize + 1).map(|k| 0.02 * k as f64).collect();
    let row =
        |t: &f64| [(2.0 * t).sin() + 0.5 * (5.3 * t).cos(), 66.0 + 6.0 * (4.1 * t).sin(), (3.7 * t).sin()];
    let names = ["push", "spin", "twist"].map(str::to_owned).to_vec();
    InputSeries::new(names, times_s.clone(), times_s.iter().flat_map(row).collect()).expect("inputs")
}

fn poses_s() -> Vec<f64> {
    (0..(30.0 * DURATION_S) as usize).map(|k| k as f64 / 30.0).collect()
}

/// At 200 Hz, from before the first pose on.
fn samples_ns() -> Vec<i64> {
    (-3..(200.0 * DURATION_S) as i64).map(|k| 5_000_000 * k + 1_300_000).collect()
}

fn flown(parameters: &[f64], start: &InitialState, times_s: &[f64]) -> Vec<FlightState> {
    let mut vehicle = vehicle("");
    for (name, value) in NAMES.iter().zip(parameters).filter(|(name, _)| **name != "bias") {
        vehicle.parameters.insert((*name).to_owned(), *value);
    }
    simulate(&vehicle, &inputs(), start, times_s).expect("a flight")
}

fn start() -> InitialState {
    InitialState { further: vec![inputs().row(0)[1]], ..InitialState::default() }
}

/// What the sensors show, by Newton's law in the axes of the body.
fn shown(state: &FlightState, parameters: &[f64]) -> [f64; 4] {
    let (v, w, e) = (state.velocity_in_body_m_s, state.rates_rad_s, state.attitude);
    let g = Vehicle::paper().environment.gravity_m_s2;
    let carried = state.velocity_rate_m_s2 + w.cross(&v);
    let a_x = carried.x + g * e.theta_rad.sin();
    let a_z = carried.z - g * e.theta_rad.cos() * e.phi_rad.cos();
    let out = nalgebra::Vector3::new(OUT_M, 0.0, 0.0);
    let lever = state.angular_acceleration_rad_s2.cross(&out) + w.cross(&w.cross(&out));
    [a_x + lever.x, a_z + lever.z, w.y + parameters[5], state.further[0]]
}

/// Samples with noise; the rotor shows every fourth alone.
fn sampled(random: &mut Random) -> SensorSeries {
    let times_ns = samples_ns();
    let times_s: Vec<f64> = times_ns.iter().map(|t| (*t as f64 * 1e-9).max(0.0)).collect();
    let states = flown(&TRUTH, &start(), &times_s[2..]);
    let mut row = |k: usize| {
        let exact = if k < 2 { [0.0; 4] } else { shown(&states[k - 2], &TRUTH) };
        let mut noisy: Vec<f64> = exact.iter().zip(STDS).map(|(x, std)| x + std * random.normal()).collect();
        if !k.is_multiple_of(4) {
            noisy[3] = f64::NAN;
        }
        noisy
    };
    let values = (0..times_ns.len()).flat_map(&mut row).collect();
    let columns = ["acc_x_m_s2", "acc_z_m_s2", "gyro", "rotor"].map(str::to_owned).to_vec();
    SensorSeries::new(columns, times_ns, values).expect("samples")
}

fn measured(random: &mut Random, with_sensors: bool) -> (FlightModel, Measurements) {
    let vehicle = vehicle(OUTPUTS);
    let states = flown(&TRUTH, &start(), &poses_s());
    let poses = Measurements::States(noisy_poses(&states, WORSE, random));
    if !with_sensors {
        return (FlightModel::new(&vehicle, &inputs()).expect("a model"), poses);
    }
    let model = FlightModel::with_outputs(&vehicle, &inputs()).expect("a model");
    let all = poses.with_sensors(model.model(), &sampled(random)).expect("sensors");
    (model, all)
}

fn fitted(seed: u64, with_sensors: bool) -> OutputErrorFit {
    let (model, measured) = measured(&mut Random::new(seed, 0), with_sensors);
    output_error(&model, &inputs(), &measured, &OutputErrorOptions::default()).expect("a fit")
}

/// How many intervals hold.
fn holds(fit: &OutputErrorFit) -> usize {
    let inside = |(name, truth): &(&&str, &f64)| {
        fit.parameter(name).is_some_and(|p| (p.ci_low..=p.ci_high).contains(truth))
    };
    NAMES.iter().zip(&TRUTH).filter(inside).count()
}

/// The bound of Cramér and Rao, by differences of simulated flights.
fn bound(with_sensors: bool) -> Vec<f64> {
    let times_s: Vec<f64> = samples_ns().iter().filter(|t| **t > 0).map(|t| *t as f64 * 1e-9).collect();
    let nominal = flown(&TRUTH, &start(), &poses_s());
    let predicted = |parameters: &[f64], start: &InitialState| {
        let mut out = Vec::new();
        for (state, nominal) in flown(parameters, start, &poses_s()).iter().zip(&nominal) {
            out.extend((state.position_in_world_m / (WORSE * POSITION_STD_M)).iter());
            let turn = nominal.pose().rotation.inverse() * state.pose().rotation;
            out.extend((turn.scaled_axis() / (WORSE * TURN_STD_RAD)).iter());
        }
        for (k, state) in flown(parameters, start, &times_s).iter().enumerate().filter(|_| with_sensors) {
            let own = shown(state, parameters);
            // The first sample behind time zero is the fourth.
            let last = if (k + 3).is_multiple_of(4) { 4 } else { 3 };
            out.extend((0..last).map(|s| own[s] / STDS[s]));
        }
        DVector::from_vec(out)
    };
    let count = if with_sensors { 6 } else { 5 };
    let columns: Vec<DVector<f64>> = (0..count + 12)
        .map(|column| {
            let step = if column < count { 1e-4 * TRUTH[column] } else { 1e-5 };
            let at = |h: f64| {
                let (mut parameters, mut start) = (TRUTH, start());
                match column.checked_sub(count) {
                    None => parameters[column] += h,
                    Some(k @ 0..=2) => start.position_in_world_m[k] += h,
                    Some(3) => start.attitude.phi_rad += h,
                    Some(4) => start.attitude.theta_rad += h,
                    Some(5) => start.attitude.psi_rad += h,
                    Some(k @ 6..=8) => start.velocity_in_body_m_s[k - 6] += h,
                    Some(k) => start.rates_rad_s[k - 9] += h,
                }
                predicted(&parameters, &start)
            };
            (at(step) - at(-step)) / (2.0 * step)
        })
        .collect();
    let by = DMatrix::from_columns(&columns);
    let covariance = inverse(&by.tr_mul(&by)).expect("regular");
    (0..count).map(|k| covariance[(k, k)].sqrt()).collect()
}

#[test]
fn intervals_hold_and_are_those_of_the_bound_with_and_without_sensors() {
    let (alone, all) = (bound(false), bound(true));
    let (mut inside, flights) = (0, 6);
    for seed in 0..flights {
        let fit = fitted(seed, true);
        inside += holds(&fit);
        for (p, bound) in fit.parameters.iter().zip(&all) {
            let ratio = p.bound_std / bound;
            assert!((0.85..1.15).contains(&ratio), "{seed} {}: {} of {bound}", p.name, p.bound_std);
        }
        for (k, (name, factor)) in fit.variance_factors.iter().enumerate() {
            let factor = if k < 6 { factor / (WORSE * WORSE) } else { *factor };
            assert!((0.6..1.5).contains(&factor), "{seed} {name}: {factor}");
        }
    }
    // Of 36 intervals of 95 %, 30 or more hold but for one time in three hundred.
    assert!((30..=36).contains(&inside), "{inside} of 36");
    let poses = fitted(0, false);
    let names: Vec<&str> = poses.parameters.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, NAMES[..5], "a bias that no pose shows is not free");
    for (p, bound) in poses.parameters.iter().zip(&alone) {
        assert!((0.8..1.2).contains(&(p.bound_std / bound)), "{}: {} of {bound}", p.name, p.bound_std);
    }
    // What the sensors are good for: the rotor's time constant most.
    assert!(all[..5].iter().zip(&alone).all(|(all, alone)| all < alone));
    assert!(all[4] < 0.5 * alone[4], "{all:?} {alone:?}");
}

/// The recorder of the inputs is late by 7 ms; thrust and push show at once in the accelerometers.
#[test]
fn the_lag_of_the_inputs_is_found_from_sensors_too() {
    let (lag_s, mut inside) = (0.007, 0);
    let (inputs, vehicle) = (inputs(), vehicle(OUTPUTS));
    let rows = 0..inputs.times_s().len();
    let times_s = inputs.times_s().iter().map(|t| t - lag_s).chain([inputs.end_s() + 0.02]).collect();
    let values = rows.clone().chain([rows.end - 1]).flat_map(|k| inputs.row(k).to_vec()).collect();
    let late = InputSeries::new(inputs.names(), times_s, values).expect("inputs");
    for seed in 40..43 {
        let (_, measured) = measured(&mut Random::new(seed, 0), true);
        let model = FlightModel::with_outputs(&vehicle, &late).expect("a model").with_free_lag();
        let fit = output_error(&model, &late, &measured, &OutputErrorOptions::default()).expect("a fit");
        let lag = fit.parameter("input_lag_s").expect("the lag");
        println!("{} ± {}", lag.value, lag.std);
        assert!((lag.value - lag_s).abs() < 3.5 * lag.std && lag.std < 1.5e-3, "{} ± {}", lag.value, lag.std);
        inside += holds(&fit);
    }
    assert!(inside >= 15, "{inside} of 18");
}

#[test]
fn filter_error_takes_sensors_too() {
    let mut inside = 0;
    for seed in 20..22 {
        let (model, measured) = measured(&mut Random::new(seed, 0), true);
        let fit = filter_error(&model, &inputs(), &measured, &OutputErrorOptions::default()).expect("a fit");
        inside += holds(&fit);
        let still =
            output_error(&model, &inputs(), &measured, &OutputErrorOptions::default()).expect("a fit");
        for (a, b) in fit.parameters.iter().zip(&still.parameters) {
            assert!((0.9..2.0).contains(&(a.std / b.std)), "{}: {} and {}", a.name, a.std, b.std);
        }
    }
    assert!(inside >= 10, "{inside} of 12");
}

#[test]
fn outputs_change_nothing_where_there_are_poses_alone() {
    let states = flown(&TRUTH, &start(), &poses_s());
    let measured = Measurements::States(noisy_poses(&states, WORSE, &mut Random::new(4, 0)));
    let [with, without] = [OUTPUTS, ""].map(|outputs| {
        let text = vehicle(outputs);
        let model =
            FlightModel::new(&text, &inputs()).and_then(|m| m.with_free(&NAMES[..5])).expect("a model");
        output_error(&model, &inputs(), &measured, &OutputErrorOptions::default()).expect("a fit")
    });
    assert_eq!(with, without);
}

/// Derivatives of all rows, of poses and sensors, by start and parameters.
#[test]
fn rows_of_sensors_have_the_derivatives_of_their_residuals() {
    let (model, measured) = measured(&mut Random::new(1, 0), true);
    let options = OutputErrorOptions { segment_s: f64::INFINITY, ..OutputErrorOptions::default() };
    let inputs = model.inputs_of(&inputs()).expect("inputs");
    let recorded = Recorded { inputs: &inputs, measurements: &measured };
    let fitter = Fitter::begin(&model, recorded, &options).expect("a start");
    let (at, point) = (&fitter.at, &fitter.point);
    let n = at.tangent + at.parameters;
    let starts = [DMatrix::identity(at.tangent, n + 1)];
    for k in 0..n {
        let h = if k < at.tangent { 1e-5 } else { 1e-5 * TRUTH[k - at.tangent] };
        let residuals = |h: f64| {
            let mut step = DVector::zeros(n + 1);
            step[k] = h;
            let mut moved: Point = point.moved(&step, &starts);
            if let Some(place) = k.checked_sub(at.tangent) {
                // A step of the fit is one of the logarithm, where a parameter has a bound.
                let parameter = point.model.free()[place];
                moved.model.set(parameter, point.model.value(parameter) + h);
            }
            fitter.problem.evaluate(&moved).expect("flown").residuals().collect::<Vec<f64>>()
        };
        let (ahead, behind) = (residuals(h), residuals(-h));
        let largest = at.segments[0].rows.row(k).amax();
        for (row, place) in at.places.iter().enumerate() {
            let numeric = (behind[row] - ahead[row]) / (2.0 * h);
            let exact = at.segments[0].rows[(k, row)];
            assert!((exact - numeric).abs() < 1e-5 * largest, "{k} {place:?}: {exact} {numeric} {largest}");
        }
        assert!(at.places.iter().any(|p| p.channel == 6 + 3), "the rotor is there");
    }
}

/// Sensors take no part in the search for missing terms: what they alone determine, a bias or a place, ended it as "not determined".
#[test]
fn what_sensors_alone_determine_does_not_end_the_search_for_missing_terms() {
    let (model, measured) = measured(&mut Random::new(20, 0), true);
    let free = |model: &FlightModel| model.free().len();
    assert!(free(&model.clone().without_outputs().0) < free(&model), "there are such parameters");
    let options = OutputErrorOptions::default();
    let asked = terms_asked_for(&model, &inputs(), &measured, &options).expect("tested");
    assert!(asked.is_empty(), "{asked:?}");
    let found = search_structure(&model, &inputs(), &measured, &options).expect("searched");
    assert!(found.added.is_empty() && found.fit.parameters.len() == free(&model));
}

/// A gyroscope whose scale is 10 % off went into the derivatives, and nothing was said.
#[test]
fn the_scale_of_a_sensor_is_asked_for_by_its_name() {
    for (scale, wanted) in [(1.0, None), (1.1, Some("a scale of gyro"))] {
        let mut random = Random::new(21, 0);
        let samples = sampled(&mut random);
        let row = |k: usize| {
            let mut row = samples.row(k).to_vec();
            row[2] *= scale;
            row
        };
        let values = (0..samples.times_ns().len()).flat_map(row).collect();
        let columns = ["acc_x_m_s2", "acc_z_m_s2", "gyro", "rotor"].map(str::to_owned).to_vec();
        let samples = SensorSeries::new(columns, samples.times_ns().to_vec(), values).expect("samples");
        let model = FlightModel::with_outputs(&vehicle(OUTPUTS), &inputs()).expect("a model");
        let states = flown(&TRUTH, &start(), &poses_s());
        let poses = Measurements::States(noisy_poses(&states, WORSE, &mut random));
        let measured = poses.with_sensors(model.model(), &samples).expect("sensors");
        let asked =
            terms_asked_for(&model, &inputs(), &measured, &OutputErrorOptions::default()).expect("tested");
        let first = asked.sensors.first();
        assert_eq!(first.map(|term| term.explains.as_str()), wanted, "{asked:?}");
        let step = first.and_then(|term| term.test).map_or(scale - 1.0, |test| test.step);
        assert!((step - (scale - 1.0)).abs() < 0.03, "{step}");
        let fit = output_error(&model, &inputs(), &measured, &OutputErrorOptions::default()).expect("a fit");
        let mut fits = FlightFits { poses: Some(fit), ..FlightFits::default() };
        fits.doubt(Some(Ok(asked)));
        let fit = fits.poses.expect("output error");
        assert_eq!(fit.parameters.iter().any(|p| p.identifiable), wanted.is_none(), "{:?}", fit.notes);
    }
}
