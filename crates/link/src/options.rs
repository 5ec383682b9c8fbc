//! `[live]` of a session file, with `[live.mavlink]`, `[live.natnet]`, `[live.vrpn]`, `[live.json]` and
//! `[live.zenoh]`.
//!
//! Addresses are texts `host:port`; every default keeps to the machine itself.

use crate::LinkError;
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;

/// How a session is flown live; a section of an outlet that is there switches it on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiveSection {
    /// Poses of an earlier flight (`pose.csv`) that give the motion noise; left out: this flight's first
    /// seconds.
    pub poses: Option<PathBuf>,
    /// Half width of a parameter's interval, as a share of its value, at which enough has been seen of it;
    /// left out: 0.05.
    pub enough: Option<f64>,
    /// To an autopilot.
    pub mavlink: Option<MavlinkOptions>,
    /// To clients of OptiTrack's Motive.
    pub natnet: Option<NatnetOptions>,
    /// To clients of VRPN.
    pub vrpn: Option<VrpnOptions>,
    /// Events as lines.
    pub json: Option<JsonOptions>,
    /// Events by Zenoh.
    pub zenoh: Option<ZenohOptions>,
}

/// MAVLink ODOMETRY over UDP.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(default, deny_unknown_fields)]
pub struct MavlinkOptions {
    /// Whereto: the port on which the autopilot, or a router before it, listens. PX4 in simulation: 14580.
    #[default("127.0.0.1:14580".into())]
    pub address: String,
    /// Wherefrom; empty: any port, on the machine alone where `address` is on it.
    pub bind: String,
    /// At most so many poses a second. PX4 wants 30 to 50; ArduPilot at least 4.
    #[default(50.0)]
    pub rate_hz: f64,
    /// MAVLink system: that of the vehicle.
    #[default(1)]
    pub system_id: u8,
    /// MAVLink component: 197, visual-inertial odometry.
    #[default(197)]
    pub component_id: u8,
}

/// Axes of the body that a client of NatNet or VRPN gets; the world is W, Z up, either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BodyAxes {
    /// Forward-left-up, as ROS and Crazyswarm have it: the attitude of a level aircraft is a turn about Z
    /// alone.
    #[default]
    Flu,
    /// Forward-right-down, as all of mavsight's own files have it.
    Frd,
}

/// NatNet 3.1 by unicast.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(default, deny_unknown_fields)]
pub struct NatnetOptions {
    /// Command port, on which clients ask.
    #[default("127.0.0.1:1510".into())]
    pub address: String,
    /// Port of a client's machine to which frames go.
    #[default(1511)]
    pub data_port: u16,
    /// Axes of the body.
    pub body_axes: BodyAxes,
}

/// VRPN tracker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(default, deny_unknown_fields)]
pub struct VrpnOptions {
    /// Port, UDP and TCP, on which clients ask.
    #[default("127.0.0.1:3883".into())]
    pub address: String,
    /// Axes of the body.
    pub body_axes: BodyAxes,
}

/// Events, one JSON object a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(default, deny_unknown_fields)]
pub struct JsonOptions {
    /// TCP: clients connect here and read; empty: none.
    #[default("127.0.0.1:4884".into())]
    pub tcp: String,
    /// UDP: one line a datagram is sent here; empty: none.
    pub udp: String,
}

/// Events by Zenoh, in a build with the feature `zenoh`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(default, deny_unknown_fields)]
pub struct ZenohOptions {
    /// Endpoints on which others may connect.
    #[default(vec!["tcp/127.0.0.1:7447".into()])]
    pub listen: Vec<String>,
    /// Endpoints of routers or peers to connect to; tried until they are there.
    pub connect: Vec<String>,
    /// First part of every key.
    #[default("mavsight".into())]
    pub prefix: String,
    /// Whether to look for others by multicast: leaves the machine.
    pub scouting: bool,
}

/// The address that a text names, IPv4 where it has both.
pub(crate) fn address(outlet: &'static str, text: &str) -> Result<SocketAddr, LinkError> {
    let fault = |reason: String| LinkError::Address { outlet, text: text.into(), reason };
    let all: Vec<SocketAddr> = text.to_socket_addrs().map_err(|e| fault(e.to_string()))?.collect();
    let v4 = all.iter().find(|a| a.is_ipv4()).or(all.first()).copied();
    v4.ok_or_else(|| fault("the host has no address".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_keep_to_the_machine() {
        let all: LiveSection =
            toml::from_str("[mavlink]\n[natnet]\n[vrpn]\n[json]\n[zenoh]\n").expect("sections");
        let texts = [
            all.mavlink.expect("mavlink").address,
            all.natnet.expect("natnet").address,
            all.vrpn.expect("vrpn").address,
            all.json.expect("json").tcp,
        ];
        for text in texts {
            assert!(address("test", &text).expect("an address").ip().is_loopback(), "{text}");
        }
        let zenoh = all.zenoh.expect("zenoh");
        assert!(zenoh.listen.iter().all(|e| e.starts_with("tcp/127.0.0.1:")) && !zenoh.scouting);
        assert_eq!(toml::from_str::<LiveSection>("").expect("nothing"), LiveSection::default());
        assert_eq!(toml::to_string(&LiveSection::default()).expect("a text"), "");
    }

    #[test]
    fn a_key_that_is_not_known_is_named() {
        let said =
            toml::from_str::<LiveSection>("[mavlink]\nrate = 30\n").expect_err("no such key").to_string();
        assert!(said.contains("`rate`") && said.contains("`rate_hz`"), "{said}");
        let said = toml::from_str::<LiveSection>("[ros]\n").expect_err("no such outlet").to_string();
        assert!(said.contains("`ros`"), "{said}");
        assert!(toml::from_str::<LiveSection>("[vrpn]\nbody_axes = \"enu\"\n").is_err());
    }

    #[test]
    fn what_is_no_address_is_refused() {
        for text in ["", "127.0.0.1", "127.0.0.1:99999", "no such host:1"] {
            let said = address("vrpn", text).expect_err("no address").to_string();
            assert!(said.starts_with(&format!("vrpn: `{text}` is no address")), "{said}");
        }
    }
}
