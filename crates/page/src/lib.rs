//! The browser page of a running flight, and the small server that feeds it.
//!
//! The built page is part of the binary. It gets [`mavsight_link::Event`]s as JSON texts over a WebSocket and
//! pictures of the cameras as binary messages (see [`Server::preview`]), and sends [`Command`]s back. The
//! producer never waits for a browser: each page has a bounded queue of its own, from which the oldest
//! message falls out first.
//!
//! [`Server::start_site`] serves a page of another kind by the same rules.
//!
//! Only this machine is served unless [`Reach::Network`] permits more, and then only with the token of the
//! printed address; without it nobody gives commands. Pages of other origins, and host names that lead here by
//! DNS rebinding, are refused.

mod access;
mod answer;
mod assets;
mod command;
mod connection;
mod error;
mod hub;
mod limits;
mod listener;
mod pace;
mod preview;
mod queue;
mod server;
mod site;

pub use command::Command;
pub use error::PageError;
pub use limits::Limits;
pub use preview::{LONGEST_SIDE_PX, encode as encode_preview};
pub use server::{Reach, Server};
pub use site::Reply;
