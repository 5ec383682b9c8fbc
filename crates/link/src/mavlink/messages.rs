//! The three messages that are spoken.

use mavlink_core::error::{EncoderError, ParserError};
use mavlink_core::utils::remove_trailing_zeroes;
use mavlink_core::{Dialect, MavlinkVersion};

/// MAV_FRAME_LOCAL_FRD.
const LOCAL_FRD: u8 = 20;
/// MAV_FRAME_BODY_FRD.
const BODY_FRD: u8 = 12;
/// MAV_ESTIMATOR_TYPE_VISION.
const VISION: u8 = 2;
/// MAV_TYPE_ONBOARD_CONTROLLER, MAV_AUTOPILOT_INVALID, no mode, MAV_STATE_ACTIVE, MAVLink 3 (as 1 and 2 both
/// say).
const HEART: [u8; 5] = [18, 8, 0, 4, 3];

const HEARTBEAT: u32 = 0;
const TIMESYNC: u32 = 111;
const ODOMETRY: u32 = 331;

/// A message.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "nearly every message is the large one, and none is kept")]
pub(super) enum Message {
    Heartbeat,
    Timesync(Timesync),
    Odometry(Odometry),
}

/// TIMESYNC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Timesync {
    /// tc1: 0 in a request.
    pub(super) responding_ns: i64,
    /// ts1.
    pub(super) asking_ns: i64,
    /// System and component.
    pub(super) target: [u8; 2],
}

/// ODOMETRY, always LOCAL_FRD and BODY_FRD by VISION.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Odometry {
    pub(super) time_usec: u64,
    pub(super) position_m: [f32; 3],
    /// w, x, y, z.
    pub(super) attitude: [f32; 4],
    pub(super) velocity_m_s: [f32; 3],
    pub(super) rates_rad_s: [f32; 3],
    pub(super) pose_covariance: [f32; 21],
    pub(super) velocity_covariance: [f32; 21],
    pub(super) resets: u8,
    pub(super) quality: i8,
}

/// The dialect of these messages.
pub(super) struct Messages;

impl Odometry {
    fn write(&self, to: &mut Vec<u8>) {
        to.extend(self.time_usec.to_le_bytes());
        let parts: [&[f32]; 6] = [
            &self.position_m,
            &self.attitude,
            &self.velocity_m_s,
            &self.rates_rad_s,
            &self.pose_covariance,
            &self.velocity_covariance,
        ];
        to.extend(parts.concat().iter().flat_map(|value| value.to_le_bytes()));
        to.extend([LOCAL_FRD, BODY_FRD, self.resets, VISION]);
        to.extend(self.quality.to_le_bytes());
    }
}

impl Dialect for Messages {
    type Message = Message;
    type EncodeError = EncoderError;

    fn message_id(&self, message: &Message) -> u32 {
        match message {
            Message::Heartbeat => HEARTBEAT,
            Message::Timesync(_) => TIMESYNC,
            Message::Odometry(_) => ODOMETRY,
        }
    }

    fn extra_crc(&self, message_id: u32) -> Option<u8> {
        match message_id {
            HEARTBEAT => Some(50),
            TIMESYNC => Some(34),
            ODOMETRY => Some(91),
            _ => None,
        }
    }

    /// Heartbeat and TIMESYNC alone; a payload whose last zeros were cut off is filled up with them.
    fn decode(&self, _: MavlinkVersion, message_id: u32, payload: &[u8]) -> Result<Message, ParserError> {
        match message_id {
            HEARTBEAT => Ok(Message::Heartbeat),
            TIMESYNC => {
                let mut whole = [0; 18];
                whole.iter_mut().zip(payload).for_each(|(to, from)| *to = *from);
                let number = |at: usize| {
                    let mut eight = [0; 8];
                    eight.copy_from_slice(&whole[at..at + 8]);
                    i64::from_le_bytes(eight)
                };
                let target = [whole[16], whole[17]];
                Ok(Message::Timesync(Timesync { responding_ns: number(0), asking_ns: number(8), target }))
            }
            id => Err(ParserError::UnknownMessage { id }),
        }
    }

    fn encode(
        &self,
        _: MavlinkVersion,
        message: &Message,
        payload: &mut [u8],
    ) -> Result<usize, EncoderError> {
        let mut bytes = Vec::with_capacity(payload.len());
        match message {
            Message::Heartbeat => bytes.extend([&[0; 4], &HEART[..]].concat()),
            Message::Timesync(t) => {
                bytes.extend(t.responding_ns.to_le_bytes());
                bytes.extend(t.asking_ns.to_le_bytes());
                bytes.extend(t.target);
            }
            Message::Odometry(o) => o.write(&mut bytes),
        }
        let (maximum, actual) = (payload.len(), bytes.len());
        let Some(written) = payload.get_mut(..actual) else {
            return Err(EncoderError::InvalidPayloadSize { id: self.message_id(message), maximum, actual });
        };
        written.copy_from_slice(&bytes);
        Ok(remove_trailing_zeroes(written))
    }
}
