//! How the samples of a topic lie in a record.

use crate::topic::Field;
use std::sync::Arc;

/// The type of a number in a record, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl Kind {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number at a place of a record; NaN where the record ends before it.
    pub(crate) fn number(self, record: &[u8], at: usize) -> f64 {
        fn bytes<const N: usize>(record: &[u8], at: usize) -> Option<[u8; N]> {
            record.get(at..at.checked_add(N)?)?.try_into().ok()
        }
        let number = match self {
            Self::I8 => bytes(record, at).map(|b| i8::from_le_bytes(b).into()),
            Self::U8 => bytes(record, at).map(|b| u8::from_le_bytes(b).into()),
            Self::I16 => bytes(record, at).map(|b| i16::from_le_bytes(b).into()),
            Self::U16 => bytes(record, at).map(|b| u16::from_le_bytes(b).into()),
            Self::I32 => bytes(record, at).map(|b| i32::from_le_bytes(b).into()),
            Self::U32 => bytes(record, at).map(|b| u32::from_le_bytes(b).into()),
            Self::I64 => bytes(record, at).map(|b| i64::from_le_bytes(b) as f64),
            Self::U64 => bytes(record, at).map(|b| u64::from_le_bytes(b) as f64),
            Self::F16 => bytes(record, at).map(|b| half(u16::from_le_bytes(b))),
            Self::F32 => bytes(record, at).map(|b| f32::from_le_bytes(b).into()),
            Self::F64 => bytes(record, at).map(f64::from_le_bytes),
        };
        number.unwrap_or(f64::NAN)
    }
}

/// A number of IEEE 754 binary16.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    match exponent {
        0 => sign * fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => sign * f64::INFINITY,
        31 => f64::NAN,
        _ => sign * (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    }
}

/// Where a number lies in a record, and by what it is multiplied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub(crate) at: usize,
    pub(crate) kind: Kind,
    pub(crate) scale: f64,
}

impl Place {
    /// Whether its numbers are exact in 32 bits, as floats.
    pub(crate) fn is_single(self) -> bool {
        self.scale == 1.0 && (self.kind.size() < 4 || self.kind == Kind::F32)
    }

    pub(crate) fn number(self, record: &[u8]) -> f64 {
        self.kind.number(record, self.at) * self.scale
    }
}

/// The numbers of a record: the fields, and where each of them lies.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Layout {
    pub(crate) fields: Arc<[Field]>,
    pub(crate) places: Arc<[Place]>,
}

/// Bytes that the definitions of a log may need in memory: those of real logs need a tenth of it.
const MOST_DEFINED: usize = 16 << 20;

/// What the definitions of a log need in memory, which a few bytes of a hostile one could multiply.
#[derive(Debug, Default)]
pub(crate) struct Budget(usize);

impl Budget {
    /// Adds a definition; whether all of them are not too many.
    pub(crate) fn add(&mut self, bytes: usize) -> bool {
        self.0 = self.0.saturating_add(bytes);
        self.0 <= MOST_DEFINED
    }

    /// Adds a field.
    pub(crate) fn add_field(&mut self, name: &str) -> bool {
        self.add(size_of::<Field>() + size_of::<Place>() + name.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_their_bytes() {
        let record = [0xff, 0xfe, 0x00, 0x80, 0x00, 0x00, 0xc0, 0x3f];
        assert_eq!(Kind::I8.number(&record, 0), -1.0);
        assert_eq!(Kind::U16.number(&record, 0), f64::from(0xfeffu32));
        assert_eq!(Kind::I32.number(&record, 0), f64::from(i32::from_le_bytes([0xff, 0xfe, 0, 0x80])));
        assert_eq!(Kind::F32.number(&record, 4), 1.5);
        assert!(Kind::F64.number(&record, 1).is_nan() && Kind::U8.number(&record, usize::MAX).is_nan());
    }

    #[test]
    fn halves_are_those_of_the_standard() {
        let known = [(0x3c00, 1.0), (0xc000, -2.0), (0x7bff, 65504.0), (0x0001, 5.960_464_477_539_063e-8)];
        for (bits, value) in known {
            assert_eq!(half(bits), value, "{bits:#x}");
        }
        assert!(half(0x7c00) == f64::INFINITY && half(0x7e00).is_nan() && half(0x8000).is_sign_negative());
    }
}
