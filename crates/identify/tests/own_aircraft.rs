//! An aircraft whose rotors lag behind their commands and whose axes of inertia lie askew: equation error by
//! the equations of its own model file.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};
use mavsight_identify::{
    Bandwidth, EquationFile, Estimator, FitOptions, IdentifyError, Options, RegressionError, coefficients,
    identify_with,
};
use mavsight_model::{Dynamics, Model};
use mavsight_pose::{Motion, MotionCovariance, MotionSample};
use nalgebra::{Quaternion, Translation3};
use std::sync::Arc;

const MODEL: &str = r#"
schema = 2
name = "two rotors"
[inputs]
c1 = { column = "c1_rad_s", trim = 100 }
c2 = { column = "c2_rad_s", trim = 100 }
[parameters]
tau = { value = 0.08, free = true }
k = { value = 2e-4, free = true }
arm = { value = 0.3 }
D_w = { value = -0.4, free = true }
M_q = { value = -0.03, free = true }
N_r = { value = -0.03 }
e_w = { value = -0.04 }
e_u = { value = 0.03 }
L_p = { value = -0.02 }
[states]
w1 = { derivative = "(c1 - w1)/tau", initial = "c1" }
w2 = { derivative = "(c2 - w2)/tau", initial = "c2" }
lean = { derivative = "-lean/0.3 + 0.5*q + e_w*w + e_u*u", initial = "0.01" }
[forces]
z = "-k*(w1^2 + w2^2) + D_w*w"
x = "2*lean*k*w1^2"
[moments]
x = "0.01*k*w1^2 + L_p*p"
y = "arm*k*(w1^2 - w2^2) + M_q*q"
z = "N_r*r"
[[equation]]
name = "Z"
measured = "force_z"
regressors = ["w1^2", "w2^2", "w"]
[[equation]]
name = "X"
measured = "force_x"
scale = "2*k*(w1^2)"
regressors = ["1", "lean"]
[[equation]]
name = "M"
measured = "moment_y"
regressors = ["w1^2", "w2^2", "q"]
[[equation]]
name = "L"
measured = "moment_x"
regressors = ["w1*w1", "p"]
"#;

/// What the equations have as coefficients.
const TRUTH: [(&str, &str, f64); 9] = [
    ("Z", "w1^2", -2e-4),
    ("Z", "w2^2", -2e-4),
    ("Z", "w", -0.4),
    ("X", "lean", 1.0),
    ("M", "w1^2", 0.3 * 2e-4),
    ("M", "w2^2", -0.3 * 2e-4),
    ("M", "q", -0.03),
    ("L", "w1*w1", 0.01 * 2e-4),
    ("L", "p", -0.02),
];

fn vehicle() -> Vehicle {
    Vehicle {
        mass_kg: 0.4,
        inertia_kg_m2: [4e-3, 5e-3, 6e-3],
        products_of_inertia_kg_m2: [0.4e-3, 1.1e-3, -0.6e-3],
        model: Arc::new(Model::parse("two.toml", MODEL).expect("a model")),
        parameters: [].into(),
        simulation: [].into(),
        ..Vehicle::paper()
    }
}

fn inputs() -> InputSeries {
    let times_s: Vec<f64> = (0..=500).map(|k| 0.01 * f64::from(k)).collect();
    let command =
        |t: f64| [100.0 + 9.0 * (7.0 * t).sin() + 5.0 * (2.0 * t).cos(), 98.0 + 8.0 * (11.0 * t).sin()];
    let values = times_s.iter().flat_map(|t| command(*t)).collect();
    InputSeries::new(["c1_rad_s".to_owned(), "c2_rad_s".to_owned()], times_s, values).expect("inputs")
}

/// The motion by the classical Runge-Kutta method, a sample at every fifth row of the inputs.
fn motion(vehicle: &Vehicle, inputs: &InputSeries) -> Motion {
    let values = vehicle.values();
    let dynamics = Dynamics::new(&vehicle.model, &values, &[]);
    let mut evaluation = dynamics.with(&[]);
    let count = dynamics.states();
    let mut state = vec![0.0; count];
    state[3] = 1.0;
    state[13..].copy_from_slice(&vehicle.model.initial(&values, inputs.row(0)));
    let mut samples = Vec::new();
    for (row, t_s) in inputs.times_s().iter().enumerate() {
        evaluation.set_inputs(inputs.row(row));
        let mut rates = |state: &[f64]| {
            let mut out = vec![0.0; count];
            evaluation.rates(state, &mut out);
            out
        };
        if row % 2 == 0 {
            samples.push(sample(*t_s, &state, &rates(&state), vehicle.environment.gravity_m_s2));
        }
        let (steps, moved) = (10, |a: &[f64], b: &[f64], h: f64| -> Vec<f64> {
            a.iter().zip(b).map(|(a, b)| a + h * b).collect()
        });
        let h = 0.01 / f64::from(steps);
        for _ in 0..steps {
            let k1 = rates(&state);
            let k2 = rates(&moved(&state, &k1, 0.5 * h));
            let k3 = rates(&moved(&state, &k2, 0.5 * h));
            let k4 = rates(&moved(&state, &k3, h));
            for i in 0..count {
                state[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
            }
        }
    }
    Motion {
        samples,
        unknown_ns: Vec::new(),
        doubts: mavsight_pose::Doubts::default(),
        translation_bandwidth_hz: 1e6,
        rotation_bandwidth_hz: 1e6,
        sample_interval_s: 0.02,
    }
}

fn sample(t_s: f64, x: &[f64], rate: &[f64], gravity_m_s2: f64) -> MotionSample {
    let level_from_body = UnitQuaternion::from_quaternion(Quaternion::new(x[3], x[4], x[5], x[6]));
    let velocity = Vector3::new(x[7], x[8], x[9]);
    let rates = Vector3::new(x[10], x[11], x[12]);
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let gravity_in_body = level_from_body.inverse() * Vector3::new(0.0, 0.0, gravity_m_s2);
    MotionSample {
        t_ns: (t_s * 1e9).round() as i64,
        world_from_body: Isometry3::from_parts(
            Translation3::new(x[0], x[1], x[2]),
            half_turn * level_from_body,
        ),
        velocity_in_body_m_s: velocity,
        rates_rad_s: rates,
        specific_force_m_s2: Vector3::new(rate[7], rate[8], rate[9]) + rates.cross(&velocity)
            - gravity_in_body,
        angular_acceleration_rad_s2: Vector3::new(rate[10], rate[11], rate[12]),
        covariance: MotionCovariance::default(),
    }
}

fn unfiltered(equations: Option<&str>) -> Options {
    let equations = equations.map(|text| EquationFile::parse("own.toml", text).expect("equations"));
    Options { bandwidth: Bandwidth::Smoother, equations, ..Options::default() }
}

#[test]
fn lagging_rotors_and_askew_inertia_give_the_coefficients_that_flew() {
    let (vehicle, inputs) = (vehicle(), inputs());
    let motion = motion(&vehicle, &inputs);
    let choice = FitOptions { estimators: vec![Estimator::LeastSquares], ..FitOptions::default() };
    let given = Vehicle { model: Arc::new(Model::rigid_body()), ..vehicle.clone() };
    // By the vehicle's own model, and by the same file given beside a vehicle that names none.
    for (vehicle, options) in [(&vehicle, unfiltered(None)), (&given, unfiltered(Some(MODEL)))] {
        let table = coefficients(&motion, &inputs, vehicle, &options).expect("a table");
        let found = identify_with(&table, &choice).expect("fits");
        for (output, name, truth) in TRUTH {
            let fit = found.fit(output, Estimator::LeastSquares).expect("a fit");
            let p = fit.parameters.iter().find(|p| p.name == name).expect("a parameter");
            let got = p.value.expect("a value");
            assert!((got / truth - 1.0).abs() < 2e-3, "{output},{name}: {got} is not {truth}");
        }
    }
    let only = Options { only: vec!["M".to_owned()], ..unfiltered(None) };
    let table = coefficients(&motion, &inputs, &vehicle, &only).expect("a table");
    let names: Vec<&str> = table.outputs.iter().map(|o| o.name.as_str()).collect();
    assert_eq!((names, only.by_equation(&vehicle).expect("one").len()), (vec!["M"], 1));
    assert_eq!(table.outputs[0].columns[0].inputs, ["c1"]);
}

#[test]
fn columns_of_numbers_are_signals_of_an_aircraft_without_a_model() {
    let (flown, inputs) = (vehicle(), inputs());
    let motion = motion(&flown, &inputs);
    let bare = Vehicle { model: Arc::new(Model::rigid_body()), ..flown };
    let text = "schema = 1\nname = \"n\"\n[[output]]\nname = \"Z\"\nmeasured = \"force_z\"\nscale = \"si\"\n\
                regressors = [\"c1_rad_s*c1_rad_s\", \"c2_rad_s*c2_rad_s\", \"w\"]";
    let table = coefficients(&motion, &inputs, &bare, &unfiltered(Some(text))).expect("a table");
    let columns = &table.outputs[0].columns;
    for (k, t_s) in table.t_s.iter().enumerate().skip(5).step_by(7).take(30) {
        let held = inputs.at(*t_s).expect("an input")[0].powi(2);
        // The mean over half a row to either side.
        let before = inputs.at(*t_s - 0.005).expect("an input")[0].powi(2);
        assert!((columns[0].values[k] - 0.5 * (held + before)).abs() < 1e-6 * held);
    }
    let refused = coefficients(&motion, &inputs, &bare, &unfiltered(None)).expect_err("no equations");
    assert!(matches!(refused, IdentifyError::NoEquations(_)), "{refused}");
    let rotor = text.replace("\"si\"", "\"rotor\"");
    let refused = coefficients(&motion, &inputs, &bare, &unfiltered(Some(&rotor))).expect_err("no rotor");
    assert!(matches!(refused, IdentifyError::Regression(RegressionError::Scale { .. })), "{refused}");
}

#[test]
fn signals_without_a_value_are_refused_with_their_time() {
    let (flown, inputs) = (vehicle(), inputs());
    let motion = motion(&flown, &inputs);
    let with = |regressors: &str, scale: &str| {
        let text = MODEL.replace(
            "regressors = [\"w1^2\", \"w2^2\", \"q\"]",
            &format!("regressors = [{regressors}]\nscale = \"{scale}\""),
        );
        coefficients(&motion, &inputs, &flown, &unfiltered(Some(&text))).expect_err("refused")
    };
    let refused = with("\"q\", \"log(c1 - 100)\"", "1");
    assert!(
        matches!(&refused, IdentifyError::SignalNotFinite { regressor, .. } if regressor.starts_with("log"))
    );
    let refused = with("\"q\"", "c1 - 100");
    assert!(matches!(refused, IdentifyError::ScaleNotPositive { .. }), "{refused}");
    let refused = with("\"q\", \"tanh(lean)\"", "1").to_string();
    assert!(refused.contains("lean") && refused.contains("output error"), "{refused}");
}
