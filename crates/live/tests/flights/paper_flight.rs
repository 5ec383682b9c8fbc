//! The recorded flight of the shared data: its first frames live and in a batch run.

use crate::common::setup;
use mavsight_live::{CameraSetup, FlightClock, Pace, fly};
use mavsight_pipeline::{
    CameraFeed, ControlStill, NoProgress, PipelineError, TimedFrame, calibrate_from_stills, track_with,
};
use mavsight_session::{Session, read_image};
use std::path::PathBuf;

const FRAMES: usize = 60;

#[test]
fn its_raw_poses_are_the_same_bit_for_bit() {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("MAVSIGHT_DATA").map_or(shared, PathBuf::from);
    let path = data.join("paper-flight/session.toml");
    if !path.is_file() {
        println!("skipped: no {}", path.display());
        return;
    }
    let session = Session::load(&path).unwrap();
    let still = |c: &mavsight_session::SessionCamera| ControlStill {
        camera: c.name.clone(),
        frame: read_image(c.still.as_ref().unwrap()).unwrap(),
    };
    let stills: Vec<_> = session.cameras().iter().map(still).collect();
    let rig = calibrate_from_stills(&stills, &session.control_points().unwrap(), &[]).unwrap();
    let feed = |k: usize| {
        let frames = session.open_camera(k).unwrap().take(FRAMES);
        let frames = frames.map(|f| {
            let (t_ns, frame) = f.unwrap();
            Ok::<_, PipelineError>(TimedFrame { t_ns, frame })
        });
        CameraFeed::new(session.cameras()[k].name.clone(), None, Box::new(frames))
    };
    let mut batch = Vec::new();
    track_with(vec![feed(0), feed(1)], &rig, &session.vehicle, &NoProgress, |i| {
        batch.push(i.association.sample.clone());
    })
    .unwrap();
    let cameras = (0..2).map(|k| {
        let frames = session.open_camera(k).unwrap().take(FRAMES);
        CameraSetup::replay(&session.cameras()[k].name, frames, Pace::Fast, &Default::default())
    });
    let clock = FlightClock::starting_at(0);
    let (flight, heard) = setup((&rig, &session.vehicle), cameras.collect(), Pace::Fast, clock);
    fly(flight).unwrap();
    let fixes = heard.fixes.lock().unwrap();
    assert_eq!((fixes.len(), batch.len()), (FRAMES, FRAMES));
    for (live, batch) in fixes.iter().zip(&batch) {
        let (a, b) = (live.measured.as_ref(), batch.estimate.as_ref().ok());
        assert_eq!(a.map(|m| m.world_from_body), b.map(|e| e.world_from_body));
        assert_eq!(a.map(|m| m.covariance), b.map(|e| e.covariance()));
    }
    assert!(fixes.iter().filter(|f| f.measured.is_some()).count() >= FRAMES - 2);
}
