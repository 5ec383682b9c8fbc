//! What a person reads who has made a mistake: for each fault its place, what is wrong, and what to do.

#![allow(clippy::unwrap_used, clippy::panic)]

mod cases;

use cases::CASES;
use mavsight_model::{Body, Model};

/// A model without fault; each case puts something else in the place of one piece of it.
const GOOD: &str = r#"schema = 2
name = "test"

[inputs]
omega = { unit = "rad/s", min = 0, max = 400, trim = "sqrt(mass*g/k_T)" }

[parameters]
k_T = { unit = "N s^2", value = 1e-4, free = true }
tau = { unit = "s", value = 0.05, free = true, min = 1e-3, max = 1 }
d = { label = "drag", unit = "N s/m", value = 0.1 }
I_xx = { free = true }

[definitions]
thrust = { unit = "N", value = "k_T*speed^2" }
lift = { unit = "N", value = "thrust + thrust_curve(1)" }

[states]
speed = { unit = "rad/s", derivative = "(omega - speed)/tau", initial = "omega" }

[forces]
x = "-d*u"
z = "-lift - d*w + thrust"

[outputs]
acc = { unit = "m/s^2", value = "a_z", std = 0.1 }

[derived]
ratio = { value = "d/k_T" }

[[table]]
name = "thrust_curve"
x = [0, 1, 2]
y = [0, 0.1, 0.4]
unit = "N"

[[equation]]
name = "X"
measured = "force_x"
regressors = ["1", "u"]
fixed = { u = -0.1 }
when = "excited"
"#;

const BODY: Body = Body {
    mass_kg: 0.5,
    inertia_kg_m2: [3e-3, 4e-3, 5e-3, 0.0, 0.0, 0.0],
    gravity_m_s2: 9.81,
    air_density_kg_m3: 1.2,
};

fn changed(old: &str, new: &str) -> String {
    assert_eq!(GOOD.matches(old).count(), 1, "{old}");
    GOOD.replacen(old, new, 1)
}

/// Lines that end in CR and LF, a byte-order mark, numbers in other bases.
#[test]
fn files_of_other_systems_are_read() {
    let text = changed("value = \"k_T*speed^2\"", "value = \"\"\"\n  k_T*\n  sped^2\"\"\"");
    for text in [text.clone(), text.replace('\n', "\r\n")] {
        let error = Model::parse("test.toml", &text).unwrap_err();
        assert_eq!(
            error.to_string(),
            "test.toml, line 16, column 3: `sped` is not defined: did you mean speed?"
        );
    }
    assert!(Model::parse("test.toml", &format!("\u{feff}{GOOD}")).is_ok());
    for (number, value) in
        [("0x10", 16.0), ("0b11", 3.0), ("1_000", 1000.0), ("-5", -5.0), ("+1.5e-3", 1.5e-3)]
    {
        let model = model("value = 0.1 }", &format!("value = {number} }}"));
        assert_eq!(model.values(&BODY, |_| None)[model.parameter("d").unwrap()], value);
    }
}

/// What a file says whose size is too much.
#[test]
fn too_much_is_said() {
    let states = (0..101).map(|k| format!("s_{k} = {{ derivative = \"-s_{k}\" }}\n")).collect::<String>();
    let states = changed("[states]\n", &format!("[states]\n{states}"));
    let long = changed("-d*u\"", &format!("-d*u{}\"", " + 0".repeat(10_000)));
    let comment = format!("{GOOD}# {}", "x".repeat(1_000_000));
    let copies = GOOD.to_owned() + &"[[equation]]\n".repeat(100);
    for (text, message) in [
        (&states, "line 17, column 1: 102 states, but at most 100 are read"),
        (&long, "line 21, column 40004: more than 20000 parts in one expression: split it into definitions"),
        (&comment, &format!("line 1, column 1: {} bytes, but at most 1000000 are read", comment.len())),
        (&copies, "line 36, column 1: 101 [[equation]], but at most 100 are read"),
    ] {
        assert_eq!(Model::parse("test.toml", text).unwrap_err().to_string(), format!("test.toml, {message}"));
    }
}

fn model(old: &str, new: &str) -> Model {
    Model::parse("test.toml", &changed(old, new)).unwrap()
}

/// What has no value at the start, with the values of an aircraft.
#[test]
fn a_model_that_is_not_finite_at_its_start_is_refused() {
    let good = model("name = \"test\"", "name = \"test\"");
    let at_rest = |model: &Model, values: &[f64]| model.check(values, &model.at_rest(values));
    assert_eq!(at_rest(&good, &good.values(&BODY, |_| None)), Ok(()));
    let start = "at the start of the flight: keep divisors and arguments of sqrt and log above zero there";
    for (old, new, message) in [
        ("x = \"-d*u\"", "x = \"-d*u*v/u\"", "line 21, column 5: x of [forces] is NaN"),
        (
            "x = \"-d*u\"",
            "x = \"-d*sqrt(u*g*tau)\"",
            "line 21, column 5: the slope of x of [forces] over u is -inf",
        ),
        (
            "x = \"-d*u\"",
            "x = \"-d*u*atan2(w, u)\"",
            "line 21, column 5: the slope of x of [forces] over u is NaN",
        ),
        (
            "initial = \"omega\"",
            "initial = \"omega^2/(omega - omega*1)\"",
            "line 18, column 73: the initial value of speed is inf",
        ),
        ("mass*g/k_T)", "-mass*g/k_T)", "line 5, column 1: the trim of omega is NaN"),
        (
            "(omega - speed)/tau",
            "(omega - speed)/tau + speed/tau*log(theta)",
            "line 18, column 40: the derivative of speed is -inf",
        ),
    ] {
        let model = model(old, new);
        let found = at_rest(&model, &model.values(&BODY, |_| None)).map_err(|e| e.to_string());
        assert_eq!(found, Err(format!("test.toml, {message} {start}")));
    }
    let error = at_rest(&good, &good.values(&BODY, |p| (p.name == "d").then_some(f64::NAN))).unwrap_err();
    let message = "test.toml, line 10, column 1: the value of d is NaN";
    assert!(error.to_string().starts_with(message), "{error}");
    // The length of the velocity has a slope at rest: zero.
    let airspeed = model("x = \"-d*u\"", "x = \"-d*sqrt(u^2 + v^2 + w^2)\"");
    assert!(at_rest(&airspeed, &airspeed.values(&BODY, |_| None)).is_ok());
    // A wing has no angle of attack at rest, but one in flight.
    let wing = model("x = \"-d*u\"", "x = \"-d*u*atan2(w, u)\"");
    let values = wing.values(&BODY, |_| None);
    let mut start = wing.at_rest(&values);
    assert!(wing.check(&values, &start).is_err());
    start.state[7] = 20.0;
    assert_eq!(wing.check(&values, &start), Ok(()));
    // No mass: not the file's fault.
    let error = at_rest(&good, &good.values(&Body { mass_kg: 0.0, ..BODY }, |_| None)).unwrap_err();
    let message = "test.toml, line 1, column 1: the rate of change of u, with this mass and inertia, is NaN";
    assert!(error.to_string().starts_with(message), "{error}");
}

/// Stiffness.
#[test]
fn a_state_that_is_too_fast_is_named() {
    let model = model("name = \"test\"", "name = \"test\"");
    let values = model.values(&BODY, |p| (p.name == "tau").then_some(2e-4));
    let start = model.at_rest(&values);
    assert_eq!(model.check_speed(&values, &start, 1e-4), Ok(()));
    let error = model.check_speed(&values, &start, 1e-3).unwrap_err();
    let message = "test.toml, line 18, column 40: speed follows with a time constant of 2.00e-4 s, and nothing \
                   faster than 1.00e-3 s can be integrated: make it slower, or replace it by the value it runs to";
    assert_eq!(error.to_string(), message);
    // Drag of 1e4 N s/m on half a kilogram: u and w follow within 5e-5 s.
    let values = model.values(&BODY, |p| (p.name == "d").then_some(1e4));
    let error = model.check_speed(&values, &start, 1e-4).unwrap_err();
    assert!(error.to_string().starts_with("test.toml, line 22, column 5: w follows"), "{error}");
    // An oscillation has no time constant on the diagonal, but one all the same: a spring of 1e8 /s².
    let spring = Model::parse("spring.toml", SPRING).unwrap();
    let values = spring.values(&BODY, |_| None);
    let dynamics = mavsight_model::Dynamics::new(&spring, &values, &[]);
    let fastest = dynamics.with(&[]).fastest(&spring.at_rest(&values).state);
    assert!((fastest.time_s - 1e-4).abs() < 2e-6, "{fastest:?}");
    assert!(fastest.state >= 13, "{fastest:?}");
}

const SPRING: &str = r#"schema = 2
name = "spring"
[states]
a = { derivative = "b" }
b = { derivative = "-1e8*a" }
[forces]
x = "a"
"#;

#[test]
fn each_fault_says_where_it_is_and_what_to_do() {
    Model::parse("test.toml", GOOD).unwrap();
    let mut wrong = Vec::new();
    for (old, new, message) in CASES {
        let found = match Model::parse("test.toml", &changed(old, new)) {
            Ok(_) => "accepted".to_owned(),
            Err(error) => error.to_string(),
        };
        if found != format!("test.toml, {message}") {
            wrong.push(format!("({old:?}, {new:?},\n    {:?}),", found.trim_start_matches("test.toml, ")));
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}
