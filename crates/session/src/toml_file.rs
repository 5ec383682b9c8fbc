//! TOML files with errors that name the file and the line.

use crate::{SessionError, error::require_file};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads a TOML file into a type.
pub fn read_toml<T: DeserializeOwned>(path: &Path, role: &str) -> Result<T, SessionError> {
    require_file(path, role)?;
    let text = std::fs::read_to_string(path).map_err(|e| SessionError::io(path, "read it", e))?;
    toml::from_str(&text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or("");
        SessionError::Row {
            path: path.to_owned(),
            line: 1 + before.matches('\n').count() as u64,
            detail: error.message().trim().replace('\n', ", "),
        }
    })
}
