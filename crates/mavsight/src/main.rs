//! The command line.

mod cli;
mod commands;
mod figures;
mod fits;
mod motion_fits;
mod out;
mod page;
mod progress;
mod summary;

use clap::Parser;
use mavsight::lab;
use std::process::ExitCode;

/// One heap for all threads. glibc has one for each, and what decoding leaves in them lies idle while later stages of a long flight
/// take new memory.
#[cfg(target_os = "linux")]
#[global_allocator]
static ALLOCATOR: dlmalloc::GlobalDlmalloc = dlmalloc::GlobalDlmalloc;

fn main() -> ExitCode {
    match commands::run(&cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("mavsight: {}", words(&error));
            ExitCode::from(if error.is::<cli::WrongCall>() { 2 } else { 1 })
        }
    }
}

/// An error with what caused it, as far as it does not say that itself.
fn words(error: &anyhow::Error) -> String {
    let mut all = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if all.is_empty() {
            all = cause;
        } else if !all.contains(&cause) {
            all += ": ";
            all += &cause;
        }
    }
    all
}
