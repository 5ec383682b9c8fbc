//! Files of text that people write, and `rig.toml` and `summary.json`.

use crate::Outcome;
use crate::files::with_file;
use mavsight_flight::Vehicle;
use mavsight_model::{Body, Dynamics, Model, SHELF};
use mavsight_plan::Planner;
use mavsight_score::CampaignFile;
use mavsight_session::{
    Session, SessionError, load_equations, load_vehicle, read_rig, read_summary, read_toml,
};
use mavsight_simulator::{Scenario, Staging};

pub(super) fn small_session() -> Vec<u8> {
    let text = "schema = 1\nname = \"a\"\nvehicle = \"vehicle.toml\"\ninputs = \"inputs.csv\"\n\n[control]\n\
        points = \"control_points.csv\"\n\n[[camera]]\nname = \"cam1\"\n\
        video = \"cam1.mp4\"\nstill = \"cam1-control.png\"\ntime_offset_s = 0.01\n\n[[camera]]\nname = \"cam2\"\n\
        video = \"cam1.mp4\"\nstill = \"cam2-control.png\"\n";
    text.into()
}

pub(super) fn session(bytes: &[u8]) -> Outcome {
    let read = |path: &std::path::Path| {
        let session = Session::load(path)?;
        session.noted_inputs()?;
        session.control_points()?;
        session.control_pixels()?;
        session.sensors()?;
        session.rig()?;
        Ok::<(), SessionError>(())
    };
    with_file("session.toml", bytes, read).into()
}

pub(super) fn old_vehicle() -> Vec<u8> {
    let text = "name = \"a\"\nmass_kg = 0.8\ninertia_kg_m2 = [6.1e-3, 6.26e-3, 0.93e-3]\n\n[rotor]\nradius_m = 0.25\n\
        [[marker]]\nname = \"r\"\nposition_m = [0.2, 0.2, 0.1]\ndiameter_m = 0.05\ncolor = \"#db1212\"\n\
        [environment]\nair_density_kg_m3 = 1.14\ngravity_m_s2 = 9.804\n";
    text.into()
}

pub(super) fn vehicle(bytes: &[u8]) -> Outcome {
    with_file("attacked-vehicle.toml", bytes, load_vehicle).into()
}

pub(super) fn models() -> Vec<Vec<u8>> {
    SHELF.iter().map(|(_, text)| text.as_bytes().to_vec()).collect()
}

/// Reads a flight model and its equations of motion; a refusal must name a place in the text.
pub(super) fn model(bytes: &[u8]) -> Outcome {
    const BODY: Body = Body {
        mass_kg: 0.5,
        inertia_kg_m2: [3e-3, 4e-3, 5e-3, 0.0, 0.0, 0.0],
        gravity_m_s2: 9.81,
        air_density_kg_m3: 1.2,
    };
    let Ok(text) = std::str::from_utf8(bytes) else { return Outcome::Refused("not text".to_owned()) };
    let model = Model::parse("model.toml", text);
    match &model {
        Ok(model) => {
            let values = model.values(&BODY, |_| None);
            let free: Vec<usize> = (0..model.parameters.len()).collect();
            let dynamics = Dynamics::new(model, &values, &free);
            let start = model.at_rest(&values);
            // Whether it flies from rest is another question.
            let _ = model.check(&values, &start);
            let mut rates = vec![0.0; dynamics.states()];
            let mut evaluation = dynamics.with(&values);
            evaluation.set_inputs(&start.inputs);
            evaluation.linearise(&start.state, &mut rates);
        }
        Err(error) => {
            let rows: Vec<&str> = text.split('\n').collect();
            assert!(error.line >= 1 && error.line <= rows.len(), "line {} of {}", error.line, rows.len());
            let columns = rows[error.line - 1].chars().count() + 1;
            assert!(error.column >= 1 && error.column <= columns, "column {} of {columns}", error.column);
        }
    }
    model.into()
}

pub(super) fn equations(bytes: &[u8]) -> Outcome {
    with_file("equations.toml", bytes, load_equations).into()
}

pub(super) fn scenario(bytes: &[u8]) -> Outcome {
    match with_file("scenario.toml", bytes, |path| read_toml::<Scenario>(path, "scenario file")) {
        Ok(scenario) => scenario.inputs(&Vehicle::paper()).into(),
        Err(error) => Err::<(), _>(error).into(),
    }
}

pub(super) fn staging(bytes: &[u8]) -> Outcome {
    with_file("staging.toml", bytes, |path| read_toml::<Staging>(path, "staging file")).into()
}

pub(super) fn room_file() -> Vec<u8> {
    include_bytes!("../../../plan/example/room.toml").to_vec()
}

pub(super) fn room(bytes: &[u8]) -> Outcome {
    with_file("room.toml", bytes, Planner::load).into()
}

pub(super) fn campaign(bytes: &[u8]) -> Outcome {
    with_file("campaign.toml", bytes, |path| read_toml::<CampaignFile>(path, "campaign file")).into()
}

pub(super) fn rig(bytes: &[u8]) -> Outcome {
    with_file("attacked-rig.toml", bytes, read_rig).into()
}

pub(super) fn summaries() -> Vec<Vec<u8>> {
    let text = r#"{"frames": 3, "smoother": {"translation_bandwidth_hz": 3.5, "rotation_bandwidth_hz": 4.5,
"sample_interval_s": 0.0333}, "notes": ["a \"note\"", null, true, -1.5e-3]}"#;
    vec![text.into()]
}

pub(super) fn summary(bytes: &[u8]) -> Outcome {
    with_file("attacked-summary.json", bytes, read_summary).into()
}
