//! Recording of what is received, detected and sent.

use crate::LiveError;
use crate::queue::{Popped, Queue, locked};
use crate::setup::Tap;
use mavsight_flight::InputSample;
use mavsight_link::Event;
use mavsight_pose::TrackedDetection;
use mavsight_session::{SessionFile, Y4mWriter, make_folder, write_toml};
use mavsight_vision::Frame;
use serde::Serialize;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// Frames and lines that may wait for the disk: a quarter second of two cameras.
const WAITING: usize = 48;

/// The session and folder of a recording; all paths of the session are absolute.
#[derive(Debug, Clone)]
pub struct RecordedSession {
    /// The folder; made if missing.
    pub folder: PathBuf,
    /// The session; its videos become the recorded ones, and its files are copied to the folder.
    pub session: SessionFile,
    /// Frames a second, for programs that do not read time stamps.
    pub rate_hz: f64,
    /// Whether inputs arrive during the flight ([`Recorder::input`]).
    pub with_inputs: bool,
    /// Whether the flight waits for the disk instead of losing frames: for runs that are not in real time.
    pub waits: bool,
}

enum Item {
    Frame { camera: usize, stamp_ns: i64, frame: Arc<Frame>, detections: Vec<TrackedDetection> },
    Sent(String),
    Input(InputSample),
}

/// Writes a recording on a thread of its own.
///
/// Each frame goes to the system as soon as it is written, so that a kill loses at most the last one. If the
/// disk is full or too slow, the recording ends with a fault, and the flight goes on.
pub struct Recorder {
    folder: PathBuf,
    waits: bool,
    queue: Arc<Queue<Item>>,
    status: Arc<Status>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Default)]
struct Status {
    bytes: AtomicU64,
    first_ns: Mutex<Option<i64>>,
    seconds: Mutex<f64>,
    fault: Mutex<Option<String>>,
    is_news: AtomicBool,
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

    /// The tap that records frames.
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

/// Name of the log of detections.
const DETECTED: &str = "detected.ndjson";
/// Name of the log of events that were sent.
const SENT: &str = "sent.ndjson";
/// Name of the table of inputs.
const INPUTS: &str = "inputs.csv";

/// One line of the log of detections.
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
    /// Begins a recording: copies the session and its files, and opens videos and logs.
    ///
    /// # Errors
    /// A folder that holds a session already or cannot be written, files that cannot be copied.
    pub fn begin(to: RecordedSession) -> Result<Self, LiveError> {
        let RecordedSession { folder, mut session, rate_hz, with_inputs, waits } = to;
        let refuse = |detail: String| LiveError::Record { folder: folder.clone(), detail };
        if folder.join("session.toml").exists() {
            return Err(refuse("it holds a session already: name another folder".into()));
        }
        make_folder(&folder)?;
        let mut videos = Vec::new();
        for (k, camera) in session.camera.iter_mut().enumerate() {
            let name = format!("cam{}.y4m", k + 1);
            videos.push(Y4mWriter::create(&folder.join(&name), rate_hz)?);
            camera.video = name.into();
            (camera.live, camera.latency_s, camera.frame_rate_hz, camera.interlaced) =
                (None, None, None, None);
            copy_in(&folder, camera.still.as_mut()).map_err(refuse)?;
        }
        copy_in(&folder, Some(&mut session.vehicle)).map_err(refuse)?;
        copy_in(&folder, session.model.as_mut()).map_err(refuse)?;
        copy_in(&folder, session.rig.as_mut().map(|r| &mut r.file)).map_err(refuse)?;
        if let Some(control) = &mut session.control {
            copy_in(&folder, Some(&mut control.points)).map_err(refuse)?;
            copy_in(&folder, control.observations.as_mut()).map_err(refuse)?;
        }
        (session.truth, session.live) = (None, None);
        let io = |e: std::io::Error| refuse(e.to_string());
        let mut inputs = None;
        if with_inputs {
            let mut file = File::create(folder.join(INPUTS)).map_err(io)?;
            file.write_all(b"t_s,omega_u_rad_s,omega_l_rad_s,delta_lon_rad,delta_lat_rad\n").map_err(io)?;
            session.inputs = INPUTS.into();
            inputs = Some(file);
        } else if !session.inputs.as_os_str().is_empty() {
            copy_in(&folder, Some(&mut session.inputs)).map_err(refuse)?;
        }
        let names = session.camera.iter().map(|c| c.name.clone()).collect();
        let log = |name: &str| File::create(folder.join(name)).map_err(io);
        let writer = Writer { videos, names, inputs, detected: log(DETECTED)?, sent: log(SENT)?, lines: 0 };
        write_toml(&folder.join("session.toml"), &session)?;
        let (queue, status) = (Arc::new(Queue::new(WAITING)), Arc::new(Status::default()));
        let (own, shared) = (Arc::clone(&queue), Arc::clone(&status));
        let thread = std::thread::Builder::new()
            .name("record".into())
            .spawn(move || {
                crate::give_way();
                writer.run(&own, &shared);
            })
            .map_err(|source| LiveError::Thread { what: "the recording", source })?;
        Ok(Self { folder, waits, queue, status, thread: Mutex::new(Some(thread)) })
    }

    /// Records a frame and its detections.
    fn frame(&self, camera: usize, stamp_ns: i64, frame: &Arc<Frame>, seen: &[TrackedDetection]) {
        let (frame, detections) = (Arc::clone(frame), seen.to_vec());
        self.put(Item::Frame { camera, stamp_ns, frame, detections });
    }

    fn put(&self, item: Item) {
        if locked(&self.status.fault).is_some() {
            return;
        }
        if self.waits {
            self.queue.push_waiting(item);
        } else if let Some(lost) = self.queue.push(item)
            && !self.queue.is_closed()
        {
            let what = match lost {
                Item::Frame { stamp_ns, .. } => format!("the frame at {:.3} s", stamp_ns as f64 * 1e-9),
                Item::Input(sample) => format!("the input at {:.3} s", sample.t_s),
                Item::Sent(_) => "an event that was sent".to_owned(),
            };
            self.status.fail(format!("the disk is too slow: {what} is missing, so the recording ends there"));
        }
    }

    /// Records an event that was sent.
    pub(crate) fn sent(&self, event: &Event) {
        // Events are numbers and texts, which always have a JSON form.
        if let Ok(line) = serde_json::to_string(event) {
            self.put(Item::Sent(line));
        }
    }

    /// Records an input.
    pub fn input(&self, sample: InputSample) {
        self.put(Item::Input(sample));
    }

    /// The state of the recording as an event.
    pub fn event(&self) -> Event {
        Event::Recording {
            folder: Some(self.folder.display().to_string()),
            seconds: *locked(&self.status.seconds),
            bytes: self.status.bytes.load(Ordering::Relaxed),
            fault: locked(&self.status.fault).clone(),
        }
    }

    /// The state of the recording if it has a fault that was not reported yet.
    pub(crate) fn news(&self) -> Option<Event> {
        self.status.is_news.swap(false, Ordering::Relaxed).then(|| self.event())
    }

    /// The fault that ended it early, if any.
    pub fn fault(&self) -> Option<String> {
        locked(&self.status.fault).clone()
    }

    /// Writes all that waits, and ends.
    pub fn finish(&self) {
        self.queue.close();
        if let Some(thread) = locked(&self.thread).take() {
            // A panic has been printed by its thread.
            let _ = thread.join();
        }
    }
}

impl Status {
    fn fail(&self, text: String) {
        let mut fault = locked(&self.fault);
        if fault.is_none() {
            *fault = Some(text);
            self.is_news.store(true, Ordering::Relaxed);
        }
    }
}

/// Copies a file into a folder and sets its path to the copy's name.
fn copy_in(folder: &Path, path: Option<&mut PathBuf>) -> Result<(), String> {
    let Some(path) = path else { return Ok(()) };
    let name = path.file_name().map(PathBuf::from).ok_or_else(|| format!("{} is no file", path.display()))?;
    if path.parent() == Some(folder) {
        *path = name;
        return Ok(());
    }
    let mut to = name;
    for k in 2.. {
        if !folder.join(&to).exists() {
            break;
        }
        to = PathBuf::from(format!("{k}-{}", path.file_name().unwrap_or_default().to_string_lossy()));
    }
    std::fs::copy(&*path, folder.join(&to)).map_err(|e| format!("{}: {e}", path.display()))?;
    *path = to;
    Ok(())
}

struct Writer {
    videos: Vec<Y4mWriter>,
    names: Vec<String>,
    inputs: Option<File>,
    detected: File,
    sent: File,
    /// Bytes of all lines.
    lines: u64,
}

impl Writer {
    fn run(mut self, queue: &Queue<Item>, status: &Status) {
        loop {
            let item = match queue.pop(Duration::from_millis(200)) {
                Popped::Item(item) => item,
                Popped::Nothing => continue,
                Popped::Closed => return,
            };
            if locked(&status.fault).is_some() {
                continue;
            }
            if let Err(text) = self.write(item, status) {
                status.fail(format!("{text}: the recording ends here, the flight goes on"));
            }
        }
    }

    fn write(&mut self, item: Item, status: &Status) -> Result<(), String> {
        match item {
            Item::Frame { camera, stamp_ns, frame, detections } => {
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
                self.lines += append(&mut self.detected, &line)?;
                let first_ns = *locked(&status.first_ns).get_or_insert(stamp_ns);
                let mut seconds = locked(&status.seconds);
                *seconds = seconds.max((stamp_ns - first_ns) as f64 * 1e-9);
            }
            Item::Sent(line) => self.lines += append(&mut self.sent, &line)?,
            Item::Input(s) => {
                let Some(file) = &mut self.inputs else { return Ok(()) };
                let line = format!(
                    "{},{},{},{},{}",
                    s.t_s, s.omega_u_rad_s, s.omega_l_rad_s, s.delta_lon_rad, s.delta_lat_rad
                );
                self.lines += append(file, &line)?;
            }
        }
        let videos: u64 = self.videos.iter().map(Y4mWriter::bytes).sum();
        status.bytes.store(videos + self.lines, Ordering::Relaxed);
        Ok(())
    }
}

/// Appends a line at once, so that it is complete or missing.
fn append(file: &mut File, line: &str) -> Result<u64, String> {
    let before = file.metadata().map(|m| m.len()).map_err(|e| e.to_string())?;
    let mut whole = String::with_capacity(line.len() + 1);
    whole.push_str(line);
    whole.push('\n');
    file.write_all(whole.as_bytes()).map_err(|e| {
        let _ = file.set_len(before);
        e.to_string()
    })?;
    Ok(whole.len() as u64)
}
