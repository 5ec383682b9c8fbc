//! What may be typed of `overlay`, `completions` and `man`.

use super::interval;
use clap::Args;
use std::path::PathBuf;

/// `overlay`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight overlay paper-flight/session.toml --out flight.mp4\n  \
mavsight overlay session.toml --out part.mp4 --within 3..5 --enlarge 100\n\n\
White rings: balls as detected. Yellow crosses: balls as the pose puts them. Lines in red, green and blue: the body's\n\
x, y and z axis. White line: the path so far. Pink, enlarged as the picture says: residuals, each with the 95 % ellipse\n\
of its detection, and at the body origin the 95 % ellipse of the pose.")]
pub(crate) struct Overlay {
    /// The session file
    #[arg(value_name = "SESSION.toml")]
    pub(crate) session: PathBuf,
    /// The video, MP4 with H.264
    #[arg(long, value_name = "FILE.mp4")]
    pub(crate) out: PathBuf,
    /// How many times residuals and ellipses are enlarged [default: so that a typical ellipse is seen]
    #[arg(long, value_name = "FACTOR", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) enlarge: Option<u32>,
    /// The part of the flight that is shown, s
    #[arg(long, value_name = "FROM..TO", value_parser = interval)]
    pub(crate) within: Option<(f64, f64)>,
}

/// `completions`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  mavsight completions bash > ~/.local/share/bash-completion/completions/mavsight"
)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_enum)]
    pub(crate) shell: clap_complete::Shell,
}

/// `man`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight man ~/.local/share/man/man1\n  man mavsight-run")]
pub(crate) struct Man {
    /// Folder for the pages
    #[arg(value_name = "DIR")]
    pub(crate) dir: PathBuf,
}
