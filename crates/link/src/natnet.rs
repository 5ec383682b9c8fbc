//! NatNet 3.1 by unicast, as OptiTrack's Motive speaks it: one rigid body, numbered 1.
//!
//! A client asks at the command port. Frames go to the data port of every machine from which a client has
//! asked to connect (libmotioncapture, Crazyswarm2), and to the address of every client that keeps its
//! connection alive (NatNet's newer clients, the Python package `natnet`), until it has been silent for ten
//! seconds.
//!
//! The world is W, Z up, metres; the body's axes are as the options say; quaternions are x, y, z, w. Every
//! instant is sent: one without a pose has the tracking-valid bit cleared and NaN in place of the pose, so
//! that a client that overlooks the bit cannot take it for one. The marker error is the standard deviation of
//! the position. Times of exposure, reception and sending are ticks of 1 ns of the UNIX epoch.
//!
//! Layout: the direct depacketization of NatNet 3.1, as libmotioncapture and `natnet` read it.

pub(crate) mod packets;

use crate::axes::sound;
use crate::options::address;
use crate::outlet::now_ns;
use crate::udp;
use crate::worker::{Worker, lock};
use crate::{Body, Fix, LinkError, NatnetOptions, Outlet};
use packets::{Frame, Request};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const NAME: &str = "natnet";

/// A client that keeps its connection alive says so many times a second; after this it has gone.
const SILENCE: Duration = Duration::from_secs(10);

/// Most clients and machines that are served; the oldest makes place.
const MOST: usize = 32;

/// Serves clients of NatNet.
pub struct Natnet {
    socket: Arc<UdpSocket>,
    options: NatnetOptions,
    listeners: Arc<Mutex<Listeners>>,
    began_ns: Option<i64>,
    _worker: Worker,
}

#[derive(Default)]
struct Listeners {
    /// Data ports of machines from which somebody connected.
    machines: Vec<SocketAddr>,
    /// Clients that keep alive, with when they were last heard.
    kept: Vec<(SocketAddr, Instant)>,
}

impl Listeners {
    fn machine(&mut self, data: SocketAddr) {
        if !self.machines.contains(&data) {
            if self.machines.len() >= MOST {
                self.machines.remove(0);
            }
            self.machines.push(data);
        }
    }

    fn alive(&mut self, client: SocketAddr, now: Instant) {
        self.kept.retain(|(_, heard)| now.duration_since(*heard) < SILENCE);
        if let Some((_, heard)) = self.kept.iter_mut().find(|(address, _)| *address == client) {
            *heard = now;
        } else if self.kept.len() < MOST {
            self.kept.push((client, now));
        }
    }
}

impl Natnet {
    /// Opens the command port.
    ///
    /// # Errors
    /// The address or data port is wrong, or the port cannot be opened.
    pub fn open(options: &NatnetOptions, body: &Body) -> Result<Self, LinkError> {
        if options.data_port == 0 {
            return Err(LinkError::Option {
                outlet: NAME,
                option: "data_port",
                value: "0".into(),
                allowed: "from 1 to 65535; clients expect 1511",
            });
        }
        let socket = Arc::new(udp::open(NAME, address(NAME, &options.address)?)?);
        let listeners = Arc::new(Mutex::new(Listeners::default()));
        let mut desk = Desk {
            socket: Arc::clone(&socket),
            data_port: options.data_port,
            listeners: Arc::clone(&listeners),
            model: packets::model(body, options.body_axes),
            inbox: [0; 2048],
        };
        let (options, worker) = (options.clone(), Worker::start(move || desk.step()));
        Ok(Self { socket, options, listeners, began_ns: None, _worker: worker })
    }

    /// The command port that was opened.
    ///
    /// # Errors
    /// The system does not know it.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }
}

impl Outlet for Natnet {
    fn send(&mut self, fix: &Fix) -> Result<(), LinkError> {
        let began_ns = *self.began_ns.get_or_insert(fix.captured_ns);
        let pose = sound(fix).map(|m| {
            let variance_m2 = m.covariance.fixed_view::<3, 3>(0, 0).trace();
            (self.options.body_axes.pose(&m.world_from_body), variance_m2.max(0.0).sqrt())
        });
        let frame = Frame {
            sequence: fix.sequence,
            pose,
            since_start_s: (fix.captured_ns - began_ns) as f64 * 1e-9,
            times_ns: [fix.captured_ns, fix.received_ns, now_ns()],
        };
        let bytes = packets::frame(&frame);
        let listeners = lock(&self.listeners);
        let kept = listeners.kept.iter().filter(|(_, heard)| heard.elapsed() < SILENCE).map(|(to, _)| to);
        let mut fault = None;
        for to in listeners.machines.iter().chain(kept) {
            fault = udp::send(NAME, &self.socket, &bytes, *to).err().or(fault);
        }
        fault.map_or(Ok(()), Err)
    }
}

struct Desk {
    socket: Arc<UdpSocket>,
    data_port: u16,
    listeners: Arc<Mutex<Listeners>>,
    model: Vec<u8>,
    inbox: [u8; 2048],
}

impl Desk {
    fn step(&mut self) {
        if let Some((length, from)) = udp::receive(&self.socket, &mut self.inbox)
            && let Some(request) = packets::request(&self.inbox[..length])
            && let Some(answer) = self.answer(request, from)
        {
            // A client that does not hear asks again.
            let _ = udp::send(NAME, &self.socket, &answer, from);
        }
    }

    fn answer(&self, request: Request, from: SocketAddr) -> Option<Vec<u8>> {
        let mut listeners = lock(&self.listeners);
        Some(match request {
            Request::Connect => {
                listeners.machine(SocketAddr::new(from.ip(), self.data_port));
                packets::server_info(self.data_port)
            }
            Request::Model => self.model.clone(),
            Request::UnitsToMillimetres => packets::response(1000f32.to_le_bytes()),
            Request::UpAxis => packets::response(2i32.to_le_bytes()),
            Request::Other => packets::unrecognized(),
            Request::Alive => {
                listeners.alive(from, Instant::now());
                return None;
            }
            Request::Disconnect => {
                listeners.kept.retain(|(address, _)| *address != from);
                return None;
            }
        })
    }
}

#[cfg(test)]
mod tests;
