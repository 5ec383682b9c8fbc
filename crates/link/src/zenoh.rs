//! Events by Zenoh.
//!
//! Each event is put under `<prefix>/<body>/<event>`, such as `mavsight/cf231/pose`, as the JSON object that
//! newline JSON has; the encoding says `application/json`. An instant without a pose is an object with
//! `valid` false and without position. The session is a peer that looks for nobody by itself unless
//! `scouting` says so. What a subscriber does not take in time is dropped.

use crate::{Body, Event, LinkError, Outlet, ZenohOptions};
use serde_json::json;
use zenoh::Wait;

/// Puts events.
pub struct Zenoh {
    session: zenoh::Session,
    stem: String,
}

impl Zenoh {
    /// Opens a session. A peer to connect to that is not there is tried again and again.
    ///
    /// # Errors
    /// An endpoint or the prefix is wrong, or an endpoint is held by another program.
    pub fn open(options: &ZenohOptions, body: &Body) -> Result<Self, LinkError> {
        let refused = |e: zenoh::Error| LinkError::Zenoh(e.to_string());
        let stem = format!("{}/{}/", options.prefix, body.name());
        if options.prefix.contains(['*', '$'])
            || zenoh::key_expr::KeyExpr::new(stem.trim_end_matches('/')).is_err()
        {
            return Err(LinkError::Option {
                outlet: "zenoh",
                option: "prefix",
                value: format!("`{}`", options.prefix),
                allowed: "a key without wild cards, such as mavsight or lab/room1",
            });
        }
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", json!("peer")),
            ("listen/endpoints", json!(options.listen)),
            ("connect/endpoints", json!(options.connect)),
            ("connect/timeout_ms", json!(-1)),
            ("connect/exit_on_failure", json!(false)),
            ("scouting/multicast/enabled", json!(options.scouting)),
            ("scouting/gossip/enabled", json!(options.scouting)),
        ] {
            config.insert_json5(key, &value.to_string()).map_err(refused)?;
        }
        let session = zenoh::open(config).wait().map_err(refused)?;
        Ok(Self { session, stem })
    }
}

impl Outlet for Zenoh {
    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        let object = serde_json::to_value(event)?;
        let kind = object["event"].as_str().unwrap_or_default();
        self.session
            .put(format!("{}{kind}", self.stem), object.to_string())
            .encoding(zenoh::bytes::Encoding::APPLICATION_JSON)
            .wait()
            .map_err(|e| LinkError::Zenoh(e.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::Zenoh;
    use crate::testing::body;
    use crate::{Event, Outlet, ZenohOptions};
    use std::net::TcpListener;
    use std::time::{Duration, Instant};

    #[test]
    fn a_router_that_is_not_there_is_not_waited_for() {
        let nobody = TcpListener::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a port");
        let options =
            ZenohOptions { listen: Vec::new(), connect: vec![format!("tcp/{nobody}")], ..Default::default() };
        let begun = Instant::now();
        let mut outlet = Zenoh::open(&options, &body()).expect("a session");
        for _ in 0..1000 {
            outlet.event(&Event::Note { t_s: 0.0, fault: false, text: "x".into() }).expect("put");
        }
        assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    }

    #[test]
    fn wrong_options_are_refused() {
        let held = TcpListener::bind("127.0.0.1:0").expect("a port");
        let endpoint = format!("tcp/{}", held.local_addr().expect("its address"));
        let base = ZenohOptions { listen: Vec::new(), ..Default::default() };
        for (options, want) in [
            (ZenohOptions { listen: vec![endpoint], ..base.clone() }, "zenoh: "),
            (ZenohOptions { connect: vec!["nonsense".into()], ..base.clone() }, "zenoh: "),
            (ZenohOptions { prefix: "a/*".into(), ..base.clone() }, "`prefix`"),
            (ZenohOptions { prefix: "/a".into(), ..base.clone() }, "`prefix`"),
            (ZenohOptions { prefix: String::new(), ..base }, "`prefix`"),
        ] {
            let said = Zenoh::open(&options, &body()).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(said.contains(want), "{options:?}: {said}");
        }
    }
}
