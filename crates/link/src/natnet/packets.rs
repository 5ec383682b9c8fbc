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

/// The protocol's version.
const VERSION: [u8; 4] = [3, 1, 0, 0];
const TICKS_A_SECOND: u64 = 1_000_000_000;
const BODY_NUMBER: i32 = 1;

/// What a client asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Request {
    Connect,
    Model,
    Alive,
    Disconnect,
    UnitsToMillimetres,
    UpAxis,
    Other,
}

/// The request in a packet; none where it is none, or a kind that only servers send. The length that the
/// packet says may be wrong, as that of libmotioncapture is.
pub(super) fn request(packet: &[u8]) -> Option<Request> {
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

/// One instant.
pub(super) struct Frame {
    pub(super) sequence: u64,
    /// The pose in the axes that are sent, and the standard deviation of its position in metres.
    pub(super) pose: Option<(Isometry3<f64>, f64)>,
    pub(super) since_start_s: f64,
    /// Middle of exposure, received, sent.
    pub(super) times_ns: [i64; 3],
}

/// A packet that is written again and again.
#[derive(Default)]
pub(super) struct Packet {
    bytes: Vec<u8>,
}

impl Packet {
    fn begin(&mut self, kind: u16) -> &mut Vec<u8> {
        self.bytes.clear();
        self.bytes.extend(kind.to_le_bytes());
        self.bytes.extend([0; 2]);
        &mut self.bytes
    }

    fn end(&mut self) -> &[u8] {
        let length = u16::try_from(self.bytes.len() - 4).unwrap_or(u16::MAX);
        self.bytes[2..4].copy_from_slice(&length.to_le_bytes());
        &self.bytes
    }

    /// Who serves, and how: name and version, protocol, ticks a second, data port, no multicast.
    pub(super) fn server_info(&mut self, data_port: u16) -> &[u8] {
        let number = |text: &str| text.parse().unwrap_or(0);
        let out = self.begin(SERVER_INFO);
        let mut name = [0; 256];
        name[..8].copy_from_slice(b"mavsight");
        out.extend(name);
        out.extend([
            number(env!("CARGO_PKG_VERSION_MAJOR")),
            number(env!("CARGO_PKG_VERSION_MINOR")),
            number(env!("CARGO_PKG_VERSION_PATCH")),
            0,
        ]);
        out.extend(VERSION);
        out.extend(TICKS_A_SECOND.to_le_bytes());
        out.extend(data_port.to_le_bytes());
        out.extend([0; 5]);
        self.end()
    }

    /// The answer to a question.
    pub(super) fn response(&mut self, payload: &[u8]) -> &[u8] {
        self.begin(RESPONSE).extend(payload);
        self.end()
    }

    /// The answer to what is not understood.
    pub(super) fn unrecognized(&mut self) -> &[u8] {
        self.begin(UNRECOGNIZED);
        self.end()
    }

    /// One instant.
    pub(super) fn frame(&mut self, frame: &Frame) -> &[u8] {
        let out = self.begin(FRAME);
        let mut int = |value: i32| out.extend(value.to_le_bytes());
        int((frame.sequence & 0x7fff_ffff) as i32);
        // Marker sets, other markers.
        int(0);
        int(0);
        int(1);
        int(BODY_NUMBER);
        let (pose, error_m) = match &frame.pose {
            Some((pose, std_m)) => {
                let (t, q) = (pose.translation, pose.rotation);
                ([t.x, t.y, t.z, q.i, q.j, q.k, q.w], *std_m)
            }
            None => ([f64::NAN; 7], 0.0),
        };
        out.extend(pose.iter().chain([&error_m]).flat_map(|v| (*v as f32).to_le_bytes()));
        out.extend(u16::from(frame.pose.is_some()).to_le_bytes());
        // Skeletons, labelled markers, force plates, devices; time code and its fraction.
        out.extend([0; 6 * 4]);
        out.extend(frame.since_start_s.to_le_bytes());
        out.extend(frame.times_ns.iter().flat_map(|t| u64::try_from(*t).unwrap_or(0).to_le_bytes()));
        // Nothing of recording or changed models; end.
        out.extend([0; 2 + 4]);
        self.end()
    }
}

/// The rigid body: its name, number, and markers in the axes that are sent.
pub(super) fn model(body: &Body, axes: BodyAxes) -> Vec<u8> {
    let mut packet = Packet::default();
    let out = packet.begin(MODEL);
    // One data set, a rigid body.
    out.extend(1i32.to_le_bytes());
    out.extend(1i32.to_le_bytes());
    out.extend(body.name().as_bytes());
    out.push(0);
    out.extend(BODY_NUMBER.to_le_bytes());
    // No parent, no offset from it.
    out.extend((-1i32).to_le_bytes());
    out.extend([0; 3 * 4]);
    out.extend(i32::try_from(body.markers.len()).unwrap_or(0).to_le_bytes());
    for marker in &body.markers {
        out.extend(axes.point(marker.in_body_m).iter().flat_map(|v| (*v as f32).to_le_bytes()));
    }
    // Active labels: none.
    out.extend(std::iter::repeat_n(0, 4 * body.markers.len()));
    packet.end();
    packet.bytes
}
