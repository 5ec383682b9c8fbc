//! A client of the server, good or bad.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use mavsight_link::Event;
use mavsight_page::{Limits, Reach, Server};
use tungstenite::{Message, WebSocket};

pub(crate) fn limits() -> Limits {
    Limits { connections: 24, listeners: 3, request_time: Duration::from_millis(800), ..Limits::default() }
}

pub(crate) fn start() -> Server {
    Server::start("127.0.0.1:0".parse().unwrap(), Reach::Loopback, limits()).unwrap()
}

pub(crate) fn connect(server: &Server) -> TcpStream {
    let stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    stream
}

/// All that the server answers until it closes.
pub(crate) fn rest_of(mut stream: TcpStream) -> String {
    let mut bytes = Vec::new();
    // A reset after the answer is an end too.
    let _ = stream.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

pub(crate) fn ask(server: &Server, request: &[u8]) -> String {
    let mut stream = connect(server);
    // The server may have answered and closed before all is written.
    let _ = stream.write_all(request);
    rest_of(stream)
}

/// A request of a browser for a path, with further header lines.
pub(crate) fn get(server: &Server, path: &str, more: &str) -> String {
    ask(server, format!("GET {path} HTTP/1.1\r\nHost: {}\r\n{more}\r\n", server.address()).as_bytes())
}

pub(crate) fn status(answer: &str) -> u16 {
    answer
        .get(9..12)
        .and_then(|digits| digits.parse().ok())
        .unwrap_or_else(|| panic!("no status: {answer:?}"))
}

pub(crate) fn assert_still_serving(server: &Server) {
    assert_eq!(status(&get(server, "/", "")), 200);
    drop(open(server).unwrap());
}

pub(crate) fn handshake(
    address: SocketAddr,
    host: &str,
    path: &str,
    origin: &str,
) -> Result<WebSocket<TcpStream>, u16> {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let request = tungstenite::http::Request::get(format!("ws://{address}{path}"))
        .header("Host", host)
        .header("Origin", origin)
        .header("Connection", "Upgrade")
        .header("Upgrade", "websocket")
        .header("Sec-WebSocket-Version", "13")
        .header("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==")
        .body(())
        .unwrap();
    match tungstenite::client(request, stream) {
        Ok((socket, _)) => Ok(socket),
        Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
            Err(answer.status().as_u16())
        }
        Err(error) => panic!("{error}"),
    }
}

pub(crate) fn token(server: &Server) -> String {
    server.url().rsplit('/').nth(1).unwrap().to_owned()
}

/// Opens a page that may look and command.
pub(crate) fn open(server: &Server) -> Result<WebSocket<TcpStream>, u16> {
    let host = server.address().to_string();
    handshake(server.address(), &host, &format!("/{}/events", token(server)), &format!("http://{host}"))
}

/// The next text that is no beat.
pub(crate) fn next_text(socket: &mut WebSocket<TcpStream>) -> String {
    loop {
        if let Message::Text(text) = socket.read().unwrap()
            && !text.contains(r#""event":"beat""#)
        {
            return text.to_string();
        }
    }
}

pub(crate) fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < Duration::from_secs(5), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub(crate) fn note(text: &str) -> Event {
    Event::Note { t_s: 1.0, fault: false, text: text.to_owned() }
}

pub(crate) fn detections(t_s: f64) -> Event {
    Event::Detections { camera: 0, t_s, seen: Vec::new() }
}
