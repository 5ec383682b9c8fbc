//! Files that are either whole or not there, and TOML.

use crate::SessionError;
use crate::error::read_text;
use serde::{Serialize, de::DeserializeOwned};
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// A file written next to its place: renamed into it when whole, gone when dropped before.
#[derive(Debug)]
pub(crate) struct PartFile {
    path: PathBuf,
    part: PathBuf,
}

impl PartFile {
    /// Writes the hidden `.NAME.PID.part`; the folder is made where it is missing.
    pub(crate) fn write(
        path: &Path,
        content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<Self, SessionError> {
        if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            make_folder(parent)?;
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let part = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
        // Made first, so that a file that cannot be finished is taken away.
        let this = Self { path: path.to_owned(), part };
        let written = File::create(&this.part).map(BufWriter::new).and_then(|mut out| {
            content(&mut out)?;
            out.flush()
        });
        written.map_err(|e| SessionError::io(path, "write it", e))?;
        Ok(this)
    }

    /// What was written, to be gone on with at its end.
    pub(crate) fn append(&self) -> std::io::Result<File> {
        let mut file = File::options().write(true).open(&self.part)?;
        file.seek(std::io::SeekFrom::End(0))?;
        Ok(file)
    }

    pub(crate) fn keep(&self) -> Result<(), SessionError> {
        std::fs::rename(&self.part, &self.path).map_err(|e| SessionError::io(&self.path, "write it", e))
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        // Nothing is there once it was kept; otherwise the reason why it is half counts, not that it remains.
        drop(std::fs::remove_file(&self.part));
    }
}

/// Writes a whole file: to a hidden `.NAME.PID.part` in the same folder, then renamed, so that a killed run
/// leaves nothing that looks whole. The folder is made where it is missing.
///
/// # Errors
/// What the file system refuses.
pub fn write_whole(path: &Path, content: &[u8]) -> Result<(), SessionError> {
    PartFile::write(path, |out| out.write_all(content))?.keep()
}

/// Makes a folder, refusing a path at which there is something else.
///
/// # Errors
/// What the file system refuses.
pub fn make_folder(path: &Path) -> Result<(), SessionError> {
    if path.exists() && !path.is_dir() {
        let source = std::io::Error::other("a file has that name already: give another folder");
        return Err(SessionError::io(path, "make the folder", source));
    }
    std::fs::create_dir_all(path).map_err(|e| SessionError::io(path, "make the folder", e))
}

/// Reads a TOML file into a type; `role` says what the file is for.
///
/// # Errors
/// Names the file and the line.
pub fn read_toml<T: DeserializeOwned>(path: &Path, role: &str) -> Result<T, SessionError> {
    let text = read_text(path, role)?;
    toml::from_str(&text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or("");
        let line = 1 + before.matches('\n').count() as u64;
        SessionError::line(path, line, with_near(error.message().trim().replace('\n', ", ")))
    })
}

/// What the parser says of a name that it does not know, with the known ones that are near.
fn with_near(message: String) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    let given = quoted.next().filter(|_| message.starts_with("unknown "));
    let near = given.map_or_else(Vec::new, |given| mavsight_model::near(given, quoted));
    if near.is_empty() { message } else { format!("{message}: did you mean {}?", near.join(" or ")) }
}

/// Writes a vehicle, a session file or another value as TOML. Paths are written as given, relative ones
/// relative to the file.
///
/// # Errors
/// What the file system refuses.
pub fn write_toml(path: &Path, value: &impl Serialize) -> Result<(), SessionError> {
    write_whole(path, toml_text(path, value)?.as_bytes())
}

pub(crate) fn toml_text(path: &Path, value: &impl Serialize) -> Result<String, SessionError> {
    toml::to_string(value).map_err(|e| SessionError::express(path, "express it as TOML", e))
}

/// Writes a value as JSON, indented for people.
///
/// # Errors
/// What the file system refuses.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), SessionError> {
    write_whole(path, json_text(path, value)?.as_bytes())
}

pub(crate) fn json_text(path: &Path, value: &impl Serialize) -> Result<String, SessionError> {
    let text = serde_json::to_string_pretty(value);
    text.map(|t| t + "\n").map_err(|e| SessionError::express(path, "express it as JSON", e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_is_not_known_is_answered_with_those_that_are_near() {
        let unknown = "unknown field `vidoe`, expected one of `name`, `video`, `still`";
        assert_eq!(with_near(unknown.to_owned()), format!("{unknown}: did you mean video?"));
        for other in ["unknown field `zz`, expected `name` or `video`", "missing field `name`"] {
            assert_eq!(with_near(other.to_owned()), other);
        }
    }
}
