//! The planes of uncompressed video as programs pass them on: packed RGB, or YUV 4:2:0.

use super::color::YuvCoding;
use mavsight_geometry::ImageSize;
use mavsight_vision::{Frame, Pixels};
use std::io::{self, Read};

/// What the planes of a stream hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Planes {
    Rgb,
    Yuv(YuvCoding),
}

impl Planes {
    /// Reads the planes of a frame; none where the stream ends before their first byte.
    pub(super) fn read(self, size: ImageSize, input: &mut impl Read) -> io::Result<Option<Frame>> {
        let area = size.area_px();
        let chroma = size.width_px.div_ceil(2) as usize * size.height_px.div_ceil(2) as usize;
        let mut is_first = true;
        let mut plane = |length: usize| {
            let mut bytes = Vec::with_capacity(length);
            input.take(length as u64).read_to_end(&mut bytes)?;
            let is_end = std::mem::replace(&mut is_first, false) && bytes.is_empty();
            let is_whole = is_end || bytes.len() == length;
            let cut = || io::Error::new(io::ErrorKind::UnexpectedEof, "it is not whole");
            if is_whole { Ok(Some(bytes).filter(|_| !is_end)) } else { Err(cut()) }
        };
        let pixels = match self {
            Self::Rgb => plane(3 * area)?.map(Pixels::Rgb),
            Self::Yuv(YuvCoding { full_range, matrix }) => match plane(area)? {
                Some(y) => {
                    let [u, v] = [plane(chroma)?, plane(chroma)?].map(Option::unwrap_or_default);
                    Some(Pixels::Yuv420 { y, u, v, full_range, matrix })
                }
                None => None,
            },
        };
        Ok(pixels.map(|pixels| Frame { size, pixels }))
    }
}
