//! What arrives from a network: NatNet, VRPN, MAVLink, and HTTP with WebSocket and commands of the page.

use crate::Outcome;
use mavsight_link::received;
use mavsight_page::{Limits, Reach, Server};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpStream};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

fn taken(is_taken: bool) -> Outcome {
    if is_taken { Outcome::Read } else { Outcome::Refused("passed over".to_owned()) }
}

pub(super) fn natnet_packets() -> Vec<Vec<u8>> {
    let packet = |kind: u16, payload: &[u8]| {
        [&kind.to_le_bytes()[..], &(payload.len() as u16).to_le_bytes(), payload].concat()
    };
    let texts = [&b"UnitsToMillimeters\0"[..], b"UpAxis\0"].map(|text| packet(2, text));
    [0, 4, 6, 9, 10].map(|kind| packet(kind, &[0; 8])).into_iter().chain(texts).collect()
}

pub(super) fn natnet(bytes: &[u8]) -> Outcome {
    taken(received::natnet(bytes))
}

fn vrpn_message(sender: i32, kind: i32, payload: &[u8]) -> Vec<u8> {
    let length = 24 + payload.len() as i32;
    let mut bytes: Vec<u8> = [length, 0, 0, sender, kind, 0].into_iter().flat_map(i32::to_be_bytes).collect();
    bytes.extend(payload);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

pub(super) fn vrpn_packets() -> Vec<Vec<u8>> {
    let name = [&23_i32.to_be_bytes()[..], b"vrpn_Base ping_message\0"].concat();
    let stream =
        [&b"vrpn: ver. 07.38  0\0\0\0\0\0"[..], &vrpn_message(5, -2, &name), &vrpn_message(0, 5, &[])];
    vec![b"127.0.0.1 3883\0".to_vec(), stream.concat()]
}

pub(super) fn vrpn(bytes: &[u8]) -> Outcome {
    // In pieces of a length that the input itself gives.
    taken(received::vrpn(bytes, 1 + bytes.len() % 64))
}

/// The checksum of MAVLink: CRC-16/MCRF4XX over all but the first byte, and one byte of the message's kind.
fn mavlink_checksum(bytes: &[u8], extra: u8) -> [u8; 2] {
    let crc = bytes.iter().chain([&extra]).fold(0xffff_u16, |crc, byte| {
        let mut t = byte ^ (crc as u8);
        t ^= t << 4;
        (crc >> 8) ^ (u16::from(t) << 8) ^ (u16::from(t) << 3) ^ (u16::from(t) >> 4)
    });
    crc.to_le_bytes()
}

pub(super) fn mavlink_packets() -> Vec<Vec<u8>> {
    let frame = |kind: u8, extra: u8, payload: &[u8]| {
        let mut bytes = vec![0xfd, payload.len() as u8, 0, 0, 7, 1, 1, kind, 0, 0];
        bytes.extend(payload);
        let checksum = mavlink_checksum(&bytes[1..], extra);
        bytes.extend(checksum);
        bytes
    };
    let timesync = frame(111, 34, &[0, 0, 0, 0, 0, 0, 0, 0, 9, 8, 7]);
    vec![timesync.clone(), [frame(0, 50, &[0, 0, 0, 0, 18, 8, 0, 4, 3]), timesync].concat()]
}

/// Sets the checksum of the first frame right.
pub(super) fn repair_mavlink(mut bytes: Vec<u8>) -> Vec<u8> {
    let Some([0xfd, length, ..]) = bytes.get(..10) else { return bytes };
    let end = 10 + usize::from(*length);
    let extra = if bytes[7] == 111 { 34 } else { 50 };
    if let Some(content) = bytes.get(1..end) {
        let checksum = mavlink_checksum(content, extra);
        bytes.resize(bytes.len().max(end + 2), 0);
        bytes[end..end + 2].copy_from_slice(&checksum);
    }
    bytes
}

pub(super) fn mavlink(bytes: &[u8]) -> Outcome {
    taken(received::mavlink(bytes) > 0)
}

/// A text frame of a WebSocket's client (RFC 6455, section 5.2), its mask being zero.
fn frame(text: &str) -> Vec<u8> {
    [&[0x81, 0x80 | text.len() as u8, 0, 0, 0, 0], text.as_bytes()].concat()
}

pub(super) fn page_requests() -> Vec<Vec<u8>> {
    let upgrade = "GET /events HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nConnection: Upgrade\r\n\
        Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
    let commands =
        ["{\"command\":\"start_recording\"}", "{\"command\":\"calibrate\",\"x\":[1,2]}"].map(frame);
    vec![
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:8080\r\n\r\n".to_vec(),
        b"HEAD /page.js HTTP/1.1\r\nHost: [::1]:80\r\nContent-Length: 0\r\n\r\n".to_vec(),
        [upgrade.as_bytes(), &commands.concat(), &[0x88, 0x82, 0, 0, 0, 0, 3, 0xe8]].concat(),
    ]
}

/// Panics on the server's thread, which nobody else sees.
static PANICS: AtomicU64 = AtomicU64::new(0);

static SERVER: LazyLock<Server> = LazyLock::new(|| {
    let others = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if std::thread::current().name() == Some("page") {
            PANICS.fetch_add(1, Ordering::SeqCst);
        }
        others(panic);
    }));
    let limits = Limits { request_time: Duration::from_millis(800), ..Limits::default() };
    Server::start(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), Reach::Loopback, limits).unwrap()
});

/// Sends bytes to the page's server and reads until it closes.
pub(super) fn page(bytes: &[u8]) -> Outcome {
    let before = PANICS.load(Ordering::SeqCst);
    let mut stream = TcpStream::connect(SERVER.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    // The server may close before all is written, and what it said before may be lost then.
    let _ = stream.write_all(bytes).and_then(|()| stream.shutdown(Shutdown::Write));
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    assert_eq!(PANICS.load(Ordering::SeqCst), before, "the server panicked");
    while SERVER.next_command(Duration::ZERO).is_some() {}
    taken(answer.starts_with(b"HTTP/1.1 200") || answer.starts_with(b"HTTP/1.1 101"))
}
