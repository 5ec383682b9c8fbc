//! Files that grow, and that are made safe from a power cut now and then.

use std::fs::File;
use std::io::{Error, ErrorKind, Result, Seek, SeekFrom, Write};
use std::path::Path;

/// A file that is written from its beginning to its end.
pub trait Storage: Write + Send {
    /// Cuts it back to a length, where writing goes on.
    ///
    /// # Errors
    /// What the system says.
    fn cut(&mut self, length: u64) -> Result<()>;

    /// What waits, on another thread, until all that was written before the call is on the disk itself.
    ///
    /// # Errors
    /// What the system says.
    fn syncer(&self) -> Result<Syncer>;
}

/// Waits for a disk; see [`Storage::syncer`].
pub type Syncer = Box<dyn FnMut() -> Result<()> + Send>;

impl Storage for File {
    fn cut(&mut self, length: u64) -> Result<()> {
        self.set_len(length)?;
        self.seek(SeekFrom::Start(length)).map(drop)
    }

    fn syncer(&self) -> Result<Syncer> {
        let own = self.try_clone()?;
        Ok(Box::new(move || where_there_is_a_disk(own.sync_data())))
    }
}

/// Waits until the files of a folder, and the folder's own entries, are on the disk itself.
///
/// # Errors
/// What the system says.
pub fn sync_folder(folder: &Path) -> Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_file() {
            where_there_is_a_disk(File::open(path)?.sync_all())?;
        }
    }
    // Elsewhere a folder cannot be opened, and its entries are safe with their files.
    #[cfg(unix)]
    for folder in [Some(folder), folder.parent().filter(|p| !p.as_os_str().is_empty())].into_iter().flatten()
    {
        where_there_is_a_disk(File::open(folder)?.sync_all())?;
    }
    Ok(())
}

/// A file that is on no disk, such as a pipe, has nothing to wait for: EINVAL of fsync(2).
fn where_there_is_a_disk(synced: Result<()>) -> Result<()> {
    synced.or_else(|e: Error| if e.kind() == ErrorKind::InvalidInput { Ok(()) } else { Err(e) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_was_cut_is_gone_on_with_at_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut file: Box<dyn Storage> = Box::new(File::create(&path).unwrap());
        file.write_all(b"whole and half").unwrap();
        file.cut(5).unwrap();
        file.write_all(b", whole").unwrap();
        file.syncer().unwrap()().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "whole, whole");
        sync_folder(folder.path()).unwrap();
        assert!(sync_folder(&path).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_on_no_disk_has_nothing_to_wait_for() {
        let file = File::options().write(true).open("/dev/null").unwrap();
        file.syncer().unwrap()().unwrap();
    }
}
