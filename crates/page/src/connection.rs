//! One connection: its request and the answer.

use std::convert::Infallible;
use std::future::ready;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use hyper::body::{Body, Incoming};
use hyper::header::{HOST, HeaderMap, HeaderName, ORIGIN, SEC_WEBSOCKET_KEY};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::error::{Error, ProtocolError};
use tokio_tungstenite::tungstenite::handshake::server::create_response_with_body;

use crate::access::Right;
use crate::answer::{Refusal, answer, refusal_bytes, refuse};
use crate::hub::{Hub, Seat};
use crate::site::{OWN_HEADER, Site};
use crate::{access, assets, listener};

/// Longest request line and header lines together: several times what browsers send.
const HEAD_LIMIT_BYTES: usize = 8192;
/// Most header lines; browsers send about twenty.
const HEADER_LIMIT: usize = 64;

const NOT_FOUND: Refusal = Refusal(StatusCode::NOT_FOUND, "There is no such file.");
const MALFORMED: Refusal = Refusal(StatusCode::BAD_REQUEST, "This request does not follow HTTP/1.1.");

/// Serves one request to its end; if it asked for a WebSocket, that goes on as a task of its own.
pub(crate) async fn serve(mut stream: TcpStream, hub: Arc<Hub>) {
    let (seat, is_answered) = (OnceLock::new(), AtomicBool::new(false));
    let service = service_fn(|request: Request<Incoming>| {
        is_answered.store(true, Ordering::Relaxed);
        ready(Ok::<_, Infallible>(respond(&request, &hub, &seat).unwrap_or_else(refuse)))
    });
    let served = http1::Builder::new()
        .max_buf_size(HEAD_LIMIT_BYTES)
        .max_headers(HEADER_LIMIT)
        .title_case_headers(true)
        .header_read_timeout(None)
        .serve_connection(TokioIo::new(&mut stream), service)
        .without_shutdown();
    let served = timeout(hub.limits.request_time, served).await;
    let mut farewell = Vec::new();
    let received = match served {
        Ok(Ok(parts)) => Some(parts.read_buf),
        // Malformed or too long, which hyper has answered; or the client has gone.
        Ok(Err(_)) => None,
        Err(_) => {
            if !is_answered.load(Ordering::Relaxed) {
                let late = "The request did not come to its end in time.";
                farewell = refusal_bytes(Refusal(StatusCode::REQUEST_TIMEOUT, late));
            }
            None
        }
    };
    match (seat.into_inner(), received) {
        (Some(seat), Some(received)) => drop(tokio::spawn(listener::serve(stream, received, seat))),
        (Some(_), None) => {}
        (None, _) => {
            // Whether it arrives is the client's matter.
            let _ = timeout(hub.limits.request_time, close(&mut stream, &farewell)).await;
        }
    }
}

/// The answer to a request, whose seat is set if it opens a WebSocket. A refusal of access says nothing about
/// the files.
fn respond(
    request: &Request<Incoming>,
    hub: &Arc<Hub>,
    seat: &OnceLock<Seat>,
) -> Result<Response<String>, Refusal> {
    let (headers, uri) = (request.headers(), request.uri());
    let host = single(headers, HOST)?.ok_or(MALFORMED)?;
    if uri.authority().is_some() || !uri.path().starts_with('/') {
        return Err(MALFORMED);
    }
    let refused = |text| Err(Refusal(StatusCode::FORBIDDEN, text));
    if !access::is_own_host(host) {
        return refused(
            "This server goes by its address or localhost only: use the address that was printed.",
        );
    }
    let origin = single(headers, ORIGIN)?;
    if origin.is_some_and(|origin| !access::is_own_origin(origin, host)) {
        return refused("Pages of other origins get nothing here.");
    }
    let Some((path, right)) = access::below(uri.path(), &hub.token, hub.is_private) else {
        return refused("The token is missing or wrong: use the address that was printed.");
    };
    if request.method() != Method::GET && request.method() != Method::HEAD {
        return Err(Refusal(StatusCode::METHOD_NOT_ALLOWED, "Only GET and HEAD are served."));
    }
    if !request.body().is_end_stream() {
        return Err(Refusal(StatusCode::PAYLOAD_TOO_LARGE, "No request here has a body."));
    }
    if let Some(site) = &hub.site {
        let asked = Asked { path, query: uri.query().unwrap_or(""), right };
        return of_site(site, headers, &asked);
    }
    if path == "events" {
        let response = upgrade(request, origin)?;
        let full = Refusal(StatusCode::SERVICE_UNAVAILABLE, "As many pages as may are open: close one.");
        let joined = hub.join(right).ok_or(full)?;
        seat.get_or_init(|| joined);
        return Ok(response);
    }
    let (media_type, text) = assets::find(path).ok_or(NOT_FOUND)?;
    Ok(answer(StatusCode::OK, media_type, text))
}

/// What is asked of a page of another kind.
struct Asked<'a> {
    path: &'a str,
    query: &'a str,
    right: Right,
}

/// The answer of a page of another kind.
fn of_site(site: &Site, headers: &HeaderMap, asked: &Asked<'_>) -> Result<Response<String>, Refusal> {
    let is_own = single(headers, HeaderName::from_static(OWN_HEADER.0))? == Some(OWN_HEADER.1);
    if asked.path.starts_with("do/") && !(is_own && asked.right == Right::Command) {
        return Err(Refusal(
            StatusCode::FORBIDDEN,
            "Only the page at the printed address does anything here.",
        ));
    }
    let reply = (site.0)(asked.path, asked.query).ok_or(NOT_FOUND)?;
    Ok(answer(StatusCode::OK, reply.media_type, &reply.text))
}

/// The answer that accepts a WebSocket (RFC 6455, section 4.2).
fn upgrade(request: &Request<Incoming>, origin: Option<&str>) -> Result<Response<String>, Refusal> {
    let accepted = create_response_with_body(request, String::new);
    let has_key = !matches!(&accepted, Err(Error::Protocol(ProtocolError::MissingSecWebSocketKey)));
    if accepted.is_err() && has_key {
        let text = "Events come over a WebSocket of version 13.";
        return Err(Refusal(StatusCode::UPGRADE_REQUIRED, text));
    }
    // Every browser sends its origin here, so a client that sends none is no page.
    if origin.is_none() {
        return Err(Refusal(StatusCode::FORBIDDEN, "A WebSocket must name its origin."));
    }
    let is_base64 = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'/' | b'=');
    let key = single(request.headers(), SEC_WEBSOCKET_KEY)?.unwrap_or_default();
    match accepted {
        Ok(response) if key.len() == 24 && key.bytes().all(is_base64) => Ok(response),
        _ => Err(Refusal(StatusCode::BAD_REQUEST, "The WebSocket's key is not 16 bytes in base 64.")),
    }
}

/// The value of a header that may occur only once.
fn single(headers: &HeaderMap, name: HeaderName) -> Result<Option<&str>, Refusal> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| MALFORMED),
        _ => Err(MALFORMED),
    }
}

/// Writes the last bytes and closes; what the client still sends is read first, so that all arrives.
async fn close(stream: &mut TcpStream, farewell: &[u8]) -> std::io::Result<()> {
    stream.write_all(farewell).await?;
    stream.shutdown().await?;
    let mut rest = [0_u8; 4096];
    for _ in 0..64 {
        if stream.read(&mut rest).await? == 0 {
            break;
        }
    }
    Ok(())
}
