//! The outlets of a session, opened by its options.

use crate::json::JsonLines;
use crate::mavlink::Mavlink;
use crate::natnet::Natnet;
use crate::vrpn::Vrpn;
use crate::{Body, LinkError, LiveSection, Outlet};

/// Opens every outlet that the options have.
///
/// # Errors
/// An address or option is wrong, a port is held by another program, or this build has not the outlet.
pub fn open(options: &LiveSection, body: &Body) -> Result<Vec<Box<dyn Outlet>>, LinkError> {
    let mut outlets: Vec<Box<dyn Outlet>> = Vec::new();
    if let Some(options) = &options.mavlink {
        outlets.push(Box::new(Mavlink::open(options, body)?));
    }
    if let Some(options) = &options.natnet {
        outlets.push(Box::new(Natnet::open(options, body)?));
    }
    if let Some(options) = &options.vrpn {
        outlets.push(Box::new(Vrpn::open(options, body)?));
    }
    if let Some(options) = &options.json {
        outlets.push(Box::new(JsonLines::open(options)?));
    }
    #[cfg(feature = "zenoh")]
    if let Some(options) = &options.zenoh {
        outlets.push(Box::new(crate::Zenoh::open(options, body)?));
    }
    #[cfg(not(feature = "zenoh"))]
    if options.zenoh.is_some() {
        return Err(LinkError::Absent("zenoh"));
    }
    Ok(outlets)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_is_held_is_reported() {
        let held = std::net::UdpSocket::bind("127.0.0.1:0").expect("a port");
        let address = held.local_addr().expect("its address").to_string();
        let natnet = crate::NatnetOptions { address: address.clone(), ..Default::default() };
        let options = LiveSection { natnet: Some(natnet), ..Default::default() };
        let said = match open(&options, &Body::new("x", Vec::new())) {
            Err(fault) => fault.to_string(),
            Ok(_) => String::new(),
        };
        assert!(said.starts_with(&format!("natnet: {address} cannot be opened")), "{said}");
    }

    #[cfg(not(feature = "zenoh"))]
    #[test]
    fn an_outlet_that_was_not_built_is_reported() {
        let options = LiveSection { zenoh: Some(Default::default()), ..Default::default() };
        let said = open(&options, &Body::new("x", Vec::new())).err().map(|e| e.to_string());
        assert!(said.is_some_and(|s| s.contains("--features zenoh")));
    }
}
