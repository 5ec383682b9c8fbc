//! The shelf's models can begin: at rest, or, wings, in flight; and no faster than a step of an integration.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_model::{Body, Dynamics, Model};

const BODY: Body = Body {
    mass_kg: 0.5,
    inertia_kg_m2: [3e-3, 4e-3, 5e-3, 0.0, 0.0, 0.0],
    gravity_m_s2: 9.81,
    air_density_kg_m3: 1.2,
};

const AEROPLANE: Body = Body { mass_kg: 5e3, inertia_kg_m2: [3e4, 5e4, 7e4, 0.0, 0.0, 0.0], ..BODY };

#[test]
fn each_shelf_model_can_begin() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/shelf");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    for path in files.filter(|path| path.extension().is_some_and(|e| e == "toml")) {
        let model = Model::parse(&path.to_string_lossy(), &std::fs::read_to_string(&path).unwrap()).unwrap();
        let mut values = model.values(&BODY, |_| None);
        let mut start = model.at_rest(&values);
        if let Err(error) = model.check(&values, &start) {
            println!("{error}");
            values = model.values(&AEROPLANE, |_| None);
            start = model.at_rest(&values);
            start.state[7] = 60.0;
            assert_eq!(model.check(&values, &start), Ok(()));
        }
        assert_eq!(model.check_speed(&values, &start, 1e-3), Ok(()));
        let dynamics = Dynamics::new(&model, &values, &[]);
        let mut evaluation = dynamics.with(&[]);
        evaluation.set_inputs(&start.inputs);
        let fastest = evaluation.fastest(&start.state);
        println!("{}: {:.2e} s, {}", model.name, fastest.time_s, model.state_name(fastest.state));
    }
}

/// The fastest motion of the helicopter of the paper is its lower disc.
#[test]
fn the_fastest_motion_is_found() {
    let text = include_str!("../shelf/coaxial.toml");
    let model = Model::parse("coaxial.toml", text).unwrap();
    for tau in [2e-3, 1e-5] {
        let values = model.values(&BODY, |p| (p.name == "tau_l").then_some(tau));
        let dynamics = Dynamics::new(&model, &values, &[]);
        let mut evaluation = dynamics.with(&[]);
        let start = model.at_rest(&values);
        evaluation.set_inputs(&start.inputs);
        let fastest = evaluation.fastest(&start.state);
        assert!((fastest.time_s / tau - 1.0).abs() < 0.02, "{fastest:?}");
        assert!(["alpha_l", "beta_l"].contains(&model.state_name(fastest.state).as_str()), "{fastest:?}");
    }
}
