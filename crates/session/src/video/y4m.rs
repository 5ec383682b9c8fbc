//! Uncompressed video that can be written frame by frame and read after any end: YUV4MPEG2 with a time stamp
//! in each frame's header.
//!
//! The format is the one of the mjpegtools (yuv4mpeg(5)): a line of parameters, then for each frame a line
//! that begins with FRAME and its planes. Parameters that begin with X are an application's own: `XT` of a
//! frame is its time stamp in nanoseconds, and a file of packed red, green and blue says `XPIXELS=RGB24`.
//! Other programs pass over both.

use super::Opened;
use super::color::YuvCoding;
use super::planes::Planes;
use crate::decimal::LATEST_NS;
use crate::{SessionError, Storage, Syncer};
use mavsight_geometry::ImageSize;
use mavsight_vision::{Frame, Pixels, YuvMatrix};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest line of parameters that is believed to be one.
const LONGEST_LINE: u64 = 4096;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Header {
    size: ImageSize,
    planes: Planes,
    /// Frames a second, for frames without a stamp; none where it is not known.
    rate_hz: Option<f64>,
}

impl Header {
    /// Reads the first line's parameters; what is wrong with them where they are not understood.
    fn parse(line: &str) -> Result<Self, String> {
        let mut words = line.trim_end().split(' ');
        if words.next() != Some("YUV4MPEG2") {
            return Err("it does not begin with YUV4MPEG2".into());
        }
        let mut size = ImageSize { width_px: 0, height_px: 0 };
        let (mut coding, mut rate_hz, mut format, mut rgb) = (YuvCoding::default(), None, "420jpeg", false);
        for word in words {
            if let Some(tag) = word.strip_prefix('X') {
                match tag {
                    "COLORRANGE=FULL" => coding.full_range = true,
                    "MATRIX=709" => coding.matrix = YuvMatrix::Bt709,
                    "PIXELS=RGB24" => rgb = true,
                    _ => {}
                }
                continue;
            }
            let mut letters = word.chars();
            let (key, value) = (letters.next(), letters.as_str());
            match key {
                Some('W') => size.width_px = value.parse().unwrap_or(0),
                Some('H') => size.height_px = value.parse().unwrap_or(0),
                Some('C') => format = value,
                Some('F') => {
                    let rate = value
                        .split_once(':')
                        .and_then(|(a, b)| Some(a.parse::<f64>().ok()? / b.parse::<f64>().ok()?));
                    rate_hz = rate.filter(|rate| crate::RATES_HZ.contains(rate));
                }
                _ => {}
            }
        }
        // Beyond any camera, and below a gigabyte to hold.
        if !(1..=1 << 14).contains(&size.width_px) || !(1..=1 << 14).contains(&size.height_px) {
            return Err(format!("its size is {} by {}", size.width_px, size.height_px));
        }
        let planes = if rgb { Planes::Rgb } else { Planes::Yuv(coding) };
        if !rgb && !matches!(format, "420" | "420jpeg" | "420mpeg2" | "420paldv") {
            return Err(format!(
                "its planes are C{format}, and only C420 is read: convert it with -pix_fmt yuv420p"
            ));
        }
        Ok(Self { size, planes, rate_hz })
    }

    /// The time of a frame, from its stamp or from its number; what is wrong where neither says it.
    fn t_ns(&self, number: usize, stamp: Option<String>) -> Result<i64, String> {
        match (stamp, self.rate_hz) {
            (Some(stamp), _) => {
                let t_ns =
                    stamp.parse().ok().filter(|t_ns: &i64| t_ns.unsigned_abs() <= LATEST_NS.unsigned_abs());
                t_ns.ok_or_else(|| {
                    format!("its stamp XT={stamp} is no number of nanoseconds within 146 years of zero")
                })
            }
            (None, Some(rate_hz)) => Ok(crate::ns_from_s(number as f64 / rate_hz)),
            (None, None) => {
                Err("it has no stamp, and the first line no rate of 0.01 to 100000 frames a second: convert \
                                 the film with ffmpeg -r RATE"
                    .to_owned())
            }
        }
    }

    fn of(frame: &Frame, rate_hz: f64) -> String {
        let ImageSize { width_px, height_px } = frame.size;
        let planes = match &frame.pixels {
            Pixels::Rgb(_) => "C444 XPIXELS=RGB24".to_owned(),
            Pixels::Yuv420 { full_range, matrix, .. } => {
                let range = if *full_range { "FULL" } else { "LIMITED" };
                let matrix = if *matrix == YuvMatrix::Bt709 { "709" } else { "601" };
                format!("C420jpeg XCOLORRANGE={range} XMATRIX={matrix}")
            }
        };
        format!(
            "YUV4MPEG2 W{width_px} H{height_px} F{}:1000 Ip A1:1 {planes}\n",
            (1e3 * rate_hz).round() as u64
        )
    }
}

/// Reads frames of a stream whose first line has been read.
pub(super) struct Y4mFrames<R> {
    input: R,
    header: Header,
    read: usize,
}

/// What comes next in a stream.
pub(super) enum Piece {
    /// A whole frame and the stamp in its header, as it stands there.
    Frame(Option<String>, Frame),
    /// The end, after a whole frame.
    End,
    /// The end, within a frame.
    Cut,
    /// Something that is no frame.
    Wrong,
}

impl<R: BufRead> Y4mFrames<R> {
    pub(super) fn new(mut input: R) -> Result<Self, String> {
        let line = line_of(&mut input).map_err(|e| e.to_string())?;
        let header = Header::parse(&String::from_utf8_lossy(&line))?;
        Ok(Self { input, header, read: 0 })
    }

    pub(super) fn piece(&mut self) -> Piece {
        let line = match line_of(&mut self.input) {
            Ok(line) if line.is_empty() => return Piece::End,
            Ok(line) if line.ends_with(b"\n") => line,
            _ => return Piece::Cut,
        };
        if !line.starts_with(b"FRAME") {
            return Piece::Wrong;
        }
        let line = String::from_utf8_lossy(&line);
        let stamp = line.split_whitespace().find_map(|word| word.strip_prefix("XT=")).map(str::to_owned);
        self.read += 1;
        match self.header.planes.read(self.header.size, &mut self.input) {
            Ok(Some(frame)) => Piece::Frame(stamp, frame),
            _ => Piece::Cut,
        }
    }
}

fn line_of(input: &mut impl BufRead) -> std::io::Result<Vec<u8>> {
    let mut line = Vec::new();
    input.take(LONGEST_LINE).read_until(b'\n', &mut line)?;
    Ok(line)
}

pub(super) fn open(path: &Path) -> Result<Opened, SessionError> {
    let broken = |detail: String| SessionError::frame(path, 0, detail);
    let file = File::open(path).map_err(|e| SessionError::io(path, "read it", e))?;
    if file.metadata().is_ok_and(|m| m.len() == 0) {
        return Err(SessionError::NoFrames(path.to_owned()));
    }
    let frames = Y4mFrames::new(BufReader::with_capacity(1 << 16, file)).map_err(broken)?;
    let size = frames.header.size;
    let frames = Recorded { path: path.to_owned(), frames, ended: false };
    Ok(Opened {
        size,
        declared: None,
        declared_s: None,
        quarters: 0,
        is_reordered: Some(false),
        frames: Box::new(frames),
    })
}

struct Recorded {
    path: PathBuf,
    frames: Y4mFrames<BufReader<File>>,
    ended: bool,
}

impl Iterator for Recorded {
    type Item = Result<(i64, Frame), SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let number = self.frames.read;
        let wrong = match self.frames.piece() {
            Piece::Frame(stamp, frame) => match self.frames.header.t_ns(number, stamp) {
                Ok(t_ns) => return Some(Ok((t_ns, frame))),
                Err(why) => {
                    self.ended = true;
                    return Some(Err(SessionError::at(
                        &self.path,
                        format!(", frame {number} (from 0)"),
                        why,
                    )));
                }
            },
            Piece::End => None,
            Piece::Cut => Some("the recording was cut off within it, and is whole before it"),
            Piece::Wrong => Some("what stands there is no frame"),
        };
        self.ended = true;
        wrong.map(|detail| Err(SessionError::frame(&self.path, number, detail)))
    }
}

/// Writes frames as they come, so that whatever happens the file is whole but for its last frame.
pub struct Y4mWriter {
    path: PathBuf,
    file: Box<dyn Storage>,
    rate_hz: f64,
    bytes: u64,
    line: String,
}

impl Y4mWriter {
    /// Begins a file, of which nothing is written before the first frame. The rate is what a program goes by
    /// that does not know of time stamps.
    ///
    /// # Errors
    /// A place that cannot be written.
    pub fn create(path: &Path, rate_hz: f64) -> Result<Self, SessionError> {
        let file = File::create(path).map_err(|e| SessionError::io(path, "write it", e))?;
        Ok(Self::new(path, Box::new(file), rate_hz))
    }

    /// Begins on an open file, which `path` names in errors.
    pub fn new(path: &Path, file: Box<dyn Storage>, rate_hz: f64) -> Self {
        Self { path: path.to_owned(), file, rate_hz, bytes: 0, line: String::new() }
    }

    /// Bytes so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// What waits until the frames so far are on the disk itself.
    ///
    /// # Errors
    /// What the system says.
    pub fn syncer(&self) -> std::io::Result<Syncer> {
        self.file.syncer()
    }

    /// Adds a frame with its time stamp, and hands it to the system.
    ///
    /// # Errors
    /// A full disk, or whatever else the system says. The file is then cut back to its whole frames.
    pub fn push(&mut self, t_ns: i64, frame: &Frame) -> Result<(), SessionError> {
        use std::fmt::Write as _;
        self.line.clear();
        if self.bytes == 0 {
            self.line = Header::of(frame, self.rate_hz);
        }
        // Writing to a string cannot fail.
        let _ = writeln!(self.line, "FRAME XT={t_ns}");
        let planes: [&[u8]; 3] = match &frame.pixels {
            Pixels::Rgb(rgb) => [rgb, &[], &[]],
            Pixels::Yuv420 { y, u, v, .. } => [y, u, v],
        };
        let written = self
            .file
            .write_all(self.line.as_bytes())
            .and_then(|()| planes.iter().try_for_each(|plane| self.file.write_all(plane)));
        if let Err(source) = written {
            // What is left of the frame is passed over by readers too, should it not come off.
            let _ = self.file.cut(self.bytes);
            return Err(SessionError::io(&self.path, "write it", source));
        }
        self.bytes += self.line.len() as u64 + planes.iter().map(|p| p.len() as u64).sum::<u64>();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameSource;

    const SIZE: ImageSize = ImageSize { width_px: 7, height_px: 5 };

    fn frames() -> Vec<(i64, Frame)> {
        let yuv = |k: u8| {
            let planes = [vec![k; 35], vec![k + 1; 12], vec![k + 2; 12]];
            Frame::from_yuv420(SIZE, planes, true, YuvMatrix::Bt709).unwrap()
        };
        (0..5_u8).map(|k| (i64::from(k) * 16_666_667 + 5, yuv(10 * k))).collect()
    }

    fn written(path: &Path, frames: &[(i64, Frame)]) {
        let mut writer = Y4mWriter::create(path, 60.0).unwrap();
        frames.iter().for_each(|(t, f)| writer.push(*t, f).unwrap());
        assert_eq!(writer.bytes(), std::fs::metadata(path).unwrap().len());
    }

    /// Stamps that are none, and a rate that is not known, became times at 25 Hz.
    #[test]
    fn a_frame_whose_time_is_not_known_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film.y4m");
        let times = |rate: &str, stamp: &str| {
            let head = format!("YUV4MPEG2 W2 H2 F{rate} C420jpeg\nFRAME{stamp}\n");
            std::fs::write(&path, [head.as_bytes(), &[0; 6]].concat()).unwrap();
            FrameSource::open(&path, None).and_then(|mut frames| frames.next().unwrap()).map(|frame| frame.0)
        };
        assert_eq!((times("30:1", "").unwrap(), times("0:0", " XT=7").unwrap()), (0, 7));
        for (rate, stamp, says) in [
            ("0:0", "", "has no stamp"),
            ("1e300:1", "", "has no stamp"),
            ("30:1", " XT=33333333.0", "XT=33333333.0 is no number"),
            ("30:1", " XT=9200000000000000000", "within 146 years"),
        ] {
            let refused = times(rate, stamp).unwrap_err().to_string();
            assert!(refused.contains(says), "{refused}");
        }
    }

    #[test]
    fn frames_and_stamps_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let rgb = Frame::from_rgb(SIZE, (0..105).collect()).unwrap();
        for (name, frames) in [("yuv", frames()), ("rgb", vec![(-3, rgb.clone()), (9, rgb)])] {
            let path = folder.path().join(format!("{name}.y4m"));
            written(&path, &frames);
            let source = FrameSource::open(&path, None).unwrap();
            assert_eq!(source.size(), SIZE);
            assert_eq!(source.map(Result::unwrap).collect::<Vec<_>>(), frames);
        }
    }

    /// Cut anywhere, all frames before the cut are there, and the cut is reported.
    #[test]
    fn a_file_that_was_cut_is_whole_up_to_its_last_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut.y4m");
        let frames = frames();
        written(&path, &frames);
        let bytes = std::fs::read(&path).unwrap();
        let header = bytes.iter().position(|b| *b == b'\n').unwrap() + 1;
        for cut in header..bytes.len() {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let read: Vec<_> = FrameSource::open(&path, None).unwrap().collect();
            let whole = read.iter().filter(|r| r.is_ok()).count();
            for (got, want) in read.iter().flatten().zip(&frames) {
                assert_eq!(got, want);
            }
            let behind = bytes[header..cut].windows(6).filter(|w| w == b"FRAME ").count();
            assert!(whole + 1 >= behind && whole <= behind, "{cut}: {whole} of {behind}");
        }
    }

    #[test]
    fn what_other_programs_write_is_read_and_what_is_none_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.y4m");
        let mut bytes = b"YUV4MPEG2 W4 H2 F30000:1001 Ip C420mpeg2 XYSCSS=420MPEG2\n".to_vec();
        for k in 0..3 {
            bytes.extend(b"FRAME\n");
            bytes.extend([k; 12]);
        }
        std::fs::write(&path, &bytes).unwrap();
        let stamps: Vec<i64> = FrameSource::open(&path, None).unwrap().map(|f| f.unwrap().0).collect();
        assert_eq!(stamps, [0, 33_366_667, 66_733_333]);
        // The word beside the size begins with a letter of two bytes.
        for wrong in [
            "YUV4MPEG2 W4 H2 é C444\n",
            "YUV4MPEG2 W0 H2\n",
            "YUV4MPEG2 W4 H2 C444\n",
            "RIFF\n",
            "YUV4MPEG2 W99999 H2\n",
        ] {
            std::fs::write(&path, wrong).unwrap();
            assert!(FrameSource::open(&path, None).is_err(), "{wrong}");
        }
    }
}
