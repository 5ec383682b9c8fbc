//! The server as its producer sees it.

use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use mavsight_link::Event;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, watch};

use crate::connection::{House, serve};
use crate::http::{refusal, refuse};
use crate::hub::{Hub, lock};
use crate::listener::end;
use crate::{Command, PageError, access};

/// Requests of a user that wait to be carried out; a person presses no more keys than that before something happens.
const COMMANDS_WAITING: usize = 16;
/// What the system may hold back for a page that does not read: one picture and some poses, so that a slow page shows what is new.
const SEND_BUFFER_BYTES: u32 = 64 * 1024;

/// Who may reach the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reach {
    /// Programs on this machine.
    #[default]
    Loopback,
    /// Every machine that can reach the address, and knows the token that [`Server::url`] ends in. What passes is not encrypted.
    Network,
}

/// How much the server puts up with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Connections at one time; more are turned away.
    pub connections: usize,
    /// Open pages at one time; more are turned away.
    pub listeners: usize,
    /// Time for a whole request to come in, and for its answer to go out.
    pub request_time: Duration,
    /// An open page hears that the server is there this often, however little happens.
    pub beat: Duration,
    /// An open page that takes or answers nothing for so long is left.
    pub silence: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 64,
            listeners: 16,
            request_time: Duration::from_secs(5),
            beat: Duration::from_millis(500),
            silence: Duration::from_secs(10),
        }
    }
}

/// The page's server, on a thread of its own until it is dropped.
///
/// All methods may be called from any thread; none waits for a browser.
#[derive(Debug)]
pub struct Server {
    hub: Arc<Hub>,
    address: SocketAddr,
    token: Option<String>,
    commands: Mutex<Receiver<Command>>,
    end: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves the page on an address; port 0 takes any that is free.
    ///
    /// # Errors
    /// [`PageError::NotLoopback`] where others could reach the address and `reach` does not say that they may,
    /// [`PageError::Listen`] where it cannot be had, [`PageError::Token`] or [`PageError::Start`] where the system gives no
    /// random numbers or no thread.
    pub fn start(address: SocketAddr, reach: Reach) -> Result<Self, PageError> {
        Self::start_with(address, reach, Limits::default())
    }

    /// The same with limits other than the usual ones.
    ///
    /// # Errors
    /// As [`Server::start`].
    pub fn start_with(address: SocketAddr, reach: Reach, limits: Limits) -> Result<Self, PageError> {
        let is_open = !address.ip().to_canonical().is_loopback();
        if is_open && reach == Reach::Loopback {
            return Err(PageError::NotLoopback(address));
        }
        let token = if is_open { Some(access::token().map_err(PageError::Token)?) } else { None };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .build()
            .map_err(PageError::Start)?;
        let listener = listen(&runtime, address).map_err(|source| PageError::Listen { address, source })?;
        let address = listener.local_addr().map_err(|source| PageError::Listen { address, source })?;
        let (sender, commands) = sync_channel(COMMANDS_WAITING);
        let (end, ended) = watch::channel(false);
        let hub = Arc::new(Hub::new(sender));
        let house = Arc::new(House { hub: Arc::clone(&hub), token: token.clone(), limits, ended });
        let thread = std::thread::Builder::new()
            .name("page".to_owned())
            .spawn(move || runtime.block_on(accept(listener, house)))
            .map_err(PageError::Start)?;
        Ok(Self { hub, address, token, commands: Mutex::new(commands), end, thread: Some(thread) })
    }

    /// Where the server listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What a user opens; beyond this machine it holds the token, so it is for the user's eyes only. An unspecified address
    /// (0.0.0.0) is told as it is: whoever opens the page puts this machine's address there.
    #[must_use]
    pub fn url(&self) -> String {
        match &self.token {
            Some(token) => format!("http://{}/{token}/", self.address),
            None => format!("http://{}/", self.address),
        }
    }

    /// Open pages.
    #[must_use]
    pub fn listeners(&self) -> usize {
        self.hub.listeners()
    }

    /// Tells all open pages of an event. Who opens the page later gets the scene, and the last state of cameras, parameters
    /// and recording with the last notes; a new [`Event::Scene`] forgets the cameras' states.
    pub fn publish(&self, event: &Event) {
        self.hub.publish(event);
    }

    /// Whether a page would show a picture of this camera now: somebody looks, and the last one is a tenth of a second old.
    /// Who asks and hears yes is expected to make one.
    ///
    /// `t_ns` counts nanoseconds since the flight began.
    #[must_use]
    pub fn wants_preview(&self, camera: usize, t_ns: i64) -> bool {
        self.hub.wants_preview(camera, t_ns)
    }

    /// Shows a picture (JPEG, see [`crate::encode_preview`]) of a camera at an instant, nanoseconds since the flight began,
    /// on which the page draws the [`Event::Detections`] of the same instant.
    ///
    /// On the wire: one byte of camera, eight of the instant (little endian), the JPEG.
    pub fn preview(&self, camera: u8, t_ns: i64, jpeg: &[u8]) {
        self.hub.preview(camera, t_ns, jpeg);
    }

    /// The next thing that a user asked for, waiting for it at most so long.
    #[must_use]
    pub fn next_command(&self, wait: Duration) -> Option<Command> {
        lock(&self.commands).recv_timeout(wait).ok()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end.send_replace(true);
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has ended too.
            let _ = thread.join();
        }
    }
}

fn listen(runtime: &Runtime, address: SocketAddr) -> std::io::Result<TcpListener> {
    let _entered = runtime.enter();
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    #[cfg(unix)]
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.bind(address)?;
    socket.listen(128)
}

/// Takes connections until the server ends; open pages then have a moment to hear of it.
async fn accept(listener: TcpListener, house: Arc<House>) {
    let places = Arc::new(Semaphore::new(house.limits.connections));
    let mut ended = house.ended.clone();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = end(&mut ended) => break,
        };
        let Ok((stream, _)) = accepted else {
            // Out of file handles, as a rule: others will be given back.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        // Without it poses would only come later.
        let _ = stream.set_nodelay(true);
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
            turn_away(stream);
            continue;
        };
        let house = Arc::clone(&house);
        tokio::spawn(async move {
            serve(stream, house).await;
            drop(place);
        });
    }
    drop(listener);
    for _ in 0..20 {
        if house.hub.listeners() == 0 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Tells a connection that there is no place for it, without waiting for anything.
fn turn_away(stream: TcpStream) {
    let full = refusal("503 Service Unavailable", "Too many connections: try again in a few seconds.");
    if let Ok(mut stream) = stream.into_std() {
        // The socket does not block; who gets nothing sees it closed.
        let _ = std::io::Write::write(&mut stream, &refuse(full));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_address_must_be_asked_for_and_has_a_token() {
        let open: SocketAddr = "0.0.0.0:0".parse().unwrap();
        let error = Server::start(open, Reach::Loopback).unwrap_err();
        assert!(matches!(error, PageError::NotLoopback(_)), "{error}");
        assert!(error.to_string().contains("0.0.0.0:0"), "{error}");
        let server = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Network).unwrap();
        assert_eq!(server.url(), format!("http://{}/", server.address()));
    }

    #[test]
    fn a_port_that_is_taken_is_an_error() {
        let first = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback).unwrap();
        let error = Server::start(first.address(), Reach::Loopback).unwrap_err();
        assert!(matches!(error, PageError::Listen { .. }), "{error}");
        assert!(error.to_string().contains("free port"), "{error}");
    }

    #[test]
    fn the_port_is_free_again_once_a_server_is_dropped() {
        let address = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback).unwrap().address();
        Server::start(address, Reach::Loopback).unwrap();
    }
}
