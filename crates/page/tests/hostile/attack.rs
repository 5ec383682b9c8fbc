//! Clients that mean harm, as many as wanted, on a thread of their own that gives way to all others: they
//! stand for other machines.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use mavsight_link::give_way;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpSocket;
use tokio::time::{sleep, timeout};

/// Longest that one connection is tried; the server ends most of them before.
const PATIENCE: Duration = Duration::from_secs(12);
/// Between the end of a connection and the next.
const PAUSE: Duration = Duration::from_millis(100);

/// What the clients did, and what they got.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    pub(crate) connections: AtomicU64,
    /// Most connections at one time.
    pub(crate) open: AtomicU64,
    pub(crate) most_open: AtomicU64,
    /// WebSocket frames that the server's machine took.
    pub(crate) frames: AtomicU64,
    pub(crate) bytes: AtomicU64,
    /// What was served that should not have been.
    pub(crate) breaches: Mutex<Vec<String>>,
}

/// An attack that lasts until it is dropped.
pub(crate) struct Attack {
    pub(crate) tally: Arc<Tally>,
    ending: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Attack {
    /// `count` connections at a time, of every kind alike many, each opened again when it ends.
    pub(crate) fn start(address: SocketAddr, count: usize) -> Self {
        let (tally, ending) = (Arc::new(Tally::default()), Arc::new(AtomicBool::new(false)));
        let (own, end) = (Arc::clone(&tally), Arc::clone(&ending));
        let run = move || {
            give_way();
            give_way();
            let runtime =
                tokio::runtime::Builder::new_current_thread().enable_all().build().expect("runtime");
            runtime.block_on(async {
                let kinds = Arc::new(kinds(address));
                for k in 0..count {
                    tokio::spawn(client(address, k, Arc::clone(&kinds), Arc::clone(&own)));
                }
                while !end.load(Ordering::Relaxed) {
                    sleep(Duration::from_millis(20)).await;
                }
            });
        };
        Self { tally, ending, thread: Some(std::thread::spawn(run)) }
    }
}

impl Drop for Attack {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        self.thread.take().map(JoinHandle::join);
    }
}

struct Kind {
    name: &'static str,
    /// What is sent first.
    hello: Vec<u8>,
    /// What is sent again and again after it, and how long after the last.
    then: Vec<u8>,
    every: Duration,
    /// WebSocket frames in `then`.
    frames: u64,
    /// Whether it reads after the head of the answer.
    reads: bool,
    /// Whether it may see the flight, as programs on the same machine may.
    may_look: bool,
}

/// A WebSocket frame with a mask of zeros.
fn frame(first: u8, payload: &[u8]) -> Vec<u8> {
    [&[first, 0x80 | payload.len() as u8, 0, 0, 0, 0], payload].concat()
}

fn upgrade(path: &str, host: &str, origin: &str) -> Vec<u8> {
    format!(
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\n\
         Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    )
    .into_bytes()
}

const OTHER_FILES: [&str; 4] =
    ["/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/..%2f..%2fetc/passwd", "//etc/passwd"];

fn kinds(address: SocketAddr) -> Vec<Kind> {
    let own = address.to_string();
    let origin = format!("http://{own}");
    let get = |path: &str| format!("GET {path} HTTP/1.1\r\nHost: {own}\r\n").into_bytes();
    let ask = |name: &str| frame(0x81, format!(r#"{{"command":"{name}"}}"#).as_bytes());
    let asks = [ask("start_recording"), ask("calibrate"), ask("stop_recording")].concat();
    let kind = |name, hello: Vec<u8>| Kind {
        name,
        hello,
        then: Vec::new(),
        every: Duration::ZERO,
        frames: 0,
        reads: true,
        may_look: false,
    };
    let page = |name, then: Vec<u8>, frames| Kind {
        then,
        frames,
        may_look: true,
        ..kind(name, upgrade("/events", &own, &origin))
    };
    let mut all = vec![
        kind("silent", Vec::new()),
        Kind {
            then: b"x".to_vec(),
            every: Duration::from_millis(100),
            ..kind("slow header", [get("/"), b"Cookie: ".to_vec()].concat())
        },
        Kind { then: vec![b'y'; 16384], ..kind("endless header", [get("/"), b"Cookie: ".to_vec()].concat()) },
        Kind {
            then: [&b"4000\r\n"[..], &[b'z'; 0x4000], b"\r\n"].concat(),
            ..kind(
                "endless body",
                format!("POST / HTTP/1.1\r\nHost: {own}\r\nTransfer-Encoding: chunked\r\n\r\n").into_bytes(),
            )
        },
        Kind {
            then: b"0".to_vec(),
            every: Duration::from_millis(100),
            ..kind("slow body", [get("/"), b"Content-Length: 1000000000\r\n\r\n".to_vec()].concat())
        },
        kind("no HTTP", (0..4000_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8).collect()),
        // A foreign page, one whose name leads here, and programs that guess the token.
        Kind {
            then: asks.clone(),
            ..kind("foreign origin", upgrade("/events", &own, "http://evil.example"))
        },
        Kind {
            then: asks.clone(),
            ..kind("rebinding", upgrade("/events", "evil.example:8750", "http://evil.example:8750"))
        },
        // Of a machine's own programs, who may look, and send what they like.
        Kind {
            then: asks.repeat(30),
            frames: 90,
            may_look: true,
            ..kind("wrong token", upgrade(&format!("/{}/events", "0".repeat(32)), &own, &origin))
        },
        page("commands", asks.repeat(30), 90),
        page("nonsense", frame(0x81, b"{}").repeat(500), 500),
        page("pings", frame(0x89, b"").repeat(1000), 1000),
        page("empty fragments", [frame(0x01, b"{"), frame(0x00, b"").repeat(1000)].concat(), 1001),
        page("no frames", vec![0xff; 4096], 0),
        page(
            "giant frame",
            [&[0x82, 0xff, 0x3f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff][..], &[0; 4096]].concat(),
            1,
        ),
        Kind { reads: false, ..page("no reader", Vec::new(), 0) },
    ];
    all.extend(OTHER_FILES.map(|path| kind("other files", [get(path), b"\r\n".to_vec()].concat())));
    all
}

async fn client(address: SocketAddr, number: usize, kinds: Arc<Vec<Kind>>, tally: Arc<Tally>) {
    let kind = &kinds[number % kinds.len()];
    loop {
        let _ = timeout(PATIENCE, attempt(address, number, kind, &tally)).await;
        sleep(PAUSE).await;
    }
}

async fn attempt(address: SocketAddr, number: usize, kind: &Kind, tally: &Tally) -> std::io::Result<()> {
    let socket = TcpSocket::new_v4()?;
    // Addresses of their own, so that they do not use up the ports of this machine's other programs.
    let from = Ipv4Addr::new(127, 0, 1, 1 + (number % 250) as u8);
    socket.bind((from, 0).into())?;
    let stream = socket.connect(address).await?;
    tally.connections.fetch_add(1, Ordering::Relaxed);
    let _open = Open::new(tally);
    let (mut reader, mut writer) = stream.into_split();
    let write = async {
        writer.write_all(&kind.hello).await?;
        while !kind.then.is_empty() {
            sleep(kind.every).await;
            writer.write_all(&kind.then).await?;
            tally.frames.fetch_add(kind.frames, Ordering::Relaxed);
            tally.bytes.fetch_add(kind.then.len() as u64, Ordering::Relaxed);
        }
        std::future::pending().await
    };
    let read = async {
        let mut bytes = vec![0; 4096];
        let mut length = reader.read(&mut bytes).await?;
        judge(kind, &bytes[..length], tally);
        while length > 0 {
            if !kind.reads {
                std::future::pending::<()>().await;
            }
            length = reader.read(&mut bytes).await?;
        }
        Ok(())
    };
    tokio::select! { done = write => done, done = read => done }
}

fn judge(kind: &Kind, answer: &[u8], tally: &Tally) {
    let text = String::from_utf8_lossy(answer);
    let is_served = text.starts_with("HTTP/1.1 101") || text.starts_with("HTTP/1.1 200");
    if (is_served && !kind.may_look) || text.contains("root:") {
        tally.breaches.lock().expect("no panic").push(format!("{}: {text}", kind.name));
    }
}

/// One open connection, counted.
struct Open<'a>(&'a Tally);

impl<'a> Open<'a> {
    fn new(tally: &'a Tally) -> Self {
        let open = tally.open.fetch_add(1, Ordering::Relaxed) + 1;
        tally.most_open.fetch_max(open, Ordering::Relaxed);
        Self(tally)
    }
}

impl Drop for Open<'_> {
    fn drop(&mut self) {
        self.0.open.fetch_sub(1, Ordering::Relaxed);
    }
}
