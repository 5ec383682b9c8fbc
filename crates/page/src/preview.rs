//! Small pictures of camera frames.

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::PageError;

/// The longer side of a picture has at most this many pixels: as many as the page has room for.
pub const LONGEST_SIDE_PX: u32 = 640;

/// Quality of the JPEG, 1 to 100: pictures are looked at, not measured.
const QUALITY: u8 = 75;

/// A picture of a frame as JPEG, for [`crate::Server::preview`].
///
/// `pixel(x, y)` is the colour (sRGB) of a column and row of the frame. A frame whose longer side exceeds
/// [`LONGEST_SIDE_PX`] is shrunk by the least whole factor that fits; each pixel is then the mean of two by
/// two of the frame, which hides aliasing and reads few of the frame's pixels.
///
/// # Errors
/// [`PageError::PictureSize`] where a side is 0 or above 65535, [`PageError::Encode`] where the encoder
/// fails.
pub fn encode(
    width_px: u32,
    height_px: u32,
    pixel: impl Fn(usize, usize) -> [u8; 3],
) -> Result<Vec<u8>, PageError> {
    let sides = 1..=u32::from(u16::MAX);
    if !sides.contains(&width_px) || !sides.contains(&height_px) {
        return Err(PageError::PictureSize { width_px, height_px });
    }
    let factor = width_px.max(height_px).div_ceil(LONGEST_SIDE_PX);
    let (columns, rows) = ((width_px / factor).max(1), (height_px / factor).max(1));
    // The mean of two by two pixels, half a factor apart.
    let mean = |column: u32, row: u32| {
        let at = |right: u32, down: u32| {
            let x = (column * factor + right * factor / 2).min(width_px - 1);
            let y = (row * factor + down * factor / 2).min(height_px - 1);
            pixel(x as usize, y as usize).map(u16::from)
        };
        let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        std::array::from_fn(|k| (four.iter().map(|c| c[k]).sum::<u16>() / 4) as u8)
    };
    let color =
        |column, row| if factor == 1 { pixel(column as usize, row as usize) } else { mean(column, row) };
    let pixels = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
    let rgb: Vec<u8> = pixels.flat_map(|(column, row)| color(column, row)).collect();
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
        .encode(&rgb, columns, rows, ExtendedColorType::Rgb8)
        .map_err(|source| PageError::Encode { width_px: columns, height_px: rows, source })?;
    Ok(jpeg)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_frames_are_shrunk_in_place() {
        // Left half red, right half blue, 1080p: 640 x 360 with the edge in the middle.
        let jpeg = encode(1920, 1080, |x, _| if x < 960 { [220, 20, 20] } else { [20, 20, 220] }).unwrap();
        let picture = image::load_from_memory(&jpeg).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (640, 360));
        for (x, want) in [(300, [220, 20, 20]), (340, [20, 20, 220])] {
            let seen = picture.get_pixel(x, 180).0;
            assert!(seen.iter().zip(want).all(|(a, b)| a.abs_diff(b) < 12), "column {x}: {seen:?}");
        }
    }

    #[test]
    fn a_frame_that_fits_keeps_its_size() {
        let picture = image::load_from_memory(&encode(640, 480, |_, _| [9, 9, 9]).unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (640, 480));
        let picture = image::load_from_memory(&encode(3, 2000, |_, _| [9, 9, 9]).unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (1, 500));
    }

    #[test]
    fn sizes_that_no_jpeg_has_are_refused() {
        for (width_px, height_px) in [(0, 10), (10, 0), (70_000, 10)] {
            let error = encode(width_px, height_px, |_, _| [0; 3]).unwrap_err();
            assert!(matches!(error, PageError::PictureSize { .. }), "{error}");
            assert!(error.to_string().contains("1 to 65535"), "{error}");
        }
    }
}
