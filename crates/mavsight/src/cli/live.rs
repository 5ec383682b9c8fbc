//! What may be typed after `live`.

use super::size;
use clap::Args;
use mavsight_geometry::ImageSize;
use std::path::PathBuf;

/// `live`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  mavsight live session.toml --json\n  mavsight live session.toml --replay\n  \
mavsight live --virtual --record flight\n\n\
A camera of the session is what its `live` names. Poses that were not measured are not sent. See docs/live.md."
)]
pub(crate) struct Live {
    /// The session; none with --virtual
    #[arg(value_name = "SESSION.toml", required_unless_present = "virtual_room")]
    pub(crate) session: Option<PathBuf>,
    /// Replay the session's recordings at their own pace
    #[arg(long, conflicts_with = "virtual_room")]
    pub(crate) replay: bool,
    /// Film the virtual room, flown by a pilot
    #[arg(long = "virtual", conflicts_with = "session")]
    pub(crate) virtual_room: bool,
    /// As fast as it goes, nothing dropped; with --replay or --virtual
    #[arg(long)]
    pub(crate) fast: bool,
    /// Length of the flight; until Ctrl-C, or the end of its recordings, where left out
    #[arg(long = "for", value_name = "SECONDS", allow_negative_numbers = true)]
    pub(crate) seconds: Option<f64>,
    /// Events as JSON on standard output, one a line
    #[arg(long)]
    pub(crate) json: bool,
    /// Record what is received, detected and sent: a session that `run` takes
    #[arg(long, value_name = "DIR")]
    pub(crate) record: Option<PathBuf>,
    /// Folder for live.json, the figures of the flight
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// MAVLink ODOMETRY by UDP, to an address where one is given; otherwise the session's [live.mavlink]
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) mavlink: Option<Option<String>>,
    /// NatNet 3.1, asked for at an address
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) natnet: Option<Option<String>>,
    /// VRPN, asked for at an address
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) vrpn: Option<Option<String>>,
    /// Events as lines to who connects to an address by TCP
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) lines: Option<Option<String>>,
    /// Events by Zenoh, on an endpoint such as tcp/127.0.0.1:7447; in a build with the feature `zenoh`
    #[arg(long, value_name = "ENDPOINT", num_args = 0..=1)]
    pub(crate) zenoh: Option<Option<String>>,
    /// A recording for Rerun: poses, curves, notes
    #[arg(long, value_name = "FILE.rrd")]
    pub(crate) rerun: Option<PathBuf>,
    /// A page in the browser; of this machine alone (127.0.0.1:8750) where no address is given
    #[cfg(feature = "page")]
    #[arg(long, value_name = "IP:PORT", num_args = 0..=1)]
    pub(crate) serve: Option<Option<std::net::SocketAddr>>,
    /// Frames a second of the virtual room; with --virtual
    #[arg(long, value_name = "HZ", default_value_t = 60.0, conflicts_with = "session")]
    pub(crate) rate: f64,
    /// Size of the virtual room's images, such as 1920x1080; with --virtual
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = size, conflicts_with = "session")]
    pub(crate) size: ImageSize,
    /// Seed of the virtual room; with --virtual
    #[arg(long, default_value_t = 1, conflicts_with = "session")]
    pub(crate) seed: u64,
}
