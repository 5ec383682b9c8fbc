//! Values and exact derivatives of the crate against the text of the file, worked out in 57 digits.
//!
//! A derivative is right where it is within 1e-12 of the central difference, relative to the difference.
//! Where it is the difference of larger terms, no number of 64 bits holds it so well: there, 1e-12 of the sum
//! of its terms by the chain rule, without regard to sign, is the measure. How many derivatives need that is
//! counted, and must be few.

#![allow(clippy::unwrap_used, clippy::panic)]

mod by_text;

use by_text::{BODY, Constants, File, RIGID, Tape};
use mavsight_model::{Body, Dynamics, Evaluation, Model, Slope};

const STATES: usize = 1000;
const NEAR: f64 = 1e-12;

/// A fixed sequence of random numbers (splitmix64).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A state, inputs and parameters.
struct Draw {
    state: Vec<f64>,
    inputs: Vec<f64>,
    parameters: Vec<f64>,
}

const BODY_VALUES: Body = Body {
    mass_kg: 0.5,
    inertia_kg_m2: [3e-3, 4e-3, 5e-3, 2e-4, -3e-4, 1e-4],
    gravity_m_s2: 9.81,
    air_density_kg_m3: 1.2,
};

/// How often derivatives were compared, and how often their terms had to be the measure.
#[derive(Default)]
struct Count {
    all: usize,
    by_terms: usize,
    worst: f64,
}

impl Count {
    fn compare(&mut self, exact: f64, difference: f64, terms: impl FnOnce() -> f64) {
        let error = (exact - difference).abs();
        self.all += 1;
        if error <= NEAR * difference.abs() {
            self.worst = self.worst.max(if error == 0.0 { 0.0 } else { error / difference.abs() });
            return;
        }
        let terms = terms();
        // A difference of nothing is zero but for its own rounding.
        self.by_terms += usize::from(difference.abs() > 1e-20 * terms);
        let relative = if terms > 0.0 { error / terms } else { f64::INFINITY };
        self.worst = if relative.is_nan() { f64::INFINITY } else { self.worst.max(relative) };
    }
}

fn dense(rows: usize, columns: usize, slopes: impl Iterator<Item = Slope>) -> Vec<Vec<f64>> {
    let mut out = vec![vec![0.0; rows]; columns];
    slopes.for_each(|slope| out[slope.column][slope.row] = slope.value);
    out
}

/// The crate's values and derivatives by each state, input and parameter: of the rates, behind them those of
/// the sensors.
fn exact(evaluation: &mut Evaluation<'_>, model: &Model, draw: &Draw) -> (Vec<f64>, Vec<Vec<f64>>) {
    let n = model.state_count();
    evaluation.set_inputs(&draw.inputs);
    let mut rates = vec![0.0; n];
    evaluation.linearise(&draw.state, &mut rates);
    let mut alone = vec![0.0; n];
    evaluation.rates(&draw.state, &mut alone);
    assert_eq!(rates, alone);
    let mut slopes = dense(n, n, evaluation.by_state());
    slopes.extend(dense(n, model.inputs.len(), evaluation.by_input()));
    slopes.extend(dense(n, model.parameters.len(), evaluation.by_parameter()));
    let sensors = model.sensors.len();
    let mut sensed = vec![0.0; sensors];
    evaluation.sense(&draw.state, &mut sensed);
    let mut of_sensors = dense(sensors, n, evaluation.sensors_by_state());
    of_sensors.extend(dense(sensors, model.inputs.len(), evaluation.sensors_by_input()));
    of_sensors.extend(dense(sensors, model.parameters.len(), evaluation.sensors_by_parameter()));
    slopes.iter_mut().zip(of_sensors).for_each(|(slopes, own)| slopes.extend(own));
    rates.extend(sensed);
    (rates, slopes)
}

fn names(model: &Model) -> (Vec<String>, Vec<String>) {
    let states: Vec<String> =
        RIGID.iter().map(|n| (*n).to_owned()).chain(model.states.iter().map(|s| s.name.clone())).collect();
    let inputs = model.inputs.iter().map(|i| i.name.clone());
    let variables =
        states.iter().cloned().chain(inputs).chain(model.parameters.iter().map(|p| p.name.clone()));
    (variables.collect(), states)
}

/// Compares at random states, derivatives by all variables or by the states, inputs and parameters of the
/// file alone; `reference` is the text that is worked out in 57 digits.
fn compare(
    [text, reference]: [&str; 2],
    states: usize,
    all: bool,
    mut draw: impl FnMut(&mut Random, &Model) -> Draw,
) -> Count {
    let model = Model::parse("model.toml", text).unwrap();
    let (variables, states_of) = names(&model);
    let of_states = states_of.iter().map(|name| format!("$d {name}"));
    let of_sensors = model.sensors.iter().map(|s| format!("$output {}", s.name));
    let outputs: Vec<String> = of_states.chain(of_sensors).collect();
    let tape = Tape::new(&File::new(reference), &variables, &outputs);
    let is_own = |k: &usize| all || !RIGID.iter().chain(&BODY).any(|name| *name == variables[*k]);
    let by: Vec<usize> = (0..variables.len()).filter(is_own).collect();
    let values = model.values(&BODY_VALUES, |_| None);
    let free: Vec<usize> = (0..model.parameters.len()).collect();
    let dynamics = Dynamics::with_all_slopes(&model, &values, &free);
    let mut random = Random(33);
    let mut constants = Constants::new();
    let mut count = Count::default();
    for _ in 0..states {
        let draw = draw(&mut random, &model);
        let mut evaluation = dynamics.with(&draw.parameters);
        let (rates, slopes) = exact(&mut evaluation, &model, &draw);
        let all = [draw.state, draw.inputs, draw.parameters].concat();
        let differences = tape.differences(&all, &by, &mut constants);
        for ((rate, value), size) in rates.iter().zip(&differences.values).zip(&differences.sizes) {
            count.compare(*rate, *value, || *size);
        }
        for (k, of_variable) in by.iter().zip(&differences.slopes) {
            for (row, (exact, slope)) in slopes[*k].iter().zip(of_variable).enumerate() {
                count.compare(*exact, *slope, || tape.terms(*k, &differences)[row]);
            }
        }
    }
    count
}

fn rigid(random: &mut Random) -> Vec<f64> {
    let mut state: Vec<f64> = (0..3).map(|_| random.between(-2.0, 2.0)).collect();
    let turn: Vec<f64> = (0..4).map(|_| random.between(-1.0, 1.0)).collect();
    // Lengths other than one too: the equations must hold for them.
    let length = turn.iter().map(|t| t * t).sum::<f64>().sqrt() / random.between(0.9, 1.1);
    state.extend(turn.iter().map(|t| t / length));
    state.extend((0..6).map(|_| random.between(-3.0, 3.0)));
    state
}

/// Within the ranges of the file; parameters about their values.
fn draw_of_file(random: &mut Random, model: &Model, values: &[f64]) -> Draw {
    let mut state = rigid(random);
    state.extend(model.states.iter().map(|s| random.between(-2.0, 2.0) * s.size));
    let end = |end: f64, other: f64| if end.is_finite() { end } else { other };
    let inputs = model.inputs.iter().map(|i| random.between(end(i.min, -1.0), end(i.max, 1.0))).collect();
    let one = |(parameter, value): (&mavsight_model::Parameter, &f64)| {
        let wide = if *value == 0.0 { parameter.prior_std.unwrap_or(0.1) } else { 0.3 * value.abs() };
        random.between(value - wide, value + wide).clamp(parameter.min, parameter.max)
    };
    let parameters = model.parameters.iter().zip(values).map(one).collect();
    Draw { state, inputs, parameters }
}

fn shelf() -> Vec<(String, String)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/shelf");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = files.filter(|path| path.extension().is_some_and(|e| e == "toml"));
    let read = |path: std::path::PathBuf| {
        (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read_to_string(path).unwrap())
    };
    files.map(read).collect()
}

#[test]
fn derivatives_of_each_shelf_model_are_exact() {
    let files = shelf();
    assert!(!files.is_empty());
    let one = |(name, text): &(String, String)| {
        let begin = std::time::Instant::now();
        let values = Model::parse(name, text).unwrap().values(&BODY_VALUES, |_| None);
        let count = compare([text, text], STATES, true, |random, model| draw_of_file(random, model, &values));
        let Count { all, by_terms, worst } = &count;
        println!(
            "{name}: {all} compared, {by_terms} by their terms, worst {worst:.1e}, {:.1?}",
            begin.elapsed()
        );
        assert!(*worst <= NEAR, "{name}: {worst:e}");
        assert!(by_terms * 1000 < *all, "{name}: {by_terms} of {all}");
    };
    std::thread::scope(|scope| {
        for files in files.chunks(files.len().div_ceil(2)) {
            scope.spawn(move || files.iter().for_each(one));
        }
    });
}

/// Values, trim and initial states of the shelf models, and derived quantities with their derivatives.
#[test]
fn what_follows_from_parameters_is_that_of_the_text() {
    for (name, text) in shelf() {
        let model = Model::parse(&name, &text).unwrap();
        let mut file = File::new(&text);
        let values = model.values(&BODY_VALUES, |_| None);
        let body: Vec<String> = BODY.iter().map(|n| (*n).to_owned()).collect();
        let own: Vec<String> = model.parameters[BODY.len()..].iter().map(|p| p.name.clone()).collect();
        let outputs = |lead: &str, of: Vec<String>| -> Vec<String> {
            of.iter().map(|name| format!("{lead} {name}")).collect()
        };
        let all: Vec<String> = body.iter().chain(&own).cloned().collect();
        let inputs: Vec<String> = model.inputs.iter().map(|i| i.name.clone()).collect();
        let states: Vec<String> = model.states.iter().map(|s| s.name.clone()).collect();
        let near = |found: &[f64], wanted: &[f64], what: &str| {
            assert_eq!(found.len(), wanted.len());
            for (found, wanted) in found.iter().zip(wanted) {
                assert!((found - wanted).abs() <= 1e-14 * wanted.abs(), "{name}, {what}: {found} {wanted}");
            }
        };
        let trim = Tape::new(&file, &all, &outputs("$trim", inputs.clone())).values(&values);
        near(&model.trim(&values), &trim, "trim");
        let begin: Vec<String> = all.iter().chain(&inputs).cloned().collect();
        let initial = Tape::new(&file, &begin, &outputs("$initial", states));
        near(&model.initial(&values, &trim), &initial.values(&[values.clone(), trim].concat()), "initial");
        let derived: Vec<String> = model.derived.iter().map(|d| d.name.clone()).collect();
        let derived = Tape::new(&file, &all, &outputs("$derived", derived));
        let by: Vec<usize> = (0..all.len()).collect();
        let differences = derived.differences(&values, &by, &mut Constants::new());
        let mut count = Count::default();
        for (k, (value, slopes)) in model.derived_values(&values, &by).into_iter().enumerate() {
            count.compare(value, differences.values[k], || differences.sizes[k]);
            for (j, slope) in slopes.into_iter().enumerate() {
                count.compare(slope, differences.slopes[j][k], || derived.terms(j, &differences)[k]);
            }
        }
        assert!(count.worst <= NEAR, "{name}: {:e}", count.worst);
        // The value of a parameter from the values of others: their texts in the place of their names.
        for name in &own {
            let text = file.texts[&format!("$value {name}")].clone();
            file.texts.insert(name.clone(), text);
        }
        let numbers: Vec<f64> = values[..BODY.len()].to_vec();
        near(&values[BODY.len()..], &Tape::new(&file, &body, &own).values(&numbers), "value");
    }
}

/// Expressions of a state s, an input i and a parameter k, and the range of all three.
const FUNCTIONS: [(&str, f64, f64); 38] = [
    ("s + i + k", -3.0, 3.0),
    ("s - i - k", -3.0, 3.0),
    ("s*i*k", -3.0, 3.0),
    ("s/i/k", 0.1, 3.0),
    ("s/(i/k)", 0.1, 3.0),
    ("-s^2*i - -k", -3.0, 3.0),
    ("s^3 + i^-2 + k^4", 0.1, 3.0),
    ("(s*i)^2.5 + k^-0.5", 0.1, 3.0),
    ("(s*k)^i", 0.1, 3.0),
    ("s^i^k", 0.5, 1.5),
    ("2^(s*i) + k^0.5 + k^0 + k^1", 0.1, 2.0),
    ("sin(s*i + k)", -3.0, 3.0),
    ("cos(s*i + k)", -3.0, 3.0),
    ("tan(s*i*k)", -1.1, 1.1),
    ("asin(s*i*k)", -0.999, 0.999),
    ("acos(s*i*k)", -0.999, 0.999),
    ("atan(s*i + k)", -5.0, 5.0),
    ("atan2(s*i, k)", -3.0, 3.0),
    ("atan2(k, s - i)", -3.0, 3.0),
    ("sqrt(s*i + k)", 0.1, 3.0),
    ("sqrt(s^2 + i^2 + k^2)", -3.0, 3.0),
    ("abs(s*i + k)", -3.0, 3.0),
    ("s*abs(i*k)", -3.0, 3.0),
    ("exp(s*i + k)", -3.0, 3.0),
    ("log(s*i + k)", 0.1, 3.0),
    ("log(1 + s^2)/k + i", 0.1, 3.0),
    ("tanh(s*i + k)", -5.0, 5.0),
    ("min(s*i, k)", -3.0, 3.0),
    ("max(s*i, k)", -3.0, 3.0),
    ("sqrt(max(s*i, 0)) + k", -3.0, 3.0),
    ("asin(clamp(s*i, -1, 1)) + k", -3.0, 3.0),
    ("clamp(s*i, -k, 2*k)", 0.1, 3.0),
    ("clamp(3*s, -1, 1)*i*k", -1.0, 1.0),
    ("deadzone(3*s*i, k)", 0.1, 2.0),
    ("deadzone(s, 0.5)*i*k", -2.0, 2.0),
    ("saturate(s*i, k)", 0.2, 3.0),
    ("curve(s*i)*k", -3.0, 3.0),
    ("exp(-s^2)*sin(3*i)/(1 + tanh(k)^2) - curve(k)^2", -1.0, 1.0),
];

fn one_function(expression: &str) -> String {
    format!(
        "schema = 2\nname = \"one\"\n[inputs]\ni = {{}}\n[parameters]\nk = {{ value = 1 }}\n[states]\n\
         s = {{ derivative = \"{expression}\" }}\n[forces]\nx = \"s\"\n[[table]]\nname = \"curve\"\n\
         x = [-2, -0.5, 0.25, 1, 4]\ny = [1, -1, 0.5, 2, 2.5]\n"
    )
}

#[test]
fn derivatives_of_each_function_are_exact() {
    for (expression, low, high) in FUNCTIONS {
        let text = one_function(expression);
        let count = compare([&text, &text], STATES, false, |random, model| {
            let mut state = rigid(random);
            state.push(random.between(low, high));
            let inputs = vec![random.between(low, high)];
            let mut parameters = model.values(&BODY_VALUES, |_| None);
            parameters[BODY.len()] = random.between(low, high);
            Draw { state, inputs, parameters }
        });
        assert!(count.worst <= NEAR, "{expression}: {:e}", count.worst);
    }
}

/// Sensors that see all that there is: specific force at a place, angular acceleration, attitude, a further
/// state, a bias.
const SENSORS: &str = r#"
schema = 2
name = "sensed"
inputs = { push = { unit = "N" }, spin = { unit = "rad/s" } }
forces = { x = "push - drag*u", y = "-drag*v", z = "-k*omega^2" }
moments = { x = "arm*push", y = "arm*k*omega^2 - damp*q", z = "damp*omega" }
[parameters]
drag = { unit = "N s/m", value = 0.3 }
k = { unit = "N s^2", value = 1e-3 }
arm = { unit = "m", value = 0.1 }
tau = { unit = "s", value = 0.1 }
out = { unit = "m", value = 0.05 }
damp = { unit = "N m s", value = 0.01 }
far = { unit = "m", value = 2 }
bias = { unit = "rad/s", value = 0.01 }
[states]
omega = { unit = "rad/s", derivative = "(spin - omega)/tau", size = 2 }
[outputs]
acc_x = { value = "a_x - out*(q^2 + r^2)", std = 1 }
acc_y = { value = "a_y + out*(r_dot + p*q)", std = 1 }
acc_z = { value = "a_z + out*(p*r - q_dot)", std = 1 }
gyro_x = { value = "p + bias", std = 1 }
tilt = { value = "sin(phi)*cos(theta) + psi*exp(-(x/far)^2)", std = 1 }
speed = { value = "omega*(1 + spin*tau)", std = 1 }
"#;

#[test]
fn derivatives_of_sensors_are_exact() {
    let values = Model::parse("sensed.toml", SENSORS).unwrap().values(&BODY_VALUES, |_| None);
    let count =
        compare([SENSORS, SENSORS], STATES, true, |random, model| draw_of_file(random, model, &values));
    assert!(count.worst <= NEAR, "{:e}", count.worst);
    assert!(count.by_terms * 200 < count.all, "{} of {}", count.by_terms, count.all);
    let wrong = SENSORS.replace("p*r - q_dot", "p*r - 1.0000000001*q_dot");
    let count = compare([SENSORS, &wrong], 3, true, |random, model| draw_of_file(random, model, &values));
    assert!(count.worst > NEAR, "a wrong factor is seen");
}

/// The comparison can fail: a factor that is wrong by 1e-10 shows.
#[test]
fn a_wrong_factor_is_seen() {
    let (text, other) = (one_function("sin(2*s)*i*k"), one_function("sin(2.0000000002*s)*i*k"));
    let count = compare([&text, &other], 10, false, |random, model| {
        let mut state = rigid(random);
        state.push(random.unit());
        let parameters = model.values(&BODY_VALUES, |_| None);
        Draw { state, inputs: vec![random.unit()], parameters }
    });
    assert!(count.worst > NEAR);
}
