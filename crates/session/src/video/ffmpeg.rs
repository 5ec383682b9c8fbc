//! Any other recording, by the ffmpeg and ffprobe programs as child processes.

use super::Opened;
use super::color::YuvCoding;
use super::planes::Planes;
use crate::SessionError;
use mavsight_geometry::ImageSize;
use mavsight_vision::{Frame, YuvMatrix};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// The ffmpeg program: the environment variable `MAVSIGHT_FFMPEG`, or the one on the search path.
pub fn program() -> String {
    std::env::var("MAVSIGHT_FFMPEG").ok().filter(|p| !p.is_empty()).unwrap_or_else(|| "ffmpeg".into())
}

/// ffprobe from the same installation.
fn probe_program(ffmpeg: &str) -> String {
    match ffmpeg.rfind("ffmpeg") {
        Some(at) => format!("{}ffprobe{}", &ffmpeg[..at], &ffmpeg[at + "ffmpeg".len()..]),
        None => ffmpeg.to_owned(),
    }
}

struct Probe {
    size: ImageSize,
    planes: Planes,
    quarters: u8,
    declared_s: Option<f64>,
}

/// Opens a video; `reason` says why ffmpeg is needed, for the case that it is not there.
pub(crate) fn open(path: &Path, ffmpeg: &str, reason: &str) -> Result<Opened, SessionError> {
    let missing = |program: &str| SessionError::NeedsFfmpeg {
        path: path.to_owned(),
        reason: reason.to_owned(),
        program: program.to_owned(),
    };
    let Probe { size, planes, quarters, declared_s } = probe(path, &probe_program(ffmpeg), missing)?;
    // The pixel format has the range of the source, so that nothing is rescaled.
    let format = match planes {
        Planes::Rgb => "rgb24",
        Planes::Yuv(coding) if coding.full_range => "yuvj420p",
        Planes::Yuv(_) => "yuv420p",
    };
    let mut command = Command::new(ffmpeg);
    command
        .args(["-hide_banner", "-nostdin", "-nostats", "-loglevel", "info", "-copyts", "-noautorotate", "-i"])
        .arg(path)
        .args(["-map", "0:v:0", "-an", "-sn", "-vf", "showinfo=checksum=0", "-fps_mode", "passthrough"])
        .args(["-pix_fmt", format, "-f", "rawvideo", "pipe:1"]);
    let Process { child, stdout, stderr } = start(command, path, reason)?;
    let listener = Listener::new(stderr);
    let frames =
        FfmpegFrames { path: path.to_owned(), child, stdout, listener, size, planes, read: 0, ended: false };
    Ok(Opened { size, declared: None, declared_s, quarters, is_reordered: None, frames: Box::new(frames) })
}

pub(super) struct Process {
    pub(super) child: Child,
    pub(super) stdout: ChildStdout,
    pub(super) stderr: ChildStderr,
}

/// Starts ffmpeg on a recording; `reason` says why it is needed, for the case that it is not there.
pub(super) fn start(mut command: Command, path: &Path, reason: &str) -> Result<Process, SessionError> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|_| SessionError::NeedsFfmpeg {
        path: path.to_owned(),
        reason: reason.to_owned(),
        program: command.get_program().to_string_lossy().into_owned(),
    })?;
    match (child.stdout.take(), child.stderr.take()) {
        (Some(stdout), Some(stderr)) => Ok(Process { child, stdout, stderr }),
        _ => Err(SessionError::ffmpeg(path, "it has no output")),
    }
}

fn probe(path: &Path, program: &str, missing: impl Fn(&str) -> SessionError) -> Result<Probe, SessionError> {
    let output = Command::new(program)
        .args(["-v", "error", "-select_streams", "v:0", "-of", "default=noprint_wrappers=1", "-show_entries"])
        .arg("stream=width,height,pix_fmt,color_range,color_space,duration:stream_tags=DURATION:stream_side_data=rotation")
        .arg(path)
        .stdin(Stdio::null())
        .output()
        .map_err(|_| missing(program))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let value =
        |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('=')).unwrap_or("");
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        let last: Vec<&str> = words.lines().rev().take(3).collect();
        let detail = last.into_iter().rev().collect::<Vec<_>>().join("; ");
        let detail = format!("{detail}: the file is damaged or not a video; copy it again");
        return Err(SessionError::ffmpeg(path, detail));
    }
    let (Ok(width_px), Ok(height_px)) = (value("width").parse(), value("height").parse()) else {
        return Err(SessionError::NoFrames(path.to_owned()));
    };
    let format = value("pix_fmt");
    let planes = if ["rgb", "bgr", "gbr", "pal8"].iter().any(|name| format.contains(name)) {
        Planes::Rgb
    } else {
        let full_range = format.starts_with("yuvj") || value("color_range") == "pc";
        let wide = matches!(value("color_space"), "bt709" | "bt2020nc" | "bt2020c");
        Planes::Yuv(YuvCoding { full_range, matrix: if wide { YuvMatrix::Bt709 } else { YuvMatrix::Bt601 } })
    };
    // ffprobe counts degrees anticlockwise.
    let quarters = value("rotation").parse::<f64>().map_or(0, |d| (-d / 90.0).round().rem_euclid(4.0) as u8);
    let declared_s = value("duration").parse().ok().or_else(|| seconds(value("TAG:DURATION")));
    Ok(Probe { size: ImageSize { width_px, height_px }, planes, quarters, declared_s })
}

/// Hours, minutes and seconds with colons between, as Matroska has them.
fn seconds(text: &str) -> Option<f64> {
    let mut parts = text.split(':').map(|p| p.parse::<f64>().ok());
    let (hours, minutes, seconds) = (parts.next()??, parts.next()??, parts.next()??);
    Some(3600.0 * hours + 60.0 * minutes + seconds)
}

/// What ffmpeg said apart from the times.
#[derive(Default)]
pub(super) struct Words {
    last: VecDeque<String>,
    /// Lines that report damage, with the number of frames before.
    complaints: Vec<(usize, String)>,
}

impl Words {
    pub(super) fn last(&self) -> String {
        self.last.iter().cloned().collect::<Vec<_>>().join("; ")
    }
}

/// What ffmpeg's demuxers and decoders say of damage that they pass over.
const DAMAGE: [&str; 6] = [
    "error while decoding",
    "corrupt",
    "concealing",
    "Invalid data",
    "ended prematurely",
    "Error submitting",
];

/// Whether a line is of the statistics or the encoder, which ffmpeg names at every end.
fn is_statistics(line: &str) -> bool {
    // From version 6 on the name of the output stands before them.
    let own = line.strip_prefix('[').and_then(|l| l.split_once("] ")).map_or(line, |(_, rest)| rest);
    ["frame=", "video:", "encoder"].iter().any(|begin| own.starts_with(begin))
}

/// What the `showinfo` filter says of a frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    pub(super) t_ns: Option<i64>,
    pub(super) matrix: YuvMatrix,
}

/// A thread that reads what ffmpeg says.
pub(super) struct Listener {
    pub(super) shown: Receiver<Shown>,
    words: Arc<Mutex<Words>>,
    thread: Option<JoinHandle<()>>,
}

impl Listener {
    pub(super) fn new(stderr: ChildStderr) -> Self {
        let (out, shown) = channel();
        let words = Arc::<Mutex<Words>>::default();
        let own = Arc::clone(&words);
        let thread = Some(std::thread::spawn(move || listen(stderr, &out, &own)));
        Self { shown, words, thread }
    }

    pub(super) fn words(&self) -> MutexGuard<'_, Words> {
        self.words.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn all_words(&mut self) -> MutexGuard<'_, Words> {
        // What a thread that broke down has heard is in its words.
        let _ = self.thread.take().map(JoinHandle::join);
        self.words()
    }
}

fn listen(stderr: ChildStderr, out: &Sender<Shown>, words: &Mutex<Words>) {
    let (mut base, mut frames) = (None, 0);
    for line in BufReader::new(stderr).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line).trim().to_owned();
        if line.contains("Parsed_showinfo") {
            let field = |key: &str| line.split_once(key)?.1.trim_start().split([' ', ',']).next();
            if let Some(text) = field("config in time_base:") {
                base = text.split_once('/').and_then(|(n, d)| Some((n.parse().ok()?, d.parse().ok()?)));
            } else if let Some(pts) = field(" pts:") {
                let wide = field("color_space:").is_some_and(|c| c.starts_with("bt709"));
                let matrix = if wide { YuvMatrix::Bt709 } else { YuvMatrix::Bt601 };
                // A receiver that is gone wants no more; ffmpeg's words are still read to its end.
                let _ = out.send(Shown { t_ns: nanoseconds(base, pts), matrix });
                frames += 1;
            }
        } else if !line.is_empty() && !is_statistics(&line) {
            let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
            if DAMAGE.iter().any(|word| line.contains(word)) {
                words.complaints.push((frames, line.clone()));
            }
            words.last.push_back(line);
            if words.last.len() > 3 {
                words.last.pop_front();
            }
        }
    }
}

/// A stamp in ticks of a time base, numerator and denominator.
fn nanoseconds(base: Option<(i128, i128)>, pts: &str) -> Option<i64> {
    let ((numerator, denominator), pts) = (base.filter(|b| b.1 > 0)?, pts.parse::<i128>().ok()?);
    i64::try_from((pts * numerator * 1_000_000_000 + denominator / 2).div_euclid(denominator)).ok()
}

struct FfmpegFrames {
    path: PathBuf,
    child: Child,
    stdout: ChildStdout,
    listener: Listener,
    size: ImageSize,
    planes: Planes,
    read: usize,
    ended: bool,
}

impl FfmpegFrames {
    fn failed(&self, detail: String) -> SessionError {
        SessionError::ffmpeg(&self.path, detail)
    }

    fn frame(&mut self) -> Result<Option<Frame>, SessionError> {
        let frame = self.planes.read(self.size, &mut self.stdout);
        frame.map_err(|e| self.failed(format!("frame {}: {e}", self.read)))
    }

    /// Waits for the end of the program: what it said, if it failed.
    fn finish(&mut self) -> Option<SessionError> {
        let status = self.child.wait();
        let (read, words) = (self.read, self.listener.all_words());
        let detail = match status {
            Ok(status) if status.success() => {
                let (near, first) = words.complaints.first()?;
                let places = words.complaints.len();
                format!(
                    "{places} complaint(s) of damaged data, the first near frame {near} of {read}: {first}: frames there may show what is not so; copy the file again"
                )
            }
            Ok(status) => format!("{status} after {read} frames: {}", words.last()),
            Err(error) => error.to_string(),
        };
        drop(words);
        Some(self.failed(detail))
    }
}

impl Iterator for FfmpegFrames {
    type Item = Result<(i64, Frame), SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = match self.frame() {
            Ok(Some(frame)) => match self.listener.shown.recv().map(|shown| shown.t_ns) {
                Ok(Some(t_ns)) => {
                    self.read += 1;
                    return Some(Ok((t_ns, frame)));
                }
                _ => Some(Err(self.failed(format!(
                    "frame {} has no time stamp: convert the recording to MP4, which has them",
                    self.read
                )))),
            },
            Ok(None) => self.finish().map(Err),
            Err(error) => Some(Err(self.finish().unwrap_or(error))),
        };
        self.ended = true;
        item
    }
}

impl Drop for FfmpegFrames {
    fn drop(&mut self) {
        // A program that has ended already cannot be killed: nothing is left to do then.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_no_reason() {
        for line in [
            "encoder         : Lavc59.37.100 wrapped_avframe",
            "frame=  239 fps= 30 q=-0.0 Lsize=  107551kB time=00:00:00.00 bitrate=N/A speed=   0x",
            "video:110kB audio:0kB subtitle:0kB other streams:0kB global headers:0kB muxing overhead: 97%",
            "[out#0/yuv4mpegpipe @ 0x5581] video:110KiB audio:0KiB subtitle:0KiB",
        ] {
            assert!(is_statistics(line), "{line}");
        }
        for line in ["tcp://cam:1: Connection refused", "[h264 @ 0x55] error while decoding MB 3 4"] {
            assert!(!is_statistics(line), "{line}");
        }
    }
}
