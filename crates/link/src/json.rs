//! Events as lines of JSON, one object a line, over TCP and over UDP.
//!
//! The objects are those of [`Event`], with `event` naming their kind: a pose that was not measured is an
//! object with `valid` false and without position. Who connects by TCP gets the scene first, then what
//! happens from then on; one that does not read fast enough is cut off and may connect again. By UDP each
//! event is a datagram, and the scene comes again every five seconds for who listens later.

use crate::options::address;
use crate::peers::{MOST, Peer, knocking};
use crate::udp;
use crate::{Event, JsonOptions, LinkError, Outlet};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::time::{Duration, Instant};

const NAME: &str = "json";

const SCENE_AGAIN: Duration = Duration::from_secs(5);

const LONGEST_DATAGRAM: usize = 65_507;

/// Events as lines.
#[derive(Default)]
pub struct JsonLines {
    server: Option<Server>,
    udp: Option<Datagrams>,
    scene: Vec<u8>,
}

struct Datagrams {
    socket: UdpSocket,
    to: SocketAddr,
    scene_sent: Option<Instant>,
}

struct Server {
    listener: TcpListener,
    peers: Vec<Peer>,
}

/// Takes in who has come, with the scene.
fn accept(listener: &TcpListener, peers: &mut Vec<Peer>, scene: &[u8]) {
    for stream in knocking(listener) {
        if peers.len() < MOST
            && let Ok(mut peer) = Peer::new(stream)
            && (scene.is_empty() || peer.push(scene))
        {
            peers.push(peer);
        }
    }
}

impl JsonLines {
    /// Opens what the options have.
    ///
    /// # Errors
    /// An address is wrong or there is none, or the port cannot be opened.
    pub fn open(options: &JsonOptions) -> Result<Self, LinkError> {
        let mut this = Self::default();
        if options.tcp.is_empty() && options.udp.is_empty() {
            return Err(LinkError::Option {
                outlet: NAME,
                option: "tcp",
                value: "empty, and so is `udp`".into(),
                allowed: "an address, or `udp` must be one",
            });
        }
        if !options.tcp.is_empty() {
            let fault = |source| LinkError::Open { outlet: NAME, address: options.tcp.clone(), source };
            let listener = TcpListener::bind(address(NAME, &options.tcp)?).map_err(fault)?;
            listener.set_nonblocking(true).map_err(fault)?;
            this.server = Some(Server { listener, peers: Vec::new() });
        }
        if !options.udp.is_empty() {
            let to = address(NAME, &options.udp)?;
            let socket = udp::open(NAME, udp::any_port_towards(to))?;
            this.udp = Some(Datagrams { socket, to, scene_sent: None });
        }
        Ok(this)
    }

    /// The TCP port that was opened.
    pub fn address(&self) -> Option<SocketAddr> {
        self.server.as_ref().and_then(|s| s.listener.local_addr().ok())
    }
}

impl Outlet for JsonLines {
    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        let mut line = serde_json::to_vec(event)?;
        line.push(b'\n');
        if let Some(Server { listener, peers }) = &mut self.server {
            accept(listener, peers, &self.scene);
            peers.retain_mut(|peer| peer.push(&line));
        }
        let is_scene = matches!(event, Event::Scene(_));
        if let Some(Datagrams { socket, to, scene_sent }) = &mut self.udp {
            let is_due = scene_sent.is_none_or(|at| at.elapsed() >= SCENE_AGAIN);
            if is_scene || is_due {
                *scene_sent = Some(Instant::now());
            }
            if is_due && !is_scene && !self.scene.is_empty() {
                datagram(socket, *to, &self.scene)?;
            }
            datagram(socket, *to, &line)?;
        }
        if is_scene {
            self.scene = line;
        }
        Ok(())
    }
}

/// A line too long for a datagram is left out: nothing but a scene of hundreds of markers is.
fn datagram(socket: &UdpSocket, to: SocketAddr, line: &[u8]) -> Result<(), LinkError> {
    if line.len() > LONGEST_DATAGRAM {
        return Ok(());
    }
    udp::send(NAME, socket, line, to)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PoseEvent, Scene, Tracking};
    use serde_json::Value;
    use std::io::{BufRead, BufReader};
    use std::net::TcpStream;

    fn scene() -> Event {
        Event::Scene(Scene {
            name: "room".into(),
            cameras: Vec::new(),
            markers: Vec::new(),
            volume_m: [[0.0; 3], [4.0; 3]],
        })
    }

    fn pose(sequence: u64, valid: bool) -> Event {
        let some = |v| valid.then_some(v);
        Event::Pose(Box::new(PoseEvent {
            t_s: sequence as f64 * 0.01,
            sequence,
            captured_ns: 1_700_000_000_123_456_789,
            valid,
            tracking: if valid { Tracking::Tracking } else { Tracking::Lost },
            position_m: some([1.0, 2.0, 3.0]),
            attitude: valid.then_some([1.0, 0.0, 0.0, 0.0]),
            euler_rad: None,
            covariance: None,
            velocity_in_body_m_s: None,
            velocity_std_m_s: None,
            rates_rad_s: None,
            rates_std_rad_s: None,
            residual_px: None,
            latency_ms: 0.5,
            reason: None,
        }))
    }

    fn read(from: &mut impl BufRead) -> Value {
        let mut line = String::new();
        from.read_line(&mut line).expect("a line");
        serde_json::from_str(&line).expect("JSON")
    }

    fn connect(outlet: &JsonLines) -> BufReader<TcpStream> {
        let stream = TcpStream::connect(outlet.address().expect("a port")).expect("connected");
        stream.set_read_timeout(Some(Duration::from_secs(5))).expect("a timeout");
        BufReader::new(stream)
    }

    #[test]
    fn who_comes_late_gets_the_scene_and_what_is_new() {
        let options = JsonOptions { tcp: "127.0.0.1:0".into(), ..Default::default() };
        let mut outlet = JsonLines::open(&options).expect("an outlet");
        let mut early = connect(&outlet);
        for event in [scene(), pose(0, true)] {
            outlet.event(&event).expect("sent");
        }
        let mut late = connect(&outlet);
        std::thread::sleep(Duration::from_millis(50));
        outlet.event(&pose(1, false)).expect("sent");
        assert_eq!(read(&mut early)["event"], "scene");
        let first = read(&mut early);
        assert_eq!((&first["event"], &first["sequence"]), (&"pose".into(), &0.into()));
        assert_eq!(first["captured_ns"], 1_700_000_000_123_456_789_i64);
        assert_eq!(first["position_m"], serde_json::json!([1.0, 2.0, 3.0]));
        assert_eq!(read(&mut late)["volume_m"][1][0], 4.0);
        for reader in [&mut early, &mut late] {
            let lost = read(reader);
            assert_eq!((&lost["valid"], &lost["position_m"]), (&false.into(), &Value::Null));
            assert_eq!((&lost["tracking"], &lost["sequence"]), (&"lost".into(), &1.into()));
        }
        drop(early);
        for k in 2..50 {
            outlet.event(&pose(k, true)).expect("sent");
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(outlet.server.as_ref().expect("a server").peers.len(), 1, "who has left is forgotten");
        assert_eq!(read(&mut late)["sequence"], 2);
    }

    #[test]
    fn datagrams_are_whole_lines() {
        let far = UdpSocket::bind("127.0.0.1:0").expect("a port");
        far.set_read_timeout(Some(Duration::from_secs(5))).expect("a timeout");
        let udp = far.local_addr().expect("its address").to_string();
        let mut outlet = JsonLines::open(&JsonOptions { tcp: String::new(), udp }).expect("an outlet");
        for event in [scene(), pose(0, true), pose(1, false)] {
            outlet.event(&event).expect("sent");
        }
        let mut inbox = [0; 4096];
        for want in ["scene", "pose", "pose"] {
            let length = far.recv(&mut inbox).expect("a datagram");
            let value: Value = serde_json::from_slice(&inbox[..length]).expect("JSON");
            assert_eq!(value["event"], want);
        }
        drop(far);
        for k in 2..20 {
            outlet.event(&pose(k, true)).expect("nobody listens, and that is no fault");
        }
    }

    #[test]
    fn no_address_is_refused() {
        let said = JsonLines::open(&JsonOptions { tcp: String::new(), udp: String::new() }).err();
        assert!(said.is_some_and(|e| e.to_string().contains("`tcp` is empty")));
    }
}
