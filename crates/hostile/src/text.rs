//! Mutations of text: words, numbers and lines that are exchanged, moved, repeated and nested.

use crate::Mutator;
use std::ops::Range;

/// Numbers that no measurement has, or that arithmetic cannot hold.
const NUMBERS: [&str; 24] = [
    "",
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "0.5",
    "1e-300",
    "-1e-320",
    "1e300",
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "-nan",
    "inf",
    "-inf",
    "4294967296",
    "-2147483649",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "0xffff",
    "1_000",
];

/// Words of the formats, and what is in none.
const WORDS: [&str; 28] = [
    "=",
    "\"",
    "'",
    "{",
    "}",
    "[",
    "]",
    "[[",
    "]]",
    "(",
    ")",
    "#",
    ",",
    ";",
    ":",
    "\n",
    "\r",
    "\t",
    "\\",
    "\\u0000",
    "\u{0}",
    "\u{feff}",
    "日本",
    "e\u{301}",
    "- ",
    "&a",
    "*a",
    "!!binary ",
];

/// Openings that are repeated to nest deeply.
const NESTS: [&str; 8] = ["[", "{a=", "(", "- ", "[[", "{", "a.", "-("];

/// Bytes at which a word ends.
fn is_between(byte: u8) -> bool {
    byte.is_ascii_whitespace() || b"=,;:[](){}\"'".contains(&byte)
}

/// The parts of some bytes that end behind a byte of a kind, without the empty ones.
fn parts(bytes: &[u8], ends: impl Fn(u8) -> bool) -> Vec<Range<usize>> {
    let mut all = Vec::new();
    let mut from = 0;
    for (at, byte) in bytes.iter().enumerate() {
        if ends(*byte) {
            all.push(from..at + 1);
            from = at + 1;
        }
    }
    all.push(from..bytes.len());
    all
}

/// Words, each without the byte behind it.
fn words(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut all = parts(bytes, is_between);
    for word in &mut all {
        if word.end > word.start && is_between(bytes[word.end - 1]) {
            word.end -= 1;
        }
    }
    all.retain(|word| !word.is_empty());
    all
}

fn is_number(word: &[u8]) -> bool {
    word.iter().any(u8::is_ascii_digit) && word.iter().all(|b| b.is_ascii_digit() || b"+-.eE_".contains(b))
}

fn swap(bytes: &mut Vec<u8>, a: &Range<usize>, b: &Range<usize>) {
    let (a, b) = if a.start <= b.start { (a, b) } else { (b, a) };
    if a.end <= b.start {
        let (first, second) = (bytes[a.clone()].to_vec(), bytes[b.clone()].to_vec());
        drop(bytes.splice(b.clone(), first));
        drop(bytes.splice(a.clone(), second));
    }
}

/// Spoils a text at one place.
pub(crate) fn mutate(mutator: &mut Mutator, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
    match mutator.below(12) {
        0..3 => exchange_number(mutator, bytes),
        3..6 => move_word(mutator, bytes),
        6..9 => move_line(mutator, bytes, seeds),
        9 => {
            let at = mutator.below(bytes.len() + 1);
            let word = *mutator.of(&WORDS);
            drop(bytes.splice(at..at, word.bytes()));
        }
        10 if mutator.chance(4) => {
            let (at, nest) = (mutator.below(bytes.len() + 1), *mutator.of(&NESTS));
            let deep = nest.repeat(mutator.size(2048));
            drop(bytes.splice(at..at, deep.bytes()));
        }
        _ => mutator.mutate(bytes, seeds),
    }
}

fn exchange_number(mutator: &mut Mutator, bytes: &mut Vec<u8>) {
    let mut numbers = words(bytes);
    numbers.retain(|word| is_number(&bytes[word.clone()]));
    if numbers.is_empty() {
        return;
    }
    let at = mutator.of(&numbers).clone();
    let by = match mutator.below(4) {
        0 => bytes[mutator.of(&numbers).clone()].to_vec(),
        1 => f64::from_bits(mutator.next_u64()).to_string().into_bytes(),
        _ => mutator.of(&NUMBERS).bytes().collect(),
    };
    drop(bytes.splice(at, by));
}

fn move_word(mutator: &mut Mutator, bytes: &mut Vec<u8>) {
    let all = words(bytes);
    if all.is_empty() {
        return;
    }
    let (a, b) = (mutator.of(&all).clone(), mutator.of(&all).clone());
    match mutator.below(4) {
        0 => drop(bytes.drain(a)),
        1 => {
            let again = [&bytes[a.clone()], b" "].concat().repeat(mutator.size(32));
            drop(bytes.splice(a.end..a.end, again));
        }
        2 => {
            let word = bytes[b].to_vec();
            drop(bytes.splice(a, word));
        }
        _ => swap(bytes, &a, &b),
    }
}

fn move_line(mutator: &mut Mutator, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
    let all = parts(bytes, |byte| byte == b'\n');
    let (a, b) = (mutator.of(&all).clone(), mutator.of(&all).clone());
    match mutator.below(4) {
        0 => drop(bytes.drain(a)),
        1 => {
            let again = bytes[a.clone()].repeat(mutator.size(16));
            drop(bytes.splice(b.start..b.start, again));
        }
        2 => {
            let other = mutator.of(seeds);
            let lines = parts(other, |byte| byte == b'\n');
            let from = mutator.of(&lines).clone();
            drop(bytes.splice(a.start..a.start, other[from].iter().copied()));
        }
        _ => swap(bytes, &a, &b),
    }
}
