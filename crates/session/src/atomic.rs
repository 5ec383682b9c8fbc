//! Files that are either whole or not there.

use crate::SessionError;
use std::path::Path;

/// Writes a whole file: to a hidden `.NAME.PID.part` in the same folder, then renamed, so that a killed run leaves
/// nothing that looks whole. The folder is made where it is missing.
///
/// # Errors
/// What the file system refuses.
pub fn write_whole(path: &Path, content: &[u8]) -> Result<(), SessionError> {
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        make_folder(parent)?;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let part = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    std::fs::write(&part, content).and_then(|()| std::fs::rename(&part, path)).map_err(|e| {
        // The half file is of no use; that it cannot be removed either is less important than why.
        drop(std::fs::remove_file(&part));
        SessionError::io(path, "write it", e)
    })
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
