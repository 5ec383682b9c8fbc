//! Recording of what is received, detected and sent.

mod files;
mod writer;

use crate::LiveError;
use crate::queue::{Queue, locked};
use crate::setup::Tap;
use crate::worker::Worker;
use files::copy_files;
use mavsight_link::Event;
use mavsight_pose::TrackedDetection;
use mavsight_session::{SessionFile, Storage, Y4mWriter, make_folder, sync_folder, write_toml};
use mavsight_vision::Frame;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use writer::{INPUTS, Item, Keeper, LOGS, Log, SENT, Status, Writer};

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

/// Writes a recording on a thread of its own, and waits for the disk on another.
///
/// Each frame goes to the system as soon as it is written, so that a kill loses at most the last one. What
/// [`Recorder::event`] says is on the disk itself, so that a power cut does not take it. If the disk is full
/// or too slow, the recording ends with a fault, and the flight goes on.
pub struct Recorder {
    folder: PathBuf,
    status: Arc<Mutex<Status>>,
    worker: Worker<Item>,
    keeper: Worker<()>,
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

impl Recorder {
    /// Begins a recording: makes the folder if missing, copies the session and its files, and opens videos
    /// and logs.
    ///
    /// # Errors
    /// A folder that holds a session already or cannot be written, files that cannot be copied.
    pub fn begin(folder: &Path, of: RecordedSession) -> Result<Self, LiveError> {
        Self::begin_on(folder, of, &|path| Ok(Box::new(File::create(path)?)))
    }

    /// The same on a storage of the caller's.
    ///
    /// # Errors
    /// As [`Recorder::begin`], and what `create` says.
    pub fn begin_on(
        folder: &Path,
        of: RecordedSession,
        create: &dyn Fn(&Path) -> std::io::Result<Box<dyn Storage>>,
    ) -> Result<Self, LiveError> {
        let RecordedSession { mut session, base, rate_hz, inputs, waits } = of;
        let refuse = |detail: String| LiveError::Record { folder: folder.to_owned(), detail };
        let refused = |e: std::io::Error| refuse(e.to_string());
        if folder.join("session.toml").exists() {
            return Err(refuse("it holds a session already: name another folder".into()));
        }
        make_folder(folder)?;
        copy_files(&mut session, &base, folder).map_err(refuse)?;
        let mut videos = Vec::new();
        for (k, camera) in session.camera.iter_mut().enumerate() {
            let name = format!("cam{}.y4m", k + 1);
            let path = folder.join(&name);
            videos.push(Y4mWriter::new(&path, create(&path).map_err(refused)?, rate_hz));
            camera.video = name.into();
            (camera.live, camera.latency_s, camera.frame_rate_hz, camera.interlaced) =
                (None, None, None, None);
        }
        (session.truth, session.live) = (None, None);
        let names = session.camera.iter().map(|c| c.name.clone()).collect();
        let logs = &LOGS[..if inputs.is_some() { 3 } else { 2 }];
        let logs = logs.iter().map(|name| create(&folder.join(name)).map(Log::new));
        let mut logs = logs.collect::<Result<Vec<_>, _>>().map_err(refused)?;
        if let (Some(names), Some(log)) = (inputs, logs.get_mut(INPUTS)) {
            session.inputs = LOGS[INPUTS].into();
            let header: Vec<&str> = std::iter::once("t_s").chain(names.iter().map(String::as_str)).collect();
            log.append(&header.join(",")).map_err(refuse)?;
        }
        write_toml(&folder.join("session.toml"), &session)?;
        sync_folder(folder).map_err(refused)?;
        let mut writer = Writer { videos, names, logs, status: Arc::default() };
        let status = Arc::clone(&writer.status);
        let mut keeper = Keeper::new(writer.syncers().map_err(refused)?, Arc::clone(&status));
        let queue = Arc::new(Queue::new(WAITING, waits));
        let own = Arc::clone(&queue);
        // After one that was lost nothing is whole.
        let write = move |item: Option<Item>| {
            item.into_iter().filter(|_| own.dropped() == 0).for_each(|item| writer.take(item));
        };
        let worker = Worker::start("record", queue, true, write)?;
        let keep = move |now: Option<()>| keeper.keep(now.is_some());
        let keeper = Worker::start("keep", Queue::new(1, false), true, keep)?;
        Ok(Self { folder: folder.to_owned(), status, worker, keeper })
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
                Item::Line { log, line, .. } => format!("a line of {} ({line})", LOGS[log]),
            };
            let text = format!("the disk is too slow: {what} is missing, so the recording ends there");
            locked(&self.status).fail(text);
        }
    }

    pub(crate) fn sent(&self, event: &Event) {
        let instant_ns = match event {
            Event::Pose(pose) => Some((pose.t_s * 1e9).round() as i64),
            _ => None,
        };
        // Events are numbers and texts, which always have a JSON form.
        if let Ok(line) = serde_json::to_string(event) {
            self.put(Item::Line { log: SENT, line, instant_ns });
        }
    }

    /// Records the inputs from a time on, in the order of their names ([`RecordedSession::inputs`]).
    pub fn input(&self, t_s: f64, values: &[f64]) {
        let cells = std::iter::once(&t_s).chain(values).map(f64::to_string);
        let line = cells.collect::<Vec<_>>().join(",");
        self.put(Item::Line { log: INPUTS, line, instant_ns: None });
    }

    /// The state of the recording as an event: what is safe.
    pub fn event(&self) -> Event {
        let Status { safe, fault, .. } = &*locked(&self.status);
        let folder = Some(self.folder.display().to_string());
        Event::Recording { folder, seconds: safe.seconds, bytes: safe.bytes, fault: fault.clone() }
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

    /// Writes all that waits, waits for the disk, and ends.
    pub fn finish(&self) {
        self.worker.finish();
        self.keeper.queue.push(());
        self.keeper.finish();
    }
}
