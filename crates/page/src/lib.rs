//! The browser page of a running flight, and the small server that feeds it.
//!
//! The page is built once and is part of the binary. It gets [`mavsight_link::Event`]s as JSON texts over a WebSocket, pictures of the
//! cameras as binary messages (see [`Server::preview`]), and sends [`Command`]s back. Whatever a browser does, or fails to do, the
//! producer is never held: each listener has a bounded queue of its own, from which what is oldest falls out first.
//!
//! Only this machine is served unless [`Reach::Network`] asks for more, and then only who knows the token in the printed address. Pages of
//! other origins, and names that lead here by a trick of DNS, are refused.

mod access;
mod assets;
mod command;
mod connection;
mod error;
mod http;
mod hub;
mod listener;
mod preview;
mod queue;
mod server;

pub use command::Command;
pub use error::PageError;
pub use preview::{LONGEST_SIDE_PX, encode as encode_preview};
pub use server::{Limits, Reach, Server};
