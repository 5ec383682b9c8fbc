use super::*;
use crate::model::Body;
use approx::assert_relative_eq;

const BODY: Body = Body {
    mass_kg: 0.8,
    inertia_kg_m2: [6e-3, 6e-3, 1e-3, 0.0, 0.0, 0.0],
    gravity_m_s2: 9.8,
    air_density_kg_m3: 1.2,
};

/// A quadrotor's rotor that lags behind its command, and a disc that follows rates and a lagging servo.
const TEXT: &str = r#"
schema = 2
name = "test"
[inputs]
command = { column = "command_rad_s" }
delta = {}
[parameters]
tau = { value = 0.1 }
tau_d = { value = 0.05 }
k = { value = 2 }
e = { value = 0.25 }
[definitions]
disc = "0.5*alpha"
force = "-k*omega^2"
[states]
omega = { derivative = "(command - omega)/tau", initial = "command" }
servo = { derivative = "(delta - servo)/tau" }
alpha = { derivative = "(3*servo - alpha)/tau_d - 2*q + 0.5*p + e*w", initial = "3*delta" }
stiff = { derivative = "-omega*stiff - q" }
climbing = { derivative = "-climbing + x" }
curved = { derivative = "-curved - q*abs(q)" }
[forces]
z = "force + disc + stiff + climbing + curved"
"#;

fn with(regressors: &str) -> Result<Regression, RegressionError> {
    let text = format!(
        "{TEXT}[[equation]]\nname = \"Z\"\nmeasured = \"force_z\"\nscale = \"command^2\"\nregressors = [{regressors}]\n"
    );
    let model = Model::parse("test.toml", &text).expect("a model");
    model.regression(&model.values(&BODY, |_| None))
}

#[test]
fn states_of_first_order_are_found_with_their_factors() {
    let got = with(r#""disc*command*3", "force", "-(u + 2*alpha - delta)""#).expect("a regression");
    let names: Vec<&str> = got.states.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["omega", "servo", "alpha"]);
    let alpha = &got.states[2];
    assert_relative_eq!(alpha.time_s, 0.05, epsilon = 1e-15);
    assert_eq!(
        (alpha.rates, alpha.is_of_inputs(), got.states[0].is_of_inputs()),
        ([0.5, -2.0, 0.0], false, true)
    );
    assert_eq!(alpha.velocity, [0.0, 0.0, 0.25]);
    assert_eq!(alpha.forcing.states(), [1]);
    let row = InputRow { inputs: &[7.0, 0.1], states: &[0.0, 0.2, 0.0, 0.0, 0.0, 0.0] };
    let at = |signal: &InputSignal| signal.series([row].into_iter())[0];
    assert_relative_eq!(at(&alpha.forcing), 3.0 * 0.2 / 0.05, epsilon = 1e-12);
    assert_relative_eq!(at(&alpha.initial), 0.3, epsilon = 1e-15);

    let equation = &got.equations[0];
    assert_relative_eq!(at(&equation.scale), 49.0, epsilon = 1e-12);
    // 0.5*3*command holds; alpha is of the motion.
    let first = &equation.regressors[0];
    assert_eq!((first.inputs.len(), first.motion.len()), (1, 1));
    let factor = first.motion[0].states[0].factor;
    assert_relative_eq!(at(&first.inputs[0]) * factor, 0.5 * 3.0 * 7.0, epsilon = 1e-12);
    // A state that inputs alone drive is one of them, in any expression.
    let second = &equation.regressors[1];
    assert_eq!((second.inputs.len(), second.motion.len()), (1, 0));
    assert_eq!(second.inputs[0].states(), [0]);
    // A sum keeps its factors, and what of it is of inputs.
    let third = &equation.regressors[2];
    let motion = &third.motion[0];
    let sign = third.inputs.first().map_or(1.0, at);
    assert_eq!((sign * motion.velocity[0], sign * motion.states[0].factor), (-1.0, -2.0));
    assert_relative_eq!(sign * at(motion.inputs.as_ref().expect("a part")), 0.1, epsilon = 1e-15);
}

#[test]
fn what_is_no_known_signal_is_refused_by_name() {
    for (regressor, words) in [
        ("stiff", vec!["stiff", "proportion"]),
        ("climbing", vec!["climbing", "depends on x"]),
        ("curved*command", vec!["curved", "follow q", "output error"]),
        ("sin(theta)", vec!["attitude", "output error"]),
        ("abs(u)", vec!["not linear in u"]),
        ("u*command + v", vec!["not linear in u"]),
        ("z", vec!["depends on z"]),
        ("u^8*v", vec!["more than 8"]),
    ] {
        let refused = with(&format!("\"{regressor}\"")).expect_err(regressor).to_string();
        assert!(words.iter().all(|w| refused.contains(w)), "{refused}");
    }
}

#[test]
fn equations_by_names_may_use_columns_that_the_model_does_not_have() {
    let model = Model::parse("test.toml", TEXT).expect("a model");
    let equation = |regressors: &[&str], scale: PowerProduct| NamedEquation {
        name: "Z".to_owned(),
        measured: Axis::Force(2),
        scale,
        regressors: regressors.iter().map(|r| (*r).to_owned()).collect(),
        fixed: vec![],
        where_excited: false,
    };
    let one = || PowerProduct { factor: 1.0, powers: vec![] };
    let columns = ["command_rad_s".to_owned(), "omega 4".to_owned()];
    let own = equation(&["1", "command_rad_s*omega 4", "disc*omega 4*q"], one());
    let more = model.with_equations(&[own], &columns).expect("equations");
    assert_eq!(more.inputs.len(), 3);
    let got = more.regression(&model.values(&BODY, |_| None)).expect("a regression");
    let regressors = &got.equations[0].regressors;
    assert!(regressors[0].inputs.is_empty() && regressors[0].motion.is_empty());
    assert_eq!(regressors[1].inputs[0].inputs(), [0, 2]);
    assert_eq!(regressors[2].motion.len(), 2);
    let unknown =
        model.with_equations(&[equation(&["disk"], one())], &columns).expect_err("unknown").to_string();
    assert!(["disk", "disc", "omega 4", "command_rad_s"].iter().all(|w| unknown.contains(w)), "{unknown}");
    let scale = PowerProduct { factor: 0.5, powers: vec![("rho", 1), ("R", 4)] };
    let refused = model.with_equations(&[equation(&["1"], scale)], &columns);
    assert!(matches!(refused, Err(RegressionError::Scale { name, .. }) if name == "R"));
}

#[test]
fn the_equations_of_every_model_of_the_shelf_are_regressions() {
    for (name, _) in crate::SHELF {
        let model = Model::shelf(name).expect("a model");
        if let Err(error) = model.regression(&model.values(&BODY, |_| None)) {
            panic!("{name}: {error}");
        }
    }
}
