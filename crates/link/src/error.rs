//! What can go wrong at an outlet.

use std::io;

/// What can go wrong at an outlet.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// A text that should be an address is none.
    #[error("{outlet}: `{text}` is no address ({reason}): write host:port, such as 127.0.0.1:3883")]
    Address {
        /// Outlet.
        outlet: &'static str,
        /// What was written.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
    /// An option out of its range.
    #[error("{outlet}: `{option}` is {value}; it must be {allowed}")]
    Option {
        /// Outlet.
        outlet: &'static str,
        /// Key in the session file.
        option: &'static str,
        /// What was written.
        value: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// A port could not be opened.
    #[error(
        "{outlet}: {address} cannot be opened ({source}): end the program that holds the port, or choose another"
    )]
    Open {
        /// Outlet.
        outlet: &'static str,
        /// Where.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// Nothing goes out; the next instant is tried again.
    #[error("{outlet}: {address} cannot be reached ({source}): look at the address and at the network")]
    Send {
        /// Outlet.
        outlet: &'static str,
        /// Whereto.
        address: String,
        /// What the system says.
        source: io::Error,
    },
    /// An event has no JSON form.
    #[error("json: an event has no such form ({0}): leave [live.json] out")]
    Write(#[from] serde_json::Error),
    /// A file cannot be written.
    #[error("{path} cannot be written ({source}): look at its folder and at the disk")]
    File {
        /// Which.
        path: String,
        /// What the system says.
        source: io::Error,
    },
    /// This build has not the outlet that is asked for.
    #[error(
        "{0}: not in this build: install with `cargo install mavsight --features {0}`, or take [live.{0}] out"
    )]
    Absent(&'static str),
    /// Zenoh refuses.
    #[error("zenoh: {0}: look at `listen` and `connect`, such as tcp/127.0.0.1:7447")]
    Zenoh(String),
}
