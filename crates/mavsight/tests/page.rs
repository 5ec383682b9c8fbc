//! The page of a flight through the virtual room: poses come by its WebSocket, a recording begins and ends
//! from it, and a browser sees the aircraft move. Skipped in part where there is no Chromium.

#![cfg(feature = "page")]
#![allow(clippy::unwrap_used, clippy::panic)]

#[allow(dead_code)]
#[path = "../../page/tests/browser/chromium.rs"]
mod chromium;

use chromium::Chromium;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

/// A flight whose page is served; it ends when it is dropped.
struct Flight {
    child: Child,
    /// Where recordings go.
    folder: TempDir,
    /// Address of the page: host and port, and below it the token.
    host: String,
    token: String,
}

impl Flight {
    /// Begins a flight of some kind in a folder, in which it is for five minutes at most.
    fn start(folder: TempDir, kind: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_mavsight"))
            .args(["live", "--serve", "127.0.0.1:0", "--for", "300"])
            .args(kind)
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        let url = lines
            .find_map(|l| l.split_once("http://").map(|(_, url)| url.trim_end_matches('/').to_owned()))
            .expect("an address is printed");
        let (host, token) = url.split_once('/').expect("it ends in a token");
        let (host, token) = (host.to_owned(), token.to_owned());
        // What else it says is read so that it does not wait.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, folder, host, token }
    }

    fn open(&self) -> WebSocket<TcpStream> {
        let stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let request = tungstenite::http::Request::get(format!("ws://{}/{}/events", self.host, self.token))
            .header("Host", &self.host)
            .header("Origin", format!("http://{}", self.host))
            .header("Connection", "Upgrade")
            .header("Upgrade", "websocket")
            .header("Sec-WebSocket-Version", "13")
            .header("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==")
            .body(())
            .unwrap();
        tungstenite::client(request, stream).unwrap().0
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What comes until an event is as wanted, which is the last.
fn until(socket: &mut WebSocket<TcpStream>, mut wanted: impl FnMut(&Value, &BTreeSet<u8>) -> bool) -> Value {
    let (begun, mut pictures) = (Instant::now(), BTreeSet::new());
    loop {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing of that kind comes");
        match socket.read().unwrap() {
            Message::Binary(bytes) => {
                assert_eq!(bytes[9..11], [0xff, 0xd8], "no JPEG");
                pictures.insert(bytes[0]);
            }
            Message::Text(text) => {
                let event: Value = serde_json::from_str(&text).unwrap();
                if wanted(&event, &pictures) {
                    return event;
                }
            }
            _ => {}
        }
    }
}

fn ask(socket: &mut WebSocket<TcpStream>, command: &str) {
    socket.send(Message::text(json!({ "command": command }).to_string())).unwrap();
}

#[test]
fn a_flight_is_seen_and_recorded_from_its_page() {
    let virtual_room = ["--virtual", "--size", "400x300", "--rate", "15"];
    let flight = Flight::start(TempDir::new().unwrap(), &virtual_room);
    poses_come_and_a_recording_begins_and_ends(&flight);
    match Chromium::start() {
        Some(browser) => a_browser_sees_the_aircraft_move(&flight, browser),
        None => println!("skipped: no chromium on this machine"),
    }
}

fn poses_come_and_a_recording_begins_and_ends(flight: &Flight) {
    let mut socket = flight.open();
    let scene = until(&mut socket, |e, _| e["event"] == "scene");
    assert_eq!(scene["cameras"].as_array().map(Vec::len), Some(2));
    let (mut last, mut measured) = (None, 0);
    until(&mut socket, |e, pictures| {
        if e["event"] == "pose" {
            let sequence = e["sequence"].as_u64();
            assert!(sequence > last, "{sequence:?} after {last:?}");
            last = sequence;
            measured += usize::from(e["valid"] == true && e["position_m"][2].as_f64().is_some());
        }
        measured >= 20 && pictures.len() == 2
    });
    ask(&mut socket, "self_check");
    let note = until(&mut socket, |e, _| e["event"] == "note");
    assert!(note["text"].as_str().is_some_and(|t| t.contains("frames/s")), "{note}");
    // In flight no control points are in view.
    ask(&mut socket, "calibrate");
    let note = until(&mut socket, |e, _| e["event"] == "note");
    assert!(
        note["fault"] == true && note["text"].as_str().is_some_and(|t| t.contains("control balls")),
        "{note}"
    );
    ask(&mut socket, "start_recording");
    until(&mut socket, |e, _| {
        e["event"] == "recording" && e["folder"] == "flight-1" && e["seconds"].as_f64() > Some(0.2)
    });
    ask(&mut socket, "stop_recording");
    until(&mut socket, |e, _| e["event"] == "recording" && e["folder"].is_null());
    let session = flight.folder.path().join("flight-1/session.toml");
    let run = assert_cmd::Command::new(env!("CARGO_BIN_EXE_mavsight"))
        .arg("live")
        .arg(session)
        .args(["--replay", "--fast", "--json"])
        .assert()
        .success();
    let out = String::from_utf8_lossy(&run.get_output().stdout);
    assert!(out.lines().filter(|l| l.contains(r#""valid":true"#)).count() >= 2, "{out}");
}

/// Cameras that show the control points for half a minute, with noise of its own in every other frame:
/// copies show nothing new.
fn before_the_control_points() -> TempDir {
    const FRAMES: usize = 900;
    let folder = TempDir::new().unwrap();
    let here = folder.path();
    let run = |args: &str| {
        let mut program = assert_cmd::Command::new(env!("CARGO_BIN_EXE_mavsight"));
        program.args(args.split(' ')).current_dir(here).assert().success();
    };
    std::fs::write(here.join("short.toml"), scenario_of(0.1)).unwrap();
    run("simulate --scenario short.toml --out flight");
    run("film flight --out flight");
    run("film flight --out other --seed 2");
    run("calibrate flight/session.toml --out calibrated");
    for camera in ["cam1", "cam2"] {
        for k in 0..FRAMES {
            let film = if k % 2 == 0 { "flight" } else { "other" };
            let still = here.join(format!("{film}/{camera}-control.png"));
            let frame = here.join(format!("flight/{camera}/frame_{k:05}.png"));
            let _ = std::fs::remove_file(&frame);
            std::fs::hard_link(&still, frame).unwrap();
        }
    }
    folder
}

/// The usual scenario, of so many seconds.
fn scenario_of(duration_s: f64) -> String {
    let mut program = assert_cmd::Command::new(env!("CARGO_BIN_EXE_mavsight"));
    let usual = program.args(["simulate", "--print-scenario"]).assert().success();
    let usual = String::from_utf8_lossy(&usual.get_output().stdout).into_owned();
    let line = usual.lines().find(|l| l.starts_with("duration_s = ")).unwrap();
    usual.replace(line, &format!("duration_s = {duration_s:?}"))
}

#[test]
fn cameras_that_see_the_control_points_are_calibrated_from_the_page() {
    let flight = Flight::start(before_the_control_points(), &["flight/session.toml", "--replay"]);
    let mut socket = flight.open();
    until(&mut socket, |_, pictures| pictures.len() == 2);
    ask(&mut socket, "calibrate");
    let note = until(&mut socket, |e, _| e["event"] == "note");
    assert!(note["fault"] == false && note["text"].as_str().unwrap().contains("rig-1.toml"), "{note}");
    let rig = |path: &str| mavsight_session::read_rig(&flight.folder.path().join(path)).unwrap();
    let (found, wanted) = (rig("rig-1.toml"), rig("calibrated/rig.toml"));
    assert_eq!(found.cameras.len(), 2);
    for (a, b) in found.cameras.iter().zip(&wanted.cameras) {
        let away = a.camera.centre_in_world() - b.camera.centre_in_world();
        assert!(away.component_div(&b.centre_std_m).amax() < 5.0, "{}: {away}", a.name);
    }
}

fn a_browser_sees_the_aircraft_move(flight: &Flight, mut browser: Chromium) {
    browser.look_like(1280, 720, "light");
    browser.open(&format!("http://{}/{}/", flight.host, flight.token));
    browser.wait_for("document.getElementById('tracking-word').textContent === 'Tracking'");
    let values = "document.body.dataset.live === 'true' ? \
        [...document.querySelectorAll('#strips output')].map(o => o.textContent).join(';') : ''";
    let (begun, mut seen) = (Instant::now(), BTreeSet::new());
    while seen.len() < 5 {
        assert!(begun.elapsed() < Duration::from_secs(30), "poses stand still: {seen:?}");
        let now = browser.text(values);
        if !now.is_empty() {
            seen.insert(now);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    browser.wait_for("document.querySelectorAll('#pictures canvas').length === 2");
    browser.photograph("live");
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
}
