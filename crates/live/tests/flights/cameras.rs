//! Cameras that stall, end and come back.

use crate::common::{Scripted, camera, film, picture, pose, rig, setup};
use mavsight_flight::Vehicle;
use mavsight_geometry::ImageSize;
use mavsight_link::{CameraState, Event, Measured, Tracking};
use mavsight_live::{CameraSetup, FlightClock, Next, Pace, Source, fly};
use mavsight_pose::Rig;
use mavsight_vision::Frame;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Slow enough for a loaded computer to keep up.
const RATE_HZ: f64 = 10.0;
pub(crate) const STEP_NS: i64 = 100_000_000;

/// What happens to a camera at a frame.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Fate {
    Films,
    Empty,
    Silent,
    Ends,
    /// Shows the picture of another frame.
    Shows(u32),
    /// Shows the balls where they were in another frame.
    Stands(u32),
    /// Has a stamp that is off, ns.
    Off(i64),
}

/// A camera that films in real time what `fate` says of each frame's number.
fn scripted(rig: &Rig, k: usize, clock: FlightClock, frames: u32, fate: fn(u32) -> Fate) -> CameraSetup {
    let view = rig.cameras[k].camera;
    let next = Arc::new(AtomicU32::new(0));
    let open = move |_| {
        let next = Arc::clone(&next);
        let source = move || {
            loop {
                let frame = next.fetch_add(1, Ordering::Relaxed);
                if frame >= frames {
                    return Next::Over;
                }
                let t_ns = i64::from(frame) * STEP_NS;
                let (placed, shown) = match fate(frame) {
                    Fate::Shows(other) => (other, other),
                    Fate::Stands(other) => (other, frame),
                    _ => (frame, frame),
                };
                let at = pose(f64::from(placed) / RATE_HZ);
                let picture = picture(&view, (fate(frame) != Fate::Empty).then_some(&at), shown as usize);
                std::thread::sleep(clock.until(t_ns));
                match fate(frame) {
                    Fate::Silent => {}
                    Fate::Ends => return Next::End("the cable is off".into()),
                    Fate::Films | Fate::Empty | Fate::Shows(_) | Fate::Stands(_) => {
                        return Next::Frame(t_ns, Arc::new(picture));
                    }
                    Fate::Off(by_ns) => return Next::Frame(t_ns + by_ns, Arc::new(picture)),
                }
            }
        };
        Ok(Box::new(Scripted(source)) as Box<dyn Source>)
    };
    camera(&rig.cameras[k].name, Box::new(open), true)
}

pub(crate) struct Observed {
    /// Time of each change of state, camera, state and reason.
    pub(crate) states: Vec<(f64, usize, CameraState, Option<String>)>,
    /// Time, validity, tracking and reset count of each instant.
    pub(crate) instants: Vec<(f64, bool, Tracking, u8)>,
    /// Poses with their times.
    pub(crate) poses: Vec<(f64, Measured)>,
    /// Time and text of each note of a fault.
    pub(crate) notes: Vec<(f64, String)>,
}

/// Flies for a number of frames, with a fate of each frame of each camera.
pub(crate) fn flown(frames: u32, fates: [fn(u32) -> Fate; 2]) -> Observed {
    flown_after(200_000_000, frames, fates)
}

/// Flies with the first frames a time after the clock began.
fn flown_after(wait_ns: i64, frames: u32, fates: [fn(u32) -> Fate; 2]) -> Observed {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let clock = FlightClock::starting_at(-wait_ns);
    let cameras = (0..2).map(|k| scripted(&rig, k, clock, frames, fates[k])).collect();
    let (mut flight, heard) = setup((&rig, &vehicle), cameras, Pace::Own, clock);
    flight.for_ns = Some(i64::from(frames) * STEP_NS + 200_000_000 + wait_ns);
    fly(flight).expect("as staged");
    let (events, fixes) = (heard.events.lock().expect("as staged"), heard.fixes.lock().expect("as staged"));
    let mut out = Observed { states: Vec::new(), instants: Vec::new(), poses: Vec::new(), notes: Vec::new() };
    let mut now_s = 0.0;
    for event in events.iter() {
        match event {
            Event::Pose(p) => {
                assert_eq!(p.position_m.is_some(), p.valid);
                now_s = p.t_s;
                let fix = &fixes[p.sequence as usize];
                assert_eq!(fix.measured.is_some(), p.valid);
                out.instants.push((p.t_s, p.valid, p.tracking, fix.resets));
                out.poses.extend(fix.measured.clone().map(|measured| (p.t_s, measured)));
            }
            Event::Camera { camera, state, reason, .. }
                if out.states.iter().rev().find(|s| s.1 == *camera).is_none_or(|s| s.2 != *state) =>
            {
                out.states.push((now_s, *camera, *state, reason.clone()));
            }
            Event::Note { t_s, fault: true, text } => out.notes.push((*t_s, text.clone())),
            _ => {}
        }
    }
    // No pose is ever sent twice.
    let places: Vec<_> = fixes.iter().filter_map(|f| Some(f.measured.as_ref()?.world_from_body)).collect();
    assert!(places.windows(2).all(|w| w[0] != w[1]));
    out
}

fn states_of(flown: &Observed, camera: usize) -> Vec<CameraState> {
    flown.states.iter().filter(|s| s.1 == camera).map(|s| s.2).collect()
}

#[test]
fn a_camera_that_stalls_is_reported_and_used_again() {
    let second = |k: u32| if (15..24).contains(&k) { Fate::Silent } else { Fate::Films };
    let flown = flown(40, [|_| Fate::Films, second]);
    use CameraState::{Running, Stalled, Starting};
    // At the end the film is over.
    assert!(states_of(&flown, 1).starts_with(&[Starting, Running, Stalled, Running]), "{:?}", flown.states);
    let stalled = flown.states.iter().find(|s| s.2 == Stalled).unwrap();
    // The last frame is at 1.4 s: two intervals, and what a loaded computer takes.
    assert!((1.4..1.85).contains(&stalled.0) && stalled.3.as_ref().unwrap().contains("cable"), "{stalled:?}");
    // The other camera goes on by itself, with one pose an instant.
    let during: Vec<_> = flown.instants.iter().filter(|i| (1.65..2.35).contains(&i.0)).collect();
    assert!(during.len() >= 6 && during.iter().all(|i| i.1), "{:?}", flown.instants);
    // PX4 begins anew at each reset, of which there were two for each stall.
    let resets: Vec<u8> = flown.instants.iter().map(|i| i.3).collect();
    assert!(resets.iter().all(|count| *count == 0), "{resets:?}");
    assert!(flown.instants.len() >= 37, "{}", flown.instants.len());
}

#[test]
fn cameras_that_take_long_to_start_show_their_rate_all_the_same() {
    let flown = flown_after(3_000_000_000, 20, [|_| Fate::Films, |_| Fate::Films]);
    // At the rate of a camera of which nothing is known, 30 Hz, these would stall between any two frames.
    assert!(flown.states.iter().all(|s| s.2 != CameraState::Stalled || s.0 > 1.8), "{:?}", flown.states);
    assert!(flown.instants.iter().filter(|i| i.0 < 1.8).all(|i| i.3 == 0), "{:?}", flown.instants);
}

#[test]
fn a_camera_that_ends_is_opened_again() {
    let second = |k: u32| if k == 15 { Fate::Ends } else { Fate::Films };
    let flown = flown(36, [|_| Fate::Films, second]);
    use CameraState::{Gone, Running, Starting};
    let states = states_of(&flown, 1);
    assert!(states.starts_with(&[Starting, Running, Gone]) && states[3..].contains(&Running), "{states:?}");
    let gone = flown.states.iter().find(|s| s.2 == Gone).unwrap();
    assert!(
        (1.3..1.75).contains(&gone.0) && gone.3.as_ref().unwrap().contains("the cable is off"),
        "{gone:?}"
    );
}

/// At `Pace::Fast` no clock shows that a recording is over before the others.
#[test]
fn a_recording_that_ends_early_is_reported_at_any_pace() {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let mut films = film(&rig, 40, 30.0);
    films[1].truncate(20);
    let cameras = films.into_iter().enumerate().map(|(k, film)| {
        let frames = film.into_iter().map(Ok::<_, std::convert::Infallible>);
        CameraSetup::replay(&rig.cameras[k].name, frames, Pace::Fast, &Default::default())
    });
    let (flight, heard) = setup((&rig, &vehicle), cameras.collect(), Pace::Fast, FlightClock::starting_at(0));
    let flown = fly(flight).unwrap();
    assert_eq!((flown.instants, flown.frames), (40, vec![40, 20]));
    let events = heard.events.lock().unwrap();
    let gone = events.iter().filter_map(|e| match e {
        Event::Camera { camera, state: CameraState::Gone, reason, .. } => Some((*camera, reason.clone())),
        _ => None,
    });
    let gone: Vec<_> = gone.collect();
    assert!(!gone.is_empty() && gone.iter().all(|g| g.0 == 1), "{gone:?}");
    assert!(gone[0].1.as_ref().unwrap().contains("poses go on without it"), "{gone:?}");
}

/// The fault notes of a flight at `Pace::Fast` with given frames and end of the second camera.
pub(crate) fn noted(frames: Vec<(i64, Frame)>, end: Option<&'static str>) -> Vec<String> {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let first = film(&rig, 20, 30.0).swap_remove(0);
    let cameras = [(first, None), (frames, end)].into_iter().enumerate().map(|(k, (frames, end))| {
        let mut frames = frames.into_iter();
        let mut source = Some(move || match frames.next() {
            Some((t_ns, frame)) => Next::Frame(t_ns, Arc::new(frame)),
            None => end.map_or(Next::Over, |words| Next::End(words.into())),
        });
        let open = move |_| Ok(Box::new(Scripted(source.take().ok_or("open")?)) as Box<dyn Source>);
        camera(&rig.cameras[k].name, Box::new(open), false)
    });
    let (flight, heard) = setup((&rig, &vehicle), cameras.collect(), Pace::Fast, FlightClock::starting_at(0));
    fly(flight).expect("as staged");
    let events = heard.events.lock().expect("as staged");
    let note = |e: &Event| match e {
        Event::Note { fault: true, text, .. } => Some(text.clone()),
        _ => None,
    };
    events.iter().filter_map(note).collect()
}

#[test]
fn the_reason_of_an_early_end_is_reported() {
    let frames = || film(&rig(), 20, 30.0).swap_remove(1);
    assert_eq!(noted(frames(), None), [""; 0]);
    let cut = noted(frames()[..9].to_vec(), Some("the file is damaged"));
    assert_eq!(cut, ["cam2: the file is damaged."]);
    let mut other_size = frames();
    let size = ImageSize { width_px: 64, height_px: 48 };
    other_size[9].1 = Frame::from_rgb(size, vec![90; 64 * 48 * 3]).unwrap();
    let noted = noted(other_size, None);
    assert!(noted.len() == 1 && noted[0].contains("64×48"), "{noted:?}");
}

#[test]
fn stamps_that_went_back_are_reported_once() {
    let mut frames = film(&rig(), 20, 30.0).swap_remove(1);
    frames.iter_mut().skip(10).for_each(|f| f.0 -= 200_000_000);
    let noted = noted(frames, None);
    assert!(
        noted.len() == 1 && noted[0].contains("cam2") && noted[0].contains("went back by 0.167 s"),
        "{noted:?}"
    );
}

#[test]
fn an_aircraft_that_is_gone_is_lost_and_found_and_nothing_is_sent_meanwhile() {
    let both = |k: u32| match k {
        0..8 | 20..24 => Fate::Empty,
        30..34 => Fate::Silent,
        _ => Fate::Films,
    };
    let flown = flown(46, [both, both]);
    let at = |t: f64| *flown.instants.iter().find(|i| (i.0 - t).abs() < 0.01).unwrap();
    assert!(at(0.5).2 == Tracking::Acquiring && !at(0.5).1);
    assert!(
        flown.instants.iter().any(|i| i.0 < 0.95 && i.1 && i.2 == Tracking::Tracking),
        "{:?}",
        flown.instants
    );
    assert!(at(1.9).1 && at(1.9).2 != Tracking::Lost, "{:?}", flown.instants);
    // Within two frames.
    assert!(at(2.1).2 == Tracking::Lost && !at(2.1).1 && !at(2.3).1);
    let found = flown.instants.iter().find(|i| i.0 > 2.3 && i.1).unwrap();
    assert!(found.0 < 2.75 && found.2 == Tracking::Reacquired && found.3 > 0, "{found:?}");
    // Where no camera films there is no instant.
    assert!(!flown.instants.iter().any(|i| (2.95..3.35).contains(&i.0)), "{:?}", flown.instants);
    // Nothing was missed then, and yet its first pose does not follow from the last.
    let before = flown.instants.iter().rfind(|i| i.0 < 2.95).unwrap();
    let again = flown.instants.iter().find(|i| i.0 > 3.35 && i.1).unwrap();
    assert!(again.2 == Tracking::Reacquired && again.3 > before.3, "{before:?} {again:?}");
    assert!(flown.instants.iter().any(|i| i.0 > 3.6 && i.1));
}
