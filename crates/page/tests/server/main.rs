//! The running server against malformed, oversized and slow requests, pages of other origins, and pages that
//! flood it or do not read.

#![allow(clippy::unwrap_used, clippy::panic)]

mod access;
mod client;

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use client::{
    ask, assert_still_serving, connect, detections, get, limits, next_text, note, open, rest_of, start,
    status, token, wait_for,
};
use mavsight_link::{CameraState, Event};
use mavsight_page::{Command, Limits, Reach, Reply, Server};
use tungstenite::Message;

#[test]
fn the_page_and_its_files_come_with_a_policy() {
    let server = start();
    for (path, media_type) in [("/", "text/html"), ("/page.js", "text/javascript"), ("/page.css", "text/css")]
    {
        let answer = get(&server, path, "");
        assert_eq!(status(&answer), 200, "{path}");
        for header in [
            &format!("Content-Type: {media_type}"),
            "default-src 'none'",
            "frame-ancestors 'none'",
            "Referrer-Policy: no-referrer",
            "nosniff",
        ] {
            assert!(answer.contains(header), "{path}: {header}");
        }
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        assert!(body.len() > 500 && head.contains(&format!("Content-Length: {}", body.len())), "{head}");
    }
    let head = ask(&server, format!("HEAD / HTTP/1.1\r\nHost: {}\r\n\r\n", server.address()).as_bytes());
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.ends_with("\r\n\r\n"), "{head}");
}

#[test]
fn malformed_requests_are_refused_and_it_still_serves() {
    let server = start();
    let host = format!("Host: {}\r\n", server.address());
    for (request, want) in [
        ("\u{0}\u{3}\u{1}nonsense\r\n\r\n".to_owned(), 400),
        ("GET\r\n\r\n".to_owned(), 400),
        ("GET / HTTP/1.1\r\n\r\n".to_owned(), 400),
        (format!("GET / HTTP/7.3\r\n{host}\r\n"), 400),
        (format!("GET / HTTP/1.1\r\n{host}{host}\r\n"), 400),
        (format!("GET / HTTP/1.1\r\n{host}Content-Length: many\r\n\r\n"), 400),
        (format!("GET http://other/ HTTP/1.1\r\n{host}\r\n"), 400),
        (format!("GET /../../etc/passwd HTTP/1.1\r\n{host}\r\n"), 404),
        (format!("GET /index.php HTTP/1.1\r\n{host}\r\n"), 404),
        (format!("DELETE / HTTP/1.1\r\n{host}\r\n"), 405),
        (format!("GET /events HTTP/1.1\r\n{host}\r\n"), 426),
        (format!("GET /events HTTP/1.1\r\n{host}Upgrade: websocket\r\nConnection: Upgrade\r\n\r\n"), 426),
    ] {
        assert_eq!(status(&ask(&server, request.as_bytes())), want, "{request:?}");
    }
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n";
    let origin = format!("Origin: http://{}\r\n", server.address());
    assert_eq!(status(&get(&server, "/events", &format!("{upgrade}{origin}"))), 400);
    assert_eq!(
        status(&get(&server, "/events", &format!("{upgrade}{origin}Sec-WebSocket-Key: abc\r\n"))),
        400
    );
    assert_eq!(server.listeners(), 0);
    assert_still_serving(&server);
}

#[test]
fn oversized_requests_are_refused_and_it_still_serves() {
    let server = start();
    let long = "x".repeat(1 << 20);
    assert_eq!(status(&get(&server, &format!("/{long}"), "")), 431);
    assert_eq!(status(&get(&server, "/", &format!("Cookie: {long}\r\n"))), 431);
    assert_eq!(status(&get(&server, "/", &"A: b\r\n".repeat(100))), 431);
    let host = server.address();
    for body in [
        format!("Content-Length: {}\r\n\r\n{long}", long.len()),
        "Transfer-Encoding: chunked\r\n\r\n".to_owned(),
    ] {
        let request = format!("GET / HTTP/1.1\r\nHost: {host}\r\n{body}");
        assert_eq!(status(&ask(&server, request.as_bytes())), 413);
    }
    let mut socket = open(&server).unwrap();
    socket.send(Message::text("y".repeat(5000))).unwrap();
    assert!(std::iter::from_fn(|| socket.read().ok()).all(|message| !matches!(message, Message::Binary(_))));
    wait_for("a page that sends too much is left", || server.listeners() == 0);
    assert_still_serving(&server);
}

#[test]
fn slow_requests_end_and_do_not_keep_others_out() {
    let server = start();
    let mut slow: Vec<TcpStream> = (0..20).map(|_| connect(&server)).collect();
    let begun = Instant::now();
    for letter in "GET / HTTP/1.1".bytes() {
        for stream in &mut slow {
            let _ = stream.write_all(&[letter]);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(status(&get(&server, "/", "")), 200);
    for stream in slow {
        assert_eq!(status(&rest_of(stream)), 408);
    }
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    assert_still_serving(&server);
}

#[test]
fn of_more_connections_than_may_be_the_oldest_is_closed() {
    let server = start();
    let mut idle: Vec<TcpStream> = (0..24).map(|_| connect(&server)).collect();
    assert_eq!(status(&get(&server, "/", "")), 200);
    assert_eq!(rest_of(idle.remove(0)), "");
    for stream in idle {
        assert_eq!(status(&rest_of(stream)), 408);
    }
    let pages: Vec<_> = (0..3).map(|_| open(&server).unwrap()).collect();
    assert_eq!(open(&server).unwrap_err(), 503);
    drop(pages);
    wait_for("pages that are closed are forgotten", || server.listeners() == 0);
    assert_still_serving(&server);
}

#[test]
fn a_page_that_floods_is_heard_at_its_share_and_the_rest_waits_at_its_end() {
    let server = start();
    let mut socket = open(&server).unwrap();
    socket.get_mut().set_write_timeout(Some(Duration::from_millis(300))).unwrap();
    let pings = [0x89, 0x80, 0, 0, 0, 0].repeat(2000);
    let begun = Instant::now();
    let mut taken = 0;
    // Until the system's buffers are full and nobody empties them.
    while begun.elapsed() < Duration::from_secs(20) {
        match socket.get_mut().write(&pings) {
            Ok(bytes) => taken += bytes,
            Err(_) => break,
        }
    }
    // A server that reads all takes gigabytes in that time.
    assert!(taken < 64 << 20 && begun.elapsed() < Duration::from_secs(20), "{taken} bytes");
    assert_still_serving(&server);
}

#[test]
fn events_pictures_and_commands_go_through() {
    let server = start();
    server.publish(&note("before"));
    server.publish(&detections(0.5));
    let mut socket = open(&server).unwrap();
    wait_for("the page is counted", || server.listeners() == 1);
    server.publish(&detections(1.5));
    server.publish(&Event::Camera {
        camera: 1,
        state: CameraState::Stalled,
        rate_hz: 0.0,
        latency_ms: 0.0,
        missing: 0,
        dropped: 3,
        markers: vec![0.5],
        reason: None,
    });
    assert!(next_text(&mut socket).contains("before"));
    let detections: serde_json::Value = serde_json::from_str(&next_text(&mut socket)).unwrap();
    assert_eq!((&detections["event"], detections["t_s"].as_f64()), (&"detections".into(), Some(1.5)));
    assert!(next_text(&mut socket).contains("stalled"));
    server.preview(1, -2, b"picture");
    let picture = loop {
        if let Message::Binary(bytes) = socket.read().unwrap() {
            break bytes;
        }
    };
    assert_eq!(&picture[..], b"\x01\xfe\xff\xff\xff\xff\xff\xff\xffpicture");
    for (name, command) in [
        ("start_recording", Command::StartRecording),
        ("stop_recording", Command::StopRecording),
        ("calibrate", Command::Calibrate),
        ("self_check", Command::SelfCheck),
    ] {
        socket.send(Message::text(format!(r#"{{"command":"{name}"}}"#))).unwrap();
        assert_eq!(server.next_command(Duration::from_secs(5)), Some(command));
    }
    drop(server);
    let last = std::iter::from_fn(|| socket.read().ok()).last();
    assert!(matches!(last, Some(Message::Close(Some(frame))) if frame.reason.contains("ended")));
}

#[test]
fn commands_that_are_none_or_too_many_are_answered_and_do_no_harm() {
    let server = start();
    let mut socket = open(&server).unwrap();
    socket.send(Message::text(r#"{"command":"explode"}"#)).unwrap();
    let answer: serde_json::Value = serde_json::from_str(&next_text(&mut socket)).unwrap();
    assert_eq!((&answer["event"], &answer["fault"]), (&"note".into(), &true.into()));
    for _ in 0..20 {
        socket.send(Message::text(r#"{"command":"calibrate"}"#)).unwrap();
    }
    assert!(next_text(&mut socket).contains("Too many requests"));
    let waiting = std::iter::from_fn(|| server.next_command(Duration::ZERO)).count();
    assert_eq!(waiting, 16);
    for _ in 0..10 {
        let _ = socket.send(Message::text("nonsense"));
    }
    wait_for("who sends nonsense is left", || server.listeners() == 0);
    let mut socket = open(&server).unwrap();
    socket.send(Message::binary(vec![1, 2, 3])).unwrap();
    wait_for("who sends bytes is left", || server.listeners() == 0);
    assert_still_serving(&server);
}

#[test]
fn a_listener_that_does_not_read_holds_nobody_and_then_sees_what_is_new() {
    let patient = Limits { silence: Duration::from_secs(60), ..limits() };
    let server = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback, patient).unwrap();
    let mut asleep = open(&server).unwrap();
    let mut awake = open(&server).unwrap();
    wait_for("both are counted", || server.listeners() == 2);
    let picture = vec![7; 40_000];
    let mut slowest = Duration::ZERO;
    for count in 0..2000 {
        let before = Instant::now();
        server.publish(&detections(f64::from(count)));
        if count % 4 == 0 {
            server.preview(0, 0, &picture);
        }
        slowest = slowest.max(before.elapsed());
        if count % 50 == 0 {
            // So that who reads is never behind.
            server.publish(&note("here"));
            while !next_text(&mut awake).contains("here") {}
        }
    }
    // One that waited for the sleeper would take until it is left, which is after a minute; this leaves room
    // for a busy machine.
    assert!(slowest < Duration::from_secs(1), "a publish took {slowest:?}");
    // What the sleeper finds: what had gone out before the system's buffers were full, then only the newest.
    server.publish(&note("the end"));
    let mut seen = Vec::new();
    loop {
        let text = next_text(&mut asleep);
        if text.contains("the end") {
            break;
        }
        let event: serde_json::Value = serde_json::from_str(&text).unwrap();
        seen.extend(event["t_s"].as_f64().filter(|_| event["event"] == "detections"));
    }
    assert!(seen.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(seen.len() < 1500, "{} of 2000 waited", seen.len());
    assert_eq!(seen[seen.len() - 30..], (1970..2000).map(f64::from).collect::<Vec<_>>());
}

#[test]
fn a_page_that_has_gone_without_a_word_is_left() {
    let quick = Limits { beat: Duration::from_millis(30), silence: Duration::from_millis(300), ..limits() };
    let server = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback, quick).unwrap();
    let silent = open(&server).unwrap();
    wait_for("the page is counted", || server.listeners() == 1);
    let mut beats = open(&server).unwrap();
    for _ in 0..30 {
        beats.read().unwrap();
    }
    wait_for("who answers no ping is left", || {
        // Reading answers the pings of the other.
        server.listeners() == 1
    });
    drop(silent);
}

#[test]
fn a_page_of_another_kind_is_served_by_the_same_rules() {
    let answer = |path: &str, query: &str| {
        let is_known = path == "state" || path == "do/save";
        is_known.then(|| Reply { media_type: "text/plain", text: format!("{path}?{query}") })
    };
    let address = "127.0.0.1:0".parse().unwrap();
    let server = Server::start_site(address, Reach::Loopback, limits(), answer).unwrap();
    let own = "x-mavsight: page\r\n";
    let save = format!("/{}/do/save", token(&server));
    assert!(get(&server, "/state?a=1", "").ends_with("state?a=1"));
    assert!(get(&server, &save, own).ends_with("do/save?"));
    // Without the token a program on this machine may look alone.
    assert_eq!(status(&get(&server, "/do/save", own)), 403);
    // As a link or a form of another page would ask, with whatever origin.
    assert_eq!(status(&get(&server, &save, "")), 403);
    assert_eq!(status(&get(&server, &save, "x-mavsight: other\r\n")), 403);
    assert_eq!(status(&get(&server, &save, "Origin: http://evil.example\r\nx-mavsight: page\r\n")), 403);
    let preflight = format!("OPTIONS {save} HTTP/1.1\r\nHost: {}\r\n\r\n", server.address());
    assert_eq!(status(&ask(&server, preflight.as_bytes())), 405);
    for nothing in ["/", "/page.js", "/events"] {
        assert_eq!(status(&get(&server, nothing, "")), 404, "{nothing}");
    }
}
