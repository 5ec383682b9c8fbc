//! A recording gives the same poses live as in a batch run.

use crate::common::{film, rig, setup};
use mavsight_flight::Vehicle;
use mavsight_link::Event;
use mavsight_live::{CameraSetup, FlightClock, Pace, fly};
use mavsight_pipeline::{CameraFeed, NoProgress, PipelineError, TimedFrame, track_with};
use mavsight_pose::{CausalFilter, JerkNoise, MotionNoise, PoseSample};
use mavsight_vision::Frame;
use std::convert::Infallible;

fn noise() -> MotionNoise {
    MotionNoise { translation: JerkNoise::white(0.3, 1.2), rotation: JerkNoise::white(4.0, 0.8) }
}

/// Recordings as live cameras.
fn replays(films: &[Vec<(i64, Frame)>]) -> Vec<CameraSetup> {
    let replay = |(k, film): (usize, &Vec<(i64, Frame)>)| {
        let frames = film.clone().into_iter().map(Ok::<_, Infallible>);
        CameraSetup::replay(&format!("cam{}", k + 1), frames, Pace::Fast, &Default::default())
    };
    films.iter().enumerate().map(replay).collect()
}

/// The raw poses of a batch run.
fn batch(films: &[Vec<(i64, Frame)>]) -> Result<Vec<PoseSample>, PipelineError> {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let feed = |(k, film): (usize, &Vec<(i64, Frame)>)| {
        let frames =
            film.clone().into_iter().map(|(t_ns, frame)| Ok::<_, PipelineError>(TimedFrame { t_ns, frame }));
        CameraFeed::new(format!("cam{}", k + 1), None, Box::new(frames))
    };
    let mut poses = Vec::new();
    let feeds = films.iter().enumerate().map(feed).collect();
    track_with(feeds, &rig, &vehicle, &NoProgress, |i| poses.push(i.association.sample.clone()))?;
    Ok(poses)
}

#[test]
fn batch_and_live_are_one_bit_for_bit() {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let mut films = film(&rig, 60, 30.0);
    // A gap in one camera and one in both.
    films[1].drain(30..33);
    films.iter_mut().for_each(|f| drop(f.drain(45..47)));
    let poses = batch(&films).expect("a batch run");
    let clock = FlightClock::starting_at(0);
    let (mut flight, heard) = setup((&rig, &vehicle), replays(&films), Pace::Fast, clock);
    flight.noise = Some(noise());
    let flown = fly(flight).unwrap();
    let fixes = heard.fixes.lock().unwrap();
    assert_eq!((fixes.len(), flown.instants as usize, flown.dropped), (poses.len(), poses.len(), vec![0, 0]));
    assert!(flown.measured > 50, "{}", flown.measured);
    let mut filter = CausalFilter::new(noise(), vehicle.environment.gravity_m_s2).unwrap();
    let mut moved = 0;
    for (k, (fix, batch)) in fixes.iter().zip(&poses).enumerate() {
        assert_eq!((fix.sequence, fix.captured_ns), (k as u64, clock.unix_ns(batch.t_ns)));
        let motion = filter.push(batch).unwrap();
        let (Some(live), Ok(batch)) = (&fix.measured, &batch.estimate) else {
            assert!(fix.measured.is_none() && batch.estimate.is_err(), "instant {k}");
            continue;
        };
        assert_eq!(live.world_from_body, batch.world_from_body, "instant {k}");
        assert_eq!(live.covariance, batch.covariance(), "instant {k}");
        assert_eq!(live.moving.is_some(), motion.is_some(), "instant {k}");
        let Some((moving, motion)) = live.moving.as_ref().zip(motion) else { continue };
        assert_eq!(moving.velocity_in_body_m_s, motion.velocity_in_body_m_s);
        assert_eq!(moving.rates_rad_s, motion.rates_rad_s);
        moved += 1;
    }
    assert!(moved > 40, "{moved}");
}

/// A batch run refuses exchanged cameras; a flight reports them, and gives no pose from then on.
#[test]
fn exchanged_cameras_are_reported() {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let mut films = film(&rig, 90, 30.0);
    films.swap(0, 1);
    let refused = batch(&films).expect_err("cameras in each other's place").to_string();
    assert!(refused.contains("cam1 and cam2 exchanged"), "{refused}");
    let clock = FlightClock::starting_at(0);
    let (flight, heard) = setup((&rig, &vehicle), replays(&films), Pace::Fast, clock);
    fly(flight).unwrap();
    let events = heard.events.lock().unwrap();
    let notes: Vec<&String> = events
        .iter()
        .filter_map(|e| match e {
            Event::Note { fault: true, text, .. } => Some(text),
            _ => None,
        })
        .collect();
    assert!(matches!(notes[..], [one] if one.contains("cam1 and cam2 exchanged")), "{notes:?}");
    let fixes = heard.fixes.lock().unwrap();
    assert!(fixes.len() > 80 && fixes[70..].iter().all(|fix| fix.measured.is_none()));
}
