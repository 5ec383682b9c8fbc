//! A Parquet file that is checked before the library reads it: that counts up to the length that a list claims to have, two
//! thousand million, whatever the file holds.

use bytes::{Buf, Bytes};
use parquet::errors::{ParquetError, Result};
use parquet::file::reader::{ChunkReader, Length};
use std::io::{ErrorKind, Read};

/// The file ends in the length of its last header and four letters.
const TAIL: usize = 8;
/// Structures within structures, as many as the library follows.
const DEEPEST: usize = 64;

/// The bytes of a file whose last header has been walked.
pub(crate) struct Walked(Bytes);

impl Walked {
    /// A file whose last header holds together; one that has none is left to the library to refuse.
    pub(crate) fn new(bytes: Bytes) -> Result<Self> {
        let before = bytes.len().saturating_sub(TAIL);
        let length = bytes.get(before..before + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
        if let Some(from) = length.and_then(|length| before.checked_sub(length as usize)) {
            Walk::new(&bytes[from..before]).whole()?;
        }
        Ok(Self(bytes))
    }
}

impl Length for Walked {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }
}

impl ChunkReader for Walked {
    type T = Ending;

    /// The library reads headers of pages by this, and asks for it at places without a header too, so that these are not walked.
    fn get_read(&self, start: u64) -> Result<Self::T> {
        let from = usize::try_from(start).ok().filter(|from| *from <= self.0.len());
        let rest = self.0.slice(from.ok_or_else(beyond)?..);
        Ok(Ending(rest.reader()))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes> {
        self.0.get_bytes(start, length)
    }
}

/// Refuses to read on at its end: the library passes over what is not there without noticing.
pub(crate) struct Ending(bytes::buf::Reader<Bytes>);

impl Read for Ending {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        match self.0.read(to)? {
            0 if !to.is_empty() => Err(ErrorKind::UnexpectedEof.into()),
            count => Ok(count),
        }
    }
}

fn beyond() -> ParquetError {
    ParquetError::EOF("a header holds more than the file".to_owned())
}

/// A walk through a structure of Thrift's compact protocol, whose fields and elements take at least a byte each: where that is
/// not so in the library, it is counted so here.
struct Walk<'a> {
    bytes: &'a [u8],
    /// Elements that may still follow.
    elements: usize,
}

impl<'a> Walk<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, elements: bytes.len() }
    }

    fn whole(mut self) -> Result<()> {
        self.pass(12, DEEPEST)
    }

    fn skip(&mut self, count: usize) -> Result<()> {
        self.bytes = self.bytes.get(count..).ok_or_else(beyond)?;
        Ok(())
    }

    fn byte(&mut self) -> Result<u8> {
        let (first, rest) = self.bytes.split_first().ok_or_else(beyond)?;
        self.bytes = rest;
        Ok(*first)
    }

    /// A number of seven bits a byte; of one that is too large what fits.
    fn number(&mut self) -> Result<usize> {
        let (mut number, mut shift) = (0_u64, 0_u32);
        loop {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f).wrapping_shl(shift);
            shift = shift.wrapping_add(7);
            if byte & 0x80 == 0 {
                return usize::try_from(number).map_err(|_| beyond());
            }
        }
    }

    /// Elements of the same kinds one after the other.
    fn elements(&mut self, count: usize, kinds: &[u8], depth: usize) -> Result<()> {
        self.elements = self.elements.checked_sub(count).ok_or_else(beyond)?;
        (0..count).try_for_each(|_| kinds.iter().try_for_each(|kind| self.pass(*kind, depth)))
    }

    /// Passes over what a kind of field has, by the numbers of the protocol.
    fn pass(&mut self, kind: u8, depth: usize) -> Result<()> {
        let depth = depth.checked_sub(1).ok_or_else(beyond)?;
        match kind {
            1 | 2 => Ok(()),
            3 => self.skip(1),
            4..=6 => self.number().map(|_| ()),
            7 => self.skip(8),
            8 => {
                let length = self.number()?;
                self.skip(length)
            }
            9 | 10 => {
                let head = self.byte()?;
                let count = if head >> 4 == 15 { self.number()? } else { usize::from(head >> 4) };
                self.elements(count, &[head & 15], depth)
            }
            11 => match self.number()? {
                0 => Ok(()),
                count => {
                    let kinds = self.byte()?;
                    self.elements(count, &[kinds >> 4, kinds & 15], depth)
                }
            },
            12 => loop {
                let head = self.byte()?;
                if head & 15 == 0 {
                    return Ok(());
                }
                if head >> 4 == 0 {
                    self.number()?;
                }
                self.pass(head & 15, depth)?;
            },
            13 => self.skip(16),
            other => Err(ParquetError::General(format!("a header has a field of the unknown kind {other}"))),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_list_longer_than_the_file_is_refused_before_it_is_counted() {
        // Field 1, a list of more than two thousand million: of truth values, of doubles, of lists of such.
        for list in [
            &[0xf1, 0xff, 0xff, 0xff, 0xff, 0x07][..],
            &[0xf7, 0xff, 0xff, 0xff, 0xff, 0x07],
            &[0x29, 0xf1, 90],
        ] {
            let header = [&[0x19], list, &[0; 32]].concat();
            assert!(Walk::new(&header).whole().is_err(), "{list:?}");
        }
        // Field 1 a number, field 2 three bytes, field 3 a list of two numbers, field 4 a structure with field 7, a double.
        let whole =
            [0x15, 0x81, 0x01, 0x18, 3, 1, 2, 3, 0x19, 0x25, 4, 6, 0x1c, 0x77, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        Walk::new(&whole).whole().unwrap();
        assert!((0..whole.len()).all(|cut| Walk::new(&whole[..cut]).whole().is_err()));
    }

    #[test]
    fn nothing_is_read_beyond_the_end() {
        let file = Walked(Bytes::from_static(&[0x15, 2, 0, 9]));
        let mut reader = file.get_read(0).unwrap();
        assert_eq!(std::io::copy(&mut reader.by_ref().take(4), &mut std::io::sink()).unwrap(), 4);
        assert!(std::io::copy(&mut reader.by_ref().take(8), &mut std::io::sink()).is_err());
        assert!(file.get_read(5).is_err());
    }
}
