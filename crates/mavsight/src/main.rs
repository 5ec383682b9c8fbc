//! The command line.

use std::process::ExitCode;

/// Memory that decoding has freed is given back, which glibc does not do, and threads of a live flight do not
/// wait for one lock.
#[cfg(target_os = "linux")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    mavsight::command_line(std::env::args_os()).into()
}
