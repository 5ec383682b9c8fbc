//! Photographs in a page.

use crate::ReportError;
use base64::Engine;
use image::codecs::jpeg::JpegEncoder;
use mavsight_vision::Frame;

/// Quality at which blocks of JPEG are not seen at the size of a page.
const QUALITY: u8 = 82;

/// A frame as the address of a picture within the page, no wider than so many pixels.
///
/// # Errors
/// [`ReportError::Picture`] for a frame whose size is not that of its pixels.
pub fn picture_address(frame: &Frame, most_width_px: u32) -> Result<String, ReportError> {
    let (width_px, height_px) = (frame.size.width_px, frame.size.height_px);
    let whole = image::RgbImage::from_raw(width_px, height_px, frame.to_rgb()).ok_or(ReportError::Picture)?;
    let shown = if width_px > most_width_px {
        let height_px = (u64::from(height_px) * u64::from(most_width_px) / u64::from(width_px)).max(1);
        image::imageops::thumbnail(&whole, most_width_px, u32::try_from(height_px).unwrap_or(1))
    } else {
        whole
    };
    let mut bytes = Vec::new();
    shown
        .write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY))
        .map_err(|_| ReportError::Picture)?;
    Ok(format!("data:image/jpeg;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_vision::ImageSize;

    #[test]
    fn a_wide_frame_is_shown_smaller() {
        let frame = |width_px: u32| {
            let size = ImageSize { width_px, height_px: width_px / 2 };
            let noise = |k: usize| (k.wrapping_mul(2_654_435_761) >> 7) as u8;
            Frame::from_rgb(size, (0..3 * size.area_px()).map(noise).collect()).unwrap()
        };
        let (small, large) =
            (picture_address(&frame(64), 64).unwrap(), picture_address(&frame(512), 64).unwrap());
        assert!(small.starts_with("data:image/jpeg;base64,/9j/") && large.len() < 2 * small.len());
    }
}
