//! NatNet's packets: two bytes of kind, two of the payload's length, the payload; little-endian throughout.

use crate::{Body, BodyAxes};
use mavsight_geometry::Isometry3;

const CONNECT: u16 = 0;
const SERVER_INFO: u16 = 1;
const REQUEST: u16 = 2;
const RESPONSE: u16 = 3;
const REQUEST_MODEL: u16 = 4;
const MODEL: u16 = 5;
const REQUEST_FRAME: u16 = 6;
const FRAME: u16 = 7;
const DISCONNECT: u16 = 9;
const KEEP_ALIVE: u16 = 10;
const UNRECOGNIZED: u16 = 100;

const VERSION: [u8; 4] = [3, 1, 0, 0];
const TICKS_A_SECOND: u64 = 1_000_000_000;
const BODY_NUMBER: i32 = 1;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Request {
    Connect,
    Model,
    Alive,
    Disconnect,
    UnitsToMillimetres,
    UpAxis,
    Other,
}

/// The request in a packet, if it is a client's. The length that it says may be wrong (libmotioncapture).
pub(crate) fn request(packet: &[u8]) -> Option<Request> {
    let (head, rest) = packet.split_at_checked(4)?;
    match u16::from_le_bytes([head[0], head[1]]) {
        CONNECT => Some(Request::Connect),
        REQUEST_MODEL => Some(Request::Model),
        KEEP_ALIVE => Some(Request::Alive),
        DISCONNECT => Some(Request::Disconnect),
        REQUEST => {
            let text = rest.split(|b| *b == 0).next().unwrap_or_default();
            Some(match text {
                b"UnitsToMillimeters" => Request::UnitsToMillimetres,
                b"UpAxis" => Request::UpAxis,
                _ => Request::Other,
            })
        }
        REQUEST_FRAME => Some(Request::Other),
        _ => None,
    }
}

pub(super) struct Frame {
    pub(super) sequence: u64,
    /// The pose in the axes that are sent, and the standard deviation of its position in metres.
    pub(super) pose: Option<(Isometry3<f64>, f64)>,
    pub(super) since_start_s: f64,
    /// Middle of exposure, received, sent.
    pub(super) times_ns: [i64; 3],
}

fn packet(kind: u16, payload: &[u8]) -> Vec<u8> {
    let length = u16::try_from(payload.len()).unwrap_or(u16::MAX);
    [&kind.to_le_bytes(), &length.to_le_bytes(), payload].concat()
}

fn floats<'a>(values: impl IntoIterator<Item = &'a f64>) -> impl Iterator<Item = u8> {
    values.into_iter().flat_map(|v| (*v as f32).to_le_bytes())
}

/// Who serves, and how: name and version, protocol, ticks a second, data port, no multicast.
pub(super) fn server_info(data_port: u16) -> Vec<u8> {
    let version = env!("CARGO_PKG_VERSION").split('.').map(|part| part.parse().unwrap_or(0));
    let mut payload = b"mavsight".to_vec();
    payload.resize(256, 0);
    payload.extend(version.chain([0]).take(4));
    payload.extend(VERSION);
    payload.extend(TICKS_A_SECOND.to_le_bytes());
    payload.extend(data_port.to_le_bytes());
    payload.extend([0; 5]);
    packet(SERVER_INFO, &payload)
}

pub(super) fn response(payload: [u8; 4]) -> Vec<u8> {
    packet(RESPONSE, &payload)
}

pub(super) fn unrecognized() -> Vec<u8> {
    packet(UNRECOGNIZED, &[])
}

pub(super) fn frame(frame: &Frame) -> Vec<u8> {
    // Number, no marker sets and other markers, one body.
    let head = [(frame.sequence & 0x7fff_ffff) as i32, 0, 0, 1, BODY_NUMBER];
    let mut payload: Vec<u8> = head.into_iter().flat_map(i32::to_le_bytes).collect();
    let (pose, error_m) = frame.pose.map_or(([f64::NAN; 7], 0.0), |(pose, std_m)| {
        let (t, q) = (pose.translation, pose.rotation);
        ([t.x, t.y, t.z, q.i, q.j, q.k, q.w], std_m)
    });
    payload.extend(floats(pose.iter().chain([&error_m])));
    payload.extend(u16::from(frame.pose.is_some()).to_le_bytes());
    // Skeletons, labelled markers, force plates, devices; time code and its fraction.
    payload.extend([0; 6 * 4]);
    payload.extend(frame.since_start_s.to_le_bytes());
    payload.extend(frame.times_ns.iter().flat_map(|t| u64::try_from(*t).unwrap_or(0).to_le_bytes()));
    // Nothing of recording or changed models; end.
    payload.extend([0; 2 + 4]);
    packet(FRAME, &payload)
}

/// The rigid body: its name, number, and markers in the axes that are sent.
pub(super) fn model(body: &Body, axes: BodyAxes) -> Vec<u8> {
    let markers = i32::try_from(body.markers.len()).unwrap_or(0);
    // One data set, a rigid body.
    let mut payload = [1i32.to_le_bytes(); 2].concat();
    payload.extend(body.name().as_bytes());
    payload.push(0);
    // No parent, no offset from it.
    payload.extend([BODY_NUMBER, -1, 0, 0, 0, markers].into_iter().flat_map(i32::to_le_bytes));
    for marker in &body.markers {
        payload.extend(floats(&axes.point(marker.in_body_m)));
    }
    // Active labels: none.
    payload.resize(payload.len() + 4 * body.markers.len(), 0);
    packet(MODEL, &payload)
}
