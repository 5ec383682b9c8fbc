//! Unmodified clients of all streams at once, while a recording of the virtual room is replayed: each
//! receives the poses that were sent, in its own axes, and none else; Rerun's own reader finds all of them
//! in the file.
//!
//! The interpreter is MAVSIGHT_PYTHON, or python3; a client whose package it has not is skipped with a
//! message.

#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::mavsight;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A pose by this program's own axes: when, where, world_from_body.
struct Pose {
    captured_ns: i64,
    position_m: Vector3<f64>,
    world_from_body: UnitQuaternion<f64>,
    has_velocity: bool,
}

fn numbers(of: &Value) -> Vec<f64> {
    of.as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn quaternion(of: &Value) -> UnitQuaternion<f64> {
    let q = numbers(of);
    UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]))
}

/// The valid poses among events.
fn poses(events: &[Value]) -> Vec<Pose> {
    let valid = events.iter().filter(|e| e["event"] == "pose" && e["valid"] == true);
    let of = |e: &Value| Pose {
        captured_ns: e["captured_ns"].as_i64().unwrap(),
        position_m: Vector3::from_vec(numbers(&e["position_m"])),
        world_from_body: quaternion(&e["attitude"]),
        has_velocity: e["velocity_in_body_m_s"].is_array(),
    };
    valid.map(of).collect()
}

/// How a client has turned a pose.
#[derive(Clone, Copy)]
enum Axes {
    /// Both as here.
    Own,
    /// World W, body forward-left-up.
    Flu,
    /// Level frame N, body forward-right-down.
    Level,
}

impl Axes {
    fn back(self, position: Vector3<f64>, turn: UnitQuaternion<f64>) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        match self {
            Self::Own => (position, turn),
            Self::Flu => (position, turn * over),
            Self::Level => (over * position, over * turn),
        }
    }
}

struct Client {
    name: &'static str,
    axes: Axes,
    /// Whether it gets only poses with velocity.
    wants_velocity: bool,
    child: Child,
    lines: JoinHandle<String>,
}

impl Client {
    fn start(name: &'static str, axes: Axes, of: &[impl ToString]) -> Option<Self> {
        let python = std::env::var("MAVSIGHT_PYTHON").unwrap_or_else(|_| "python3".into());
        let child = Command::new(&python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clients.py"))
            .arg(name)
            .args(of.iter().map(ToString::to_string))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let Ok(mut child) = child else {
            println!("skipped: {python} does not start; name one by MAVSIGHT_PYTHON");
            return None;
        };
        let mut out = child.stdout.take().unwrap();
        let lines = std::thread::spawn(move || {
            let mut text = String::new();
            let _ = out.read_to_string(&mut text);
            text
        });
        Some(Self { name, axes, wants_velocity: matches!(axes, Axes::Level), child, lines })
    }

    /// Waits until it ends by itself.
    fn wait(mut self) -> Self {
        self.child.wait().unwrap();
        self
    }

    /// Ends it, and compares what it has received with what was sent: how many poses.
    fn compare(mut self, sent: &[Pose]) -> usize {
        if let Some(status) = self.child.try_wait().unwrap().filter(|s| !s.success()) {
            let mut said = String::new();
            let _ = self.child.stderr.take().unwrap().read_to_string(&mut said);
            assert_eq!(status.code(), Some(77), "{}: {said}", self.name);
            println!("skipped: {}: {said}", self.name);
            return sent.len();
        }
        let _ = self.child.kill();
        self.child.wait().unwrap();
        let text = self.lines.join().unwrap();
        let got: Vec<Value> = text.lines().filter_map(|l| serde_json::from_str(l).ok()).collect();
        let (mut which, mut last) = (Vec::new(), None);
        for line in got.iter().filter(|l| l[1] == true) {
            let place = Vector3::from_vec(numbers(&line[2]));
            let (position_m, turn) = self.axes.back(place, quaternion(&line[3]));
            let near = |p: &Pose| {
                let stamped = line[0].as_i64().is_none_or(|ns| (ns - p.captured_ns).abs() < 1000);
                stamped
                    && (p.position_m - position_m).norm() < 3e-7
                    && p.world_from_body.angle_to(&turn) < 2e-6
            };
            let Some(index) = sent.iter().position(near) else {
                panic!("{}: this was never sent: {line}", self.name)
            };
            assert!(last < Some(index), "{}: {line} comes again or late", self.name);
            last = Some(index);
            which.push(index);
        }
        let (Some(first), Some(last)) = (which.first(), which.last()) else {
            panic!("{}: nothing received: {text}", self.name)
        };
        let wanted = sent[*first..=*last].iter().filter(|p| p.has_velocity || !self.wants_velocity).count();
        println!("{}: {} of {wanted} poses since the first", self.name, which.len());
        // motioncapture keeps the latest pose only, so that a busy machine leaves some out between two looks.
        let least = if self.name.starts_with("motioncapture") { 20 } else { 20.max(9 * wanted / 10) };
        assert!(which.len() >= least, "{}: too few", self.name);
        which.len()
    }
}

/// A port that is free for both.
fn free_port() -> u16 {
    loop {
        let port = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).unwrap().port();
        if TcpListener::bind(("127.0.0.1", port)).is_ok() {
            return port;
        }
    }
}

/// A replay with outlets, and its events.
struct Replay {
    child: Child,
    events: JoinHandle<Vec<Value>>,
}

impl Replay {
    /// Starts it, and waits until it has begun.
    fn start(folder: &Path, name: &str, outlets: &str) -> Self {
        let session = folder.join(format!("{name}.toml"));
        let plain = std::fs::read_to_string(folder.join("session.toml")).unwrap();
        std::fs::write(&session, format!("{plain}\n{outlets}")).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_mavsight"))
            .arg("live")
            .arg(&session)
            .args(["--replay", "--json", "--rerun"])
            .arg(folder.join(format!("{name}.rrd")))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let scene = lines.next().expect("a scene");
        assert!(scene.contains("scene"), "{scene}");
        let events =
            std::thread::spawn(move || lines.filter_map(|l| serde_json::from_str(&l).ok()).collect());
        Self { child, events }
    }

    fn finish(mut self) -> Vec<Pose> {
        assert!(self.child.wait().unwrap().success());
        poses(&self.events.join().unwrap())
    }
}

/// Lines by TCP until the end.
fn listen(port: u16) -> JoinHandle<Vec<Value>> {
    let begun = Instant::now();
    let stream = loop {
        match TcpStream::connect(("127.0.0.1", port)) {
            Ok(stream) => break stream,
            Err(error) => assert!(begun.elapsed() < Duration::from_secs(10), "{error}"),
        }
    };
    std::thread::spawn(move || {
        let lines = BufReader::new(stream).lines().map_while(Result::ok);
        lines.filter_map(|l| serde_json::from_str(&l).ok()).collect()
    })
}

#[test]
fn clients_of_all_streams_receive_what_is_sent() {
    let dir = tempfile::TempDir::new().unwrap();
    let film = dir.path().join("film");
    // Velocity is known after five seconds, and MAVLink has it in each pose.
    mavsight()
        .args(["live", "--virtual", "--fast", "--size", "400x300", "--rate", "20", "--for", "9", "--record"])
        .arg(&film)
        .assert()
        .success();
    let [mavlink, natnet, data, vrpn, lines, other, other_data] = std::array::from_fn(|_| free_port());
    let listening = [Client::start("mavlink", Axes::Level, &[mavlink])];
    let mut outlets = format!(
        "[live.mavlink]\naddress = \"127.0.0.1:{mavlink}\"\n[live.natnet]\naddress = \"127.0.0.1:{natnet}\"\n\
         data_port = {data}\n[live.vrpn]\naddress = \"127.0.0.1:{vrpn}\"\n[live.json]\ntcp = \"127.0.0.1:{lines}\"\n"
    );
    let zenoh = free_port();
    if cfg!(feature = "zenoh") {
        outlets += &format!("[live.zenoh]\nlisten = [\"tcp/127.0.0.1:{zenoh}\"]\n");
    }
    let all = Replay::start(&film, "all", &outlets);
    let asking = [
        Client::start("natnet", Axes::Flu, &[natnet, data]),
        Client::start("motioncapture_vrpn", Axes::Flu, &[vrpn]),
        if cfg!(feature = "zenoh") { Client::start("zenoh", Axes::Own, &[zenoh]) } else { None },
    ];
    let heard = listen(lines);
    // Two clients of one machine would take the data port from each other.
    let second = format!("[live.natnet]\naddress = \"127.0.0.1:{other}\"\ndata_port = {other_data}\n");
    let second = Replay::start(&film, "second", &second);
    let mocap = Client::start("motioncapture_natnet", Axes::Flu, &[other, other_data]);
    let sent = all.finish();
    for client in listening.into_iter().chain(asking).flatten() {
        client.compare(&sent);
    }
    // All of them are in the file, and nothing else.
    if let Some(client) = Client::start("rerun", Axes::Own, &[film.join("all.rrd").display()]) {
        assert_eq!(client.wait().compare(&sent), sent.len());
    }
    let sent_second = second.finish();
    if let Some(client) = mocap {
        client.compare(&sent_second);
    }
    let heard = poses(&heard.join().unwrap());
    assert!(heard.len() + 40 >= sent.len(), "{} of {} by lines", heard.len(), sent.len());
    for (got, want) in heard.iter().rev().zip(sent.iter().rev()) {
        assert_eq!((got.captured_ns, got.position_m), (want.captured_ns, want.position_m));
    }
    std::io::stdout().flush().unwrap();
}
