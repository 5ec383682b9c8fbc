//! What cannot be read or written: the file, the place in it, and what to do.

use mavsight_flight::FlightError;
use std::path::PathBuf;
use thiserror::Error;

/// A file that is missing, malformed or cannot be written.
///
/// Rows are counted from 1 below the header; the line of the file is given too.
#[derive(Debug, Error)]
pub enum SessionError {
    /// A file that another one names is not there.
    #[error("{}: there is no such file ({role}): correct the path or put the file there", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What it is wanted for.
        role: String,
    },
    /// A file that is not what it should be.
    #[error("{}: {detail}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        detail: String,
    },
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// The system's words.
        source: std::io::Error,
    },
    /// A value that is well formed but makes no sense.
    #[error("{}: {key}: {detail}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Key concerned.
        key: String,
        /// What is wrong and what to do.
        detail: String,
    },
    /// A vehicle or series that flight refuses.
    #[error("{}: {source}", path.display())]
    Flight {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: FlightError,
    },
    /// A model file that identification refuses.
    #[error("{}: {source}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: mavsight_identify::IdentifyError,
    },
    /// A cell that is not what its column holds.
    #[error("{}, row {row} below the header (line {line}), column {column}: {detail}", path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Row, from 1 below the header.
        row: usize,
        /// Line of the file, from 1.
        line: u64,
        /// Column.
        column: String,
        /// What is wrong and what to do.
        detail: String,
    },
    /// A line that does not hold what it should.
    #[error("{}, line {line}: {detail}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// What is wrong.
        detail: String,
    },
    /// A table without rows.
    #[error("{}: the table has no rows: fill it, or correct the path", path.display())]
    EmptyTable {
        /// The file.
        path: PathBuf,
    },
    /// A video or image sequence without frames.
    #[error("{}: the recording has no frames: record it again, or correct the path", path.display())]
    NoFrames {
        /// The file or pattern.
        path: PathBuf,
    },
    /// A frame that cannot be decoded.
    #[error("{}, frame {frame} (from 0): {detail}: the file is damaged there; copy it again, or cut it before that frame", path.display())]
    Frame {
        /// The file.
        path: PathBuf,
        /// Frame in order of time, from 0.
        frame: usize,
        /// What is wrong.
        detail: String,
    },
    /// A recording shorter or longer than it says.
    #[error("{}: the file announces {declared} frames but {read} were read: it is damaged or cut off; copy it again", path.display())]
    FrameCount {
        /// The file.
        path: PathBuf,
        /// Frames announced.
        declared: usize,
        /// Frames read.
        read: usize,
    },
    /// The ffmpeg program is needed and missing.
    #[error("{}: reading it needs the ffmpeg program ({reason}), and {program:?} cannot be started: install it with `apt-get install ffmpeg`, or convert the recording to MP4 with H.264", path.display())]
    NeedsFfmpeg {
        /// The file.
        path: PathBuf,
        /// Why the built-in decoder does not read it.
        reason: String,
        /// Program tried.
        program: String,
    },
    /// The ffmpeg program failed.
    #[error("{}: ffmpeg failed: {detail}", path.display())]
    Ffmpeg {
        /// The file.
        path: PathBuf,
        /// Its last words.
        detail: String,
    },
}

impl SessionError {
    pub(crate) fn io(path: &std::path::Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, source }
    }

    pub(crate) fn value(path: &std::path::Path, key: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::Value { path: path.to_owned(), key: key.into(), detail: detail.into() }
    }
}

/// Refuses a path at which there is no file.
pub(crate) fn require_file(path: &std::path::Path, role: &str) -> Result<(), SessionError> {
    if path.is_file() {
        Ok(())
    } else if path.is_dir() {
        let detail = format!("is a folder, where a file is wanted ({role}): name the file");
        Err(SessionError::File { path: path.to_owned(), detail })
    } else {
        Err(SessionError::Missing { path: path.to_owned(), role: role.to_owned() })
    }
}
