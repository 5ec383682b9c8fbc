//! Unmodified clients on the loopback: what they receive of a circling flight is what its formula says, an
//! instant that was not measured is never a pose to them, and either side may go away and come back.
//!
//! The interpreter is MAVSIGHT_PYTHON, or python3; a client whose package it has not is skipped with a
//! message.

#[path = "../examples/publish/circle.rs"]
mod circle;

use mavsight_link::{Body, Mavlink, MavlinkOptions, Natnet, NatnetOptions, Outlet, Vrpn, VrpnOptions};
use std::net::UdpSocket;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

const RATE_HZ: u64 = 60;

fn body() -> Body {
    Body::new("circle", circle::markers())
}

/// A port that is free for UDP.
fn free_port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a port").port()
}

/// A flight in a thread of its own, until it is dropped.
struct Flight {
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Flight {
    fn start(mut outlet: impl Outlet + 'static) -> Self {
        let ending = Arc::new(AtomicBool::new(false));
        let asked = Arc::clone(&ending);
        let thread = std::thread::spawn(move || {
            outlet.event(&circle::scene()).expect("sent");
            for sequence in 1.. {
                if asked.load(Ordering::Relaxed) {
                    return;
                }
                let fix = circle::fix(sequence, mavsight_link::now_ns());
                outlet.send(&fix).and_then(|()| outlet.event(&circle::event(&fix))).expect("sent");
                std::thread::sleep(Duration::from_micros(1_000_000 / RATE_HZ));
            }
        });
        Self { ending, thread: Some(thread) }
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || matches!(ended, Some(Ok(()))), "the flight broke off");
    }
}

/// Runs a client; a missing package is reported and passes.
fn client(case: &str, ports: &[u16]) {
    let python = std::env::var("MAVSIGHT_PYTHON").unwrap_or_else(|_| "python3".into());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clients.py");
    let ports = ports.iter().map(u16::to_string);
    // A client that waits for ever, as some do, fails.
    let mut command = Command::new("timeout");
    let Ok(output) = command.args(["-k", "1", "40", &python, script, case]).args(ports).output() else {
        println!("skipped: {python} does not start; name one by MAVSIGHT_PYTHON");
        return;
    };
    let said =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    if matches!(output.status.code(), Some(77) | Some(127)) {
        println!("skipped: {python}: {said}");
        return;
    }
    assert!(output.status.success(), "{case}: {:?}: {said}", output.status.code());
    println!("{said}");
}

#[test]
fn pymavlink_reads_odometry() {
    let port = free_port();
    let options = MavlinkOptions {
        address: format!("127.0.0.1:{port}"),
        bind: "127.0.0.1:0".into(),
        rate_hz: 40.0,
        ..Default::default()
    };
    let _flight = Flight::start(Mavlink::open(&options, &body()).expect("an outlet"));
    client("mavlink", &[port]);
}

fn natnet() -> (Flight, [u16; 2]) {
    let data_port = free_port();
    let options = NatnetOptions { address: "127.0.0.1:0".into(), data_port, ..Default::default() };
    let outlet = Natnet::open(&options, &body()).expect("an outlet");
    let port = outlet.address().expect("its address").port();
    (Flight::start(outlet), [port, data_port])
}

#[test]
fn natnet_reads_frames() {
    let (_flight, ports) = natnet();
    client("natnet", &ports);
}

#[test]
fn motioncapture_reads_frames_of_natnet() {
    let (_flight, ports) = natnet();
    client("natnet_motioncapture", &ports);
    // It has gone without a word, and comes back.
    client("natnet_motioncapture", &ports);
}

#[test]
fn motioncapture_reads_a_tracker_of_vrpn_that_goes_away_and_comes_back() {
    // A port that was tried and closed may still be held by the child that another test is about to start.
    let open = |port: u16| {
        let options = VrpnOptions { address: format!("127.0.0.1:{port}"), ..Default::default() };
        Vrpn::open(&options, &body()).expect("an outlet")
    };
    let outlet = open(0);
    let port = outlet.address().port();
    let first = Flight::start(outlet);
    let reader = std::thread::spawn(move || client("vrpn", &[port]));
    std::thread::sleep(Duration::from_secs(4));
    drop(first);
    std::thread::sleep(Duration::from_secs(1));
    let _second = Flight::start(open(port));
    reader.join().expect("the client");
}

#[cfg(feature = "zenoh")]
#[test]
fn zenoh_subscribes_to_poses() {
    use mavsight_link::{Zenoh, ZenohOptions};
    let port =
        std::net::TcpListener::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a port").port();
    let options = ZenohOptions { listen: vec![format!("tcp/127.0.0.1:{port}")], ..ZenohOptions::default() };
    let _flight = Flight::start(Zenoh::open(&options, &body()).expect("an outlet"));
    client("zenoh", &[port]);
}
