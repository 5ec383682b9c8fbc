//! The three messages that are spoken, as their payloads.

use mavlink_core::error::{EncoderError, ParserError};
use mavlink_core::utils::remove_trailing_zeroes;
use mavlink_core::{Dialect, MavlinkVersion};

const LOCAL_FRD: u8 = 20;
const BODY_FRD: u8 = 12;
const VISION: u8 = 2;

const HEARTBEAT: u32 = 0;
const TIMESYNC: u32 = 111;
const ODOMETRY: u32 = 331;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Message {
    id: u32,
    pub(super) payload: Vec<u8>,
}

/// HEARTBEAT of an onboard controller that is active, no autopilot, without a mode; MAVLink 3, as 2 says too.
pub(super) fn heartbeat() -> Message {
    Message { id: HEARTBEAT, payload: vec![0, 0, 0, 0, 18, 8, 0, 4, 3] }
}

/// ODOMETRY in LOCAL_FRD and BODY_FRD by VISION. The numbers are position, attitude (w, x, y, z), velocity,
/// rates, and the upper triangles of the covariances of pose and velocity.
pub(super) fn odometry(
    time_usec: u64,
    numbers: impl IntoIterator<Item = f64>,
    resets: u8,
    quality: i8,
) -> Message {
    let mut payload = time_usec.to_le_bytes().to_vec();
    payload.extend(numbers.into_iter().flat_map(|value| (value as f32).to_le_bytes()));
    payload.extend([LOCAL_FRD, BODY_FRD, resets, VISION, quality.to_le_bytes()[0]]);
    Message { id: ODOMETRY, payload }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Timesync {
    /// tc1: 0 in a request.
    pub(super) responding_ns: i64,
    /// ts1.
    pub(super) asking_ns: i64,
    /// System and component.
    pub(super) target: [u8; 2],
}

impl Timesync {
    pub(crate) fn message(&self) -> Message {
        let mut payload = [self.responding_ns.to_le_bytes(), self.asking_ns.to_le_bytes()].concat();
        payload.extend(self.target);
        Message { id: TIMESYNC, payload }
    }

    /// Reads the payload, of which zeros at its end may be cut off.
    pub(super) fn read(message: &Message) -> Option<Self> {
        let mut payload = message.payload.clone();
        payload.resize(18, 0);
        let (responding, rest) = payload.split_first_chunk()?;
        let (asking, target) = rest.split_first_chunk()?;
        let (responding_ns, asking_ns) = (i64::from_le_bytes(*responding), i64::from_le_bytes(*asking));
        let target = target.try_into().ok()?;
        (message.id == TIMESYNC).then_some(Self { responding_ns, asking_ns, target })
    }
}

pub(super) struct Messages;

impl Dialect for Messages {
    type Message = Message;
    type EncodeError = EncoderError;

    fn message_id(&self, message: &Message) -> u32 {
        message.id
    }

    fn extra_crc(&self, message_id: u32) -> Option<u8> {
        match message_id {
            HEARTBEAT => Some(50),
            TIMESYNC => Some(34),
            ODOMETRY => Some(91),
            _ => None,
        }
    }

    fn decode(&self, _: MavlinkVersion, id: u32, payload: &[u8]) -> Result<Message, ParserError> {
        Ok(Message { id, payload: payload.to_vec() })
    }

    fn encode(
        &self,
        _: MavlinkVersion,
        message: &Message,
        payload: &mut [u8],
    ) -> Result<usize, EncoderError> {
        let (id, maximum, actual) = (message.id, payload.len(), message.payload.len());
        let too_long = EncoderError::InvalidPayloadSize { id, maximum, actual };
        let written = payload.get_mut(..actual).ok_or(too_long)?;
        written.copy_from_slice(&message.payload);
        Ok(remove_trailing_zeroes(written))
    }
}
