//! As much of HTTP as the page needs: one request a connection, without a body.
//!
//! A connection that serves one request and ends cannot be held open, reused for another origin, or made to hide a second request.

use tokio::io::{AsyncRead, AsyncReadExt};

/// Longest request line and header lines together: several times what browsers send.
const HEAD_LIMIT_BYTES: usize = 8192;
/// Most header lines; browsers send about twenty.
const HEADER_LIMIT: usize = 64;

/// Why a request gets nothing: a status and a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Refusal {
    pub(crate) status: &'static str,
    pub(crate) text: &'static str,
}

pub(crate) const fn refusal(status: &'static str, text: &'static str) -> Refusal {
    Refusal { status, text }
}

const MALFORMED: Refusal = refusal("400 Bad Request", "This is not a request that HTTP/1.1 knows.");

/// One request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Request {
    pub(crate) method: String,
    /// Without what follows a question mark.
    pub(crate) path: String,
    pub(crate) host: String,
    pub(crate) origin: Option<String>,
    pub(crate) has_body: bool,
    pub(crate) upgrade: Upgrade,
}

/// What a request says of a WebSocket.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Upgrade {
    pub(crate) is_asked: bool,
    pub(crate) version: Option<String>,
    pub(crate) key: Option<String>,
}

/// Reads one request; what came behind it is returned beside it.
///
/// # Errors
/// A refusal where it is too long or malformed; none where the other side has closed.
pub(crate) async fn read(
    stream: &mut (impl AsyncRead + Unpin),
) -> Result<(Request, Vec<u8>), Option<Refusal>> {
    let mut head = Vec::with_capacity(1024);
    loop {
        let before = head.len();
        let room = (HEAD_LIMIT_BYTES - before) as u64;
        if room == 0 {
            return Err(Some(refusal("431 Request Header Fields Too Large", "The request is too long.")));
        }
        match stream.take(room).read_buf(&mut head).await {
            Ok(count) if count > 0 => {}
            _ => return Err(None),
        }
        if let Some((request, length)) = parse(&head).map_err(Some)? {
            return Ok((request, head.split_off(length)));
        }
    }
}

/// The request at the beginning of these bytes, and its length; none where it is not whole yet.
///
/// # Errors
/// A refusal where it never will be one.
pub(crate) fn parse(head: &[u8]) -> Result<Option<(Request, usize)>, Refusal> {
    let mut headers = [httparse::EMPTY_HEADER; HEADER_LIMIT];
    let mut raw = httparse::Request::new(&mut headers);
    let length = match raw.parse(head) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(httparse::Error::TooManyHeaders) => {
            return Err(refusal(
                "431 Request Header Fields Too Large",
                "The request has too many header lines.",
            ));
        }
        Err(_) => return Err(MALFORMED),
    };
    let (Some(method), Some(path)) = (raw.method, raw.path) else { return Err(MALFORMED) };
    if !path.starts_with('/') {
        return Err(MALFORMED);
    }
    let host = single(raw.headers, "host")?.ok_or(MALFORMED)?;
    let body_bytes = single(raw.headers, "content-length")?
        .map(|text| if text.bytes().all(|byte| byte.is_ascii_digit()) { Ok(text) } else { Err(MALFORMED) })
        .transpose()?;
    let has_body = body_bytes.is_some_and(|text| text.bytes().any(|byte| byte != b'0'))
        || single(raw.headers, "transfer-encoding")?.is_some();
    let upgrade = Upgrade {
        is_asked: has_word(single(raw.headers, "upgrade")?, "websocket")
            && has_word(single(raw.headers, "connection")?, "upgrade"),
        version: single(raw.headers, "sec-websocket-version")?.map(str::to_owned),
        key: single(raw.headers, "sec-websocket-key")?.map(str::to_owned),
    };
    let path = path.split_once('?').map_or(path, |(path, _)| path).to_owned();
    let origin = single(raw.headers, "origin")?.map(str::to_owned);
    let request =
        Request { method: method.to_owned(), path, host: host.to_owned(), origin, has_body, upgrade };
    Ok(Some((request, length)))
}

/// The value of a header that may stand only once.
fn single<'a>(headers: &[httparse::Header<'a>], name: &str) -> Result<Option<&'a str>, Refusal> {
    let mut values = headers.iter().filter(|header| header.name.eq_ignore_ascii_case(name));
    let Some(first) = values.next() else { return Ok(None) };
    if values.next().is_some() {
        return Err(MALFORMED);
    }
    std::str::from_utf8(first.value).map(|text| Some(text.trim())).map_err(|_| MALFORMED)
}

fn has_word(list: Option<&str>, word: &str) -> bool {
    list.is_some_and(|list| list.split(',').any(|part| part.trim().eq_ignore_ascii_case(word)))
}

/// Header lines that every answer has: nothing may be kept, framed, guessed at, or loaded from elsewhere.
const COMMON_HEADERS: &str = "Cache-Control: no-store\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Referrer-Policy: no-referrer\r\n\
    X-Content-Type-Options: nosniff\r\n\
    X-Frame-Options: DENY\r\n\
    Connection: close\r\n";

/// An answer; `HEAD` gets all but its body.
pub(crate) fn answer(status: &str, media_type: &str, body: &[u8], is_head: bool) -> Vec<u8> {
    let extra = match status.get(..3) {
        Some("405") => "Allow: GET, HEAD\r\n",
        Some("426") => "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n",
        Some("503") => "Retry-After: 5\r\n",
        _ => "",
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {media_type}\r\nContent-Length: {}\r\n{extra}{COMMON_HEADERS}\r\n",
        body.len()
    );
    let mut bytes = head.into_bytes();
    if !is_head {
        bytes.extend_from_slice(body);
    }
    bytes
}

/// The answer to a refused request.
pub(crate) fn refuse(refused: Refusal) -> Vec<u8> {
    answer(refused.status, "text/plain; charset=utf-8", format!("{}\n", refused.text).as_bytes(), false)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(head: &str) -> &'static str {
        match parse(head.as_bytes()) {
            Err(refused) => refused.status,
            Ok(None) => "partial",
            Ok(Some(_)) => "whole",
        }
    }

    #[test]
    fn requests_are_told_from_what_is_none() {
        assert_eq!(status("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"), "whole");
        assert_eq!(status("GET / HTTP/1.1\r\nHost: loc"), "partial");
        for malformed in [
            "\u{0}\u{1}",
            "GET / HTTP/9.9\r\nHost: a\r\n\r\n",
            "GET / HTTP/1.1\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
            "GET http://a/ HTTP/1.1\r\nHost: a\r\n\r\n",
            "OPTIONS * HTTP/1.1\r\nHost: a\r\n\r\n",
            "GET / HTTP/1.1\r\nHost : a\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nContent-Length: -1\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
        ] {
            assert_eq!(status(malformed), "400 Bad Request", "{malformed:?}");
        }
    }

    #[test]
    fn what_a_request_says_is_read() {
        let head = b"GET /events?x=1 HTTP/1.1\r\nhost: [::1]:8\r\nOrigin: http://[::1]:8\r\nUpgrade: WebSocket\r\n\
            Connection: keep-alive, Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: abc\r\n\r\nrest";
        let (request, length) = parse(head).unwrap().unwrap();
        assert_eq!(&head[length..], b"rest");
        assert_eq!((request.path.as_str(), request.host.as_str()), ("/events", "[::1]:8"));
        assert_eq!(request.origin.as_deref(), Some("http://[::1]:8"));
        assert!(request.upgrade.is_asked && !request.has_body);
        assert_eq!(request.upgrade.key.as_deref(), Some("abc"));
        let bodies = ["Content-Length: 5", "Transfer-Encoding: chunked"];
        for body in bodies {
            let head = format!("POST / HTTP/1.1\r\nHost: a\r\n{body}\r\n\r\n");
            assert!(parse(head.as_bytes()).unwrap().unwrap().0.has_body, "{body}");
        }
        let head = b"GET / HTTP/1.1\r\nHost: a\r\nContent-Length: 0\r\n\r\n";
        assert!(!parse(head).unwrap().unwrap().0.has_body);
    }
}
