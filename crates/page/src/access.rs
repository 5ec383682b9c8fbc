//! Access to the page: host, origin, token.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, SocketAddrV6};

use subtle::ConstantTimeEq;

/// Hexadecimal digits of a token.
const TOKEN_DIGITS: usize = 32;

/// Whether the `Host` of a request is an IP address or `localhost`.
///
/// A foreign page can make its own name resolve to this machine (DNS rebinding); its scripts then have the
/// origin of this server, but still send their own name. An address cannot be rebound. Any port is accepted,
/// because a forwarded port differs.
pub(crate) fn is_own_host(host: &str) -> bool {
    let is_local = |name: &str| name.eq_ignore_ascii_case("localhost");
    match host.split_once(':') {
        None => is_local(host) || host.parse::<Ipv4Addr>().is_ok(),
        Some((name, port)) if is_local(name) => format!("127.0.0.1:{port}").parse::<SocketAddrV4>().is_ok(),
        _ => host.parse::<SocketAddr>().is_ok() || format!("{host}:80").parse::<SocketAddrV6>().is_ok(),
    }
}

/// Whether an origin is that of the page served under this `Host`.
pub(crate) fn is_own_origin(origin: &str, host: &str) -> bool {
    origin.strip_prefix("http://").is_some_and(|rest| rest.eq_ignore_ascii_case(host))
}

/// A new token: 128 random bits as hexadecimal digits.
pub(crate) fn token() -> Result<String, getrandom::Error> {
    let mut bytes = [0_u8; TOKEN_DIGITS / 2];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// What a client may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Right {
    /// See the flight.
    Look,
    /// See it and send commands.
    Command,
}

/// The part of a path below the page's own address, after `/TOKEN/`, and what that token permits. A path with
/// a wrong token or none leads nowhere if the page `is_private`, and otherwise permits to look: a page that
/// was open before the program was started again still shows the flight.
///
/// The comparison takes the same time wherever the token is wrong.
pub(crate) fn below<'a>(path: &'a str, token: &str, is_private: bool) -> Option<(&'a str, Right)> {
    let path = path.strip_prefix('/')?;
    let split = path.split_once('/');
    match split {
        Some((given, rest)) if bool::from(given.as_bytes().ct_eq(token.as_bytes())) => {
            Some((rest, Right::Command))
        }
        _ if is_private => None,
        Some((given, rest)) if is_like_a_token(given) => Some((rest, Right::Look)),
        _ => Some((path, Right::Look)),
    }
}

fn is_like_a_token(text: &str) -> bool {
    text.len() == TOKEN_DIGITS && text.bytes().all(|digit| digit.is_ascii_hexdigit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_addresses_and_localhost_are_own_hosts() {
        for own in [
            "127.0.0.1",
            "127.0.0.1:80",
            "localhost:9000",
            "LocalHost",
            "[::1]:8080",
            "[::1]",
            "192.168.1.7:80",
        ] {
            assert!(is_own_host(own), "{own}");
        }
        for other in [
            "",
            ":",
            "evil.example",
            "evil.example:8080",
            "127.0.0.1.evil.example",
            "localhost.evil.example",
            "::1",
            "[::1",
            "[::1]x",
            "[::1]:x",
            "[127.0.0.1]",
            "127.0.0.1:",
            "127.0.0.1:+8",
            "127.0.0.1:99999",
            "127.0.0.1:80:80",
            "a@127.0.0.1",
        ] {
            assert!(!is_own_host(other), "{other}");
        }
    }

    #[test]
    fn an_origin_is_own_only_if_it_is_the_host_itself() {
        assert!(is_own_origin("http://127.0.0.1:8080", "127.0.0.1:8080"));
        for other in [
            "null",
            "",
            "http://127.0.0.1:3000",
            "http://127.0.0.1",
            "https://127.0.0.1:8080",
            "http://evil.example",
        ] {
            assert!(!is_own_origin(other, "127.0.0.1:8080"), "{other}");
        }
    }

    #[test]
    fn tokens_differ_and_open_only_their_own_door() {
        let (one, two) = (token().unwrap(), token().unwrap());
        assert_eq!(one.len(), TOKEN_DIGITS);
        assert_ne!(one, two);
        let (own, others) = (format!("/{one}/events"), format!("/{two}/events"));
        for is_private in [true, false] {
            assert_eq!(below(&own, &one, is_private), Some(("events", Right::Command)));
            assert_eq!(below(&format!("/{one}/"), &one, is_private), Some(("", Right::Command)));
            assert_eq!(below("events", &one, is_private), None);
        }
        for path in [&others, &format!("/{one}"), "/events", "//", "/", &format!("//{one}/events")] {
            assert_eq!(below(path, &one, true), None, "{path}");
        }
        assert_eq!(below("/events", &one, false), Some(("events", Right::Look)));
        assert_eq!(below(&others, &one, false), Some(("events", Right::Look)));
        assert_eq!(below(&format!("/{}/events", &one[1..]), &one, false).unwrap().1, Right::Look);
        assert_eq!(below("/", &one, false), Some(("", Right::Look)));
    }
}
