//! Seeded mutations that know what an input is made of.

use crate::{Kind, numbers, text};
use mavsight_random::Random;
use std::ops::Range;

/// Integers at which counters turn over, signs change or tables end.
const INTEGERS: [u64; 14] = [
    0,
    1,
    2,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0x8000,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_ffff,
];

/// Most mutations of one input.
const MOST: usize = 8;

/// Draws mutations; the same seed and number give the same ones on every machine.
pub struct Mutator {
    random: Random,
}

impl Mutator {
    /// The mutations of the input of a number under a seed.
    pub fn new(seed: u64, number: u64) -> Self {
        Self { random: Random::new(seed, number) }
    }

    /// An input made of one of some small ones.
    pub fn mutated(&mut self, kind: Kind, seeds: &[Vec<u8>]) -> Vec<u8> {
        if kind == Kind::Numbers || seeds.is_empty() {
            return numbers::drawn(self);
        }
        let mut bytes = seeds[self.below(seeds.len())].clone();
        // Every tenth is whole, or has one mutation alone.
        let count = if self.chance(10) { self.below(2) } else { 1 + self.below(MOST) };
        if kind == Kind::Film {
            return crate::targets::film::mutated(self, &bytes, count);
        }
        for _ in 0..count {
            match kind {
                Kind::Text | Kind::Table => text::mutate(self, &mut bytes, seeds),
                _ => self.mutate(&mut bytes, seeds),
            }
        }
        bytes
    }

    /// A number below another, 0 where that is 0.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.random.next_u64() % count.max(1) as u64) as usize
    }

    /// True in one of so many cases.
    pub fn chance(&mut self, of: usize) -> bool {
        self.below(of) == 0
    }

    /// Small and large numbers alike, from 1 to another.
    pub(crate) fn size(&mut self, most: usize) -> usize {
        let shift = self.below(most.max(1).ilog2() as usize + 1);
        (most >> shift).max(1)
    }

    /// One of several.
    pub(crate) fn of<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[self.below(all.len())]
    }

    pub(crate) fn next_u64(&mut self) -> u64 {
        self.random.next_u64()
    }

    /// A piece of some bytes; most lie at the beginning or the end, where headers and indices are.
    pub(crate) fn piece(&mut self, length: usize, most: usize) -> Range<usize> {
        let at = match self.below(4) {
            0 => self.below(length.min(256)),
            1 => length - self.below(length.min(256)).min(length),
            _ => self.below(length),
        };
        let at = at.min(length);
        at..at + self.below(most + 1).min(length - at)
    }

    /// Spoils bytes of an unknown format at one place.
    pub(crate) fn mutate(&mut self, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
        let piece = self.piece(bytes.len(), 16);
        match self.below(10) {
            0 => bytes.truncate(piece.start),
            1 => drop(bytes.drain(piece)),
            2 => {
                let again = bytes[piece.clone()].repeat(self.size(64));
                drop(bytes.splice(piece.start..piece.start, again));
            }
            3 => {
                let fill = *self.of(&[0x00, 0xff, 0x7f, 0x80, b' ', b'9']);
                bytes[piece].fill(fill);
            }
            4 => {
                let whole = *self.of(&INTEGERS);
                let width = *self.of(&[1, 2, 4, 8]);
                let big = whole << (64 - 8 * width);
                let coded = if self.chance(2) { whole.to_le_bytes() } else { big.to_be_bytes() };
                let end = (piece.start + width).min(bytes.len());
                bytes[piece.start..end].copy_from_slice(&coded[..end - piece.start]);
            }
            5 => {
                // A counter that is off by a few.
                if let Some(byte) = bytes.get_mut(piece.start) {
                    *byte = byte.wrapping_add(self.below(9) as u8).wrapping_sub(4);
                }
            }
            6 => {
                let digits: Vec<u8> = piece.clone().map(|_| *self.of(b"0123456789[];:,\n\0 ")).collect();
                bytes[piece].copy_from_slice(&digits);
            }
            7 => {
                let other = self.of(seeds).clone();
                let from = self.piece(other.len(), 512);
                drop(bytes.splice(piece, other[from].iter().copied()));
            }
            8 => {
                let bit = self.below(8);
                if let Some(byte) = bytes.get_mut(piece.start) {
                    *byte ^= 1 << bit;
                }
            }
            _ => {
                for at in piece {
                    bytes[at] = self.below(256) as u8;
                }
            }
        }
    }
}
