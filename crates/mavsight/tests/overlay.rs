//! The film of what was found, against where the balls truly are.

#![allow(clippy::unwrap_used)]

mod common;

use common::{Session, mavsight};
use mavsight::geometry::{Point3, Vector2, Vector3, world_from_body};
use mavsight::session::{self, FrameSource};
use mavsight::{lab, score};

#[test]
fn the_film_has_its_marks_where_the_balls_are() {
    let flight = Session::new();
    let out = flight.path("flight.mp4");
    let assert =
        mavsight().arg("overlay").arg(flight.path("session.toml")).arg("--out").arg(&out).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(said.contains("12 frames of 2 cameras") && said.contains("ellipses ×"), "{said}");

    let loaded = session::Session::load(&flight.path("session.toml")).unwrap();
    let truth = score::read_truth(&flight.path("truth.csv"), &loaded.vehicle).unwrap();
    let film: Vec<_> = FrameSource::open(&out, None).unwrap().map(Result::unwrap).collect();
    assert_eq!(film.len(), truth.len());
    let (cameras, mut seen) = (lab::cameras(), 0);
    for ((t_ns, frame), state) in film.iter().zip(&truth) {
        assert!((*t_ns as f64 * 1e-9 - (state.t_s - truth[0].t_s)).abs() < 1e-3);
        for (k, camera) in cameras.iter().enumerate() {
            for marker in &loaded.vehicle.marker {
                let body = world_from_body(state.position_in_world_m, state.attitude);
                let in_world = body * Point3::from(Vector3::from(marker.position_m));
                let ball = camera.camera.project(&in_world.coords).unwrap().pixel;
                // Two pictures of 640 pixels beside each other in 1920.
                let at = 1.5 * (ball + Vector2::new(0.5, 0.5)) + Vector2::new(960.0 * k as f64, 0.0);
                let [r, g, b] = frame.rgb(at.x as usize, at.y as usize);
                assert!(r > 170 && g > 170 && b < 130, "camera {k}, {}: {r} {g} {b} at {at}", marker.name);
                seen += 1;
            }
        }
    }
    assert_eq!(seen, 12 * 2 * 4);
    // Without the marks nothing is of their yellow.
    let (_, plain) = loaded.open_camera(0).unwrap().next().unwrap().unwrap();
    let is_yellow = |k: usize| {
        let [r, g, b] = plain.rgb(k % 640, k / 640);
        r > 200 && g > 200 && b < 60
    };
    assert!(!(0..640 * 480).any(is_yellow));
}

#[test]
fn a_part_is_cut_out_and_what_cannot_be_made_is_refused() {
    let flight = Session::new();
    let film = |out: &str, within: &str| {
        let mut command = mavsight();
        command.arg("overlay").arg(flight.path("session.toml")).arg("--out").arg(flight.path(out));
        command.args(["--within", within, "--enlarge", "100"]).assert()
    };
    let assert = film("part.mp4", "0.1..0.2").success();
    assert!(String::from_utf8_lossy(&assert.get_output().stdout).contains("ellipses ×100"));
    assert_eq!(FrameSource::open(&flight.path("part.mp4"), None).unwrap().count(), 4);
    for (out, within, why) in [("film.avi", "0..1", "MP4"), ("film.mp4", "7..8", "no frame")] {
        let assert = film(out, within).code(2);
        let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(said.contains(why), "{said}");
        assert!(!flight.path(out).exists());
    }
}

#[test]
fn shells_and_the_manual_know_every_command() {
    let folder = tempfile::TempDir::new().unwrap();
    mavsight().arg("man").arg(folder.path()).assert().success();
    let page = std::fs::read_to_string(folder.path().join("mavsight-overlay.1")).unwrap();
    assert!(page.contains("enlarge") && folder.path().join("mavsight.1").is_file());
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let assert = mavsight().args(["completions", shell]).assert().success();
        let script = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
        assert!(script.contains("overlay") && script.contains("manoeuvre"), "{shell}");
    }
}
