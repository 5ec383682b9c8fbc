//! What is recorded, and what is not when the disk is full.

use crate::common::{film, rig, setup};
use mavsight_flight::Vehicle;
use mavsight_link::Event;
use mavsight_live::{CameraSetup, FlightClock, Pace, RecordedSession, Recorder, RecorderSlot, fly};
use mavsight_session::logs::LogSection;
use mavsight_session::{
    ControlSection, FrameSource, RigSection, SESSION_SCHEMA, Session, SessionCamera, SessionFile,
};
use mavsight_vision::Frame;
use std::convert::Infallible;
use std::path::Path;

/// A session with whatever a session needs, in a folder of its own.
pub(crate) fn session(at: &Path) -> SessionFile {
    mavsight_session::write_toml(&at.join("vehicle.toml"), &Vehicle::paper()).expect("as staged");
    std::fs::write(at.join("points.csv"), "name,x_m,y_m,z_m,diameter_m,color\n").expect("as staged");
    std::fs::write(at.join("pixels.csv"), "camera,name,u_px,v_px\n").expect("as staged");
    let camera = |name: &str| SessionCamera {
        name: name.into(),
        live: Some("/dev/null".into()),
        ..Default::default()
    };
    SessionFile {
        schema: SESSION_SCHEMA,
        name: "recorded".into(),
        vehicle: at.join("vehicle.toml"),
        inputs: "".into(),
        log: None,
        sensors: None,
        truth: None,
        model: None,
        control: Some(ControlSection {
            points: at.join("points.csv"),
            observations: Some(at.join("pixels.csv")),
        }),
        wand: None,
        board: None,
        refine: None,
        flash: false,
        clap: false,
        rig: None,
        live: None,
        camera: vec![camera("cam1"), camera("cam2")],
    }
}

pub(crate) fn recorded(session: SessionFile) -> RecordedSession {
    RecordedSession { session, base: "".into(), rate_hz: 30.0, inputs: None, waits: true }
}

fn fly_into(folder: &Path, from: &Path, films: &[Vec<(i64, Frame)>]) -> (u64, Vec<Event>) {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let recorder = Recorder::begin(folder, recorded(session(from))).expect("as staged");
    let recorder = RecorderSlot::with(Some(recorder));
    let cameras = films.iter().map(|film| {
        let frames = film.clone().into_iter().map(Ok::<_, Infallible>);
        CameraSetup::replay("cam", frames, Pace::Fast, &Default::default())
    });
    let (mut flight, heard) =
        setup((&rig, &vehicle), cameras.collect(), Pace::Fast, FlightClock::starting_at(0));
    flight.recorder = recorder;
    let flown = fly(flight).expect("as staged");
    let events = heard.events.lock().expect("as staged").clone();
    (flown.measured, events)
}

#[test]
fn a_recording_is_a_session_with_the_frames_that_came() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let folder = to.path().join("flight");
    let films = film(&rig(), 20, 30.0);
    let (measured, events) = fly_into(&folder, from.path(), &films);
    assert!(measured >= 18, "{measured}");
    let session = Session::load(&folder.join("session.toml")).unwrap();
    for (k, film) in films.iter().enumerate() {
        let got: Vec<_> = session.open_camera(k).unwrap().map(Result::unwrap).collect();
        assert!(got == *film, "camera {k}");
    }
    let lines = |name: &str| -> Vec<serde_json::Value> {
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        text.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    };
    assert_eq!(lines("detected.ndjson").len(), 40);
    let sent = lines("sent.ndjson");
    assert_eq!(sent.iter().filter(|e| e["event"] == "pose").count(), 20);
    assert_eq!(sent[0]["event"], "scene");
    let Some(Event::Recording { seconds, bytes, fault, .. }) =
        events.iter().rev().find(|e| matches!(e, Event::Recording { .. }))
    else {
        panic!("no word of the recording")
    };
    assert!((seconds - 19.0 / 30.0).abs() < 1e-6 && *bytes > 40 * 3 * 640 * 480 && fault.is_none());
    let again = Recorder::begin(&folder, recorded(self::session(from.path())));
    assert!(again.is_err_and(|e| e.to_string().contains("another folder")));
}

#[test]
fn a_recording_has_the_cameras_of_its_rig_file() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let file = from.path().join("rig.toml");
    mavsight_session::write_rig(&file, &rig()).unwrap();
    let session = SessionFile { rig: Some(RigSection { file }), control: None, ..session(from.path()) };
    // As it is, it films live alone: there is no recording to compare the size with.
    let live = from.path().join("session.toml");
    mavsight_session::write_toml(&live, &session).unwrap();
    let live = Session::load(&live).unwrap();
    assert_eq!(live.rig().unwrap().unwrap().cameras.len(), 2);
    assert!(live.image_size(0).unwrap_err().to_string().contains("`video` or `still`"));
    let folder = to.path().join("flight");
    Recorder::begin(&folder, recorded(session)).unwrap().finish();
    drop(from);
    let recorded = Session::load(&folder.join("session.toml")).unwrap();
    assert_eq!(recorded.file.rig.map(|r| r.file), Some(folder.join("rig.toml")));
}

/// A log, a table of sensors, and a model file elsewhere that the vehicle names.
#[test]
fn a_recording_has_all_files_that_its_session_names() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let base = session(from.path());
    let vehicle = Vehicle::paper();
    std::fs::create_dir(from.path().join("models")).unwrap();
    std::fs::write(from.path().join("models/own.toml"), &vehicle.model.definition).unwrap();
    let text = std::fs::read_to_string(&base.vehicle).unwrap();
    let named = text.replace("model = \"coaxial\"", "model = \"models/own.toml\"");
    assert_ne!(named, text);
    std::fs::write(&base.vehicle, named).unwrap();
    std::fs::write(from.path().join("log.csv"), "t_s,a\n0,1\n").unwrap();
    std::fs::write(from.path().join("sensors.csv"), "t_s\n0\n").unwrap();
    let log = LogSection { file: "log.csv".into(), ..LogSection::default() };
    let session = SessionFile { log: Some(log), sensors: Some("sensors.csv".into()), ..base };
    let folder = to.path().join("flight");
    let of = RecordedSession { base: from.path().to_owned(), ..recorded(session) };
    Recorder::begin(&folder, of).unwrap().finish();
    drop(from);
    let recorded = Session::load(&folder).unwrap();
    assert_eq!(recorded.vehicle.model.definition, vehicle.model.definition);
    assert_eq!(recorded.file.sensors, Some(folder.join("sensors.csv")));
    assert_eq!(recorded.file.log.map(|log| log.file), Some(folder.join("log.csv")));
}

#[cfg(target_os = "linux")]
#[test]
fn on_a_full_disk_the_recording_ends_with_a_word_and_the_flight_goes_on() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let folder = to.path().join("flight");
    std::fs::create_dir(&folder).unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.join("cam2.y4m")).unwrap();
    let films = film(&rig(), 12, 30.0);
    let (measured, events) = fly_into(&folder, from.path(), &films);
    assert!(measured >= 10, "{measured}");
    let faults: Vec<_> = events
        .iter()
        .filter_map(|e| if let Event::Recording { fault: Some(f), .. } = e { Some(f) } else { None })
        .collect();
    assert!(
        faults.first().is_some_and(|f| f.contains("No space left") && f.contains("goes on")),
        "{faults:?}"
    );
    // What was written before, if anything was, is whole.
    if let Ok(first) = FrameSource::open(&folder.join("cam1.y4m"), None) {
        assert!(first.map(Result::unwrap).all(|(_, frame)| frame.check().is_ok()));
    }
}
