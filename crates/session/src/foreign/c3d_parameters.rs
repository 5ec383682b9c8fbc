//! The parameter section of a C3D file: groups of named, typed arrays.

use crate::SessionError;
use std::collections::BTreeMap;
use std::path::Path;

pub(super) const BLOCK: usize = 512;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Processor {
    Intel,
    Dec,
    Mips,
}

impl Processor {
    pub(super) fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            84 => Some(Self::Intel),
            85 => Some(Self::Dec),
            86 => Some(Self::Mips),
            _ => None,
        }
    }

    pub(super) fn int(self, b: [u8; 2]) -> i16 {
        if self == Self::Mips { i16::from_be_bytes(b) } else { i16::from_le_bytes(b) }
    }

    /// DEC's F float has its halves swapped and is four times IEEE's of the same bits.
    pub(super) fn float(self, b: [u8; 4]) -> f64 {
        match self {
            Self::Intel => f64::from(f32::from_le_bytes(b)),
            Self::Mips => f64::from(f32::from_be_bytes(b)),
            Self::Dec => f64::from(f32::from_le_bytes([b[2], b[3], b[0], b[1]])) / 4.0,
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameter {
    kind: i8,
    dims: Vec<usize>,
    data: Vec<u8>,
    processor: Processor,
}

impl Parameter {
    /// Its numbers; none of text.
    pub(super) fn numbers(&self) -> Vec<f64> {
        match self.kind {
            1 => self.data.iter().map(|b| f64::from(*b as i8)).collect(),
            2 => self.data.chunks_exact(2).map(|b| f64::from(self.processor.int([b[0], b[1]]))).collect(),
            4 => self.data.chunks_exact(4).map(|b| self.processor.float([b[0], b[1], b[2], b[3]])).collect(),
            _ => Vec::new(),
        }
    }

    /// Counts that go to 65535 in 16 bits without a sign.
    pub(super) fn counts(&self) -> Vec<f64> {
        let unsigned = |x: f64| if self.kind == 2 && x < 0.0 { x + 65536.0 } else { x };
        self.numbers().into_iter().map(unsigned).collect()
    }

    /// Its texts, spaces at their ends taken off.
    pub(super) fn texts(&self) -> Vec<String> {
        if self.kind != -1 {
            return Vec::new();
        }
        let length = self.dims.first().copied().unwrap_or(1).max(1);
        self.data
            .chunks(length)
            .map(|c| String::from_utf8_lossy(c).trim_matches([' ', '\0']).to_owned())
            .collect()
    }
}

pub(super) type Parameters = BTreeMap<String, Parameter>;

/// Reads the section that begins at a block of a file.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    first_block: usize,
) -> Result<(Processor, Parameters), SessionError> {
    let wrong = |detail: String| SessionError::value(path, "parameters", detail);
    let cut = || wrong("they lie beyond the end: the file breaks off".into());
    let start = first_block.saturating_sub(1) * BLOCK;
    let head = bytes.get(start..start + 4).ok_or_else(cut)?;
    let processor = Processor::from_byte(head[3])
        .ok_or_else(|| wrong(format!("processor type {}: 84, 85 or 86 is known", head[3])))?;
    let mut at = start + 4;
    let mut groups: BTreeMap<u8, String> = BTreeMap::new();
    let mut found: Vec<(u8, String, Parameter)> = Vec::new();
    loop {
        let head = bytes.get(at..at + 2).ok_or_else(cut)?;
        let (length, id) = (usize::from((head[0] as i8).unsigned_abs()), head[1] as i8);
        if length == 0 || id == 0 {
            break;
        }
        let after = at + 2 + length;
        let name = bytes.get(at + 2..after).ok_or_else(cut)?;
        let name = String::from_utf8_lossy(name).trim().to_uppercase();
        let step = bytes.get(after..after + 2).ok_or_else(cut)?;
        let step = processor.int([step[0], step[1]]);
        if id < 0 {
            groups.insert(id.unsigned_abs(), name);
        } else {
            found.push((id.unsigned_abs(), name, parameter(bytes, after + 2, processor).ok_or_else(cut)?));
        }
        if step <= 0 {
            break;
        }
        at = after + step as usize;
    }
    let named =
        found.into_iter().filter_map(|(id, name, p)| Some((format!("{}:{name}", groups.get(&id)?), p)));
    Ok((processor, named.collect()))
}

fn parameter(bytes: &[u8], at: usize, processor: Processor) -> Option<Parameter> {
    let kind = *bytes.get(at)? as i8;
    let count = usize::from(*bytes.get(at + 1)?);
    let dims: Vec<usize> = bytes.get(at + 2..at + 2 + count)?.iter().map(|d| usize::from(*d)).collect();
    let size = dims.iter().try_fold(usize::from(kind.unsigned_abs()), |n, d| n.checked_mul(*d))?;
    let from = at + 2 + count;
    let data = bytes.get(from..from.checked_add(size)?)?.to_vec();
    Some(Parameter { kind, dims, data, processor })
}

/// A section under construction, for Intel.
pub(super) struct Section {
    bytes: Vec<u8>,
}

impl Section {
    pub(super) fn new() -> Self {
        Self { bytes: vec![1, 0x50, 0, 84] }
    }

    pub(super) fn group(&mut self, id: u8, name: &str) {
        self.bytes.extend([name.len() as u8, (-(id as i8)) as u8]);
        self.bytes.extend(name.as_bytes());
        self.bytes.extend(3i16.to_le_bytes());
        self.bytes.push(0);
    }

    fn push(&mut self, group: u8, name: &str, kind: i8, dims: &[u8], data: &[u8]) {
        self.bytes.extend([name.len() as u8, group]);
        self.bytes.extend(name.as_bytes());
        let step = 2 + 2 + dims.len() + data.len() + 1;
        self.bytes.extend((step as i16).to_le_bytes());
        self.bytes.extend([kind as u8, dims.len() as u8]);
        self.bytes.extend(dims);
        self.bytes.extend(data);
        self.bytes.push(0);
    }

    pub(super) fn ints(&mut self, group: u8, name: &str, values: &[u16]) {
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let dims = [values.len() as u8];
        self.push(group, name, 2, if values.len() == 1 { &[] } else { &dims }, &data);
    }

    pub(super) fn float(&mut self, group: u8, name: &str, value: f32) {
        self.push(group, name, 4, &[], &value.to_le_bytes());
    }

    /// Texts of at most 255 bytes, at most 255 of them.
    pub(super) fn texts(&mut self, group: u8, name: &str, texts: &[String]) {
        let length = texts.iter().map(String::len).max().unwrap_or(0).max(1);
        let mut data = Vec::new();
        for text in texts {
            data.extend(text.as_bytes());
            data.resize(data.len() + length - text.len(), b' ');
        }
        self.push(group, name, -1, &[length as u8, texts.len() as u8], &data);
    }

    /// Whole blocks, their number in the third byte.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bytes.extend([0, 0]);
        let blocks = self.bytes.len().div_ceil(BLOCK);
        self.bytes.resize(blocks * BLOCK, 0);
        self.bytes[2] = blocks as u8;
        self.bytes
    }
}
