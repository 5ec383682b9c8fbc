//! Limits of the server.

use std::time::Duration;

/// Limits of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Connections at one time; more are refused.
    pub connections: usize,
    /// Open pages at one time; more are refused.
    pub listeners: usize,
    /// Time for a whole request to arrive and its answer to leave.
    pub request_time: Duration,
    /// Interval of the beat that shows an open page that the server is there.
    pub beat: Duration,
    /// An open page that takes or answers nothing for this time is disconnected.
    pub silence: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 64,
            listeners: 16,
            request_time: Duration::from_secs(5),
            beat: Duration::from_millis(500),
            silence: Duration::from_secs(10),
        }
    }
}
