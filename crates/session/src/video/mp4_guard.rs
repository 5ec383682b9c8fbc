//! What keeps a parser of boxes that believes what they say from going in circles or counting beyond the file.

use std::io::{Error, Read, Result, Seek, SeekFrom};

/// So many calls may reach nothing new: a parser reads some configurations twice, of at most a few kilobytes.
const MOST_IDLE: u32 = 1 << 14;

/// A reader that fails where a parser comes to nothing new, as in a box of size zero.
pub(super) struct Forward<R> {
    inner: R,
    at: u64,
    furthest: u64,
    idle: u32,
}

impl<R: Read + Seek> Forward<R> {
    pub(super) fn new(mut inner: R) -> Result<Self> {
        let at = inner.stream_position()?;
        Ok(Self { inner, at, furthest: at, idle: 0 })
    }

    fn moved_to(&mut self, at: u64) -> Result<()> {
        self.at = at;
        if at > self.furthest {
            (self.furthest, self.idle) = (at, 0);
            return Ok(());
        }
        self.idle += 1;
        if self.idle > MOST_IDLE { Err(Error::other("its boxes lead in circles")) } else { Ok(()) }
    }
}

impl<R: Read + Seek> Read for Forward<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        let length = self.inner.read(out)?;
        self.moved_to(self.at.saturating_add(length as u64))?;
        Ok(length)
    }
}

impl<R: Read + Seek> Seek for Forward<R> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let at = self.inner.seek(to)?;
        self.moved_to(at)?;
        Ok(at)
    }
}

/// Boxes that hold others, each behind so many bytes of its own.
const HOLDERS: [(&[u8; 4], u64); 17] = [
    (b"moov", 0),
    (b"mvex", 0),
    (b"trak", 0),
    (b"edts", 0),
    (b"mdia", 0),
    (b"minf", 0),
    (b"dinf", 0),
    (b"dref", 8),
    (b"stbl", 0),
    (b"stsd", 8),
    (b"avc1", 78),
    (b"moof", 0),
    (b"traf", 0),
    (b"udta", 0),
    (b"meta", 4),
    // As QuickTime has it.
    (b"meta", 0),
    (b"ilst", 0),
];

/// Boxes in each other, at most: a film's sample descriptions lie in seven.
const DEEPEST: usize = 16;

/// Why the boxes from one place to another, in a file of some length, would take memory that the file has no bytes for; none
/// where they would not. A parser makes room for what a box says before it reads it.
pub(super) fn overclaim(
    reader: &mut (impl Read + Seek),
    span: (u64, u64),
    length: u64,
) -> Result<Option<String>> {
    overclaim_within(reader, span, length, DEEPEST)
}

fn overclaim_within(
    reader: &mut (impl Read + Seek),
    (from, to): (u64, u64),
    length: u64,
    levels: usize,
) -> Result<Option<String>> {
    let mut at = from;
    while at.saturating_add(16) <= to {
        let mut head = [0_u8; 16];
        reader.seek(SeekFrom::Start(at))?;
        reader.read_exact(&mut head)?;
        let word = |k: usize| u64::from(u32::from_be_bytes([head[k], head[k + 1], head[k + 2], head[k + 3]]));
        let (size, own) = if word(0) == 1 { (word(8) << 32 | word(12), 16) } else { (word(0), 8) };
        if size < own {
            break;
        }
        let (kind, end) = (&head[4..8], at.saturating_add(size));
        if end > length && kind != b"mdat" {
            let name = String::from_utf8_lossy(kind);
            return Ok(Some(format!("the box {name:?} at byte {at} has {size} bytes, the file {length}")));
        }
        for (_, before) in HOLDERS.iter().filter(|(holder, _)| kind == *holder) {
            if levels == 0 {
                return Ok(Some(format!("boxes lie in each other more than {DEEPEST} deep at byte {at}")));
            }
            let inside = overclaim_within(reader, (at + own + before, end.min(to)), length, levels - 1)?;
            if inside.is_some() {
                return Ok(inside);
            }
        }
        let mut counts = [0_u8; 12];
        if (kind == b"stsz" || kind == b"trun") && end - at - own >= 12 {
            reader.seek(SeekFrom::Start(at + own))?;
            reader.read_exact(&mut counts)?;
            let [_, _, _, _, a, b, c, d, e, f, g, h] = counts;
            let (first, second) = (u32::from_be_bytes([a, b, c, d]), u32::from_be_bytes([e, f, g, h]));
            // Sizes that differ stand in a table, which is held against its box.
            let count = if kind == b"trun" { first } else { second.saturating_mul(u32::from(first > 0)) };
            if u64::from(count) > length {
                return Ok(Some(format!("{count} samples are announced, and the file has {length} bytes")));
            }
        }
        at = end;
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use crate::FrameSource;

    const FILM: &[u8] = include_bytes!("../../tests/fixtures/testsrc.mp4");

    /// What the reader says of the film with some bytes at a place from the name of a box.
    fn refusal(kind: &[u8; 4], offset: isize, by: &[u8]) -> String {
        let mut film = FILM.to_vec();
        let at = film.windows(4).position(|w| w == kind).unwrap().checked_add_signed(offset).unwrap();
        film[at..at + by.len()].copy_from_slice(by);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.mp4");
        std::fs::write(&path, film).unwrap();
        FrameSource::open(&path, None).map(Iterator::count).unwrap_err().to_string()
    }

    #[test]
    fn a_box_of_size_zero_inside_another_is_refused_and_not_read_for_ever() {
        let said = refusal(b"avcC", -4, b"\0\0\0\0free");
        assert!(said.contains("circles") && said.contains("copy it again"), "{said}");
    }

    #[test]
    fn more_samples_than_the_file_has_bytes_are_refused_before_they_take_memory() {
        let said = refusal(b"stsz", 8, &[0, 0, 0, 1, 0xff, 0xff, 0xff, 0xff]);
        assert!(said.contains("4294967295 samples") && said.contains("19770 bytes"), "{said}");
    }

    #[test]
    fn a_box_inside_another_that_is_larger_than_the_file_is_refused_before_it_takes_memory() {
        let said = refusal(b"stsd", -4, &[0xff; 4]);
        assert!(said.contains("\"stsd\"") && said.contains("has 4294967295 bytes"), "{said}");
    }

    /// A file of boxes in each other overflowed the stack.
    #[test]
    fn boxes_that_lie_in_each_other_too_deep_are_refused() {
        let levels = 200_000_u32;
        let boxes = (1..=levels).rev().flat_map(|left| [(8 * left).to_be_bytes(), *b"moov"]).flatten();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.mp4");
        std::fs::write(&path, boxes.collect::<Vec<u8>>()).unwrap();
        let said = FrameSource::open(&path, None).map(Iterator::count).unwrap_err().to_string();
        assert!(said.contains("more than 16 deep"), "{said}");
    }

    #[test]
    fn a_box_that_ends_beyond_the_largest_number_is_refused() {
        let size = [&[0, 0, 0, 1][..], b"mdat", &[0xff; 8]].concat();
        let said = refusal(b"ftyp", -4, &size);
        assert!(said.contains("copy it again"), "{said}");
    }
}
