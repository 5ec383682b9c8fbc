//! Frames from recordings: MP4 and image sequences in-process, everything else by the ffmpeg program.

mod color;
mod ffmpeg;
mod images;
mod mp4;
mod mp4_times;

use crate::SessionError;
use mavsight_geometry::ImageSize;
use mavsight_vision::Frame;
use std::path::{Path, PathBuf};

pub(crate) use images::sequence_exists;
pub use images::{read_image, write_png};

/// Frames in order of time, each with the middle of its exposure in nanoseconds.
pub(crate) type Frames = Box<dyn Iterator<Item = Result<(i64, Frame), SessionError>> + Send>;

/// What a reader yields before the counting around it.
pub(crate) struct Opened {
    pub(crate) size: ImageSize,
    pub(crate) declared: Option<usize>,
    pub(crate) frames: Frames,
}

/// One camera's recording.
///
/// An iterator that ends after its first error. A recording without frames, and one with another number of frames
/// than it announces, is an error as well.
pub struct FrameSource {
    path: PathBuf,
    opened: Opened,
    offset_ns: i64,
    read: usize,
    done: bool,
}

impl FrameSource {
    /// Opens a recording: a name with `%d` or `%05d` is an image sequence and needs `frame_rate_hz`; `.mp4`, `.m4v`
    /// and `.mov` with H.264 are decoded in-process; anything else goes through the ffmpeg program, whose name the
    /// environment variable `MAVSIGHT_FFMPEG` overrides.
    ///
    /// # Errors
    /// A file that is missing, damaged, empty, or needs an ffmpeg that is not there.
    pub fn open(path: &Path, frame_rate_hz: Option<f64>) -> Result<Self, SessionError> {
        if images::is_pattern(path) {
            return Ok(Self::around(path, images::open(path, frame_rate_hz)?));
        }
        crate::error::require_file(path, "video")?;
        let reason = match extension(path).as_str() {
            "mp4" | "m4v" | "mov" => match mp4::open(path)? {
                mp4::Attempt::Opened(opened) => return Ok(Self::around(path, opened)),
                mp4::Attempt::Unsupported(reason) => reason,
            },
            "" => "it has no extension that names its format".to_owned(),
            other => format!("only MP4 with H.264 is decoded without it, not .{other}"),
        };
        Ok(Self::around(path, ffmpeg::open(path, &ffmpeg::program(), &reason)?))
    }

    /// Opens a video through the given ffmpeg program, whatever its format.
    ///
    /// # Errors
    /// A program that cannot be started, or a file that it refuses.
    pub fn open_with_ffmpeg(path: &Path, program: &str) -> Result<Self, SessionError> {
        crate::error::require_file(path, "video")?;
        Ok(Self::around(path, ffmpeg::open(path, program, "it was asked for")?))
    }

    fn around(path: &Path, opened: Opened) -> Self {
        Self { path: path.to_owned(), opened, offset_ns: 0, read: 0, done: false }
    }

    /// The same frames with `lateness_s` taken off their time stamps.
    pub fn delayed_by(mut self, lateness_s: f64) -> Self {
        self.offset_ns = crate::ns_from_s(lateness_s);
        self
    }

    /// The file or pattern.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Size of every frame.
    pub fn size(&self) -> ImageSize {
        self.opened.size
    }

    /// Number of frames that the recording announces.
    pub fn declared_frames(&self) -> Option<usize> {
        self.opened.declared
    }

    fn end(&self) -> Option<SessionError> {
        if self.read == 0 {
            return Some(SessionError::NoFrames { path: self.path.clone() });
        }
        let declared = self.opened.declared.filter(|n| *n != self.read)?;
        Some(SessionError::FrameCount { path: self.path.clone(), declared, read: self.read })
    }
}

impl std::fmt::Debug for FrameSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FrameSource")
            .field("path", &self.path)
            .field("size", &self.opened.size)
            .field("declared", &self.opened.declared)
            .field("read", &self.read)
            .finish_non_exhaustive()
    }
}

impl Iterator for FrameSource {
    type Item = Result<(i64, Frame), SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        match self.opened.frames.next() {
            Some(Ok((t_ns, frame))) => {
                self.read += 1;
                Some(Ok((t_ns - self.offset_ns, frame)))
            }
            Some(Err(error)) => {
                self.done = true;
                Some(Err(error))
            }
            None => {
                self.done = true;
                self.end().map(Err)
            }
        }
    }
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
