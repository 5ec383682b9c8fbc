use super::*;
use crate::testing::{body, fix, noise};
use std::io::Write;
use std::time::Instant;

fn server() -> Vrpn {
    let options = VrpnOptions { address: "127.0.0.1:0".into(), ..Default::default() };
    Vrpn::open(&options, &body()).expect("a server")
}

/// A client that has called and been called back, its connection.
fn called(server: &Vrpn) -> TcpStream {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("its address").port();
    let calling = UdpSocket::bind("127.0.0.1:0").expect("a port");
    // The host that it names is not looked at.
    calling.send_to(format!("192.0.2.7 {port}\0").as_bytes(), server.address()).expect("sent");
    let (stream, _) = listener.accept().expect("called back");
    stream.set_read_timeout(Some(Duration::from_secs(5))).expect("a timeout");
    stream
}

fn next(stream: &mut TcpStream) -> (i32, i32, Vec<u8>, [i32; 2]) {
    let mut head = [0; 24];
    stream.read_exact(&mut head).expect("a header");
    let word = |at: usize| i32::from_be_bytes(head[at..at + 4].try_into().expect("four"));
    let length = word(0) as usize - 24;
    let mut payload = vec![0; length.next_multiple_of(8)];
    stream.read_exact(&mut payload).expect("a payload");
    payload.truncate(length);
    (word(12), word(16), payload, [word(4), word(8)])
}

fn greet(stream: &mut TcpStream) {
    let mut cookie = [0; 24];
    stream.read_exact(&mut cookie).expect("a cookie");
    // VRPN 07.38 writes "%.16s  %c" of its name and the log mode into zeros.
    assert_eq!(&cookie, b"vrpn: ver. 07.38  0\0\0\0\0\0");
    stream.write_all(b"vrpn: ver. 07.35  0\0\0\0\0\0").expect("sent");
    for name in [
        "cf231",
        "vrpn_Tracker Pos_Quat",
        "vrpn_Tracker Velocity",
        "vrpn_Base ping_message",
        "vrpn_Base pong_message",
    ] {
        let (number, kind, payload, _) = next(stream);
        assert_eq!(payload[..4], (name.len() as u32 + 1).to_be_bytes());
        assert_eq!(payload[4..], *format!("{name}\0").as_bytes());
        let want = match name {
            "cf231" => (0, -1),
            "vrpn_Tracker Pos_Quat" => (0, -2),
            "vrpn_Tracker Velocity" => (1, -2),
            "vrpn_Base ping_message" => (2, -2),
            _ => (3, -2),
        };
        assert_eq!((number, kind), want);
    }
}

fn numbers(payload: &[u8]) -> Vec<f64> {
    payload[8..].chunks(8).map(|b| f64::from_be_bytes(b.try_into().expect("eight"))).collect()
}

#[test]
fn a_client_is_called_back_and_gets_poses() {
    let mut server = server();
    let mut stream = called(&server);
    greet(&mut stream);
    server.send(&Fix { measured: None, ..fix() }).expect("sent");
    server.send(&fix()).expect("sent");
    let (sender, kind, payload, at) = next(&mut stream);
    assert_eq!((sender, kind, payload.len(), at), (0, 0, 64, [1_700_000_000, 123_456]));
    assert_eq!(payload[..8], [0; 8]);
    let pose = numbers(&payload);
    assert_eq!(pose[..3], [1.5, 2.25, 0.75]);
    assert!((pose[3..].iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12);
    let (_, kind, payload, _) = next(&mut stream);
    let motion = numbers(&payload);
    assert_eq!((kind, payload.len(), motion[7]), (1, 72, TURN_S));
    let speed = motion[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!((speed - (0.25f64 + 0.0625 + 0.015625).sqrt()).abs() < 1e-12);
    // Twice the sine of half the angle is the angle, to the third order.
    let turn = 2.0 * motion[3..6].iter().map(|v| v * v).sum::<f64>().sqrt() / TURN_S;
    assert!((turn - 0.0014f64.sqrt()).abs() < 1e-8, "{turn}");
}

/// Level, nose along X: world axes are body axes turned half about X.
#[test]
fn velocity_is_in_world_axes() {
    let mut server = server();
    let mut stream = called(&server);
    greet(&mut stream);
    let mut fix = fix();
    let pose = mavsight_geometry::world_from_body(Default::default(), Default::default());
    fix.measured.as_mut().expect("a pose").world_from_body = pose;
    server.send(&fix).expect("sent");
    let level = numbers(&next(&mut stream).2);
    // Forward-left-up in Z up: nothing is turned; x, y, z, w.
    assert!(level.iter().zip([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).all(|(a, b)| (a.abs() - b).abs() < 1e-12));
    let motion = numbers(&next(&mut stream).2);
    let half_turn = TURN_S / 2.0;
    let want = [0.5, 0.25, -0.125, 0.01 * half_turn, 0.02 * half_turn, -0.03 * half_turn, 1.0];
    assert!(motion.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-7), "{motion:?}");
}

#[test]
fn pings_are_answered_by_the_clients_own_number() {
    let server = server();
    let mut stream = TcpStream::connect(server.address()).expect("connected");
    stream.set_read_timeout(Some(Duration::from_secs(5))).expect("a timeout");
    greet(&mut stream);
    let mut bytes = Vec::new();
    let mut say = |sender: i32, kind: i32, payload: &[u8]| {
        for word in [24 + payload.len() as i32, 0, 0, sender, kind, 0] {
            bytes.extend(word.to_be_bytes());
        }
        bytes.extend(payload);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
    };
    say(5, -3, b"127.0.0.1\0");
    say(17, -2, b"\0\0\0\x17vrpn_Base ping_message\0");
    say(3, 4, b"something else");
    say(3, 17, b"");
    for byte in bytes {
        stream.write_all(&[byte]).expect("sent");
    }
    let (sender, kind, payload, _) = next(&mut stream);
    assert_eq!((sender, kind, payload.len()), (0, 3, 0));
}

#[test]
fn no_bytes_break_the_reader() {
    let mut messages = messages::COOKIE.to_vec();
    // Lengths that go on; what follows is noise.
    messages.extend([0, 0, 0, 40]);
    let (mut cookies, mut refused) = (0, 0);
    for packet in noise(&messages) {
        let mut inbox = Inbox::default();
        messages::called_port(&packet);
        for piece in packet.chunks(7) {
            let Some(asks) = inbox.take(piece) else {
                refused += 1;
                break;
            };
            cookies += asks.iter().filter(|ask| **ask == Ask::Greeting).count();
        }
    }
    assert!(cookies > 1500 && refused > 1500, "{cookies} {refused}");
}

#[test]
fn noise_is_cut_off_and_the_server_goes_on() {
    let mut server = server();
    let calling = UdpSocket::bind("127.0.0.1:0").expect("a port");
    for noise in [&b""[..], b"host", b"host 80", b"host 70000", b"a b c", &[255; 60_000], b"host 4000 more"] {
        calling.send_to(noise, server.address()).expect("sent");
    }
    let deaf = called(&server);
    for noise in [&b"GET / HTTP/1.1\r\n\r\n"[..], b"vrpn: ver. 06.00  0\0\0\0\0\0"] {
        let mut stream = TcpStream::connect(server.address()).expect("connected");
        stream.write_all(noise).expect("sent");
        stream.set_read_timeout(Some(Duration::from_secs(5))).expect("a timeout");
        let mut rest = Vec::new();
        // It ends: with a reset where bytes were left unread.
        let _ = stream.read_to_end(&mut rest);
        assert!(rest.len() <= 24);
    }
    for length in [0i32, -5, 70_000] {
        let mut stream = called(&server);
        greet(&mut stream);
        let mut head = [0; 24];
        head[..4].copy_from_slice(&length.to_be_bytes());
        stream.write_all(&head).expect("sent");
        assert!(matches!(stream.read(&mut head), Ok(0) | Err(_)));
    }
    let mut good = called(&server);
    greet(&mut good);
    let begun = Instant::now();
    for _ in 0..1000 {
        server.send(&fix()).expect("sent");
    }
    assert!(begun.elapsed() < Duration::from_secs(2), "nobody is waited for");
    assert_eq!(next(&mut good).1, 0);
    drop(deaf);
}
