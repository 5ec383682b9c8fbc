//! Recordings on a disk that keeps only what was waited for, fills up, or fails: what was announced is read
//! back whole.

use crate::common::{film, rig, setup};
use crate::recording::{recorded, session};
use mavsight_flight::Vehicle;
use mavsight_link::Event;
use mavsight_live::{CameraSetup, FlightClock, Pace, Recorder, RecorderSlot, fly};
use mavsight_random::Random;
use mavsight_session::{FrameSource, Storage, Syncer};
use mavsight_vision::Frame;
use std::collections::{BTreeMap, BTreeSet};
use std::convert::Infallible;
use std::fs::File;
use std::io::{Error, Result, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// ENOSPC.
const NO_SPACE: i32 = 28;

/// A disk, with what of each file is on it for good.
struct Disk(Mutex<State>);

struct State {
    is_on: bool,
    room_bytes: u64,
    syncs_left: u64,
    /// Bytes of each file that were written, and that were waited for.
    files: BTreeMap<PathBuf, (u64, u64)>,
}

impl Disk {
    fn new(room_bytes: u64, syncs_left: u64) -> Arc<Self> {
        Arc::new(Self(Mutex::new(State { is_on: true, room_bytes, syncs_left, files: BTreeMap::new() })))
    }

    /// The state, while there is power.
    fn on(&self) -> Result<MutexGuard<'_, State>> {
        let state = self.0.lock().expect("no panic");
        if state.is_on { Ok(state) } else { Err(Error::other("no power")) }
    }

    fn pull_the_plug(&self) {
        self.0.lock().expect("no panic").is_on = false;
    }

    /// Takes away what was written and not waited for.
    fn forget(&self) {
        for (path, (_, synced)) in &self.0.lock().expect("no panic").files {
            File::options().write(true).open(path).and_then(|f| f.set_len(*synced)).expect("cut");
        }
    }
}

struct OnDisk {
    path: PathBuf,
    file: File,
    disk: Arc<Disk>,
}

impl Write for OnDisk {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let mut state = self.disk.on()?;
        let length = bytes.len().min(usize::try_from(state.room_bytes).unwrap_or(usize::MAX));
        if length == 0 {
            return Err(Error::from_raw_os_error(NO_SPACE));
        }
        self.file.write_all(&bytes[..length])?;
        state.room_bytes -= length as u64;
        state.files.entry(self.path.clone()).or_default().0 += length as u64;
        Ok(length)
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Storage for OnDisk {
    fn cut(&mut self, length: u64) -> Result<()> {
        let mut state = self.disk.on()?;
        state.files.entry(self.path.clone()).or_default().0 = length;
        self.file.cut(length)
    }

    fn syncer(&self) -> Result<Syncer> {
        let (path, disk) = (self.path.clone(), Arc::clone(&self.disk));
        Ok(Box::new(move || {
            let written = disk.on()?.files.entry(path.clone()).or_default().0;
            // What is written meanwhile is not waited for.
            std::thread::sleep(Duration::from_millis(3));
            let mut state = disk.on()?;
            state.syncs_left = state.syncs_left.checked_sub(1).ok_or_else(|| Error::other("bad block"))?;
            state.files.entry(path.clone()).or_default().1 = written;
            Ok(())
        }))
    }
}

/// What a recording has announced: seconds, bytes and the fault.
type Announced = (f64, u64, Option<String>);

/// Records a flight through a film, with time between its frames; `meanwhile` gets the recording.
fn record(
    folder: &Path,
    disk: &Arc<Disk>,
    films: &[Vec<(i64, Frame)>],
    between: Duration,
    meanwhile: impl FnOnce(&RecorderSlot) + Send,
) -> (u64, Announced) {
    let from = tempfile::tempdir().expect("as staged");
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let create = |path: &Path| {
        let (path, file, disk) = (path.to_owned(), File::create(path)?, Arc::clone(disk));
        Ok(Box::new(OnDisk { path, file, disk }) as Box<dyn Storage>)
    };
    let recorder = Recorder::begin_on(folder, recorded(session(from.path())), &create).expect("as staged");
    let recorder = RecorderSlot::with(Some(recorder));
    let cameras = films.iter().map(|film| {
        let frames = film.clone().into_iter().map(move |frame| {
            std::thread::sleep(between);
            Ok::<_, Infallible>(frame)
        });
        CameraSetup::replay("cam", frames, Pace::Fast, &Default::default())
    });
    let (mut flight, _heard) =
        setup((&rig, &vehicle), cameras.collect(), Pace::Fast, FlightClock::starting_at(0));
    flight.recorder = Arc::clone(&recorder);
    let measured = std::thread::scope(|scope| {
        scope.spawn(|| meanwhile(&recorder));
        fly(flight).expect("as staged").measured
    });
    match recorder.event() {
        Event::Recording { seconds, bytes, fault, .. } => (measured, (seconds, bytes, fault)),
        _ => (measured, (0.0, 0, Some("no recording".to_owned()))),
    }
}

/// Reads all that was announced.
fn assert_whole(folder: &Path, films: &[Vec<(i64, Frame)>], (seconds, bytes, _): &Announced) {
    let names = ["cam1.y4m", "cam2.y4m", "detected.ndjson", "sent.ndjson"];
    let on_disk = names.iter().map(|name| std::fs::metadata(folder.join(name)).expect("a file").len());
    assert!(on_disk.sum::<u64>() >= *bytes);
    if *seconds == 0.0 {
        // Of no instant is it said that it is whole.
        return;
    }
    let whole_lines = |name: &str| -> Vec<serde_json::Value> {
        let text = std::fs::read_to_string(folder.join(name)).expect("a log");
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
    };
    let (detected, sent) = (whole_lines("detected.ndjson"), whole_lines("sent.ndjson"));
    let instant = |event: &serde_json::Value| {
        (event["event"] == "pose").then(|| (event["t_s"].as_f64().expect("a time") * 1e9).round() as i64)
    };
    let sent: BTreeSet<i64> = sent.iter().filter_map(instant).collect();
    let first_ns = films[0][0].0;
    let announced = |stamp_ns: i64| (stamp_ns - first_ns) as f64 * 1e-9 <= *seconds + 1e-9;
    for (k, film) in films.iter().enumerate() {
        let (name, camera) = (format!("cam{}.y4m", k + 1), format!("cam{}", k + 1));
        let mut read = FrameSource::open(&folder.join(&name), None).expect("a film");
        let lines: Vec<_> = detected.iter().filter(|d| d["camera"] == camera).map(|d| &d["t_ns"]).collect();
        for (stamp_ns, frame) in film.iter().take_while(|(stamp_ns, _)| announced(*stamp_ns)) {
            let got = read.next().expect("a frame").expect("whole");
            assert!(got == (*stamp_ns, frame.clone()), "{name}: {stamp_ns} of {seconds} s");
            assert!(lines.iter().any(|t_ns| **t_ns == *stamp_ns), "{camera}: no detections at {stamp_ns}");
            assert!(sent.contains(stamp_ns), "nothing of what was sent at {stamp_ns}");
        }
    }
}

/// The film again and again.
fn repeated(films: &[Vec<(i64, Frame)>], times: i64) -> Vec<Vec<(i64, Frame)>> {
    let again = |film: &Vec<(i64, Frame)>| {
        let span_ns = film[film.len() - 1].0 + film[1].0;
        (0..times).flat_map(|k| film.iter().map(move |(t, f)| (t + k * span_ns, f.clone()))).collect()
    };
    films.iter().map(again).collect()
}

#[test]
fn what_was_announced_survives_a_power_cut() {
    let films = repeated(&film(&rig(), 15, 30.0), 6);
    let mut random = Random::new(37, 0);
    let mut safe_s = 0.0;
    for _ in 0..3 {
        let (to, disk) = (tempfile::tempdir().unwrap(), Disk::new(u64::MAX, u64::MAX));
        let after = Duration::from_secs_f64(random.between(1.0, 2.5));
        let folder = to.path().join("flight");
        let (measured, announced) = record(&folder, &disk, &films, Duration::from_millis(25), |_| {
            std::thread::sleep(after);
            disk.pull_the_plug();
        });
        assert!(measured >= 80, "{measured}");
        disk.forget();
        assert_whole(&folder, &films, &announced);
        safe_s += announced.0;
    }
    assert!(safe_s > 0.3, "{safe_s} s were announced in three flights");
}

#[test]
fn what_was_announced_is_whole_when_the_disk_fills_up() {
    let films = film(&rig(), 12, 30.0);
    let all_bytes = 24.0 * 3.0 * 640.0 * 480.0;
    let mut random = Random::new(37, 1);
    let mut safe = 0;
    for _ in 0..20 {
        let (to, room) = (tempfile::tempdir().unwrap(), random.between(0.05, 0.95) * all_bytes);
        let (folder, disk) = (to.path().join("flight"), Disk::new(room as u64, u64::MAX));
        let (measured, announced) = record(&folder, &disk, &films, Duration::ZERO, |_| ());
        assert!(measured >= 10, "{measured}");
        let fault = announced.2.clone().unwrap_or_default();
        assert!(fault.contains("No space left") && fault.contains("goes on"), "{fault}");
        // All that was written was waited for at the end, and of what did not fit nothing is left.
        assert_whole(&folder, &films, &announced);
        disk.forget();
        assert_whole(&folder, &films, &announced);
        for name in ["cam1.y4m", "cam2.y4m"] {
            if let Ok(mut film) = FrameSource::open(&folder.join(name), None) {
                assert!(film.all(|frame| frame.is_ok()), "{name} ends in half a frame");
            }
        }
        safe += usize::from(announced.1 > 0);
    }
    assert!(safe >= 18, "{safe} of 20");
}

#[test]
fn a_disk_that_does_not_keep_what_it_took_ends_the_recording_with_a_word() {
    let films = film(&rig(), 12, 30.0);
    let to = tempfile::tempdir().unwrap();
    let (folder, disk) = (to.path().join("flight"), Disk::new(u64::MAX, 2));
    let (measured, announced) = record(&folder, &disk, &films, Duration::ZERO, |_| ());
    assert!(measured >= 10, "{measured}");
    assert_eq!((announced.0, announced.1), (0.0, 0));
    assert!(announced.2.as_ref().is_some_and(|f| f.contains("bad block") && f.contains("goes on")));
}
