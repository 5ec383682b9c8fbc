//! What cannot be read or written: the file, the place in it, and what to do.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// A file that is missing, malformed or cannot be written.
///
/// Rows are counted from 1 below the header; the line of the file is given too.
#[derive(Debug, Error)]
pub enum SessionError {
    /// A file, or a place in it, that is not what it should be.
    #[error("{}{place}: {detail}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The line, key, cell or frame; empty for the whole file.
        place: String,
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
    /// A vehicle, series or model that is well formed but refused.
    #[error("{}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A video or image sequence without frames.
    #[error("{}: the recording has no frames: record it again, or correct the path", .0.display())]
    NoFrames(PathBuf),
    /// A recording of sound without a picture.
    #[error("{}: the file has sound and no picture: give the video, or record it again with the camera on", .0.display())]
    SoundAlone(PathBuf),
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
    /// A camera that was ended because it gave no frames any more.
    #[error("{}: no frame comes any more: look at the camera, its power and its network", place.display())]
    Silent {
        /// What it was opened by.
        place: PathBuf,
    },
    /// A camera whose source has ended.
    #[error("{}: its source has ended: look at the camera, its power and its network", place.display())]
    Ended {
        /// What it was opened by.
        place: PathBuf,
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
}

impl SessionError {
    pub(crate) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, source }
    }

    /// What cannot be expressed in a format.
    pub(crate) fn express(path: &Path, action: &'static str, error: impl ToString) -> Self {
        Self::io(path, action, std::io::Error::other(error.to_string()))
    }

    pub(crate) fn content(path: &Path, source: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Content { path: path.to_owned(), source: Box::new(source) }
    }

    pub(crate) fn at(path: &Path, place: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::File { path: path.to_owned(), place: place.into(), detail: detail.into() }
    }

    pub(crate) fn file(path: &Path, detail: impl Into<String>) -> Self {
        Self::at(path, "", detail)
    }

    pub(crate) fn value(path: &Path, key: impl std::fmt::Display, detail: impl Into<String>) -> Self {
        Self::at(path, format!(": {key}"), detail)
    }

    pub(crate) fn line(path: &Path, line: u64, detail: impl Into<String>) -> Self {
        Self::at(path, format!(", line {line}"), detail)
    }

    pub(crate) fn frame(path: &Path, frame: usize, detail: impl std::fmt::Display) -> Self {
        let remedy = "the file is damaged there; copy it again, or cut it before that frame";
        Self::at(path, format!(", frame {frame} (from 0)"), format!("{detail}: {remedy}"))
    }

    pub(crate) fn ffmpeg(path: &Path, detail: impl Into<String>) -> Self {
        Self::at(path, ": ffmpeg failed", detail)
    }

    pub(crate) fn no_rows(path: &Path) -> Self {
        Self::file(path, "the table has no rows: fill it, or correct the path")
    }
}

pub(crate) fn require_file(path: &Path, role: &str) -> Result<(), SessionError> {
    if path.is_file() {
        return Ok(());
    }
    let detail = if path.is_dir() {
        format!("is a folder, where a file is wanted ({role}): name the file")
    } else {
        format!("there is no such file ({role}): correct the path or put the file there")
    };
    Err(SessionError::file(path, detail))
}

/// Reads a file that must be there.
pub(crate) fn read_bytes(path: &Path, role: &str) -> Result<Vec<u8>, SessionError> {
    require_file(path, role)?;
    std::fs::read(path).map_err(|e| SessionError::io(path, "read it", e))
}

/// Reads a text file that must be there, without a byte order mark.
pub(crate) fn read_text(path: &Path, role: &str) -> Result<String, SessionError> {
    let mut bytes = read_bytes(path, role)?;
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    String::from_utf8(bytes).map_err(|e| {
        let before = &e.as_bytes()[..e.utf8_error().valid_up_to()];
        let line = 1 + before.iter().filter(|b| **b == b'\n').count() as u64;
        SessionError::line(path, line, format!("not text ({role}): correct the path, or save it as UTF-8"))
    })
}
