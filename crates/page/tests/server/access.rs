//! Who may look and who may command.

use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use mavsight_page::{Reach, Server};
use tungstenite::Message;

use crate::client::{
    ask, assert_still_serving, get, handshake, limits, next_text, note, rest_of, start, status, token,
    wait_for,
};

#[test]
fn pages_of_other_origins_and_names_get_nothing() {
    let server = start();
    let own = server.address().to_string();
    for origin in ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1"] {
        assert_eq!(handshake(server.address(), &own, "/events", origin).unwrap_err(), 403, "{origin}");
        assert_eq!(status(&get(&server, "/", &format!("Origin: {origin}\r\n"))), 403, "{origin}");
    }
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
        Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    assert_eq!(status(&get(&server, "/events", upgrade)), 403, "without an origin");
    // A name that leads here: its page has that name as its origin, and is refused all the same.
    let port = server.address().port();
    for name in
        [format!("evil.example:{port}"), format!("127.0.0.1.evil.example:{port}"), "evil.example".to_owned()]
    {
        let refused = handshake(server.address(), &name, "/events", &format!("http://{name}")).unwrap_err();
        assert_eq!(refused, 403, "{name}");
        let page = ask(&server, format!("GET / HTTP/1.1\r\nHost: {name}\r\n\r\n").as_bytes());
        assert_eq!(status(&page), 403, "{name}");
    }
    let forwarded = format!("localhost:{}", port.wrapping_add(1));
    assert!(handshake(server.address(), &forwarded, "/events", &format!("http://{forwarded}")).is_ok());
    assert_eq!(server.next_command(Duration::ZERO), None);
    assert_still_serving(&server);
}

#[test]
fn beyond_this_machine_only_the_token_opens() {
    let server = Server::start("0.0.0.0:0".parse().unwrap(), Reach::Network, limits()).unwrap();
    let here = SocketAddr::from(([127, 0, 0, 1], server.address().port()));
    let token = token(&server);
    assert_eq!(token.len(), 32);
    let ask = |path: &str| {
        let mut stream = TcpStream::connect(here).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {here}\r\n\r\n").unwrap();
        status(&rest_of(stream))
    };
    let wrong = "0".repeat(32);
    for path in ["/", "/page.js", "/events", &format!("/{wrong}/"), &format!("/{token}")] {
        assert_eq!(ask(path), 403, "{path}");
    }
    assert_eq!(ask(&format!("/{token}/")), 200);
    assert_eq!(ask(&format!("/{token}/page.js")), 200);
    let (own, origin) = (here.to_string(), format!("http://{here}"));
    assert_eq!(handshake(here, &own, &format!("/{wrong}/events"), &origin).unwrap_err(), 403);
    assert!(handshake(here, &own, &format!("/{token}/events"), &origin).is_ok());
}

#[test]
fn without_the_token_a_program_on_this_machine_may_look_and_not_command() {
    let server = start();
    server.publish(&note("to be seen"));
    let (own, origin) = (server.address().to_string(), format!("http://{}", server.address()));
    let earlier = format!("/{}/", "0".repeat(32));
    for path in ["/", &earlier] {
        assert_eq!(status(&get(&server, path, "")), 200, "{path}");
        let mut socket = handshake(server.address(), &own, &format!("{path}events"), &origin).unwrap();
        assert!(next_text(&mut socket).contains("to be seen"));
        socket.send(Message::text(r#"{"command":"calibrate"}"#)).unwrap();
        let answer: serde_json::Value = serde_json::from_str(&next_text(&mut socket)).unwrap();
        assert!(
            answer["fault"] == true && answer["text"].as_str().unwrap().contains("look only"),
            "{answer}"
        );
        for _ in 0..12 {
            let _ = socket.send(Message::text(r#"{"command":"start_recording"}"#));
        }
        let last = std::iter::from_fn(|| socket.read().ok()).last();
        assert!(matches!(last, Some(Message::Close(Some(_)))), "{last:?}");
    }
    wait_for("who goes on asking is left", || server.listeners() == 0);
    assert_eq!(server.next_command(Duration::ZERO), None);
    assert_still_serving(&server);
}
