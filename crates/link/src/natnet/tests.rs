use super::*;
use crate::testing::{body, fix, noise};

/// A field of a packet by its offset.
fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four"))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight"))
}

fn server() -> (Natnet, UdpSocket, UdpSocket) {
    let data = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let asking = UdpSocket::bind("127.0.0.1:0").expect("a port");
    for socket in [&data, &asking] {
        socket.set_read_timeout(Some(Duration::from_millis(500))).expect("a timeout");
    }
    let options = NatnetOptions {
        address: "127.0.0.1:0".into(),
        data_port: data.local_addr().expect("its address").port(),
        ..Default::default()
    };
    (Natnet::open(&options, &body()).expect("a server"), asking, data)
}

fn ask(server: &Natnet, asking: &UdpSocket, packet: &[u8]) -> Option<Vec<u8>> {
    let mut inbox = [0; 4096];
    asking.send_to(packet, server.address().expect("its address")).expect("sent");
    asking.recv_from(&mut inbox).ok().map(|(length, _)| inbox[..length].to_vec())
}

/// Offsets as in the structure that libmotioncapture lays over the packet.
#[test]
fn the_server_sends_version_clock_and_port() {
    let (server, asking, data) = server();
    let info = ask(&server, &asking, &[0, 0, 0, 0]).expect("an answer");
    assert_eq!(info.len(), 283);
    assert_eq!(info[..4], [1, 0, 0x17, 1]);
    assert_eq!(&info[4..13], b"mavsight\0");
    assert_eq!(info[264..268], [3, 1, 0, 0]);
    assert_eq!(u64_at(&info, 268), 1_000_000_000);
    assert_eq!(info[276..278], data.local_addr().expect("its address").port().to_le_bytes());
    assert_eq!(info[278], 0);
}

#[test]
fn the_model_names_the_body_and_its_markers() {
    let (server, asking, _) = server();
    let model = ask(&server, &asking, &[4, 0, 0, 0]).expect("an answer");
    assert_eq!(model[..2], [5, 0]);
    assert_eq!(usize::from(u16::from_le_bytes([model[2], model[3]])), model.len() - 4);
    assert_eq!(model[4..12], [1, 0, 0, 0, 1, 0, 0, 0]);
    assert_eq!(&model[12..18], b"cf231\0");
    assert_eq!(model[18..22], [1, 0, 0, 0]);
    assert_eq!(model[38..42], [4, 0, 0, 0]);
    // Forward-left-up.
    assert_eq!([f32_at(&model, 42), f32_at(&model, 46), f32_at(&model, 50)], [0.1, -0.2, -0.3]);
    assert_eq!(model.len(), 42 + 4 * 12 + 4 * 4);
}

#[test]
fn frames_go_to_data_ports_and_to_who_keeps_alive() {
    let (mut server, asking, data) = server();
    let mut inbox = [0; 4096];
    server.send(&fix()).expect("sent");
    assert!(data.recv_from(&mut inbox).is_err(), "nobody has asked");
    ask(&server, &asking, &[0, 0, 0, 0]).expect("an answer");
    server.send(&fix()).expect("sent");
    let (length, _) = data.recv_from(&mut inbox).expect("a frame");
    let frame = inbox[..length].to_vec();
    assert!(
        asking.recv_from(&mut inbox).is_err(),
        "it reads answers at its command port until it keeps alive"
    );
    assert_eq!(frame.len(), 4 + 20 + 34 + 24 + 8 + 24 + 6);
    assert_eq!(frame[..4], [7, 0, 116, 0]);
    assert_eq!(frame[4..8], [41, 0, 0, 0]);
    assert_eq!([f32_at(&frame, 24), f32_at(&frame, 28), f32_at(&frame, 32)], [1.5, 2.25, 0.75]);
    // Of the published check value in ENU and FLU, a quarter turn back about Z: x, y, z, w.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let (w, x, y, z) = (0.8638, 0.0059, -0.0971, 0.4943);
    let want = [half * (x + y), half * (y - x), half * (z - w), half * (w + z)];
    let got = [36, 40, 44, 48].map(|at| f64::from(f32_at(&frame, at)));
    let sign = (got[3] * want[3]).signum();
    assert!(got.iter().zip(want).all(|(a, b)| (a * sign - b).abs() < 1e-4), "{got:?} {want:?}");
    assert!((f32_at(&frame, 52) - 3f32.sqrt() * 1e-3).abs() < 1e-8);
    assert_eq!(frame[56..58], [1, 0]);
    assert_eq!(u64_at(&frame, 90), 1_700_000_000_123_456_789);
    assert_eq!(u64_at(&frame, 98), 1_700_000_000_133_456_789);
    assert!(u64_at(&frame, 106) > 1_700_000_000_133_456_789);

    let to = server.address().expect("its address");
    asking.send_to(&[10, 0, 1, 0, 0], to).expect("sent");
    // Requests are read in order: once this one is answered, the one before is known.
    ask(&server, &asking, &[4, 0, 0, 0]).expect("an answer");
    server.send(&Fix { measured: None, ..fix() }).expect("sent");
    let (length, _) = asking.recv_from(&mut inbox).expect("a frame");
    assert_eq!((length, &inbox[56..58]), (frame.len(), &[0u8, 0][..]));
    assert!((24..52).step_by(4).all(|at| f32_at(&inbox, at).is_nan()));
    asking.send_to(&[9, 0, 0, 0], to).expect("sent");
    ask(&server, &asking, &[4, 0, 0, 0]).expect("an answer");
    server.send(&fix()).expect("sent");
    assert!(asking.recv_from(&mut inbox).is_err(), "it has left");
}

#[test]
fn questions_are_answered_and_noise_is_passed_over() {
    let (server, asking, _) = server();
    let up = ask(&server, &asking, b"\x02\0\x07\0UpAxis\0").expect("an answer");
    assert_eq!(up, [3, 0, 4, 0, 2, 0, 0, 0]);
    let units = ask(&server, &asking, b"\x02\0\x13\0UnitsToMillimeters\0").expect("an answer");
    assert_eq!(f32_at(&units, 4), 1000.0);
    assert_eq!(ask(&server, &asking, b"\x02\0\x01\0Bitstream,4.1\0"), Some(vec![100, 0, 0, 0]));
    for noise in [&b""[..], b"\x07", b"\x07\0\0\0", b"\xff\xff\xff\xff\xff", &[255; 60_000]] {
        assert_eq!(ask(&server, &asking, noise), None);
    }
    assert!(ask(&server, &asking, &[0, 0, 0, 0]).is_some(), "still serving");
}

#[test]
fn no_bytes_break_the_reader() {
    let requests: Vec<_> = noise(&[2, 0, 0, 0]).map(|packet| packets::request(&packet)).collect();
    assert!(requests.iter().filter(|r| **r == Some(Request::Other)).count() > 1500);
    assert!(requests.iter().filter(|r| r.is_none()).count() > 1500);
}

#[test]
fn listeners_do_not_pile_up() {
    let mut listeners = Listeners::default();
    let now = Instant::now();
    for port in 1..200 {
        listeners.machine(([127, 0, 0, 1], port).into());
        listeners.alive(([127, 0, 0, 1], port).into(), now);
        listeners.alive(([127, 0, 0, 1], 1).into(), now);
    }
    assert_eq!((listeners.machines.len(), listeners.kept.len()), (MOST, MOST));
    listeners.alive(([127, 0, 0, 1], 500).into(), now + SILENCE);
    assert_eq!(listeners.kept.len(), 1);
    let wrong = NatnetOptions { data_port: 0, ..Default::default() };
    assert!(Natnet::open(&wrong, &body()).is_err_and(|e| e.to_string().contains("`data_port`")));
}
