//! The bytes of a log in order, a part at a time.

use std::io::{ErrorKind, Read, Result};

/// Bytes fetched at once.
const PART: usize = 1 << 20;

/// A reader that shows the next bytes before they are consumed.
pub(crate) struct Window<'a> {
    source: &'a mut dyn Read,
    buffer: Vec<u8>,
    from: usize,
    until: usize,
    consumed: u64,
    has_ended: bool,
}

impl<'a> Window<'a> {
    pub(crate) fn new(source: &'a mut dyn Read) -> Self {
        Self { source, buffer: Vec::new(), from: 0, until: 0, consumed: 0, has_ended: false }
    }

    /// Place of the next byte in the file.
    pub(crate) fn offset(&self) -> u64 {
        self.consumed
    }

    /// The next bytes: at least `count` of them, or all that the file still has.
    pub(crate) fn next(&mut self, count: usize) -> Result<&[u8]> {
        if self.until - self.from < count && !self.has_ended {
            self.fetch(count)?;
        }
        Ok(&self.buffer[self.from..self.until])
    }

    /// Goes on by some of the bytes that [`Window::next`] has shown.
    pub(crate) fn consume(&mut self, count: usize) {
        let count = count.min(self.until - self.from);
        self.from += count;
        self.consumed += count as u64;
    }

    fn fetch(&mut self, count: usize) -> Result<()> {
        self.buffer.copy_within(self.from..self.until, 0);
        self.until -= self.from;
        self.from = 0;
        self.buffer.resize(self.buffer.len().max(count).max(PART), 0);
        while self.until < count {
            match self.source.read(&mut self.buffer[self.until..]) {
                Ok(0) => {
                    self.has_ended = true;
                    break;
                }
                Ok(read) => self.until += read,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives one byte at a time.
    struct Slow<'a>(&'a [u8]);

    impl Read for Slow<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
            self.0.read(&mut buffer[..1])
        }
    }

    #[test]
    fn bytes_come_in_order_whatever_is_asked_for() {
        let all: Vec<u8> = (0..=255).collect();
        let mut source = Slow(&all);
        let mut window = Window::new(&mut source);
        assert!(window.next(3).unwrap().starts_with(&[0, 1, 2]));
        window.consume(2);
        assert!(window.next(5).unwrap().starts_with(&[2, 3, 4, 5, 6]));
        window.consume(250);
        assert_eq!(window.offset(), 7, "no more than was shown");
        assert_eq!(window.next(1000).unwrap(), &all[7..]);
        window.consume(1000);
        assert!(window.next(1).unwrap().is_empty());
        assert_eq!(window.offset(), 256);
    }
}
