//! Still images and numbered sequences of them.

use super::Opened;
use crate::SessionError;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use mavsight_geometry::ImageSize;
use mavsight_vision::Frame;
use std::path::{Path, PathBuf};

/// A file name with a counter such as `%05d` or `%d`.
struct Pattern {
    folder: PathBuf,
    before: String,
    after: String,
    digits: usize,
}

impl Pattern {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        let (before, rest) = name.split_once('%')?;
        let (width, after) = rest.split_once('d')?;
        let digits = match width {
            "" => 0,
            _ => width.strip_prefix('0')?.parse().ok().filter(|n| (1..=18).contains(n))?,
        };
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Some(Self { folder, before: before.to_owned(), after: after.to_owned(), digits })
    }

    fn file(&self, number: u64) -> PathBuf {
        self.folder.join(format!("{}{number:0width$}{}", self.before, self.after, width = self.digits))
    }

    fn number(&self, name: &str) -> Option<u64> {
        let number = name.strip_prefix(&self.before)?.strip_suffix(&self.after)?;
        let plain = number.bytes().all(|b| b.is_ascii_digit());
        number.parse().ok().filter(|n| plain && self.file(*n).file_name().is_some_and(|f| f == name))
    }

    fn numbers(&self) -> Vec<u64> {
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let mut numbers: Vec<u64> =
            entries.flatten().filter_map(|e| self.number(e.file_name().to_str()?)).collect();
        numbers.sort_unstable();
        numbers
    }
}

/// Whether a path is a pattern of an image sequence, which may turn out to be empty when it is opened.
pub(crate) fn is_pattern(path: &Path) -> bool {
    Pattern::of(path).is_some()
}

pub(crate) fn open(path: &Path, frame_rate_hz: Option<f64>) -> Result<Opened, SessionError> {
    let refuse = || SessionError::NoFrames(path.to_owned());
    let pattern = Pattern::of(path).ok_or_else(refuse)?;
    let numbers = pattern.numbers();
    let first = *numbers.first().ok_or_else(refuse)?;
    let rate_hz = frame_rate_hz.filter(|r| r.is_finite() && *r > 0.0).ok_or_else(|| {
        let detail =
            "an image sequence has no time stamps: give frame_rate_hz of this camera in the session file";
        SessionError::value(path, "frame_rate_hz", detail)
    })?;
    let size = read_image(&pattern.file(first))?.size;
    let declared = Some(numbers.len());
    let mut last = first;
    let frames = numbers.into_iter().flat_map(move |number| {
        let gap = (number - last > 1).then(|| {
            let detail = format!(
                "the sequence has {} and later frames but not the {} from this one on: put them there or \
                 renumber the sequence",
                pattern.file(last).display(),
                number - last - 1
            );
            Err(SessionError::file(&pattern.file(last + 1), detail))
        });
        last = number;
        let t_ns = crate::ns_from_s((number - first) as f64 / rate_hz);
        let frame = frame_of_size(&pattern.file(number), size).map(|frame| (t_ns, frame));
        gap.into_iter().chain(std::iter::once(frame))
    });
    Ok(Opened {
        size,
        declared,
        declared_s: None,
        quarters: 0,
        is_reordered: Some(false),
        frames: Box::new(frames),
    })
}

fn frame_of_size(file: &Path, size: ImageSize) -> Result<Frame, SessionError> {
    let frame = read_image(file)?;
    if frame.size != size {
        let detail = format!(
            "the image is {}×{} but those before are {}×{}: one recording has one size",
            frame.size.width_px, frame.size.height_px, size.width_px, size.height_px
        );
        return Err(SessionError::file(file, detail));
    }
    Ok(frame)
}

/// Bytes of a decoded picture: 66 million pixels of 8-bit sRGB, more than cameras film. A file of two kilobytes may say that it has
/// billions.
const MOST_BYTES: u64 = 200_000_000;

/// Reads a PNG or JPEG image as 8-bit sRGB; transparency is dropped.
///
/// # Errors
/// A file that is missing, not such an image, or larger than 200 MB when decoded.
pub fn read_image(path: &Path) -> Result<Frame, SessionError> {
    crate::error::require_file(path, "image")?;
    let broken = |e: String| SessionError::file(path, format!("not a readable PNG or JPEG image: {e}"));
    let decoder = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|e| SessionError::io(path, "read it", e))?
        .into_decoder()
        .map_err(|e| broken(e.to_string()))?;
    if decoder.total_bytes() > MOST_BYTES {
        let (width, height) = decoder.dimensions();
        let detail = format!(
            "the image is {width}×{height}, {} MB when decoded, and at most {} MB are read: make it smaller",
            decoder.total_bytes() / 1_000_000,
            MOST_BYTES / 1_000_000
        );
        return Err(SessionError::file(path, detail));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|e| broken(e.to_string()))?.into_rgb8();
    let size = ImageSize { width_px: image.width(), height_px: image.height() };
    Frame::from_rgb(size, image.into_raw()).map_err(|e| broken(e.to_string()))
}

/// Writes a frame as a PNG file, next to its place and then renamed into it.
///
/// # Errors
/// A place that cannot be written.
pub fn write_png(path: &Path, frame: &Frame) -> Result<(), SessionError> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut bytes,
        &frame.to_rgb(),
        frame.size.width_px,
        frame.size.height_px,
        image::ExtendedColorType::Rgb8,
        ImageFormat::Png,
    )
    .map_err(|e| SessionError::express(path, "express it as PNG", e))?;
    crate::write_whole(path, bytes.get_ref())
}
