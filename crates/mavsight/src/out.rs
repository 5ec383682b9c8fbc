//! What goes to standard output.

use anyhow::{Context, Result};
use std::fmt::Arguments;
use std::io::{ErrorKind, Write};

/// Writes to standard output. Who stops reading, as `head` does, wants no more, and that is no error.
pub(crate) fn put(text: Arguments<'_>) -> Result<()> {
    match std::io::stdout().lock().write_fmt(text) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("standard output"),
    }
}

/// `print!` in a function that returns a result.
macro_rules! out {
    ($($text:tt)*) => { $crate::out::put(format_args!($($text)*))? };
}

/// `println!` in a function that returns a result.
macro_rules! outln {
    ($($text:tt)*) => { $crate::out::put(format_args!("{}\n", format_args!($($text)*)))? };
}

pub(crate) use {out, outln};
