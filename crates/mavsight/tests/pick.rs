//! Balls clicked by a client of the page, beside their centres: control points against `calibrate`, markers against `check`.

#![cfg(feature = "page")]
#![allow(clippy::unwrap_used)]

mod common;

use common::{Session, mavsight};
use mavsight::flight::Color;
use mavsight::geometry::{Camera, Point3, Vector2, Vector3, world_from_body};
use mavsight::pose::Rig;
use mavsight::session::{self, read_control_points};
use mavsight::{lab, score, vision};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// The page, ended with the test.
struct Page {
    process: Child,
    address: String,
    token: String,
}

impl Page {
    fn open(session: &Path) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_mavsight"))
            .args(["pick", "--serve", "127.0.0.1:0"])
            .arg(session)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let mut url = line.split("http://").nth(1).unwrap().split('/').map(str::to_owned);
        Self { process, address: url.next().unwrap(), token: url.next().unwrap() }
    }

    /// Status and body of an answer.
    fn get(&self, path: &str, header: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        write!(stream, "GET /{}/{path} HTTP/1.1\r\nHost: {}\r\n{header}\r\n", self.token, self.address)
            .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
    }

    fn ask(&self, path: &str) -> Value {
        let (status, body) = self.get(path, "x-mavsight: page\r\n");
        assert_eq!(status, 200, "{path}: {body}");
        serde_json::from_str(&body).unwrap()
    }

    fn pick(&self, camera: usize, point: usize, at: Vector2<f64>) -> Value {
        self.ask(&format!("do/pick?camera={camera}&point={point}&u_px={}&v_px={}", at.x, at.y))
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

/// What `calibrate` makes of a session.
fn calibrated(flight: &Session, results: &str) -> Rig {
    let out = flight.path(results);
    mavsight().arg("calibrate").arg(flight.path("session.toml")).arg("--out").arg(&out).assert().success();
    session::read_rig(&out.join("rig.toml")).unwrap()
}

#[test]
fn coarse_clicks_give_the_calibration_of_the_stills_and_a_wrong_one_is_named() {
    let flight = Session::new();
    let points = read_control_points(&flight.path("control_points.csv")).unwrap();
    let by_stills = calibrated(&flight, "by-stills");
    let page = Page::open(&flight.path("session.toml"));
    let (status, html) = page.get("", "");
    assert!(status == 200 && html.contains("Control points"), "{status}");
    assert!(page.ask("picture?camera=0")["address"].as_str().unwrap().starts_with("data:image/jpeg;base64,"));
    // A link on another page cannot do anything here.
    assert_eq!(page.get("do/save", "").0, 403);
    assert_eq!(page.get("do/pick?camera=0", "x-mavsight: page\r\n").0, 404);

    let nothing = page.pick(0, 0, Vector2::new(2.0, 2.0));
    assert!(nothing["said"].as_str().unwrap().contains("click on a ball"), "{nothing}");
    let early = page.ask("do/save");
    assert!(early["said"].as_str().unwrap().contains("six points or more of"), "{early}");

    let place = |camera: usize, point: usize| {
        let camera = &by_stills.cameras[camera].camera;
        camera.project(&points[point].position_m.into()).unwrap().pixel
    };
    // Three pixels beside the centre, each in another direction.
    let beside = |k: usize| Vector2::new(f64::cos(2.4 * k as f64), f64::sin(2.4 * k as f64)) * 3.0;
    for (camera, point) in (0..2).flat_map(|c| (0..points.len()).map(move |p| (c, p))) {
        let state = page.pick(camera, point, place(camera, point) + beside(camera + point));
        assert_eq!(state["said"], "", "{state}");
    }
    let state = page.ask("state");
    assert_eq!(state["wrong"].as_array().unwrap().len(), 0, "{state}");
    for ball in state["picked"].as_array().unwrap() {
        assert!(ball["residual_px"].as_f64().unwrap() < 0.3, "{ball}");
    }

    // The last point's name on the ball of the one before.
    let last = points.len() - 1;
    let taken = page.pick(0, last, place(0, last - 1));
    assert!(
        taken["said"].as_str().unwrap().contains(&format!("is {} already", points[last - 1].name)),
        "{taken}"
    );
    page.ask(&format!("do/forget?camera=0&point={}", last - 1));
    let wrong = page.pick(0, last, place(0, last - 1));
    let named: Vec<&str> = wrong["wrong"].as_array().unwrap().iter().map(|w| w.as_str().unwrap()).collect();
    assert!(!named.is_empty() && named.iter().all(|text| text.contains(&points[last].name)), "{wrong}");
    page.pick(0, last, place(0, last));
    page.pick(0, last - 1, place(0, last - 1));

    let saved = page.ask("do/save");
    assert!(saved["said"].as_str().unwrap().starts_with("Saved: "), "{saved}");
    for name in ["session.toml.bak", "control_points.csv.bak"] {
        assert!(flight.path(name).exists(), "{name}");
    }
    let by_clicks = calibrated(&flight, "by-clicks");
    for (a, b) in by_stills.cameras.iter().zip(&by_clicks.cameras) {
        let apart_m = a.camera.centre_in_world() - b.camera.centre_in_world();
        for axis in 0..3 {
            let std_m = a.centre_std_m[axis].hypot(b.centre_std_m[axis]);
            assert!(apart_m[axis].abs() < 2.0 * std_m, "{}: {apart_m} with {}", a.name, b.centre_std_m);
        }
    }
}

#[test]
fn control_points_are_clicked_without_a_recording_that_can_be_read() {
    let flight = Session::new();
    std::fs::write(flight.path("broken.mp4"), b"no film").unwrap();
    flight.edit_lines("session.toml", |lines| {
        let first = lines.iter().position(|line| line.starts_with("video = ")).unwrap();
        lines[first] = "video = \"broken.mp4\"".to_owned();
    });
    let page = Page::open(&flight.path("session.toml"));
    assert_eq!(page.ask("state")["cameras"].as_array().unwrap().len(), 2);
    let none = page.ask("state?of=markers&camera=0&frame=0");
    assert!(none["said"].as_str().unwrap().contains("no recording"), "{none}");
    assert_eq!(page.get("picture?of=markers&camera=0&frame=0", "x-mavsight: page\r\n").0, 404);
}

/// Where each camera of the virtual room sees each marker at the first frame.
fn markers_seen(flight: &Session) -> Vec<Vec<Vector2<f64>>> {
    let loaded = session::Session::load(&flight.path("session.toml")).unwrap();
    let first = &score::read_truth(&flight.path("truth.csv"), &loaded.vehicle).unwrap()[0];
    let world_from_body = world_from_body(first.position_in_world_m, first.attitude);
    let seen = |camera: &Camera, place: [f64; 3]| {
        let in_world = world_from_body * Point3::from(Vector3::from(place));
        camera.project(&in_world.coords).unwrap().pixel
    };
    let of_all = |camera: &Camera| loaded.vehicle.marker.iter().map(|m| seen(camera, m.position_m)).collect();
    lab::cameras().iter().map(|own| of_all(&own.camera)).collect()
}

/// Runs `check` and yields what it prints, and whether all is ready.
fn checked(flight: &Session) -> (bool, String) {
    let output = mavsight().arg("check").arg(flight.path("session.toml")).output().unwrap();
    (output.status.success(), String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn clicks_on_markers_give_a_vehicle_file_with_wrong_colours_those_of_its_balls() {
    let flight = Session::new();
    let seen = markers_seen(&flight);
    let before = session::Session::load(&flight.path("session.toml")).unwrap().vehicle;
    // Hues that no ball has, but for the first marker, which has that of the second.
    let mut wrong: Vec<String> = ["#40e0d0", "#8a2be2", "#7fff00", "#00a0ff"][..before.marker.len()]
        .iter()
        .map(|c| (*c).into())
        .collect();
    wrong[0] = before.marker[1].color.to_string();
    for (marker, wrong) in before.marker.iter().zip(&wrong).rev() {
        let own = format!("\"{}\"", marker.color);
        flight.replace("vehicle.toml", &own, &format!("\"{wrong}\"   # of {}, by its word", marker.name));
    }
    let (is_ready, said) = checked(&flight);
    assert!(!is_ready && said.contains("mavsight pick "), "{said}");
    assert!(std::fs::read_to_string(flight.path("check.html")).unwrap().contains("mavsight pick "));

    let page = Page::open(&flight.path("session.toml"));
    let shown = |camera: usize| format!("of=markers&camera={camera}&frame=0");
    let click = |camera: usize, marker: usize, at: Vector2<f64>| {
        page.ask(&format!("do/pick?point={marker}&u_px={}&v_px={}&{}", at.x, at.y, shown(camera)))
    };
    assert!(click(0, 0, seen[0][0])["said"].as_str().unwrap().contains("load the page again"));
    let picture = page.ask(&format!("picture?{}", shown(0)));
    assert!(picture["address"].as_str().unwrap().starts_with("data:image/jpeg;base64,"));
    page.ask(&format!("picture?{}", shown(1)));
    let nothing = click(0, 0, Vector2::new(2.0, 2.0));
    assert!(nothing["said"].as_str().unwrap().contains("click on a ball"), "{nothing}");
    let early = page.ask(&format!("do/save?{}", shown(0)));
    assert!(early["said"].as_str().unwrap().contains("click on a marker first"), "{early}");

    // The second marker's name on its ball, whose colour the file gives the first.
    let alike = click(0, 1, seen[0][1]);
    let names = [&before.marker[0].name, &before.marker[1].name].map(|name| format!("'{name}'"));
    let wrong = alike["wrong"][0].as_str().unwrap();
    assert!(names.iter().all(|name| wrong.contains(name)) && wrong.contains("degrees of hue"), "{alike}");
    let refused = page.ask(&format!("do/save?{}", shown(0)));
    assert!(names.iter().all(|name| refused["said"].as_str().unwrap().contains(name)), "{refused}");
    assert!(!flight.path("vehicle.toml.bak").exists());

    for (camera, places) in seen.iter().enumerate() {
        for (marker, place) in places.iter().enumerate() {
            let state = click(camera, marker, place + Vector2::new(1.5, -1.0));
            assert_eq!(state["said"], "", "{state}");
        }
    }
    for (camera, places) in seen.iter().enumerate() {
        let state = page.ask(&format!("state?{}", shown(camera)));
        assert_eq!(state["wrong"].as_array().unwrap().len(), 0, "{state}");
        for (marker, place) in places.iter().enumerate() {
            let is_there = |found: &Value| {
                let at = Vector2::new(found["u_px"].as_f64().unwrap(), found["v_px"].as_f64().unwrap());
                found["point"] == marker && (at - place).norm() < 0.5
            };
            assert!(state["found"].as_array().unwrap().iter().any(is_there), "{marker}: {state}");
        }
    }
    let saved = page.ask(&format!("do/save?{}", shown(0)));
    assert!(saved["said"].as_str().unwrap().starts_with("Saved: 4 colours"), "{saved}");
    assert!(flight.path("vehicle.toml.bak").exists());
    let text = std::fs::read_to_string(flight.path("vehicle.toml")).unwrap();
    let after = session::Session::load(&flight.path("session.toml")).unwrap().vehicle;
    for (own, was) in after.marker.iter().zip(&before.marker) {
        assert!(text.contains(&format!("# of {}, by its word", own.name)), "{text}");
        assert!(are_alike(own.color, was.color), "{}: {} for {}", own.name, own.color, was.color);
    }
    let (is_ready, said) = checked(&flight);
    assert!(is_ready && said.contains("poses at 12 of 12 instants"), "{said}");
}

/// Whether two colours are of one hue, as far as a lamp's colour leaves it.
fn are_alike(a: Color, b: Color) -> bool {
    let hue = |color: Color| vision::hue(color.to_linear()).normalize();
    hue(a).dot(&hue(b)) > f64::cos(8.0_f64.to_radians())
}
