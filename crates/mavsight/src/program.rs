//! The program, for its own `main` and for whoever brings it along.

use crate::cli::{Cli, WrongCall};
use crate::commands;
use clap::Parser;
use mavsight_engine::EngineError;
use std::ffi::OsString;
use std::io::Write;

/// Does what is asked for on a command line, of which the first word is the program's own name, and gives its exit status:
/// 0 success, 1 the work failed, 2 the call was wrong. Results go to standard output, the rest to standard error.
pub fn command_line(words: impl IntoIterator<Item = OsString>) -> u8 {
    let status = match Cli::try_parse_from(words) {
        Ok(cli) => done(&cli),
        Err(refusal) => {
            // A help that nobody reads to its end is no error.
            drop(refusal.print());
            u8::try_from(refusal.exit_code()).unwrap_or(2)
        }
    };
    drop(std::io::stdout().flush());
    status
}

fn done(cli: &Cli) -> u8 {
    let Err(error) = commands::run(cli) else { return 0 };
    eprintln!("mavsight: {}", words(&error));
    let is_of_the_input = error.downcast_ref::<EngineError>().is_some_and(EngineError::is_of_the_input);
    if error.is::<WrongCall>() || is_of_the_input { 2 } else { 1 }
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
