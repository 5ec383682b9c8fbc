//! VRPN's messages: a header of 24 bytes (length without padding, seconds, microseconds, sender, type,
//! number), the payload, padding to 8 bytes; big-endian throughout.

use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};

/// Time over which the quaternion of `Velocity` turns.
pub const TURN_S: f64 = 0.01;

const HEADER: usize = 24;
const ALIGN: usize = 8;
const LONGEST: usize = 64_000;

/// The first that either side sends; only what comes before the last point must be the same on both.
pub(super) const COOKIE: [u8; 24] = *b"vrpn: ver. 07.38  0\0\0\0\0\0";
const COOKIE_FAMILY: &[u8] = b"vrpn: ver. 07.";

/// Types that describe senders and types.
const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;

/// The aircraft's number among this side's senders, and its sensor.
const SENDER: i32 = 0;
const SENSOR: i32 = 0;

/// Types of messages, by this side's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    PosQuat = 0,
    Velocity = 1,
    Ping = 2,
    Pong = 3,
}

const KINDS: [(Kind, &str); 4] = [
    (Kind::PosQuat, "vrpn_Tracker Pos_Quat"),
    (Kind::Velocity, "vrpn_Tracker Velocity"),
    (Kind::Ping, "vrpn_Base ping_message"),
    (Kind::Pong, "vrpn_Base pong_message"),
];

fn write(at_ns: i64, sender: i32, kind: i32, payload: &[u8]) -> Vec<u8> {
    let length = (HEADER + payload.len()) as i32;
    let (seconds, rest_ns) = (at_ns.div_euclid(1_000_000_000), at_ns.rem_euclid(1_000_000_000));
    // Seconds are 32 bits on this wire.
    let head = [length, seconds as i32, (rest_ns / 1000) as i32, sender, kind, 0];
    let mut out: Vec<u8> = head.into_iter().flat_map(i32::to_be_bytes).collect();
    out.extend(payload);
    out.resize(out.len().next_multiple_of(ALIGN), 0);
    out
}

pub(super) fn message(at_ns: i64, kind: Kind, payload: &[u8]) -> Vec<u8> {
    write(at_ns, SENDER, kind as i32, payload)
}

/// What numbers this side gives: the aircraft, and the types.
pub(super) fn descriptions(body: &str) -> Vec<u8> {
    let describe = |what: i32, number: i32, name: &str| {
        let length = (name.len() as i32 + 1).to_be_bytes();
        write(0, number, what, &[&length, name.as_bytes(), &[0]].concat())
    };
    let types = KINDS.map(|(kind, name)| describe(TYPE_DESCRIPTION, kind as i32, name));
    [describe(SENDER_DESCRIPTION, SENDER, body), types.concat()].concat()
}

/// A report: two numbers of the sensor, of which the second is there for alignment, then numbers.
fn report(at_ns: i64, kind: Kind, numbers: &[f64]) -> Vec<u8> {
    let mut payload = [SENSOR.to_be_bytes(); 2].concat();
    payload.extend(numbers.iter().flat_map(|n| n.to_be_bytes()));
    message(at_ns, kind, &payload)
}

pub(super) fn pos_quat(at_ns: i64, pose: &Isometry3<f64>) -> Vec<u8> {
    let (t, q) = (pose.translation, pose.rotation);
    report(at_ns, Kind::PosQuat, &[t.x, t.y, t.z, q.i, q.j, q.k, q.w])
}

/// Velocity, the turn over [`TURN_S`] (x, y, z, w), and that time.
pub(super) fn velocity(at_ns: i64, velocity_m_s: &Vector3<f64>, turning_rad_s: &Vector3<f64>) -> Vec<u8> {
    let (v, q) = (velocity_m_s, UnitQuaternion::from_scaled_axis(turning_rad_s * TURN_S));
    report(at_ns, Kind::Velocity, &[v.x, v.y, v.z, q.i, q.j, q.k, q.w, TURN_S])
}

/// The port in a client's call, "host port".
pub(crate) fn called_port(call: &[u8]) -> Option<u16> {
    let text = std::str::from_utf8(call.split(|b| *b == 0).next()?).ok()?;
    let mut words = text.split_whitespace();
    words.next()?;
    let port = words.next()?.parse().ok();
    port.filter(|_| words.next().is_none())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ask {
    /// By its cookie: what numbers this side gives.
    Greeting,
    /// Whether this side is there.
    Pong,
}

/// What a client has sent and has not been read.
#[derive(Default)]
pub(crate) struct Inbox {
    bytes: Vec<u8>,
    /// The client's own number for pings.
    ping: Option<i32>,
    /// Whether its cookie has come.
    pub(super) is_welcome: bool,
}

impl Inbox {
    /// Takes bytes in; what they ask for, or none where no client says such.
    pub(crate) fn take(&mut self, bytes: &[u8]) -> Option<Vec<Ask>> {
        self.bytes.extend_from_slice(bytes);
        let mut asks = Vec::new();
        if !self.is_welcome {
            let so_far = self.bytes.len().min(COOKIE_FAMILY.len());
            if self.bytes[..so_far] != COOKIE_FAMILY[..so_far] {
                return None;
            }
            if self.bytes.len() < COOKIE.len() {
                return Some(asks);
            }
            self.bytes.drain(..COOKIE.len());
            self.is_welcome = true;
            asks.push(Ask::Greeting);
        }
        let mut read = 0;
        while let Some((head, rest)) = self.bytes[read..].split_at_checked(HEADER) {
            let word = |at: usize| i32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
            let (kind, number) = (word(16), word(12));
            let length = usize::try_from(word(0)).ok().filter(|l| (HEADER..=LONGEST).contains(l))?;
            let padded = length.next_multiple_of(ALIGN);
            let Some(payload) = rest.get(..padded - HEADER) else { break };
            if kind == TYPE_DESCRIPTION
                && payload.get(4..).is_some_and(|name| name.starts_with(b"vrpn_Base ping_message\0"))
            {
                self.ping = Some(number);
            }
            if self.ping == Some(kind) {
                asks.push(Ask::Pong);
            }
            read += padded;
        }
        self.bytes.drain(..read);
        Some(asks)
    }
}
