//! State that all connections share.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use crate::hub::Hub;

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

/// State that all connections share.
#[derive(Debug, Clone)]
pub(crate) struct Shared {
    pub(crate) hub: Arc<Hub>,
    pub(crate) token: Option<String>,
    pub(crate) limits: Limits,
    /// Becomes true when the server ends.
    pub(crate) ended: watch::Receiver<bool>,
}

impl Shared {
    /// Waits for the server's end.
    pub(crate) async fn end(&self) {
        // An error means that the server is gone, which is its end too.
        let _ = self.ended.clone().wait_for(|&ended| ended).await;
    }
}
