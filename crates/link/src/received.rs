//! What each protocol makes of bytes that arrive, for attacks on it.

use crate::mavlink;
use crate::natnet::packets;
use crate::vrpn::messages::{Inbox, called_port};

/// Whether NatNet's command port takes a packet for a request.
pub fn natnet(packet: &[u8]) -> bool {
    packets::request(packet).is_some()
}

/// Whether VRPN's port takes a packet for a call, or its stream takes the bytes for a client's, in pieces of some
/// length.
pub fn vrpn(bytes: &[u8], piece: usize) -> bool {
    let mut inbox = Inbox::default();
    let is_stream = bytes.chunks(piece.max(1)).all(|piece| inbox.take(piece).is_some());
    called_port(bytes).is_some() || is_stream
}

/// Number of MAVLink's requests for the time in a packet.
pub fn mavlink(packet: &[u8]) -> usize {
    mavlink::requests(packet).iter().map(mavlink::messages::Timesync::message).count()
}
