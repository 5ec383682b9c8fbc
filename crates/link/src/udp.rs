//! Datagrams that nobody waits for.

use crate::LinkError;
use crate::worker::PATIENCE;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// Longest that a full buffer of the system holds a sender up.
const SENDING: Duration = Duration::from_millis(1);

pub(crate) fn open(outlet: &'static str, from: SocketAddr) -> Result<UdpSocket, LinkError> {
    let fault = |source| LinkError::Open { outlet, address: from.to_string(), source };
    let socket = UdpSocket::bind(from).map_err(fault)?;
    socket.set_read_timeout(Some(PATIENCE)).map_err(fault)?;
    socket.set_write_timeout(Some(SENDING)).map_err(fault)?;
    Ok(socket)
}

/// Any port, on the loopback interface where the peer is on this machine.
pub(crate) fn any_port_towards(to: SocketAddr) -> SocketAddr {
    match to.ip() {
        ip if ip.is_loopback() => (ip, 0).into(),
        IpAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        IpAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    }
}

/// Whether nothing has come or gone this time, or nobody listens at the far end: neither is a fault.
pub(crate) fn is_no_fault(kind: io::ErrorKind) -> bool {
    use io::ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, TimedOut, WouldBlock};
    matches!(kind, WouldBlock | TimedOut | Interrupted | ConnectionRefused | ConnectionReset)
}

pub(crate) fn send(
    outlet: &'static str,
    socket: &UdpSocket,
    bytes: &[u8],
    to: SocketAddr,
) -> Result<(), LinkError> {
    match socket.send_to(bytes, to) {
        Err(source) if !is_no_fault(source.kind()) => {
            Err(LinkError::Send { outlet, address: to.to_string(), source })
        }
        _ => Ok(()),
    }
}

/// Receives a datagram, waiting no longer than [`PATIENCE`].
pub(crate) fn receive(socket: &UdpSocket, inbox: &mut [u8]) -> Option<(usize, SocketAddr)> {
    match socket.recv_from(inbox) {
        Ok(received) => Some(received),
        Err(e) => {
            if !is_no_fault(e.kind()) {
                // A network that is down fails at once, and again.
                std::thread::sleep(PATIENCE);
            }
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_to_the_machine_itself_opens_no_door_to_others() {
        for (to, want) in [
            ("127.0.0.1:9", "127.0.0.1:0"),
            ("[::1]:9", "[::1]:0"),
            ("192.0.2.1:9", "0.0.0.0:0"),
            ("[2001:db8::1]:9", "[::]:0"),
        ] {
            assert_eq!(any_port_towards(to.parse().expect("an address")), want.parse().expect("an address"));
        }
    }

    #[test]
    fn a_peer_that_is_not_there_is_no_fault_and_an_address_that_cannot_be_is() {
        let socket = open("test", ([127, 0, 0, 1], 0).into()).expect("a port");
        let nobody = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a port");
        for _ in 0..10 {
            send("test", &socket, b"x", nobody).expect("nobody listens");
        }
        let said = send("test", &socket, b"x", ([192, 0, 2, 1], 9).into())
            .expect_err("not from loopback")
            .to_string();
        assert!(said.starts_with("test: 192.0.2.1:9 cannot be reached"), "{said}");
    }
}
