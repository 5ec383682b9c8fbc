use super::*;
use crate::testing::{body, bytes, fix, noise};

fn framed(message: &Message, sequence: u8) -> Vec<u8> {
    let mut frame = MAVLinkV2MessageRaw::new();
    let header = MavHeader { system_id: 1, component_id: 197, sequence };
    frame.serialize_message_with_dialect(header, &Messages, message).expect("it fits");
    frame.raw_bytes().to_vec()
}

/// The bytes of pymavlink 2.4.50's own encoder.
#[test]
fn the_bytes_are_those_of_pymavlink() {
    let motion = [1.5, -2.25, -0.75, 0.9604, -0.0645, 0.0729, 0.2613, 0.5, -0.25, 0.125, 0.01, -0.02, 0.03];
    let pose_covariance = (0..21).map(|k| 0.001 * f64::from(k + 1));
    let velocity_covariance = (0..21).map(|k| -0.5 + 0.1 * f64::from(k));
    let numbers = motion.into_iter().chain(pose_covariance).chain(velocity_covariance);
    let odometry = messages::odometry(1_700_000_000_123_456, numbers, 3, 75);
    let want = bytes(
        "fde900000701c54b010040222018240a06000000c03f000010c0000040bfc6dc753f931884bd984c953d1dc9853e0000003f000080be0000003e
         0ad7233c0ad7a3bc8fc2f53c6f12833a6f12033ba69b443b6f12833b0ad7a33ba69bc43b4260e53b6f12033cbc74133c0ad7233c5839343c
         a69b443cf4fd543c4260653c8fc2753c6f12833c96438b3cbc74933ce3a59b3c0ad7a33c3108ac3c000000bfcdccccbe9a9999becdcc4cbe
         cdccccbd00000000cdcccc3dcdcc4c3e9a99993ecdcccc3e0000003f9a99193f3333333fcdcc4c3f6666663f0000803fcdcc8c3f9a99993f
         6666a63f3333b33f0000c03f140c03024b7bb0",
    );
    let got = framed(&odometry, 7);
    assert_eq!(got, want);
    assert_eq!(framed(&messages::heartbeat(), 8), bytes("fd0900000801c5000000000000001208000403dab4"));
}

#[test]
fn a_request_for_the_time_is_read_and_answered() {
    let options =
        MavlinkOptions { address: "127.0.0.1:9".into(), bind: "127.0.0.1:0".into(), ..Default::default() };
    let outlet = Mavlink::open(&options, &body()).expect("an outlet");
    let autopilot = UdpSocket::bind("127.0.0.1:0").expect("a port");
    autopilot.set_read_timeout(Some(Duration::from_secs(5))).expect("a timeout");
    let request = Timesync { responding_ns: 0, asking_ns: 5555, target: [0, 0] };
    let to = outlet.radio.socket.local_addr().expect("its address");
    // Noise and a cut packet first: they are passed over.
    autopilot.send_to(b"\xfdnoise", to).expect("sent");
    autopilot.send_to(&framed(&request.message(), 1)[..15], to).expect("sent");
    autopilot.send_to(&framed(&request.message(), 2), to).expect("sent");
    let mut inbox = [0; 300];
    let before_ns = now_ns();
    let (length, _) = autopilot.recv_from(&mut inbox).expect("an answer");
    let (_, message) = MavlinkReader::new(&inbox[..length])
        .read_message_with_dialect(&Messages, MavlinkVersion::V2)
        .expect("a message");
    let answer = Timesync::read(&message).expect("a time");
    assert_eq!((answer.asking_ns, answer.target), (5555, [1, 197]));
    assert!((answer.responding_ns - before_ns).abs() < 2_000_000_000);
}

#[test]
fn no_bytes_break_the_reader() {
    let request = framed(&Timesync { responding_ns: 0, asking_ns: 1, target: [0; 2] }.message(), 0);
    let read = |packet: &[u8]| {
        MavlinkReader::new(packet).read_message_with_dialect(&Messages, MavlinkVersion::V2).is_ok()
    };
    assert!(read(&request));
    let known = noise(&request[..10]).filter(|packet| read(packet)).count();
    // Two bytes of checksum let one packet in 65 536 through.
    assert!(known <= 2, "{known}");
    for length in 0..request.len() {
        assert!(!read(&request[..length]));
    }
}

#[test]
fn what_was_not_measured_is_not_sent() {
    let autopilot = UdpSocket::bind("127.0.0.1:0").expect("a port");
    autopilot.set_read_timeout(Some(Duration::from_millis(300))).expect("a timeout");
    let options = MavlinkOptions {
        address: autopilot.local_addr().expect("its address").to_string(),
        bind: "127.0.0.1:0".into(),
        ..Default::default()
    };
    let mut outlet = Mavlink::open(&options, &body()).expect("an outlet");
    let whole = fix();
    let mut resting = whole.clone();
    resting.measured.as_mut().expect("a pose").moving = None;
    let mut nowhere = whole.clone();
    nowhere.measured.as_mut().expect("a pose").world_from_body.translation.x = f64::NAN;
    for (k, fix) in [Fix { measured: None, ..whole.clone() }, resting, nowhere, whole].into_iter().enumerate()
    {
        let captured_ns = fix.captured_ns + k as i64 * 20_000_000;
        outlet.send(&Fix { captured_ns, ..fix }).expect("sent");
    }
    let mut inbox = [0; 300];
    let mut odometries = Vec::new();
    while let Ok((_, _)) = autopilot.recv_from(&mut inbox) {
        if inbox[7] == 75 {
            odometries.push(u64::from_le_bytes(inbox[10..18].try_into().expect("eight")));
        }
    }
    assert_eq!(odometries, [1_700_000_000_183_456]);
}

#[test]
fn quality_is_the_share_of_markers() {
    let options = MavlinkOptions { bind: "127.0.0.1:0".into(), ..Default::default() };
    let outlet = Mavlink::open(&options, &body()).expect("an outlet");
    let fix = fix();
    let quality = |markers| {
        let measured = Measured { markers, ..fix.measured.clone().expect("a pose") };
        let message = outlet.odometry(&fix, &measured, measured.moving.as_ref().expect("motion"));
        message.payload[message.payload.len() - 1]
    };
    assert_eq!([quality(4), quality(3), quality(5), quality(0)], [100, 75, 100, 1]);
}

#[test]
fn wrong_options_are_named() {
    let said = |options: MavlinkOptions| match Mavlink::open(&options, &body()) {
        Err(fault) => fault.to_string(),
        Ok(_) => "opened".into(),
    };
    for rate_hz in [0.0, -1.0, f64::NAN, 1e9] {
        assert!(said(MavlinkOptions { rate_hz, ..Default::default() }).contains("`rate_hz`"));
    }
    assert!(said(MavlinkOptions { address: "here".into(), ..Default::default() }).contains("`here`"));
    assert!(
        said(MavlinkOptions { bind: "192.0.2.1:1".into(), ..Default::default() })
            .contains("cannot be opened")
    );
}
