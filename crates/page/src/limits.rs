//! Limits of the server.

use smart_default::SmartDefault;
use std::time::Duration;

/// Limits of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, SmartDefault)]
pub struct Limits {
    /// Connections at one time; more are refused.
    #[default(64)]
    pub connections: usize,
    /// Open pages at one time; more are refused.
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
}
