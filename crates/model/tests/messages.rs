//! What a person reads who has made a mistake: for each fault its place, what is wrong, and what to do.

#![allow(clippy::unwrap_used, clippy::panic)]

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

/// What is replaced, by what, and what is said, with line and column.
const CASES: &[(&str, &str, &str)] = &[
    ("name = \"test\"", "name = \"test", "line 2, column 13: invalid basic string, expected `\"`"),
    (
        "name = \"test\"",
        "name = \"test\"\nname = \"twice\"",
        "line 3, column 1: `name` stands here for the second time: remove one of them",
    ),
    (
        "schema = 2\n",
        "",
        "line 1, column 1: schema is missing, but a flight model has schema 2: write `schema = 2`",
    ),
    (
        "schema = 2",
        "schema = 1",
        "line 1, column 10: schema is 1, but a flight model has schema 2: write `schema = 2`",
    ),
    ("[forces]", "[force]", "line 20, column 2: `force` is no key of the file: did you mean forces, source?"),
    (
        "initial = \"omega\"",
        "inital = \"omega\"",
        "line 18, column 63: `inital` is no key of state speed: did you mean initial?",
    ),
    (
        "derivative = \"(omega - speed)/tau\", ",
        "",
        "line 18, column 1: state speed has no `derivative`: add it",
    ),
    ("value = 0.1 }", "}", "line 10, column 5: parameter d has no `value`: add it"),
    ("std = 0.1", "text = \"no deviation\"", "line 25, column 7: output acc has no `std`: add it"),
    ("measured = \"force_x\"\n", "", "line 36, column 1: [[equation]] has no `measured`: add it"),
    (
        "x = \"-d*u\"",
        "x = true",
        "line 21, column 5: `x` must be an expression or a number, but is true or false",
    ),
    (
        "x = \"-d*u\"",
        "x = { value = \"-d*u\" }",
        "line 21, column 5: `x` must be an expression or a number, but is a table",
    ),
    (
        "min = 0, max = 400",
        "min = \"0\", max = 400",
        "line 5, column 33: `min` must be a number, but is text",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = \"yes\" }",
        "line 11, column 17: `free` must be true, false, or one of { moved = [\"...\"] } and { unless_moved = [\"...\"] }, but is text",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = {} }",
        "line 11, column 17: `free` must be true, false, or one of { moved = [\"...\"] } and { unless_moved = [\"...\"] }, but is empty",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = { moved = [\"omegga\"] } }",
        "line 11, column 27: `omegga` is not defined: did you mean omega?",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = true, value = 3e-3 }",
        "line 11, column 23: the value of `I_xx` comes from the vehicle file: remove it here",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = true, unit = \"kg m\" }",
        "line 11, column 8: I_xx is kg m^2, this is kg m: a factor in m is missing, or a declared unit is wrong",
    ),
    (
        "measured = \"force_x\"",
        "measured = \"force\"",
        "line 38, column 12: `measured` must be force_x, force_y, force_z, moment_x, moment_y or moment_z, but is `force`",
    ),
    (
        "when = \"excited\"",
        "when = \"moved\"",
        "line 41, column 8: `when` must be always or excited, but is `moved`",
    ),
    (
        "fixed = { u = -0.1 }",
        "fixed = { v = -0.1 }",
        "line 40, column 11: `v` is no key of `fixed` of X, which takes its regressors: did you mean 1, u?",
    ),
    (
        "thrust = { unit = \"N\", value",
        "\"2 thrust\" = { unit = \"N\", value",
        "line 14, column 1: `2 thrust` is no name: begin with a letter, go on with letters, digits and _, at most 60",
    ),
    (
        "lift = { unit",
        "u = { unit",
        "line 15, column 1: `u` is already a name of the format: take another name",
    ),
    ("lift = { unit", "omega = { unit", "line 15, column 1: `omega` is already an input: take another name"),
    ("lift = { unit", "sin = { unit", "line 15, column 1: `sin` is already a function: take another name"),
    (
        "lift = { unit",
        "a_x = { unit",
        "line 15, column 1: `a_x` is already a name of the format: take another name",
    ),
    (
        "label = \"drag\"",
        "label = \"tau\"",
        "line 9, column 1: `tau` is already name or label of the parameter d: take another name",
    ),
    (
        "unit = \"N s/m\"",
        "unit = \"N s/mm\"",
        "line 10, column 30: `mm` is no unit: write m; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    (
        "unit = \"m/s^2\"",
        "unit = \"deg\"",
        "line 25, column 16: `deg` is no unit: write rad; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    (
        "unit = \"N s/m\"",
        "unit = \"N/(m/s)\"",
        "line 10, column 30: `(m` is no unit: write each divisor with its own `/`, without parentheses; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    (
        "unit = \"rad/s\", derivative",
        "unit = \"rpm\", derivative",
        "line 18, column 18: `rpm` is no unit: write rad/s; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    ("x = \"-d*u\"", "x = \"-1.2.3*u*d\"", "line 21, column 7: `1.2.3` is no number: write 0.05 or 5e-2"),
    ("value = 0.05", "value = inf", "line 9, column 29: `value` is inf, but must be a finite number"),
    (
        "value = 0.05",
        "value = 5",
        "line 9, column 29: `the value of tau` is 5, but must be between its min and its max",
    ),
    ("max = 1 }", "max = 1e-4 }", "line 9, column 7: `max of tau` is 0.0001, but must be above min"),
    ("std = 0.1", "std = 0", "line 25, column 46: `std` is 0, but must be above zero"),
    (
        "free = true, min",
        "prior_std = -1, free = true, min",
        "line 9, column 47: `prior_std` is -1, but must be above zero",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u u\"",
        "line 21, column 11: `u` does not belong here: an operator or a comma is missing before it",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*(u + 1\"",
        "line 21, column 15: the expression ends here: a name, a number or a `)` is missing",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u)\"",
        "line 21, column 10: `)` does not belong here: a value, or the `(` of this, is missing before it",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*\"",
        "line 21, column 9: the expression ends here: a name, a number or a `)` is missing",
    ),
    (
        "x = \"-d*u\"",
        "x = \"\"",
        "line 21, column 6: the expression ends here: a name, a number or a `)` is missing",
    ),
    (
        "x = \"-d*u\"",
        "x = \"d*u > 0\"",
        "line 21, column 10: `>` does not belong here: there are no comparisons; use min, max, clamp or a table",
    ),
    ("x = \"-d*u\"", "x = \"-d*u*2µ$\"", "line 21, column 13: `$` does not belong here"),
    (
        "x = \"-d*u\"",
        "x = \"(((((((((((((((((((((((((((((((((((((((((((((((((((((((((((((u)))))))))))))))))))))))))))))))))))))))))))))))))))))))))))))\"",
        "line 21, column 66: more than 60 parentheses or definitions within each other: split the expression into definitions",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*thurst\"",
        "line 21, column 11: `thurst` is not defined: did you mean thrust?",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*velocity_of_the_air\"",
        "line 21, column 9: `velocity_of_the_air` is not defined: give it under [parameters], [inputs] or [definitions]",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*sen(u)\"",
        "line 21, column 11: there is no function `sen`: did you mean sin, asin?",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*atan2(u)\"",
        "line 21, column 11: `atan2` takes 2 arguments, but has 1: write `atan2(y, x)`",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*sin(1, 2)\"",
        "line 21, column 11: `sin` takes one argument, but has 2: write `sin(x)`",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*thrust_curve\"",
        "line 21, column 11: `thrust_curve` takes one argument, but has 0: write `thrust_curve(x)`",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u - a_x*mass\"",
        "line 21, column 13: `a_x` may not be used in forces, moments, states and definitions, which give the accelerations: use it in [outputs]",
    ),
    (
        "trim = \"sqrt(mass*g/k_T)\"",
        "trim = \"sqrt(mass*g/k_T) + speed\"",
        "line 5, column 74: `speed` may not be used in the trim of omega, which may use parameters alone",
    ),
    (
        "initial = \"omega\"",
        "initial = \"omega + q\"",
        "line 18, column 82: `q` may not be used in the initial value of speed, which may use inputs and parameters alone",
    ),
    (
        "value = \"d/k_T\"",
        "value = \"thrust/k_T\"",
        "line 28, column 20: `thrust` may not be used in `ratio`, which may use parameters alone",
    ),
    (
        "value = \"k_T*speed^2\"",
        "value = \"k_T*speed^2 + (lift - lift*u)\"",
        "line 14, column 32: this goes in a circle: thrust needs lift needs thrust; give one of them without the others",
    ),
    (
        "value = 0.1 }",
        "value = \"d\" }",
        "line 10, column 1: this goes in a circle: d needs d; give one of them without the others",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*tau\"",
        "line 21, column 6: x of [forces] is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w*tau + thrust\"",
        "line 22, column 14: z of [forces] is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-(lift*tau + d*w) + thrust\"",
        "line 22, column 8: z of [forces] is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift + 2*(thrust + d)\"",
        "line 22, column 26: the sum before this term is N, this is N s/m: a factor in m/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + thrust*sin(speed)\"",
        "line 22, column 31: the argument of `sin` is without unit, this is 1/s: a factor in s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + thrust^mass\"",
        "line 22, column 27: an exponent is without unit, this is kg: a factor in 1/kg is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + thrust*u^(speed/omega)\"",
        "line 22, column 27: the base of an exponent that is no number is without unit, this is m/s: a factor in s/m is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + min(thrust, d)\"",
        "line 22, column 32: what stands before in `min` is N, this is N s/m: a factor in m/s is missing, or a declared unit is wrong",
    ),
    (
        "derivative = \"(omega - speed)/tau\"",
        "derivative = \"omega - speed\"",
        "line 18, column 41: the derivative of speed is 1/s^2, this is 1/s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "thrust_curve(1)\"",
        "thrust_curve(1)*u\"",
        "line 15, column 40: `lift` is N, this is N m/s: a factor in s/m is missing, or a declared unit is wrong",
    ),
    (
        "[definitions]",
        "spare = { value = 1 }\n[definitions]",
        "line 13, column 1: the parameter `spare` appears in no force, moment, state, output or other parameter: use it or remove it",
    ),
    (
        "[forces]\nx = \"-d*u\"\nz = \"-lift - d*w + thrust\"\n",
        "",
        "line 1, column 1: the model has no force and no moment: give [forces] or [moments]",
    ),
    (
        "x = [0, 1, 2]",
        "x = [0, 2, 2]",
        "line 30, column 1: table `thrust_curve` needs as many y as x, at least two, finite, x increasing",
    ),
    (
        "x = [0, 1, 2]",
        "x = [0, 1]",
        "line 30, column 1: table `thrust_curve` needs as many y as x, at least two, finite, x increasing",
    ),
    (
        "value = \"k_T*speed^2\"",
        "value = \"\"\"\n  k_T*speed^2\n  + thrust_curve(1)*tau\"\"\"",
        "line 16, column 5: `thrust` is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "value = \"k_T*speed^2\"",
        "value = \"k_T*\\u0073peed^2*q\"",
        "line 14, column 32: `thrust` is N, this is N/s: a factor in s is missing, or a declared unit is wrong",
    ),
];

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
