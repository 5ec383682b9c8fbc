//! Answers of the server.

use hyper::header::{HeaderName, HeaderValue};
use hyper::{Response, StatusCode};

/// Why a request is refused: a status and a sentence for its reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Refusal(pub(crate) StatusCode, pub(crate) &'static str);

/// Headers of every answer: nothing may be cached, framed, guessed at, or loaded from elsewhere, and a
/// connection serves one request, so that it cannot be reused for another origin or hide a second request.
const HEADERS: [(&str, &str); 8] = [
    ("cache-control", "no-store"),
    (
        "content-security-policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("connection", "close"),
];

pub(crate) fn answer(status: StatusCode, media_type: &'static str, body: &str) -> Response<String> {
    let extra: &[(&str, &str)] = match status {
        StatusCode::METHOD_NOT_ALLOWED => &[("allow", "GET, HEAD")],
        StatusCode::UPGRADE_REQUIRED => &[("upgrade", "websocket"), ("sec-websocket-version", "13")],
        StatusCode::SERVICE_UNAVAILABLE => &[("retry-after", "5")],
        _ => &[],
    };
    let mut response = Response::new(body.to_owned());
    *response.status_mut() = status;
    for &(name, value) in [("content-type", media_type)].iter().chain(&HEADERS).chain(extra) {
        response.headers_mut().insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    response
}

pub(crate) fn refuse(refused: Refusal) -> Response<String> {
    answer(refused.0, "text/plain; charset=utf-8", &format!("{}\n", refused.1))
}

/// The bytes of a refusal, for a connection whose request has not been read.
pub(crate) fn refusal_bytes(refused: Refusal) -> Vec<u8> {
    let response = refuse(refused);
    let mut text = format!("HTTP/1.1 {}\r\nContent-Length: {}\r\n", refused.0, response.body().len());
    for (name, value) in response.headers() {
        text += &format!("{name}: {}\r\n", value.to_str().unwrap_or_default());
    }
    text += "\r\n";
    text += response.body();
    text.into_bytes()
}
