//! Access to the page: host, origin, token.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, SocketAddrV6};

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
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The part of a path below the page's own address: after `/`, or after `/TOKEN/`; none where the token is
/// wrong.
///
/// The comparison takes the same time wherever the token is wrong.
pub(crate) fn below<'a>(path: &'a str, token: Option<&str>) -> Option<&'a str> {
    let path = path.strip_prefix('/')?;
    let Some(token) = token else { return Some(path) };
    let (given, rest) = path.split_once('/')?;
    let differs = given.len() != token.len()
        || given.bytes().zip(token.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) != 0;
    (!differs).then_some(rest)
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
        assert_eq!(one.len(), 32);
        assert_ne!(one, two);
        assert_eq!(below(&format!("/{one}/events"), Some(&one)), Some("events"));
        assert_eq!(below(&format!("/{one}/"), Some(&one)), Some(""));
        assert_eq!(below(&format!("/{two}/events"), Some(&one)), None);
        assert_eq!(below(&format!("/{one}"), Some(&one)), None);
        assert_eq!(below("/events", Some(&one)), None);
        assert_eq!(below("//", Some(&one)), None);
        assert_eq!(below("/events", None), Some("events"));
        assert_eq!(below("events", None), None);
    }
}
