//! Recording of what is received, detected and sent.

use crate::LiveError;
use crate::queue::{Queue, locked};
use crate::setup::Tap;
use crate::worker::Worker;
use mavsight_link::Event;
use mavsight_pose::TrackedDetection;
use mavsight_session::{SessionFile, Y4mWriter, make_folder, write_toml};
use mavsight_vision::Frame;
use serde::Serialize;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Frames and lines that may wait for the disk: a quarter second of two cameras.
const WAITING: usize = 48;

/// The session of a recording.
#[derive(Debug, Clone)]
pub struct RecordedSession {
    /// The session; its videos become the recorded ones, and its files are copied to the folder.
    pub session: SessionFile,
    /// The folder from which the session's relative paths begin.
    pub base: PathBuf,
    /// Frames a second, for programs that do not read time stamps.
    pub rate_hz: f64,
    /// Names of the inputs that arrive during the flight ([`Recorder::input`]), if any do.
    pub inputs: Option<Vec<String>>,
    /// Whether the flight waits for the disk instead of losing frames: for runs that are not in real time.
    pub waits: bool,
}

/// Logs of detections, of events that were sent, and of inputs.
const LOGS: [&str; 3] = ["detected.ndjson", "sent.ndjson", "inputs.csv"];
const DETECTED: usize = 0;
const SENT: usize = 1;
const INPUTS: usize = 2;

enum Item {
    Frame { camera: usize, stamp_ns: i64, frame: Arc<Frame>, detections: Vec<TrackedDetection> },
    Line { log: usize, line: String },
}

/// Writes a recording on a thread of its own.
///
/// Each frame goes to the system as soon as it is written, so that a kill loses at most the last one. If the
/// disk is full or too slow, the recording ends with a fault, and the flight goes on.
pub struct Recorder {
    folder: PathBuf,
    status: Arc<Mutex<Status>>,
    worker: Worker<Item>,
}

#[derive(Default)]
struct Status {
    bytes: u64,
    first_ns: Option<i64>,
    seconds: f64,
    fault: Option<String>,
    is_news: bool,
}

impl Status {
    fn fail(&mut self, text: String) {
        if self.fault.is_none() {
            (self.fault, self.is_news) = (Some(text), true);
        }
    }
}

/// The place of a flight's recording, which may begin and end while the flight goes on.
#[derive(Default)]
pub struct RecorderSlot {
    recorder: Mutex<Option<Arc<Recorder>>>,
}

impl RecorderSlot {
    /// A slot with a recording that begins with the flight.
    pub fn with(recorder: Option<Recorder>) -> Arc<Self> {
        Arc::new(Self { recorder: Mutex::new(recorder.map(Arc::new)) })
    }

    /// The recording that is being written.
    pub fn current(&self) -> Option<Arc<Recorder>> {
        locked(&self.recorder).clone()
    }

    /// Ends the recording that is being written, begins another if one is given, and returns the ended one.
    pub fn replace(&self, by: Option<Recorder>) -> Option<Arc<Recorder>> {
        let before = std::mem::replace(&mut *locked(&self.recorder), by.map(Arc::new));
        before.iter().for_each(|b| b.finish());
        before
    }

    pub(crate) fn tap(self: &Arc<Self>) -> Tap {
        let own = Arc::clone(self);
        Arc::new(move |camera, stamp_ns, frame, detections| {
            if let Some(recorder) = own.current() {
                recorder.frame(camera, stamp_ns, frame, detections);
            }
        })
    }

    /// The state of the recording as an event.
    pub fn event(&self) -> Event {
        let none = || Event::Recording { folder: None, seconds: 0.0, bytes: 0, fault: None };
        self.current().map_or_else(none, |r| r.event())
    }
}

#[derive(Serialize)]
struct Detected<'a> {
    camera: &'a str,
    t_ns: i64,
    seen: Vec<DetectedBall>,
}

#[derive(Serialize)]
struct DetectedBall {
    id: u32,
    color: usize,
    u_px: f64,
    v_px: f64,
    /// uu, uv, vv.
    cov_px2: [f64; 3],
    diameter_px: f64,
}

impl Recorder {
    /// Begins a recording: makes the folder if missing, copies the session and its files, and opens videos
    /// and logs.
    ///
    /// # Errors
    /// A folder that holds a session already or cannot be written, files that cannot be copied.
    pub fn begin(folder: &Path, of: RecordedSession) -> Result<Self, LiveError> {
        let RecordedSession { mut session, base, rate_hz, inputs, waits } = of;
        let refuse = |detail: String| LiveError::Record { folder: folder.to_owned(), detail };
        if folder.join("session.toml").exists() {
            return Err(refuse("it holds a session already: name another folder".into()));
        }
        make_folder(folder)?;
        copy_files(&mut session, &base, folder).map_err(refuse)?;
        let mut videos = Vec::new();
        for (k, camera) in session.camera.iter_mut().enumerate() {
            let name = format!("cam{}.y4m", k + 1);
            videos.push(Y4mWriter::create(&folder.join(&name), rate_hz)?);
            camera.video = name.into();
            (camera.live, camera.latency_s, camera.frame_rate_hz, camera.interlaced) =
                (None, None, None, None);
        }
        (session.truth, session.live) = (None, None);
        let names = session.camera.iter().map(|c| c.name.clone()).collect();
        let logs = &LOGS[..if inputs.is_some() { 3 } else { 2 }];
        let logs = logs.iter().map(|name| File::create(folder.join(name))).collect::<Result<_, _>>();
        let mut writer = Writer {
            videos,
            names,
            logs: logs.map_err(|e: std::io::Error| refuse(e.to_string()))?,
            lines: 0,
            status: Arc::default(),
        };
        if let Some(names) = inputs {
            session.inputs = LOGS[INPUTS].into();
            let header: Vec<&str> = std::iter::once("t_s").chain(names.iter().map(String::as_str)).collect();
            writer.append(INPUTS, &header.join(",")).map_err(refuse)?;
        }
        write_toml(&folder.join("session.toml"), &session)?;
        let status = Arc::clone(&writer.status);
        let write = move |item: Option<Item>| item.into_iter().for_each(|item| writer.take(item));
        let worker = Worker::start("record", Queue::new(WAITING, waits), true, write)?;
        Ok(Self { folder: folder.to_owned(), status, worker })
    }

    fn frame(&self, camera: usize, stamp_ns: i64, frame: &Arc<Frame>, seen: &[TrackedDetection]) {
        let (frame, detections) = (Arc::clone(frame), seen.to_vec());
        self.put(Item::Frame { camera, stamp_ns, frame, detections });
    }

    fn put(&self, item: Item) {
        let queue = &self.worker.queue;
        if locked(&self.status).fault.is_some() {
            return;
        }
        if let Some(lost) = queue.push(item)
            && !queue.is_closed()
        {
            let what = match lost {
                Item::Frame { stamp_ns, .. } => format!("the frame at {:.3} s", stamp_ns as f64 * 1e-9),
                Item::Line { log, line } => format!("a line of {} ({line})", LOGS[log]),
            };
            let text = format!("the disk is too slow: {what} is missing, so the recording ends there");
            locked(&self.status).fail(text);
        }
    }

    pub(crate) fn sent(&self, event: &Event) {
        // Events are numbers and texts, which always have a JSON form.
        if let Ok(line) = serde_json::to_string(event) {
            self.put(Item::Line { log: SENT, line });
        }
    }

    /// Records the inputs from a time on, in the order of their names ([`RecordedSession::inputs`]).
    pub fn input(&self, t_s: f64, values: &[f64]) {
        let cells = std::iter::once(&t_s).chain(values).map(f64::to_string);
        let line = cells.collect::<Vec<_>>().join(",");
        self.put(Item::Line { log: INPUTS, line });
    }

    /// The state of the recording as an event.
    pub fn event(&self) -> Event {
        let Status { seconds, bytes, fault, .. } = &*locked(&self.status);
        let folder = Some(self.folder.display().to_string());
        Event::Recording { folder, seconds: *seconds, bytes: *bytes, fault: fault.clone() }
    }

    /// The state of the recording if it has a fault that was not reported yet.
    pub(crate) fn news(&self) -> Option<Event> {
        let is_news = std::mem::take(&mut locked(&self.status).is_news);
        is_news.then(|| self.event())
    }

    /// The fault that ended it early, if any.
    pub fn fault(&self) -> Option<String> {
        locked(&self.status).fault.clone()
    }

    /// Writes all that waits, and ends.
    pub fn finish(&self) {
        self.worker.finish();
    }
}

/// Copies the files that a session names, its recordings excepted, and makes their paths those of the copies.
fn copy_files(session: &mut SessionFile, base: &Path, folder: &Path) -> Result<(), String> {
    let stills = session.camera.iter_mut().filter_map(|c| c.still.as_mut());
    let rig = session.rig.iter_mut().map(|r| &mut r.file);
    let control = session.control.iter_mut().flat_map(|c| {
        let observations = c.observations.as_mut();
        std::iter::once(&mut c.points).chain(observations)
    });
    let files = [&mut session.vehicle, &mut session.inputs].into_iter().chain(&mut session.model);
    for path in files.chain(rig).chain(control).chain(stills) {
        copy_in(folder, base, path)?;
    }
    for camera in &mut session.camera {
        for path in [&mut camera.wand, &mut camera.board].into_iter().flatten() {
            *path = base.join(&path);
        }
    }
    Ok(())
}

/// Copies a file, if one is named, into a folder and sets its path to the copy's name.
fn copy_in(folder: &Path, base: &Path, path: &mut PathBuf) -> Result<(), String> {
    if path.as_os_str().is_empty() {
        return Ok(());
    }
    let from = base.join(&path);
    let name = from.file_name().map(PathBuf::from).ok_or_else(|| format!("{} is no file", from.display()))?;
    if from.parent() == Some(folder) {
        *path = name;
        return Ok(());
    }
    let mut to = name;
    for k in 2.. {
        if !folder.join(&to).exists() {
            break;
        }
        to = PathBuf::from(format!("{k}-{}", from.file_name().unwrap_or_default().to_string_lossy()));
    }
    std::fs::copy(&from, folder.join(&to)).map_err(|e| format!("{}: {e}", from.display()))?;
    *path = to;
    Ok(())
}

struct Writer {
    videos: Vec<Y4mWriter>,
    names: Vec<String>,
    logs: Vec<File>,
    /// Bytes of all lines.
    lines: u64,
    status: Arc<Mutex<Status>>,
}

impl Writer {
    fn take(&mut self, item: Item) {
        if locked(&self.status).fault.is_some() {
            return;
        }
        let written = self.write(item);
        let videos: u64 = self.videos.iter().map(Y4mWriter::bytes).sum();
        let mut status = locked(&self.status);
        status.bytes = videos + self.lines;
        if let Err(text) = written {
            status.fail(format!("{text}: the recording ends here, the flight goes on"));
        }
    }

    fn write(&mut self, item: Item) -> Result<(), String> {
        let (camera, stamp_ns, frame, detections) = match item {
            Item::Frame { camera, stamp_ns, frame, detections } => (camera, stamp_ns, frame, detections),
            Item::Line { log, line } => return self.append(log, &line),
        };
        let Some(video) = self.videos.get_mut(camera) else { return Ok(()) };
        video.push(stamp_ns, &frame).map_err(|e| e.to_string())?;
        let ball = |s: &TrackedDetection| DetectedBall {
            id: s.track_id,
            color: s.color,
            u_px: s.pixel.x,
            v_px: s.pixel.y,
            cov_px2: [s.covariance_px2.m11, s.covariance_px2.m12, s.covariance_px2.m22],
            diameter_px: s.diameter_px,
        };
        let seen = detections.iter().map(ball).collect();
        let line = Detected { camera: &self.names[camera], t_ns: stamp_ns, seen };
        let line = serde_json::to_string(&line).map_err(|e| e.to_string())?;
        self.append(DETECTED, &line)?;
        let mut status = locked(&self.status);
        let first_ns = *status.first_ns.get_or_insert(stamp_ns);
        status.seconds = status.seconds.max((stamp_ns - first_ns) as f64 * 1e-9);
        Ok(())
    }

    /// Appends a line at once, so that it is complete or missing.
    fn append(&mut self, log: usize, line: &str) -> Result<(), String> {
        let Some(file) = self.logs.get_mut(log) else { return Ok(()) };
        let before = file.metadata().map(|m| m.len()).map_err(|e| e.to_string())?;
        let line = format!("{line}\n");
        file.write_all(line.as_bytes()).map_err(|e| {
            let _ = file.set_len(before);
            e.to_string()
        })?;
        self.lines += line.len() as u64;
        Ok(())
    }
}
