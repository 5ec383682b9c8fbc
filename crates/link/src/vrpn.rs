//! A VRPN 07 server with one tracker, the aircraft, sensor 0.
//!
//! A client says by UDP on which port it listens, and the server connects to it by TCP; or it connects to the
//! same port itself (`tcp:host:port`). Both send the cookie of their version, and what numbers they give to
//! which sender and type. Pings are answered.
//!
//! The world is W, Z up, metres; the body's axes are as the options say; quaternions are x, y, z, w.
//! `Pos_Quat` is sent where a pose was measured, and nothing otherwise, as VRPN has no word for a pose that
//! is none; `Velocity` where the velocity is known, in world axes, its quaternion the turn in world axes over
//! [`TURN_S`]. Stamps are the middle of the exposure.
//!
//! Layout: VRPN 07.38's `vrpn_Connection.C` and `vrpn_Tracker.C`.

pub(crate) mod messages;

use crate::axes::{sound, sound_motion};
use crate::options::address;
use crate::outlet::now_ns;
use crate::peers::{MOST, Peer, knocking};
use crate::udp;
use crate::worker::{Worker, lock};
use crate::{Body, Fix, LinkError, Outlet, VrpnOptions};
use messages::{Ask, Inbox, Kind};
use std::io::{self, Read};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

pub use messages::TURN_S;

const NAME: &str = "vrpn";

/// How long a client may take to accept the connection that it asked for.
const CONNECTING: Duration = Duration::from_millis(500);

/// How long a client may take to send its cookie.
const GREETING: Duration = Duration::from_secs(10);

/// How much is read of a client at a time, in pieces, so that one that talks without end holds nobody up.
const PIECES: usize = 4;

/// Ports below are the system's own; no client listens there.
const LEAST_PORT: u16 = 1024;

/// Serves clients of VRPN.
pub struct Vrpn {
    clients: Arc<Mutex<Vec<Client>>>,
    options: VrpnOptions,
    address: SocketAddr,
    _worker: Worker,
}

struct Client {
    peer: Peer,
    inbox: Inbox,
    since: Instant,
}

impl Vrpn {
    /// Opens the port, UDP and TCP.
    ///
    /// # Errors
    /// The address is wrong, or the port cannot be opened.
    pub fn open(options: &VrpnOptions, body: &Body) -> Result<Self, LinkError> {
        let fault = |source| LinkError::Open { outlet: NAME, address: options.address.clone(), source };
        let listener = TcpListener::bind(address(NAME, &options.address)?).map_err(fault)?;
        listener.set_nonblocking(true).map_err(fault)?;
        let address = listener.local_addr().map_err(fault)?;
        let calls = udp::open(NAME, address)?;
        let clients = Arc::new(Mutex::new(Vec::new()));
        let greeting = messages::descriptions(body.name());
        let door = Door { calls, listener, clients: Arc::clone(&clients), greeting };
        let (options, worker) = (options.clone(), Worker::start(move || door.step()));
        Ok(Self { clients, options, address, _worker: worker })
    }

    /// The port that was opened.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Outlet for Vrpn {
    fn send(&mut self, fix: &Fix) -> Result<(), LinkError> {
        let Some(measured) = sound(fix) else { return Ok(()) };
        let pose = self.options.body_axes.pose(&measured.world_from_body);
        let mut bytes = messages::pos_quat(fix.captured_ns, &pose);
        if let Some(moving) = sound_motion(measured) {
            let world_from_body = measured.world_from_body.rotation;
            let turning_rad_s = world_from_body * moving.rates_rad_s;
            let velocity_m_s = world_from_body * moving.velocity_in_body_m_s;
            bytes.extend(messages::velocity(fix.captured_ns, &velocity_m_s, &turning_rad_s));
        }
        lock(&self.clients).retain_mut(|client| !client.inbox.is_welcome || client.peer.push(&bytes));
        Ok(())
    }
}

/// Lets clients in and listens to them.
struct Door {
    calls: UdpSocket,
    listener: TcpListener,
    clients: Arc<Mutex<Vec<Client>>>,
    greeting: Vec<u8>,
}

impl Door {
    fn step(&self) {
        let mut call = [0; 512];
        if let Some((length, from)) = udp::receive(&self.calls, &mut call) {
            self.call_back(&call[..length], from);
        }
        knocking(&self.listener).for_each(|stream| self.admit(stream));
        lock(&self.clients).retain_mut(|client| client.listen(&self.greeting));
    }

    /// Connects to the machine that called, whatever host it names, so that nobody is sent to a third one.
    fn call_back(&self, call: &[u8], from: SocketAddr) {
        let Some(port) = messages::called_port(call).filter(|port| *port >= LEAST_PORT) else { return };
        let to = SocketAddr::new(from.ip(), port);
        if lock(&self.clients).iter().any(|c| c.peer.address == to) {
            return;
        }
        if let Ok(stream) = TcpStream::connect_timeout(&to, CONNECTING) {
            self.admit(stream);
        }
    }

    fn admit(&self, stream: TcpStream) {
        let mut clients = lock(&self.clients);
        if clients.len() < MOST
            && let Ok(mut peer) = Peer::new(stream)
            && peer.push(&messages::COOKIE)
        {
            clients.push(Client { peer, inbox: Inbox::default(), since: Instant::now() });
        }
    }
}

impl Client {
    /// Reads what has come and answers it. False: it has gone, or speaks something else.
    fn listen(&mut self, greeting: &[u8]) -> bool {
        if !self.inbox.is_welcome && self.since.elapsed() > GREETING {
            return false;
        }
        let mut bytes = [0; 4096];
        for _ in 0..PIECES {
            match self.peer.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(length) => {
                    let asks = self.inbox.take(&bytes[..length]);
                    if !asks.is_some_and(|asks| asks.iter().all(|ask| self.answer(*ask, greeting))) {
                        return false;
                    }
                }
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => break,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        self.peer.flush()
    }

    fn answer(&mut self, ask: Ask, greeting: &[u8]) -> bool {
        match ask {
            Ask::Greeting => self.peer.push(greeting),
            Ask::Pong => self.peer.push(&messages::message(now_ns(), Kind::Pong, &[])),
        }
    }
}

#[cfg(test)]
mod tests;
