//! The server's interface for its producer.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use mavsight_link::{Event, give_way};
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::Runtime;
use tokio::sync::watch;
use tokio::task::AbortHandle;

use crate::connection::serve;
use crate::hub::{Hub, lock};
use crate::site::{Reply, Site};
use crate::{Command, Limits, PageError, access};

/// Commands that may wait; a person presses no more keys than that before something happens.
const COMMANDS_WAITING: usize = 16;
/// The system's buffer for a page that does not read: a picture and some poses, so that it shows new ones.
const SEND_BUFFER_BYTES: u32 = 64 * 1024;
/// Connections that the system holds until they are accepted, which is at once unless thousands come together.
const BACKLOG: u32 = 1024;

/// Machines that may reach the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reach {
    /// Programs on this machine, which may look; for commands they need the token at the end of
    /// [`Server::url`].
    #[default]
    Loopback,
    /// Every machine that can reach the address and knows that token, without which it gets nothing. Nothing
    /// is encrypted.
    Network,
}

/// The page's server, on a thread of its own until it is dropped.
///
/// All methods may be called from any thread; none waits for a browser.
#[derive(Debug)]
pub struct Server {
    hub: Arc<Hub>,
    address: SocketAddr,
    commands: Mutex<Receiver<Command>>,
    end: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves the page on an address; port 0 takes any free port.
    ///
    /// # Errors
    /// [`PageError::NotLoopback`] for an address that other machines can reach unless `reach` permits it,
    /// [`PageError::Listen`] where the address is taken or not this machine's, [`PageError::Token`] or
    /// [`PageError::Start`] where the system gives no random numbers or no thread.
    pub fn start(address: SocketAddr, reach: Reach, limits: Limits) -> Result<Self, PageError> {
        Self::start_with(address, reach, limits, None)
    }

    /// Serves a page of another kind: `answer` gets the path below the page's address and what follows a question mark, one
    /// request after the other, and gives nothing where there is nothing. It has no events. A request below `do/` comes from
    /// the page itself: it must have the token, and the header `x-mavsight: page`, which scripts of other origins cannot send.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_site(
        address: SocketAddr,
        reach: Reach,
        limits: Limits,
        answer: impl Fn(&str, &str) -> Option<Reply> + Send + Sync + 'static,
    ) -> Result<Self, PageError> {
        Self::start_with(address, reach, limits, Some(Site(Box::new(answer))))
    }

    fn start_with(
        address: SocketAddr,
        reach: Reach,
        limits: Limits,
        site: Option<Site>,
    ) -> Result<Self, PageError> {
        let is_open = !address.ip().to_canonical().is_loopback();
        if is_open && reach == Reach::Loopback {
            return Err(PageError::NotLoopback(address));
        }
        let token = access::token().map_err(PageError::Token)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .build()
            .map_err(PageError::Start)?;
        let listener = listen(&runtime, address).map_err(|source| PageError::Listen { address, source })?;
        let address = listener.local_addr().map_err(|source| PageError::Listen { address, source })?;
        let (sender, commands) = sync_channel(COMMANDS_WAITING);
        let (end, ended) = watch::channel(false);
        let hub = Arc::new(Hub::new(token, is_open, limits, sender, site, ended));
        let own = Arc::clone(&hub);
        let run = move || {
            give_way();
            runtime.block_on(accept(listener, own));
        };
        let thread =
            std::thread::Builder::new().name("page".to_owned()).spawn(run).map_err(PageError::Start)?;
        Ok(Self { hub, address, commands: Mutex::new(commands), end, thread: Some(thread) })
    }

    /// Address and port on which the server listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The page's URL. It contains the token, so it is for the user's eyes only. An unspecified address
    /// (0.0.0.0) is returned as it is: the user replaces it by this machine's address.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/{}/", self.address, self.hub.token)
    }

    /// Number of open pages.
    #[must_use]
    pub fn listeners(&self) -> usize {
        self.hub.listeners()
    }

    /// Sends an event to all open pages. A page that is opened later gets the scene, the last state of
    /// cameras, parameters and recording, and the last notes; a new [`Event::Scene`] forgets the cameras'
    /// states.
    pub fn publish(&self, event: &Event) {
        self.hub.publish(event);
    }

    /// Whether a picture of this camera is due at `t_ns`, nanoseconds since the flight began: a page is open,
    /// and the last picture is a tenth of a second old. After `true` the caller is expected to send one by
    /// [`Server::preview`].
    #[must_use]
    pub fn wants_preview(&self, camera: usize, t_ns: i64) -> bool {
        self.hub.wants_preview(camera, t_ns)
    }

    /// Sends a picture (JPEG, see [`crate::encode_preview`]) of a camera at an instant, nanoseconds since the
    /// flight began. The page draws the [`Event::Detections`] of the same instant on it.
    ///
    /// On the wire: one byte of camera, eight of the instant (little endian), the JPEG.
    pub fn preview(&self, camera: u8, t_ns: i64, jpeg: &[u8]) {
        self.hub.preview(camera, t_ns, jpeg);
    }

    /// The user's next command, waiting for it at most for `wait`.
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
    socket.listen(BACKLOG)
}

/// Accepts connections until the server ends; open pages then have 0.2 s to close.
async fn accept(listener: TcpListener, hub: Arc<Hub>) {
    let mut unanswered = VecDeque::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = hub.end() => break,
        };
        let Ok((stream, _)) = accepted else {
            // Usually out of file handles, of which others will be freed.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        // Only delays poses if it fails.
        let _ = stream.set_nodelay(true);
        make_room(&mut unanswered, hub.limits.connections);
        unanswered.push_back(tokio::spawn(serve(stream, Arc::clone(&hub))).abort_handle());
    }
    drop(listener);
    for _ in 0..20 {
        if hub.listeners() == 0 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Forgets the connections that are answered; if there are still as many as may be, closes the oldest.
fn make_room(unanswered: &mut VecDeque<AbortHandle>, most: usize) {
    if unanswered.len() < most {
        return;
    }
    unanswered.retain(|connection| !connection.is_finished());
    while unanswered.len() >= most.max(1) {
        unanswered.pop_front().iter().for_each(AbortHandle::abort);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_address_must_be_asked_for_and_has_a_token() {
        let open: SocketAddr = "0.0.0.0:0".parse().unwrap();
        let error = Server::start(open, Reach::Loopback, Limits::default()).unwrap_err();
        assert!(matches!(error, PageError::NotLoopback(_)), "{error}");
        assert!(error.to_string().contains("0.0.0.0:0"), "{error}");
        let server =
            Server::start("127.0.0.1:0".parse().unwrap(), Reach::Network, Limits::default()).unwrap();
        let url = server.url();
        let token = url.strip_prefix(&format!("http://{}/", server.address())).unwrap();
        assert_eq!(token.len(), 33, "{url}");
    }

    #[test]
    fn a_port_that_is_taken_is_an_error() {
        let first =
            Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback, Limits::default()).unwrap();
        let error = Server::start(first.address(), Reach::Loopback, Limits::default()).unwrap_err();
        assert!(matches!(error, PageError::Listen { .. }), "{error}");
        assert!(error.to_string().contains("free port"), "{error}");
    }

    #[test]
    fn the_port_is_free_again_once_a_server_is_dropped() {
        let address = Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback, Limits::default())
            .unwrap()
            .address();
        Server::start(address, Reach::Loopback, Limits::default()).unwrap();
    }
}
