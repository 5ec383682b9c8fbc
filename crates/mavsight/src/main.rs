//! The command line.

mod cli;
mod commands;
mod out;
mod progress;

use clap::Parser;
use mavsight::lab;
use mavsight_engine::EngineError;
use std::process::ExitCode;

/// Memory that decoding has freed is given back, which glibc does not do, and threads of a live flight do not
/// wait for one lock.
#[cfg(target_os = "linux")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    match commands::run(&cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("mavsight: {}", words(&error));
            let is_of_the_input =
                error.downcast_ref::<EngineError>().is_some_and(EngineError::is_of_the_input);
            ExitCode::from(if error.is::<cli::WrongCall>() || is_of_the_input { 2 } else { 1 })
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
