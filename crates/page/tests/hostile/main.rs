//! Hundreds of hostile clients at once: what the token guards remains shut, and a page that has the token is
//! served all the while.

#![allow(clippy::unwrap_used, clippy::panic)]

mod attack;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use attack::Attack;
use mavsight_link::Event;
use mavsight_page::{Command, Limits, Reach, Server};
use tungstenite::{Message, WebSocket};

/// The server's own limits end what it will not serve; this one only ends a test that would hang.
const WAIT: Duration = Duration::from_secs(20);

/// Ends the producer also where an assertion fails: its scope waits for it.
struct EndsOnDrop<'a>(&'a AtomicBool);

impl Drop for EndsOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn connect(server: &Server) -> TcpStream {
    let stream = TcpStream::connect_timeout(&server.address(), WAIT).unwrap();
    stream.set_read_timeout(Some(WAIT)).unwrap();
    stream
}

fn token(server: &Server) -> String {
    server.url().rsplit('/').nth(1).unwrap().to_owned()
}

/// The page itself, whole. Of more new connections than are kept the oldest are closed, so a client that is slow to
/// send its request asks again, as a browser does.
fn assert_page_is_served(server: &Server) {
    let since = Instant::now();
    while let Err(fault) = page_of(server) {
        assert!(since.elapsed() < WAIT, "{fault}");
    }
}

fn page_of(server: &Server) -> std::io::Result<()> {
    let mut stream = connect(server);
    write!(stream, "GET /{}/ HTTP/1.1\r\nHost: {}\r\n\r\n", token(server), server.address())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    let is_whole = answer.starts_with("HTTP/1.1 200") && answer.ends_with("</html>\n");
    is_whole.then_some(()).ok_or(std::io::Error::other(answer))
}

/// An open page with the token, which asks again as [`assert_page_is_served`] does.
fn open(server: &Server) -> WebSocket<TcpStream> {
    let host = server.address().to_string();
    let request = tungstenite::http::Request::get(format!("ws://{host}/{}/events", token(server)))
        .header("Host", &host)
        .header("Origin", format!("http://{host}"))
        .header("Connection", "Upgrade")
        .header("Upgrade", "websocket")
        .header("Sec-WebSocket-Version", "13")
        .header("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==")
        .body(())
        .unwrap();
    let since = Instant::now();
    loop {
        match tungstenite::client(request.clone(), connect(server)) {
            Ok((page, _)) => return page,
            Err(fault) => assert!(since.elapsed() < WAIT, "{fault}"),
        }
    }
}

/// Whether detections of this time or later come.
fn assert_hears_of(page: &mut WebSocket<TcpStream>, since_s: f64) {
    loop {
        if let Message::Text(text) = page.read().unwrap() {
            let event: serde_json::Value = serde_json::from_str(&text).unwrap();
            if event["event"] == "detections" && event["t_s"].as_f64() >= Some(since_s) {
                return;
            }
        }
    }
}

/// Memory of this process in megabytes, where the system says it.
fn resident_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    Some(line.trim().trim_end_matches(" kB").parse::<f64>().ok()? / 1e3)
}

#[test]
fn hostile_clients_command_nothing_and_keep_nobody_out() {
    let server = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback, Limits::default()).unwrap();
    let (begun, ending) = (Instant::now(), AtomicBool::new(false));
    let now_s = || begun.elapsed().as_secs_f64();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !ending.load(Ordering::Relaxed) {
                server.publish(&Event::Detections { camera: 0, t_s: now_s(), seen: Vec::new() });
                if server.wants_preview(0, (1e9 * now_s()) as i64) {
                    server.preview(0, 0, &[7; 30_000]);
                }
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let _ends = EndsOnDrop(&ending);
        let mut page = open(&server);
        assert_hears_of(&mut page, now_s());
        let before_mb = resident_mb().unwrap_or(0.0);
        let attack = Attack::start(server.address(), 400);
        let mut most_mb = before_mb;
        for round in 0.. {
            assert_page_is_served(&server);
            assert_hears_of(&mut page, now_s());
            if round % 10 == 0 {
                assert_hears_of(&mut open(&server), now_s());
                page.send(Message::text(r#"{"command":"self_check"}"#)).unwrap();
                assert_eq!(server.next_command(WAIT), Some(Command::SelfCheck));
            }
            most_mb = most_mb.max(resident_mb().unwrap_or(0.0));
            let tally = &attack.tally;
            let enough = tally.connections.load(Ordering::Relaxed) > 4000
                && tally.most_open.load(Ordering::Relaxed) > 200;
            if enough && begun.elapsed() > Duration::from_secs(6) || begun.elapsed() > Duration::from_secs(30)
            {
                break;
            }
        }
        let tally = std::sync::Arc::clone(&attack.tally);
        drop(attack);
        println!("{tally:?}; memory {before_mb:.0} to {most_mb:.0} MB");
        assert!(tally.connections.load(Ordering::Relaxed) > 400, "{tally:?}");
        assert!(tally.breaches.lock().unwrap().is_empty(), "{tally:?}");
        // Both sides of all connections are in this process.
        assert!(most_mb < before_mb + 60.0, "{before_mb} {most_mb}");
        assert_page_is_served(&server);
        assert_hears_of(&mut page, now_s());
        assert_hears_of(&mut open(&server), now_s());
        page.send(Message::text(r#"{"command":"calibrate"}"#)).unwrap();
        assert_eq!(server.next_command(WAIT), Some(Command::Calibrate));
        assert_eq!(server.next_command(Duration::ZERO), None);
    });
}
