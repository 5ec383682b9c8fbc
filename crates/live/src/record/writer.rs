//! The threads of a recording: one writes, one waits for the disk.

use crate::queue::locked;
use mavsight_pose::TrackedDetection;
use mavsight_session::{Storage, Syncer, Y4mWriter};
use mavsight_vision::Frame;
use serde::Serialize;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Logs of detections, of events that were sent, and of inputs.
pub(super) const LOGS: [&str; 3] = ["detected.ndjson", "sent.ndjson", "inputs.csv"];
pub(super) const DETECTED: usize = 0;
pub(super) const SENT: usize = 1;
pub(super) const INPUTS: usize = 2;

/// Time between two waits for the disk: what a power cut costs, and how late a recording is said to be safe.
const SYNC: Duration = Duration::from_millis(500);

pub(super) enum Item {
    Frame {
        camera: usize,
        stamp_ns: i64,
        frame: Arc<Frame>,
        detections: Vec<TrackedDetection>,
    },
    /// A line of a log, and the instant if it ends one: what belongs to that instant has come before.
    Line {
        log: usize,
        line: String,
        instant_ns: Option<i64>,
    },
}

/// How far a recording is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Extent {
    pub(super) bytes: u64,
    /// From the first instant to the last.
    pub(super) seconds: f64,
}

#[derive(Default)]
pub(super) struct Status {
    /// Handed to the system.
    written: Extent,
    /// On the disk itself.
    pub(super) safe: Extent,
    first_ns: Option<i64>,
    pub(super) fault: Option<String>,
    pub(super) is_news: bool,
}

impl Status {
    pub(super) fn fail(&mut self, text: String) {
        if self.fault.is_none() {
            (self.fault, self.is_news) = (Some(text), true);
        }
    }
}

/// A log that grows by whole lines.
pub(super) struct Log {
    file: Box<dyn Storage>,
    bytes: u64,
}

impl Log {
    pub(super) fn new(file: Box<dyn Storage>) -> Self {
        Self { file, bytes: 0 }
    }

    /// Appends a line at once, so that it is complete or missing.
    pub(super) fn append(&mut self, line: &str) -> Result<(), String> {
        let line = format!("{line}\n");
        self.file.write_all(line.as_bytes()).map_err(|e| {
            let _ = self.file.cut(self.bytes);
            e.to_string()
        })?;
        self.bytes += line.len() as u64;
        Ok(())
    }
}

pub(super) struct Writer {
    pub(super) videos: Vec<Y4mWriter>,
    /// Of the cameras.
    pub(super) names: Vec<String>,
    pub(super) logs: Vec<Log>,
    pub(super) status: Arc<Mutex<Status>>,
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

impl Writer {
    /// All files' [`Syncer`]s.
    pub(super) fn syncers(&self) -> std::io::Result<Vec<Syncer>> {
        let videos = self.videos.iter().map(Y4mWriter::syncer);
        videos.chain(self.logs.iter().map(|log| log.file.syncer())).collect()
    }

    pub(super) fn take(&mut self, item: Item) {
        if locked(&self.status).fault.is_some() {
            return;
        }
        let instant_ns = if let Item::Line { instant_ns, .. } = &item { *instant_ns } else { None };
        let result = self.write(item);
        let videos: u64 = self.videos.iter().map(Y4mWriter::bytes).sum();
        let logs: u64 = self.logs.iter().map(|log| log.bytes).sum();
        let mut status = locked(&self.status);
        status.written.bytes = videos + logs;
        match (result, instant_ns) {
            (Err(text), _) => status.fail(format!("{text}: the recording ends here, the flight goes on")),
            (Ok(()), Some(instant_ns)) => {
                let first_ns = *status.first_ns.get_or_insert(instant_ns);
                let seconds = (instant_ns - first_ns) as f64 * 1e-9;
                status.written.seconds = status.written.seconds.max(seconds);
            }
            (Ok(()), None) => {}
        }
    }

    fn write(&mut self, item: Item) -> Result<(), String> {
        let (camera, stamp_ns, frame, detections) = match item {
            Item::Frame { camera, stamp_ns, frame, detections } => (camera, stamp_ns, frame, detections),
            Item::Line { log, line, .. } => return self.append(log, &line),
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
        self.append(DETECTED, &line)
    }

    fn append(&mut self, log: usize, line: &str) -> Result<(), String> {
        self.logs.get_mut(log).map_or(Ok(()), |log| log.append(line))
    }
}

/// Waits for the disk, and says then how much of the recording is safe.
pub(super) struct Keeper {
    syncers: Vec<Syncer>,
    status: Arc<Mutex<Status>>,
    synced: Instant,
    /// After a wait that failed the system may have forgotten what it could not write: a later one proves nothing.
    has_failed: bool,
}

impl Keeper {
    pub(super) fn new(syncers: Vec<Syncer>, status: Arc<Mutex<Status>>) -> Self {
        Self { syncers, status, synced: Instant::now(), has_failed: false }
    }

    /// Waits for the disk if that is due, or `now`.
    pub(super) fn keep(&mut self, now: bool) {
        if self.has_failed || !now && self.synced.elapsed() < SYNC {
            return;
        }
        let written = {
            let status = locked(&self.status);
            if status.written == status.safe {
                return;
            }
            status.written
        };
        let synced = self.syncers.iter_mut().try_for_each(|sync| sync());
        self.synced = Instant::now();
        let mut status = locked(&self.status);
        match synced {
            Ok(()) => status.safe = written,
            Err(e) => {
                self.has_failed = true;
                status.fail(format!("the disk has not kept what was written ({e}): the recording ends here, the flight goes on"));
            }
        }
    }
}
