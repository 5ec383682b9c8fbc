//! Limits of the server.

use smart_default::SmartDefault;
use std::time::Duration;

/// Limits of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, SmartDefault)]
pub struct Limits {
    /// Connections at one time whose request is not answered yet; for one more the oldest is closed, so that
    /// those that hold connections open keep nobody out. A browser opens six at a time.
    #[default(256)]
    pub connections: usize,
    /// Open pages at one time; more are refused. Half of the places are kept for pages with the token.
    #[default(16)]
    pub listeners: usize,
    /// Time for a whole request to arrive and its answer to leave.
    #[default(Duration::from_secs(5))]
    pub request_time: Duration,
    /// Interval of the beat that shows an open page that the server is there.
    #[default(Duration::from_millis(500))]
    pub beat: Duration,
    /// An open page that takes or answers nothing for this time is disconnected.
    #[default(Duration::from_secs(10))]
    pub silence: Duration,
    /// Bytes that are taken from an open page in each [`Limits::pause`]; what it sends beyond waits at its own
    /// end. A command has forty, the answer to a beat six.
    #[default(512)]
    pub burst_bytes: usize,
    /// See [`Limits::burst_bytes`].
    #[default(Duration::from_millis(50))]
    pub pause: Duration,
}
