//! Frames from recordings: MP4 and image sequences in-process, everything else by the ffmpeg program.

mod audio;
mod color;
mod ffmpeg;
mod images;
mod live;
mod mp4;
mod mp4_guard;
mod mp4_times;
mod planes;
mod write;
mod y4m;

use crate::{FieldOrder, SessionError};
use mavsight_geometry::ImageSize;
use mavsight_vision::Frame;
use std::path::{Path, PathBuf};

pub use audio::find_clap;
pub use ffmpeg::program as ffmpeg_program;
pub(crate) use images::is_pattern;
pub use images::{read_image, write_png};
pub use live::LiveVideo;
pub use write::VideoWriter;
pub use y4m::Y4mWriter;

/// Frames in order of time, each with the middle of its exposure in nanoseconds.
pub(crate) type Frames = Box<dyn Iterator<Item = Result<(i64, Frame), SessionError>> + Send>;

/// What a reader yields before the counting around it.
pub(crate) struct Opened {
    pub(crate) size: ImageSize,
    pub(crate) declared: Option<usize>,
    /// Length from the first frame to the end of the last, where the file declares that in place of a number.
    pub(crate) declared_s: Option<f64>,
    /// Quarters by which the container has frames turned clockwise.
    pub(crate) quarters: u8,
    /// Whether frames are coded in another order than they are shown, so that some are predicted from both sides; none where the
    /// container does not say it.
    pub(crate) is_reordered: Option<bool>,
    pub(crate) frames: Frames,
}

/// One camera's recording, the right way up where the container says which that is.
///
/// An error before the first frame is the last item; one behind it is a fault at that place, and what can be
/// read after it follows. A recording without frames, and one with another number of frames than it
/// announces, ends with an error as well.
pub struct FrameSource {
    path: PathBuf,
    opened: Opened,
    fields: Option<Fields>,
    read: usize,
    span_ns: Option<(i64, i64)>,
    done: bool,
}

/// Fields of an interlaced recording that wait: a frame's time is known to be its first field's, the second's
/// is half a frame later, which the next frame shows.
struct Fields {
    order: FieldOrder,
    frame: Option<(i64, Frame)>,
    second: Option<(i64, Frame)>,
    interval_ns: i64,
}

impl FrameSource {
    /// Opens a recording: a name with `%d` or `%05d` is an image sequence and needs `frame_rate_hz`; `.mp4`,
    /// `.m4v` and `.mov` with H.264 are decoded in-process, `.y4m` is read as it is; anything else goes
    /// through the ffmpeg program, whose name the environment variable `MAVSIGHT_FFMPEG` overrides.
    ///
    /// # Errors
    /// A file that is missing, damaged, empty, or needs an ffmpeg that is not there.
    pub fn open(path: &Path, frame_rate_hz: Option<f64>) -> Result<Self, SessionError> {
        Self::open_or(path, frame_rate_hz, &ffmpeg::program())
    }

    /// [`Self::open`] with the given program in place of ffmpeg.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub fn open_or(path: &Path, frame_rate_hz: Option<f64>, program: &str) -> Result<Self, SessionError> {
        if images::is_pattern(path) {
            return Ok(Self::around(path, images::open(path, frame_rate_hz)?));
        }
        crate::error::require_file(path, "video")?;
        let reason = match extension(path).as_str() {
            "mp4" | "m4v" | "mov" => match mp4::open(path) {
                Ok(opened) => return Ok(Self::around(path, opened)),
                Err(mp4::Failure::Fatal(error)) => return Err(error),
                Err(mp4::Failure::Unsupported(reason)) => reason,
            },
            "y4m" => return Ok(Self::around(path, y4m::open(path)?)),
            "" => "it has no extension that names its format".to_owned(),
            other => format!("only MP4 with H.264 is decoded without it, not .{other}"),
        };
        Ok(Self::around(path, ffmpeg::open(path, program, &reason)?))
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
        let path = path.to_owned();
        Self { path, opened, fields: None, read: 0, span_ns: None, done: false }
    }

    /// The fields of an interlaced recording one by one, at twice the rate, each filled up to a whole frame.
    /// Rows are those of the recording as it is stored.
    pub fn fields(mut self, order: FieldOrder) -> Self {
        self.fields = Some(Fields { order, frame: None, second: None, interval_ns: 0 });
        self
    }

    /// Size of every frame.
    pub fn size(&self) -> ImageSize {
        let ImageSize { width_px, height_px } = self.opened.size;
        let is_turned = self.opened.quarters % 2 == 1;
        if is_turned { ImageSize { width_px: height_px, height_px: width_px } } else { self.opened.size }
    }

    /// Whether it is a sequence of images rather than a film.
    pub fn is_images(&self) -> bool {
        images::is_pattern(&self.path)
    }

    /// Number of frames that the recording announces.
    pub fn declared_frames(&self) -> Option<usize> {
        let fields = if self.fields.is_some() { 2 } else { 1 };
        self.opened.declared.map(|n| n * fields)
    }

    /// Whether some frames may be predicted from those before and after them: the recording has them in another order than they
    /// are shown, or a container of which that is not known.
    pub fn may_be_reordered(&self) -> bool {
        self.opened.is_reordered.unwrap_or(true)
    }

    /// Unit vector (u, v) in the image along which the sensor's rows follow each other.
    pub fn readout(&self) -> [f64; 2] {
        [[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]][usize::from(self.opened.quarters % 4)]
    }

    fn end(&self) -> Option<SessionError> {
        let Some((first_ns, last_ns)) = self.span_ns else {
            return Some(SessionError::NoFrames(self.path.clone()));
        };
        let interval_s = (last_ns - first_ns) as f64 * 1e-9 / self.read.saturating_sub(1).max(1) as f64;
        // A declared length is rounded, may lack the last frame's length, and of some containers is the end.
        let by_length = self.opened.declared_s.filter(|_| self.read > 1).and_then(|length_s| {
            let begins_s = (first_ns as f64 * 1e-9).max(0.0);
            let frames = ((length_s - begins_s) / interval_s).round().max(0.0) as usize;
            (frames > self.read + 2).then_some(frames)
        });
        let declared = self.opened.declared.or(by_length).filter(|n| *n != self.read)?;
        Some(SessionError::FrameCount { path: self.path.clone(), declared, read: self.read })
    }

    /// The next frame of the file as it is stored.
    fn whole(&mut self) -> Option<Result<(i64, Frame), SessionError>> {
        if self.done {
            return None;
        }
        match self.opened.frames.next() {
            Some(Ok((t_ns, frame))) => {
                self.read += 1;
                let first_ns = self.span_ns.map_or(t_ns, |s| s.0);
                self.span_ns = Some((first_ns, t_ns));
                Some(Ok((t_ns, frame)))
            }
            Some(Err(error)) => {
                self.done = self.read == 0;
                Some(Err(error))
            }
            None => {
                self.done = true;
                self.end().map(Err)
            }
        }
    }
}

impl Fields {
    /// Takes a whole frame, and yields the first field of the one before.
    fn take(&mut self, next: Option<(i64, Frame)>) -> Option<(i64, Frame)> {
        let waiting = std::mem::replace(&mut self.frame, next);
        let (t_ns, frame) = waiting?;
        if let Some((next_ns, _)) = &self.frame {
            self.interval_ns = next_ns - t_ns;
        }
        let top_first = self.order == FieldOrder::TopFirst;
        self.second = Some((t_ns + self.interval_ns / 2, frame.field(!top_first)));
        Some((t_ns, frame.field(top_first)))
    }
}

impl std::fmt::Debug for FrameSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FrameSource").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Iterator for FrameSource {
    type Item = Result<(i64, Frame), SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        let quarters = self.opened.quarters;
        let upright =
            |(t_ns, frame): (i64, Frame)| (t_ns, if quarters == 0 { frame } else { frame.turned(quarters) });
        let Some(mut fields) = self.fields.take() else { return self.whole().map(|item| item.map(upright)) };
        let mut item = fields.second.take().map(Ok);
        while item.is_none() {
            item = match self.whole() {
                Some(Ok(frame)) => fields.take(Some(frame)).map(Ok),
                Some(Err(error)) => Some(Err(error)),
                None if fields.frame.is_some() => fields.take(None).map(Ok),
                None => break,
            };
        }
        self.fields = Some(fields);
        item.map(|item| item.map(upright))
    }
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
