//! A recording gives the same poses live as in a batch run.

use crate::common::{camera, film, rig, setup};
use mavsight_flight::Vehicle;
use mavsight_live::{FlightClock, Pace, Replay, Source, fly};
use mavsight_pipeline::{CameraFeed, PipelineError, Quiet, TimedFrame, track_and};
use mavsight_pose::{CausalFilter, ChainNoise, MotionNoise, PoseSample};
use mavsight_vision::Frame;
use std::convert::Infallible;

fn noise() -> MotionNoise {
    MotionNoise { translation: ChainNoise::white(0.3, 1.2), rotation: ChainNoise::white(4.0, 0.8) }
}

/// The raw poses of a batch run.
fn batch(films: &[Vec<(i64, Frame)>]) -> Vec<PoseSample> {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let feed = |(k, film): (usize, &Vec<(i64, Frame)>)| {
        let frames =
            film.clone().into_iter().map(|(t_ns, frame)| Ok::<_, PipelineError>(TimedFrame { t_ns, frame }));
        CameraFeed::new(format!("cam{}", k + 1), None, Box::new(frames))
    };
    let mut poses = Vec::new();
    let feeds = films.iter().enumerate().map(feed).collect();
    track_and(feeds, &rig, &vehicle, &Quiet, |i| poses.push(i.association.sample.clone()))
        .expect("a batch run");
    poses
}

#[test]
fn batch_and_live_are_one_bit_for_bit() {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let mut films = film(&rig, 60, 30.0);
    // A gap in one camera and one in both.
    films[1].drain(30..33);
    films.iter_mut().for_each(|f| drop(f.drain(45..47)));
    let poses = batch(&films);
    let cameras = films.iter().enumerate().map(|(k, film)| {
        let mut frames = Some(film.clone().into_iter().map(Ok::<_, Infallible>));
        let open = move |_| {
            let replay = Replay::new(frames.take().ok_or("ended")?, None, Default::default());
            Ok(Box::new(replay) as Box<dyn Source>)
        };
        camera(&format!("cam{}", k + 1), Box::new(open), false)
    });
    let clock = FlightClock::starting_at(0);
    let (mut flight, heard) = setup((&rig, &vehicle), cameras.collect(), Pace::Fast, clock);
    flight.noise = Some(noise());
    let flown = fly(flight).unwrap();
    let fixes = heard.fixes.lock().unwrap();
    assert_eq!((fixes.len(), flown.instants as usize, flown.dropped), (poses.len(), poses.len(), vec![0, 0]));
    assert!(flown.measured > 50, "{}", flown.measured);
    let mut filter = CausalFilter::new(noise(), vehicle.environment.gravity_m_s2).unwrap();
    for (k, (fix, batch)) in fixes.iter().zip(&poses).enumerate() {
        assert_eq!((fix.sequence, fix.captured_ns), (k as u64, clock.unix_ns(batch.t_ns)));
        let motion = filter.push(batch).unwrap();
        let (Some(live), Some(batch)) = (&fix.measured, &batch.estimate) else {
            assert!(fix.measured.is_none() && batch.estimate.is_none(), "instant {k}");
            continue;
        };
        assert_eq!(live.world_from_body, batch.world_from_body, "instant {k}");
        assert_eq!(live.covariance, batch.covariance(), "instant {k}");
        let (moving, motion) = (live.moving.as_ref().unwrap(), motion.unwrap());
        assert_eq!(moving.velocity_in_body_m_s, motion.velocity_in_body_m_s);
        assert_eq!(moving.rates_rad_s, motion.rates_rad_s);
    }
}
