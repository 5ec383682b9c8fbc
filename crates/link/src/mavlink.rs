//! MAVLink 2 over UDP: ODOMETRY (331) to an autopilot, with a heartbeat a second, and answers to TIMESYNC
//! (111).
//!
//! Position and attitude are in the level frame N, which is LOCAL_FRD with its x along the world's X;
//! velocity and rates are in body axes, BODY_FRD; the estimator is named VISION. PX4 and ArduPilot take no
//! other frames rightly, and PX4's EKF2 no other estimator (MOCAP goes to a topic that it does not read).
//! Covariances are those of position in level axes with roll, pitch and yaw, and of velocity with body rates.
//! `quality` is the percentage of the body's markers that entered the pose.
//!
//! Not sent: an instant without a pose, and one whose velocity is not known yet, as ArduPilot uses the
//! velocity without looking whether it is a number. Stamps are the middle of the exposure in microseconds of
//! the UNIX epoch; an autopilot that asks by TIMESYNC learns how that clock stands to its own, and otherwise
//! takes the time of arrival for that of the exposure.
//!
//! Layouts: MAVLink's `common.xml` and `minimal.xml`; checksums and framing by `mavlink-core`, as the
//! generated dialects take half a minute to compile for three messages.

pub(crate) mod messages;
mod pace;

use crate::axes::{level_pose, sound, sound_motion, upper_triangle};
use crate::options::address;
use crate::outlet::now_ns;
use crate::udp;
use crate::worker::Worker;
use crate::{Body, Fix, LinkError, MavlinkOptions, Measured, Moving, Outlet};
use mavlink_core::{MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion};
use messages::{Message, Messages, Timesync};
use pace::Pace;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

const NAME: &str = "mavlink";

/// MAVLink asks for a heartbeat at 1 Hz.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// Rates that a companion computer may send at.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// Sends poses to an autopilot.
pub struct Mavlink {
    radio: Radio,
    peer: SocketAddr,
    pace: Pace,
    markers: usize,
    /// Keeps the heart beating and the clocks in step.
    _worker: Worker,
}

impl Mavlink {
    /// Opens the port and starts the heartbeat.
    ///
    /// # Errors
    /// An address or the rate is wrong, or the port cannot be opened.
    pub fn open(options: &MavlinkOptions, body: &Body) -> Result<Self, LinkError> {
        if !RATES_HZ.contains(&options.rate_hz) {
            return Err(LinkError::Option {
                outlet: NAME,
                option: "rate_hz",
                value: options.rate_hz.to_string(),
                allowed: "from 1 to 1000; PX4 wants 30 to 50",
            });
        }
        let peer = address(NAME, &options.address)?;
        let from = match &options.bind[..] {
            "" => udp::any_port_towards(peer),
            text => address(NAME, text)?,
        };
        let radio = Radio {
            socket: Arc::new(udp::open(NAME, from)?),
            header: MavHeader {
                system_id: options.system_id.into(),
                component_id: options.component_id,
                sequence: 0,
            },
            sequence: Arc::new(AtomicU8::new(0)),
        };
        let mut keeper = Keeper { radio: radio.clone(), peer, beaten: None, inbox: [0; 2048] };
        Ok(Self {
            radio,
            peer,
            pace: Pace::new(options.rate_hz),
            markers: body.markers.len(),
            _worker: Worker::start(move || keeper.step()),
        })
    }

    fn odometry(&self, fix: &Fix, measured: &Measured, moving: &Moving) -> Message {
        let level = level_pose(measured);
        let (place, turn) = (level.level_from_body.translation, level.level_from_body.rotation);
        let (velocity, rates) = (moving.velocity_in_body_m_s, moving.rates_rad_s);
        let share = 100 * measured.markers / self.markers.max(measured.markers).max(1);
        let numbers = [place.x, place.y, place.z, turn.w, turn.i, turn.j, turn.k]
            .into_iter()
            .chain(velocity.iter().chain(&rates).copied())
            .chain(upper_triangle(&level.covariance))
            .chain(upper_triangle(&moving.covariance));
        let time_usec = u64::try_from(fix.captured_ns / 1000).unwrap_or(0);
        messages::odometry(time_usec, numbers, fix.resets, i8::try_from(share.max(1)).unwrap_or(100))
    }
}

impl Outlet for Mavlink {
    fn send(&mut self, fix: &Fix) -> Result<(), LinkError> {
        let Some((measured, moving)) = sound(fix).and_then(|m| Some((m, sound_motion(m)?))) else {
            return Ok(());
        };
        if !self.pace.due(fix.captured_ns) {
            return Ok(());
        }
        self.radio.send(&self.odometry(fix, measured, moving), self.peer)
    }
}

#[derive(Clone)]
struct Radio {
    socket: Arc<UdpSocket>,
    header: MavHeader,
    sequence: Arc<AtomicU8>,
}

impl Radio {
    fn send(&self, message: &Message, to: SocketAddr) -> Result<(), LinkError> {
        let sequence = self.sequence.fetch_add(1, Ordering::Relaxed);
        let mut frame = MAVLinkV2MessageRaw::new();
        let header = MavHeader { sequence, ..self.header };
        frame.serialize_message_with_dialect(header, &Messages, message).map_err(|e| LinkError::Send {
            outlet: NAME,
            address: to.to_string(),
            source: io::Error::other(e),
        })?;
        udp::send(NAME, &self.socket, frame.raw_bytes(), to)
    }
}

/// The heartbeat, and the answers to TIMESYNC.
struct Keeper {
    radio: Radio,
    peer: SocketAddr,
    beaten: Option<Instant>,
    inbox: [u8; 2048],
}

impl Keeper {
    fn step(&mut self) {
        if self.beaten.is_none_or(|at| at.elapsed() >= HEARTBEAT) {
            self.beaten = Some(Instant::now());
            // A network that is down is reported with the next pose.
            let _ = self.radio.send(&messages::heartbeat(), self.peer);
        }
        if let Some((length, from)) = udp::receive(&self.radio.socket, &mut self.inbox) {
            self.answer(length, from);
        }
    }

    fn answer(&self, length: usize, from: SocketAddr) {
        for request in requests(&self.inbox[..length]) {
            let answer = Timesync { responding_ns: now_ns(), ..request };
            let _ = self.radio.send(&answer.message(), from);
        }
    }
}

/// Requests for the time in a packet, each with who asks as the target.
pub(crate) fn requests(packet: &[u8]) -> Vec<Timesync> {
    let (mut reader, mut all) = (MavlinkReader::new(packet), Vec::new());
    while let Ok((header, message)) = reader.read_message_with_dialect(&Messages, MavlinkVersion::V2) {
        let target = [u8::try_from(header.system_id).unwrap_or(0), header.component_id];
        let request = Timesync::read(&message).filter(|r| r.responding_ns == 0);
        all.extend(request.map(|request| Timesync { target, ..request }));
    }
    all
}

#[cfg(test)]
mod tests;
