//! How an H.264 stream codes colour: the video usability information of its sequence parameter set.

use mavsight_vision::YuvMatrix;

/// Range and matrix of a YUV video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct YuvCoding {
    pub(crate) full_range: bool,
    pub(crate) matrix: YuvMatrix,
}

impl Default for YuvCoding {
    /// Limited range and BT.601: what ffmpeg's scaler assumes where the stream does not say.
    fn default() -> Self {
        Self { full_range: false, matrix: YuvMatrix::Bt601 }
    }
}

impl YuvCoding {
    /// From the code points of ITU-T H.273: 1 is BT.709 and so, closely enough to find colours, is BT.2020
    /// (9, 10).
    pub(crate) fn from_h273(full_range: bool, matrix_coefficients: u32) -> Self {
        let matrix =
            if matches!(matrix_coefficients, 1 | 9 | 10) { YuvMatrix::Bt709 } else { YuvMatrix::Bt601 };
        Self { full_range, matrix }
    }

    /// From a sequence parameter set (ITU-T H.264, 7.3.2.1.1 and E.1.1), its NAL header byte included; the
    /// default where it does not say or cannot be read.
    pub(crate) fn from_sps(nal: &[u8]) -> Self {
        parse_sps(nal).unwrap_or_default()
    }
}

/// Bits of a NAL unit with emulation prevention taken out; `None` at its end.
struct Bits {
    bytes: Vec<u8>,
    at: usize,
}

impl Bits {
    fn of(nal: &[u8]) -> Self {
        let mut zeros = 0;
        let is_content = |byte: &u8| {
            let is_emulation = zeros >= 2 && *byte == 3;
            zeros = if *byte == 0 { zeros + 1 } else { 0 };
            !is_emulation
        };
        Self { bytes: nal.iter().copied().filter(is_content).collect(), at: 0 }
    }

    fn bit(&mut self) -> Option<u32> {
        let byte = *self.bytes.get(self.at / 8)?;
        let bit = (byte >> (7 - self.at % 8)) & 1;
        self.at += 1;
        Some(u32::from(bit))
    }

    fn flag(&mut self) -> Option<bool> {
        self.bit().map(|b| b == 1)
    }

    fn bits(&mut self, count: u32) -> Option<u32> {
        (0..count).try_fold(0u32, |value, _| Some((value << 1) | self.bit()?))
    }

    /// Unsigned exponential Golomb code.
    fn ue(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while self.bit()? == 0 {
            zeros += 1;
            if zeros > 31 {
                return None;
            }
        }
        Some((1u32 << zeros) - 1 + self.bits(zeros)?)
    }

    /// Passes over exponential Golomb codes, of either kind.
    fn skip(&mut self, count: u32) -> Option<()> {
        (0..count).try_for_each(|_| self.ue().map(drop))
    }

    /// Signed exponential Golomb code.
    fn se(&mut self) -> Option<i32> {
        let code = i64::from(self.ue()?);
        i32::try_from(if code % 2 == 1 { (code + 1) / 2 } else { -code / 2 }).ok()
    }
}

fn parse_sps(nal: &[u8]) -> Option<YuvCoding> {
    let mut bits = Bits::of(nal);
    bits.bits(8)?;
    let profile = bits.bits(8)?;
    bits.bits(16)?;
    bits.ue()?;
    if matches!(profile, 100 | 110 | 122 | 244 | 44 | 83 | 86 | 118 | 128 | 138 | 139 | 134 | 135) {
        skip_high_profile(&mut bits)?;
    }
    bits.skip(1)?;
    match bits.ue()? {
        0 => bits.skip(1)?,
        1 => {
            bits.flag()?;
            bits.skip(2)?;
            let count = bits.ue()?.min(255);
            bits.skip(count)?;
        }
        _ => {}
    }
    bits.skip(1)?;
    bits.flag()?;
    bits.skip(2)?;
    if !bits.flag()? {
        bits.flag()?;
    }
    bits.flag()?;
    if bits.flag()? {
        bits.skip(4)?;
    }
    if bits.flag()? { parse_vui(&mut bits) } else { None }
}

fn skip_high_profile(bits: &mut Bits) -> Option<()> {
    let chroma_format = bits.ue()?;
    if chroma_format == 3 {
        bits.flag()?;
    }
    bits.skip(2)?;
    bits.flag()?;
    if bits.flag()? {
        for list in 0..if chroma_format == 3 { 12 } else { 8 } {
            if bits.flag()? {
                skip_scaling_list(bits, if list < 6 { 16 } else { 64 })?;
            }
        }
    }
    Some(())
}

fn skip_scaling_list(bits: &mut Bits, length: usize) -> Option<()> {
    let (mut last, mut next) = (8i32, 8i32);
    for _ in 0..length {
        if next != 0 {
            next = (last + bits.se()?).rem_euclid(256);
        }
        if next != 0 {
            last = next;
        }
    }
    Some(())
}

fn parse_vui(bits: &mut Bits) -> Option<YuvCoding> {
    const EXTENDED_SAR: u32 = 255;
    if bits.flag()? && bits.bits(8)? == EXTENDED_SAR {
        bits.bits(32)?;
    }
    if bits.flag()? {
        bits.flag()?;
    }
    if !bits.flag()? {
        return None;
    }
    bits.bits(3)?;
    let full_range = bits.flag()?;
    let matrix = if bits.flag()? {
        bits.bits(16)?;
        bits.bits(8)?
    } else {
        2
    };
    Some(YuvCoding::from_h273(full_range, matrix))
}
