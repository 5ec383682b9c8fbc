//! Errors of the page.

use std::net::SocketAddr;

/// The page cannot be served, or a picture cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// An address that other machines can reach, without permission for that.
    #[error(
        "{0} can be reached from other machines: serve the page on 127.0.0.1, or ask for the network explicitly"
    )]
    NotLoopback(SocketAddr),
    /// The address is taken, or not this machine's.
    #[error(
        "cannot listen on {address} ({source}): choose a free port of an address of this machine, port 0 for any"
    )]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The thread of the server cannot be started.
    #[error("cannot start the page's server ({0}): close other programs and try again")]
    Start(std::io::Error),
    /// The system gives no random numbers, of which the token is made.
    #[error(
        "the system gives no random numbers for the page's token ({0}): fly without the page, or see to the system's random device"
    )]
    Token(getrandom::Error),
    /// A picture without pixels, or larger than JPEG can hold.
    #[error("a picture of {width_px} x {height_px} pixels cannot be shown: give 1 to 65535 both ways")]
    PictureSize {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
    },
    /// The encoder has failed.
    #[error("cannot encode a picture of {width_px} x {height_px} pixels ({source}): leave this one out")]
    Encode {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
        /// The error of the encoder.
        source: image::ImageError,
    },
}
