//! Results in pieces, appended to one file that survives a kill.

use crate::ScoreError;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A file of numbered pieces of text, each behind a line with its number, length and checksum.
///
/// A piece counts if it is whole and its checksum is right. A part of a piece, left by a kill, is cut off
/// when the file is opened again.
#[derive(Debug)]
pub struct ChunkFile {
    path: PathBuf,
    file: Mutex<File>,
    done: BTreeMap<u64, String>,
}

/// Flights of a piece.
const FLIGHTS: u64 = 10;

const MAGIC: &str = "mavsight-campaign 1";

impl ChunkFile {
    /// Opens the file of a job, or begins it. `job` is the number of the job.
    ///
    /// # Errors
    /// [`ScoreError::Chunks`] for a file of another job, or what the file system refuses.
    pub fn open(path: &Path, job: u64) -> Result<Self, ScoreError> {
        let failed = |e: std::io::Error| ScoreError::Chunks { path: path.to_owned(), detail: e.to_string() };
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(failed)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed)?;
        let head = format!("{MAGIC} {job:016x}\n");
        let (mut done, mut sound) = (BTreeMap::new(), 0);
        if bytes.starts_with(head.as_bytes()) {
            sound = head.len();
            while let Some((number, text, length)) = chunk(&bytes[sound..]) {
                done.insert(number, text);
                sound += length;
            }
        } else if !head.as_bytes().starts_with(&bytes) {
            let detail = "belongs to another campaign: remove it, or take another folder".to_owned();
            return Err(ScoreError::Chunks { path: path.to_owned(), detail });
        }
        file.set_len(sound as u64).map_err(failed)?;
        drop(file);
        let mut file = OpenOptions::new().append(true).open(path).map_err(failed)?;
        if sound == 0 {
            file.write_all(head.as_bytes()).map_err(failed)?;
        }
        Ok(Self { path: path.to_owned(), file: Mutex::new(file), done })
    }

    /// Pieces that were there when the file was opened.
    pub fn done(&self) -> &BTreeMap<u64, String> {
        &self.done
    }

    /// The rows of so many flights: those that are there, and those that `rows` makes, on all threads; `step` is called with
    /// the number of flights of each finished piece.
    ///
    /// # Errors
    /// As [`ChunkFile::append`].
    pub fn completed(
        &self,
        flights: u64,
        rows: &(dyn Fn(Range<u64>) -> String + Sync),
        step: &(dyn Fn(u64) + Sync),
    ) -> Result<String, ScoreError> {
        let chunk = |k: u64| {
            if let Some(rows) = self.done.get(&k) {
                return Ok(rows.clone());
            }
            let some = k * FLIGHTS..((k + 1) * FLIGHTS).min(flights);
            let rows = rows(some.clone());
            self.append(k, &rows)?;
            step(some.end - some.start);
            Ok(rows)
        };
        let chunks = (0..flights.div_ceil(FLIGHTS)).into_par_iter().map(chunk);
        Ok(chunks.collect::<Result<Vec<String>, ScoreError>>()?.concat())
    }

    /// Appends a piece; several threads may.
    ///
    /// # Errors
    /// [`ScoreError::Chunks`] for what the file system refuses.
    pub fn append(&self, number: u64, text: &str) -> Result<(), ScoreError> {
        let whole = format!("#{number} {} {:016x}\n{text}", text.len(), checksum(text.as_bytes()));
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let failed =
            |e: std::io::Error| ScoreError::Chunks { path: self.path.clone(), detail: e.to_string() };
        file.write_all(whole.as_bytes()).map_err(failed)
    }
}

/// The piece at the start of some bytes, and their length; none where it is not whole.
fn chunk(bytes: &[u8]) -> Option<(u64, String, usize)> {
    let end = bytes.iter().position(|b| *b == b'\n')?;
    let head = std::str::from_utf8(bytes.get(1..end)?).ok().filter(|_| bytes[0] == b'#')?;
    let mut words = head.split(' ');
    let (number, length) = (words.next()?.parse().ok()?, words.next()?.parse::<usize>().ok()?);
    let wanted = u64::from_str_radix(words.next()?, 16).ok()?;
    let text = bytes.get(end + 1..(end + 1).checked_add(length)?)?;
    let text = std::str::from_utf8(text).ok().filter(|t| checksum(t.as_bytes()) == wanted)?;
    Some((number, text.to_owned(), end + 1 + length))
}

/// FNV-1a, 64 bits (Fowler, Noll & Vo 1991).
pub(crate) fn checksum(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, b| (hash ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("mavsight-chunks-{}-{name}", std::process::id()));
        let _ = std::fs::remove_file(&path);
        path
    }

    #[test]
    fn the_checksum_is_that_of_the_reference() {
        assert_eq!(checksum(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(checksum(b"foobar"), 0x8594_4171_f739_67e8);
    }

    /// However many bytes a kill leaves, what was whole is kept and the rest can be done again.
    #[test]
    fn a_file_cut_anywhere_keeps_what_was_whole() {
        let path = path("cut");
        let texts = ["a,1\n", "", "bb,2\nc,3\n"];
        let file = ChunkFile::open(&path, 7).expect("a file");
        for (k, text) in texts.iter().enumerate() {
            file.append(k as u64, text).expect("appended");
        }
        let whole = std::fs::read(&path).expect("bytes");
        let mut counts = Vec::new();
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).expect("written");
            let again = ChunkFile::open(&path, 7).expect("opened");
            counts.push(again.done().len());
            for (k, text) in
                texts.iter().enumerate().filter(|(k, _)| !again.done().contains_key(&(*k as u64)))
            {
                again.append(k as u64, text).expect("appended");
            }
            let last = ChunkFile::open(&path, 7).expect("opened");
            assert!(last.done().values().eq(texts.iter()), "cut at {cut}");
        }
        assert!(counts.is_sorted() && counts[0] == 0 && counts[whole.len()] == 3, "{counts:?}");
        let mut spoilt = whole.clone();
        let last = spoilt.len() - 2;
        spoilt[last] ^= 1;
        std::fs::write(&path, &spoilt).expect("written");
        assert_eq!(
            ChunkFile::open(&path, 7).expect("opened").done().len(),
            2,
            "a wrong checksum does not count"
        );
        let other = ChunkFile::open(&path, 8).expect_err("another job");
        assert!(other.to_string().contains("another campaign"), "{other}");
        std::fs::remove_file(&path).expect("removed");
    }
}
