//! One connection: its request, and what it gets.

use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::handshake::derive_accept_key;

use crate::http::{Refusal, Request, refusal};
use crate::hub::Hub;
use crate::{Limits, access, assets, http, listener};

/// What all connections share.
#[derive(Debug)]
pub(crate) struct House {
    pub(crate) hub: Arc<Hub>,
    pub(crate) token: Option<String>,
    pub(crate) limits: Limits,
    /// Becomes true when the server ends.
    pub(crate) ended: watch::Receiver<bool>,
}

/// What a request may have.
#[derive(Debug)]
enum Grant {
    Asset(assets::Asset),
    /// The key with which the WebSocket is accepted.
    Events(String),
}

/// Serves one connection to its end.
pub(crate) async fn serve(mut stream: TcpStream, house: Arc<House>) {
    let patience = house.limits.request_time;
    let (request, rest) = match timeout(patience, http::read(&mut stream)).await {
        Ok(Ok(read)) => read,
        Ok(Err(None)) => return,
        Ok(Err(Some(refused))) => return part(&mut stream, &http::refuse(refused), patience).await,
        Err(_) => {
            let late = refusal("408 Request Timeout", "The request did not come to its end in time.");
            return part(&mut stream, &http::refuse(late), patience).await;
        }
    };
    match judge(&request, house.token.as_deref()) {
        Err(refused) => part(&mut stream, &http::refuse(refused), patience).await,
        Ok(Grant::Asset(asset)) => {
            let bytes = http::answer("200 OK", asset.media_type, asset.bytes, request.method == "HEAD");
            part(&mut stream, &bytes, patience).await;
        }
        Ok(Grant::Events(key)) => {
            let Some(mailbox) = house.hub.join(house.limits.listeners) else {
                let full = refusal("503 Service Unavailable", "As many pages as may are open: close one.");
                return part(&mut stream, &http::refuse(full), patience).await;
            };
            let accepted = format!(
                "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
                 Sec-WebSocket-Accept: {key}\r\n\r\n"
            );
            if matches!(timeout(patience, stream.write_all(accepted.as_bytes())).await, Ok(Ok(()))) {
                listener::serve(stream, rest, &mailbox, &house).await;
            }
            house.hub.leave(&mailbox);
        }
    }
}

/// What a request may have, or why not; who may have nothing learns nothing else.
fn judge(request: &Request, token: Option<&str>) -> Result<Grant, Refusal> {
    if !access::is_own_host(&request.host) {
        return Err(refusal(
            "403 Forbidden",
            "This server goes by its address or localhost only: use the address that was printed.",
        ));
    }
    if request.origin.as_deref().is_some_and(|origin| !access::is_own_origin(origin, &request.host)) {
        return Err(refusal("403 Forbidden", "Pages of other origins get nothing here."));
    }
    let Some(path) = access::below(&request.path, token) else {
        return Err(refusal(
            "403 Forbidden",
            "The token is missing or wrong: use the address that was printed.",
        ));
    };
    if request.method != "GET" && request.method != "HEAD" {
        return Err(refusal("405 Method Not Allowed", "Only GET and HEAD are served."));
    }
    if request.has_body {
        return Err(refusal("413 Content Too Large", "No request here has a body."));
    }
    if path == "events" {
        return upgrade(request).map(Grant::Events);
    }
    assets::find(path).map(Grant::Asset).ok_or(refusal("404 Not Found", "There is no such file."))
}

/// The key that accepts a WebSocket (RFC 6455, section 4.2).
fn upgrade(request: &Request) -> Result<String, Refusal> {
    let upgrade = &request.upgrade;
    if !upgrade.is_asked || request.method != "GET" || upgrade.version.as_deref() != Some("13") {
        return Err(refusal("426 Upgrade Required", "Events come over a WebSocket of version 13."));
    }
    // Every browser sends its origin here, so whoever sends none is no page.
    if request.origin.is_none() {
        return Err(refusal("403 Forbidden", "A WebSocket must say of which origin it is."));
    }
    let is_base64 = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'/' | b'=');
    match &upgrade.key {
        Some(key) if key.len() == 24 && key.bytes().all(is_base64) => Ok(derive_accept_key(key.as_bytes())),
        _ => Err(refusal("400 Bad Request", "The WebSocket's key is not 16 bytes in base 64.")),
    }
}

/// Writes the last answer and closes so that it arrives: what the other side still sends is read, a little of it, and left.
async fn part(stream: &mut TcpStream, answer: &[u8], patience: Duration) {
    let farewell = async {
        stream.write_all(answer).await?;
        stream.shutdown().await?;
        let mut rest = [0_u8; 4096];
        for _ in 0..64 {
            if stream.read(&mut rest).await? == 0 {
                break;
            }
        }
        std::io::Result::Ok(())
    };
    // Whether it arrives is the other side's matter.
    let _ = timeout(patience, farewell).await;
}
