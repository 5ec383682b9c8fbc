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
    /// A frame of that size and kind.
    pub(super) fn blank(self, size: ImageSize) -> Frame {
        let half = |n: u32| (n as usize).div_ceil(2);
        let chroma = half(size.width_px) * half(size.height_px);
        let pixels = match self {
            Self::Rgb => Pixels::Rgb(vec![0; 3 * size.area_px()]),
            Self::Yuv(YuvCoding { full_range, matrix }) => Pixels::Yuv420 {
                y: vec![0; size.area_px()],
                u: vec![0; chroma],
                v: vec![0; chroma],
                full_range,
                matrix,
            },
        };
        Frame { size, pixels }
    }
}

/// Fills a frame's planes without allocating; false where the stream ends before their first byte.
pub(super) fn fill(input: &mut impl Read, frame: &mut Frame) -> io::Result<bool> {
    let planes: [&mut [u8]; 3] = match &mut frame.pixels {
        Pixels::Rgb(rgb) => [rgb, &mut [], &mut []],
        Pixels::Yuv420 { y, u, v, .. } => [y, u, v],
    };
    let mut is_first = true;
    for plane in planes {
        let mut filled = 0;
        while filled < plane.len() {
            match input.read(&mut plane[filled..]) {
                Ok(0) if is_first => return Ok(false),
                Ok(0) => return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "it is not whole")),
                Ok(n) => filled += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
            is_first = false;
        }
    }
    Ok(true)
}
