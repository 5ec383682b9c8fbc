//! Sessions that are only flown live: what is there is looked at, and a refusal names the ways out.

#![allow(clippy::unwrap_used)]

use mavsight_engine::{EngineError, Harm, calibrate, check};
use mavsight_pipeline::NoProgress;
use mavsight_session::{Session, read_image, write_png};
use mavsight_vision::Frame;
use std::path::PathBuf;

/// A session without recordings, by the stills of the paper's flight and of more cameras; `None` without these.
fn flown_live(folder: &str, more: &[&str]) -> Option<Session> {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("MAVSIGHT_DATA").map_or(shared, PathBuf::from).join("paper-flight");
    if !data.join("session.toml").is_file() {
        println!("skipped: no {}", data.display());
        return None;
    }
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(folder);
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["cam1-control.png", "cam2-control.png", "control_points.csv", "vehicle.toml"] {
        std::fs::copy(data.join(name), folder.join(name)).unwrap();
    }
    let size = read_image(&data.join("cam1-control.png")).unwrap().size;
    let grey = Frame::from_rgb(size, vec![128; 3 * (size.width_px * size.height_px) as usize]).unwrap();
    write_png(&folder.join("grey-control.png"), &grey).unwrap();
    let mut text =
        "schema = 1\nname = \"live\"\nvehicle = \"vehicle.toml\"\n[control]\npoints = \"control_points.csv\"\n".to_owned();
    for name in ["cam1", "cam2"].iter().chain(more) {
        text += &format!(
            "[[camera]]\nname = \"{name}\"\nlive = \"/dev/{name}\"\nstill = \"{name}-control.png\"\n"
        );
    }
    std::fs::write(folder.join("session.toml"), text).unwrap();
    Some(Session::load(&folder.join("session.toml")).unwrap())
}

#[test]
fn a_camera_that_a_flight_would_calibrate_is_refused_before_it_with_the_ways_out() {
    let Some(session) = flown_live("before-flight", &["grey"]) else { return };
    let refused = calibrate(&session, &NoProgress).unwrap_err();
    assert!(matches!(refused, EngineError::BeforeFlight { found: 0, wanted: 8, .. }), "{refused}");
    let said = refused.to_string();
    assert!(said.contains("move the camera") && said.contains("mavsight calibrate"), "{said}");
    let found = check(&session, &NoProgress);
    assert!(
        !found.is_ready() && found.items.iter().any(|item| item.text.contains(&said)),
        "{:?}",
        found.items
    );
}

#[test]
fn check_looks_at_the_calibration_of_a_session_that_is_only_flown_live() {
    let Some(session) = flown_live("check-live", &[]) else { return };
    let found = check(&session, &NoProgress);
    assert!(found.is_ready() && !found.is_filmed(), "{:?}", found.items);
    assert!(
        found.items.iter().any(|i| i.harm == Harm::Remark && i.text.starts_with("cam1, cam2: flown live"))
    );
    for camera in &found.cameras {
        assert!(camera.size.is_some() && camera.calibration_rms_px.is_some_and(|px| px < 1.0), "{camera:?}");
        assert_eq!(camera.still.as_ref().unwrap().1.len(), 8);
    }
    let refused = session.open_camera(0).err().unwrap().to_string();
    assert!(refused.contains("cam1") && refused.contains("no recording"), "{refused}");
}
