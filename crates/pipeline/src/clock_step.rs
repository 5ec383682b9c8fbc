//! Clocks that were set to another time while their cameras filmed.
//!
//! The frames of a camera come at equal times, less some that are missing. A clock that is set leaves a time between two
//! frames that is no multiple of theirs, and so does a camera that pauses. Which of them it was, the flight shows: by a
//! clock that was set, the aircraft is elsewhere from then on. A clock that is set by a whole number of frames looks as if
//! frames were missing or came twice: it is found where the flight shows it decidedly. How far from a whole number is
//! distinguished, the film says by how regularly its other frames come.

use crate::markers::{MarkerColors, body_markers};
use crate::stream::{Stream, camera_streams};
use crate::{Cause, Finding};
use mavsight_flight::Vehicle;
use mavsight_pose::{
    CameraStream, ClockPrior, Rig, StampOdds, estimate_clocks, informative_stretches_ns, odds_of_stamps,
};

/// Frames before and after a step that come at equal times: as many as make half a second at a low rate.
const REGULAR_FRAMES: usize = 8;

/// Part of the time between frames by which a step leaves their beat: what is less matters less than the eighth of it to
/// which clocks are determined. Where frames are missing less of it shows that not all of the time is theirs, as far as the
/// film is regular.
pub(crate) const OUT_OF_BEAT: f64 = 0.1;

/// Least part of the time between frames that is taken for a departure from their beat: a container's ticks are up to 1 ms,
/// and what is exact to its last digit is not more regular than that for being short.
const LEAST_DEPARTURE: f64 = 1e-3;

/// Missing frames beside a set clock that are compared by what remains of reprojection errors: a clock that is set just where
/// many frames are lost is two faults at once.
const MOST_COMPARED: usize = 3;

/// Frames that may be missing at one place, an hour of 30 Hz: no more are compared.
const MOST_MISSING: usize = 108_000;

/// Steps of one camera that are looked for: more of them are a clock that is no clock.
const MOST_STEPS: usize = 3;

/// Places of one camera at which frames are missing or came twice that are looked at, the largest first.
const MOST_WHOLE: usize = 4;

/// Twice the logarithm of the odds, 999 to 1, at which it is decided what happened.
pub(crate) const DECISIVE: f64 = 13.8;

/// Part of the time between frames to which a clock is known that is determined, as for clocks.
const DETERMINED: f64 = 0.125;

/// Part of chi-square by which detections between frames may differ from those of frames: their covariances are good to about a
/// twentieth of a standard deviation.
const INTERPOLATED: f64 = 0.1;

/// Twice the logarithm of how much oftener frames are lost than a clock is set by just as many of them, a thousand times: of
/// all places where frames are missing the flight decides some by chance.
const USUAL_LOSS: f64 = 13.8;

/// What happened between two frames.
enum Break {
    /// The clock was set ahead, by nanoseconds.
    Set(i64),
    /// The flight does not show which; nanoseconds by which the clock would have been set.
    Undecided(i64),
    /// The flight does not show whether the clock was set back, by nanoseconds, or frames were written twice.
    Again(i64),
}

/// Takes the steps of the cameras' clocks out of their time stamps where the flight shows them, and says which. Where it does
/// not show whether a clock was set, what the camera filmed from there on is left out. The first camera, by whose clock the
/// others' are known, comes last.
pub(crate) fn set_right(streams: &mut [Stream], rig: &Rig, vehicle: &Vehicle) -> Vec<Finding> {
    let mut findings = Vec::new();
    if streams.len() < 2 {
        return findings;
    }
    for camera in (1..streams.len()).chain([0]) {
        for _ in 0..MOST_STEPS {
            let happened =
                |place: Place| Some((place.at, what_happened(streams, camera, place, rig, vehicle)?));
            let Some((at, what)) = places(&streams[camera]).into_iter().find_map(happened) else {
                break;
            };
            let (name, t_s) = (&streams[camera].name, streams[camera].stamps_ns[at] as f64 * 1e-9);
            findings.push(match what {
                Break::Set(by_ns) => {
                    let note = format!(
                        "{name}: its clock was set by {:+.1} ms at {t_s:.3} s: from there on its time stamps are taken without \
                         that. Let no program set the clock of a camera that films.",
                        by_ns as f64 * 1e-6
                    );
                    streams[camera].move_stamps(at, -by_ns);
                    Finding::of(Cause::ClockStep, Some(camera), note)
                }
                Break::Undecided(by_ns) => {
                    let by_ms = by_ns as f64 * 1e-6;
                    let note = format!(
                        "{name}: at {t_s:.3} s its time stamps leave their beat: its clock was set by {by_ms:+.1} ms, or it paused, and \
                         the flight does not show which. It is left out from there on. Let no program set the clock of a camera \
                         that films."
                    );
                    streams[camera].end_before(at);
                    let causes = vec![Cause::ClockStep, Cause::CameraPaused];
                    Finding { causes, camera: Some(camera), note }
                }
                Break::Again(by_ns) => {
                    let by_ms = by_ns as f64 * 1e-6;
                    let note = format!(
                        "{name}: at {t_s:.3} s its time stamps have gone back by {by_ms:.1} ms, to those of frames before: its clock was \
                         set, or frames were written twice, and the flight does not show which. It is left out from there on. Let no \
                         program set the clock of a camera that films."
                    );
                    streams[camera].end_before(at);
                    Finding::of(Cause::ClockStep, Some(camera), note)
                }
            });
        }
    }
    findings
}

/// A frame before which a clock may have been set.
#[derive(Clone, Copy)]
struct Place {
    at: usize,
    /// Whether the frames keep their beat there: some are missing, or came with stamps that others had.
    is_whole: bool,
    /// Frames that are missing or came twice.
    frames: usize,
}

/// Mean time between frames that come one after another, and the largest departure of one of those from it, in parts of it.
fn beat(stream: &Stream) -> (f64, f64) {
    let usual_ns = stream.interval_s() * 1e9;
    let departure = |step_ns: f64, beat_ns: f64| (step_ns / beat_ns - 1.0).abs();
    let steps = stream.stamps_ns.windows(2).map(|w| (w[1] - w[0]) as f64);
    let regular: Vec<f64> = steps.filter(|step| departure(*step, usual_ns) <= OUT_OF_BEAT).collect();
    if regular.is_empty() {
        return (usual_ns * 1e-9, OUT_OF_BEAT);
    }
    let beat_ns = regular.iter().sum::<f64>() / regular.len() as f64;
    (beat_ns * 1e-9, regular.iter().map(|step| departure(*step, beat_ns)).fold(0.0, f64::max))
}

/// Frames before which the beat is broken, and then those at which frames are missing or came twice, the most first; the frames
/// are regular on both sides.
fn places(stream: &Stream) -> Vec<Place> {
    let (beat_s, departure) = beat(stream);
    let place = |(k, w): (usize, &[i64])| {
        let (at, beats) = (k + 1, (w[1] - w[0]) as f64 * 1e-9 / beat_s);
        // Twice what no frame that came alone departs by, for each of those that did not come.
        let limit = (2.0 * departure * beats.max(1.0)).clamp(LEAST_DEPARTURE, OUT_OF_BEAT);
        let is_off = (beats - beats.round()).abs() > limit || beats < 0.5;
        let frames = backward(stream, at) + (beats.round() as usize).saturating_sub(1);
        (is_off || frames > 0).then_some(Place { at, is_whole: !is_off, frames })
    };
    let all: Vec<Place> = stream.stamps_ns.windows(2).enumerate().filter_map(place).collect();
    let is_alone = |own: &&Place| {
        // Of stamps that came twice the places just before have some too.
        let rivals = |other: &&Place| !other.is_whole || (own.is_whole && other.frames >= own.frames);
        let is_near = |other: &Place| other.at != own.at && other.at.abs_diff(own.at) <= REGULAR_FRAMES;
        let is_within = own.at >= REGULAR_FRAMES && own.at + REGULAR_FRAMES <= stream.stamps_ns.len();
        is_within && !all.iter().filter(rivals).any(is_near)
    };
    let alone = all.iter().filter(is_alone).copied();
    let (mut whole, mut out): (Vec<Place>, Vec<Place>) = alone.partition(|place| place.is_whole);
    whole.sort_by_key(|place| std::cmp::Reverse(place.frames));
    out.extend(whole.into_iter().take(MOST_WHOLE));
    out
}

/// Frames whose stamps were not after those before them that came before a frame, in its beat.
fn backward(stream: &Stream, at: usize) -> usize {
    (1..).take_while(|k| stream.has_backward(at, *k, OUT_OF_BEAT)).count()
}

/// What broke the beat before a frame; nothing happened to the clock of a camera that paused.
fn what_happened(
    streams: &[Stream],
    camera: usize,
    place: Place,
    rig: &Rig,
    vehicle: &Vehicle,
) -> Option<Break> {
    let Place { at, is_whole, .. } = place;
    let stream = &streams[camera];
    let (interval_s, _) = beat(stream);
    let gap_s = (stream.stamps_ns[at] - stream.stamps_ns[at - 1]) as f64 * 1e-9;
    // Frames whose stamps were not after those before them came in between; those are in the new beat.
    let backward = backward(stream, at);
    let by_s = |missing: usize| gap_s - (1 + backward + missing) as f64 * interval_s;
    let ns = |by_s: f64| (by_s * 1e9).round() as i64;
    // No frame is missing, or as many as the flight asks for.
    let most = ((gap_s / interval_s) as usize).saturating_sub(1).min(MOST_MISSING);
    let steps: Vec<f64> = (0..=most).map(by_s).collect();
    let against = if is_whole && backward == 0 { USUAL_LOSS } else { 0.0 };
    let mut decided = by_clocks(streams, camera, (place, interval_s), &steps, rig, vehicle);
    if (-DECISIVE..DECISIVE + against).contains(&decided.1) {
        let compared = if is_whole { 1 } else { (1 + MOST_COMPARED).min(steps.len()) };
        let seen = camera_streams(streams, &MarkerColors::of(vehicle));
        let odds = |by_s: f64| {
            let with = moved(&seen, camera, stream.stamps_ns[at], -ns(by_s));
            let odds = odds_of_stamps(rig, &body_markers(vehicle), camera, [&seen, &with]);
            odds.map_or(0.0, |odds| beyond_doubt(odds, by_s / interval_s))
        };
        decided = likeliest(&steps[..compared], odds);
    }
    let (set_s, lead) = (decided.0, decided.1 - against);
    // No time passes backward; but frames may be written twice.
    let lead = if backward > 0 && !is_whole { f64::INFINITY } else { lead };
    if set_s.abs() < OUT_OF_BEAT * interval_s {
        None
    } else if lead >= DECISIVE {
        Some(Break::Set(ns(set_s)))
    } else if lead <= -DECISIVE || (is_whole && backward == 0) {
        None
    } else if is_whole {
        Some(Break::Again(ns(set_s)))
    } else {
        Some(Break::Undecided(ns(set_s)))
    }
}

/// Twice the logarithm of the odds of a step of so many frames, beyond what may be of the interpolation between frames.
fn beyond_doubt(odds: StampOdds, frames: f64) -> f64 {
    let is_same_phase = (frames - frames.round()).abs() < OUT_OF_BEAT;
    odds.lead(if is_same_phase { 0.0 } else { INTERPOLATED * odds.chi_square })
}

/// The step that is likeliest, the first where none is decidedly more so, and twice the logarithm of its odds against none.
fn likeliest(steps_s: &[f64], odds: impl Fn(f64) -> f64) -> (f64, f64) {
    let all: Vec<(f64, f64)> = steps_s.iter().map(|by_s| (*by_s, odds(*by_s))).collect();
    let better = |a: (f64, f64), b: (f64, f64)| if b.1 > a.1 { b } else { a };
    let (Some(first), Some(best)) = (all.first().copied(), all.iter().copied().reduce(better)) else {
        return (0.0, 0.0);
    };
    if best.1 - first.1 < DECISIVE { first } else { best }
}

/// [`likeliest`] by the clock before and after a place, as each part of the flight shows it.
fn by_clocks(
    streams: &[Stream],
    camera: usize,
    (Place { at, is_whole, .. }, interval_s): (Place, f64),
    steps_s: &[f64],
    rig: &Rig,
    vehicle: &Vehicle,
) -> (f64, f64) {
    let stream = &streams[camera];
    let after = clock_of(streams, camera, at..stream.stamps_ns.len(), rig, vehicle);
    let before = match stream.clock.offset_std_s {
        0.0 => Some((stream.clock.clock.offset_s, 0.0)),
        _ => clock_of(streams, camera, 0..at, rig, vehicle),
    };
    // A clock that is less than determined may be anywhere: its estimate is near its start. By whole frames it has to be known
    // as well as decides between none and all of them.
    let whole_s = steps_s.first().map_or(0.0, |by_s| by_s.abs() / DECISIVE.sqrt());
    let limit_s = if is_whole { whole_s } else { DETERMINED * interval_s };
    let is_determined = |c: &(f64, f64)| c.1 <= limit_s;
    let (ahead_s, std_s) = match (before.filter(is_determined), after.filter(is_determined)) {
        (Some(b), Some(a)) => (a.0 - b.0, b.1.hypot(a.1)),
        _ => (0.0, f64::INFINITY),
    };
    let square = |by_s: f64| ((ahead_s - by_s) / std_s).powi(2);
    likeliest(steps_s, |by_s| square(0.0) - square(by_s))
}

/// What was seen, with the time stamps of a camera moved from one on.
fn moved(seen: &[CameraStream], camera: usize, from_ns: i64, by_ns: i64) -> Vec<CameraStream> {
    let mut out = seen.to_vec();
    for o in out[camera].observations.iter_mut().filter(|o| o.t_ns >= from_ns) {
        o.t_ns += by_ns;
    }
    out
}

/// The offset of a camera's clock by some of its frames, of which nothing is known before, and its standard deviation.
fn clock_of(
    streams: &[Stream],
    camera: usize,
    frames: std::ops::Range<usize>,
    rig: &Rig,
    vehicle: &Vehicle,
) -> Option<(f64, f64)> {
    let colors = MarkerColors::of(vehicle);
    let stamps_ns = &streams[camera].stamps_ns[frames];
    let (first_ns, last_ns) = (*stamps_ns.first()?, *stamps_ns.last()?);
    let clock = streams[camera].clock.clock;
    let stretches_ns = informative_stretches_ns((clock.time_ns(first_ns), clock.time_ns(last_ns)));
    let seen: Vec<_> = streams
        .iter()
        .enumerate()
        .map(|(k, stream)| {
            let mut seen = stream.camera_stream(&colors, &stretches_ns);
            if k == camera {
                seen.prior = ClockPrior { drift_std: 0.0, ..ClockPrior::unknown() };
                seen.prior.clock = clock;
                seen.observations.retain(|o| (first_ns..=last_ns).contains(&o.t_ns));
            }
            seen
        })
        .collect();
    let found = estimate_clocks(rig, &body_markers(vehicle), &seen).get(camera).copied()?;
    found.offset_std_s.is_finite().then_some((found.shown.offset_s, found.offset_std_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{rig, stream, with_frames};
    use mavsight_pose::CameraClock;

    fn streams() -> Vec<Stream> {
        (0..3).map(|camera| stream(camera, CameraClock::default(), 30.0, 0..180)).collect()
    }

    fn found(streams: &mut [Stream]) -> Vec<Finding> {
        set_right(streams, &rig(), &Vehicle::paper())
    }

    /// A clock that was set put the aircraft elsewhere, and nothing said so.
    #[test]
    fn a_clock_that_was_set_is_set_right_whether_it_was_known_or_not() {
        let sound = streams()[1].stamps_ns.clone();
        for (by_ms, is_known) in
            [(20, true), (-12, false), (150, false), (-90, true), (100, true), (-67, false), (33, false)]
        {
            let mut stepped = streams();
            if !is_known {
                stepped[1].clock = ClockPrior::unknown();
            }
            // Frames whose stamps are not after those before them are not taken.
            let lost = usize::try_from(-by_ms / 33).unwrap_or(0);
            let backward_ns = stepped[1].stamps_ns[70..70 + lost].to_vec();
            stepped[1] = with_frames(&stepped[1], 1, |k| !(70..70 + lost).contains(&k));
            backward_ns.iter().for_each(|t| stepped[1].add_backward(t + by_ms * 1_000_000));
            stepped[1].move_stamps(70, by_ms * 1_000_000);
            let findings = found(&mut stepped);
            let [one] = &findings[..] else { panic!("{by_ms} ms: {findings:?}") };
            assert_eq!((one.cause(), one.camera), (Some(Cause::ClockStep), Some(1)), "{}", one.note);
            let right = &sound[..70].iter().chain(&sound[70 + lost..]).copied().collect::<Vec<i64>>();
            let apart_ns = stepped[1].stamps_ns.iter().zip(right).map(|(a, b)| (a - b).abs()).max();
            assert!(apart_ns < Some(1_000_000), "{by_ms} ms: {apart_ns:?} ns");
        }
    }

    /// A clock that was set to the time of day asked for as many steps as frames of half a century, and for their memory.
    #[test]
    fn a_clock_that_was_set_to_the_time_of_day_needs_no_memory_for_half_a_century() {
        let mut stepped = streams();
        stepped[1].move_stamps(70, 1_700_000_000_000_000_000);
        assert!(found(&mut stepped).len() <= 1);
    }

    /// Of the first camera, by whose clock the others' are known, no step was looked for.
    #[test]
    fn a_clock_of_the_first_camera_that_was_set_is_set_right() {
        let sound = streams()[0].stamps_ns.clone();
        for by_ms in [20, 100, 150] {
            let mut stepped = streams();
            stepped[0].move_stamps(70, by_ms * 1_000_000);
            let findings = found(&mut stepped);
            let [one] = &findings[..] else { panic!("{by_ms} ms: {findings:?}") };
            assert_eq!((one.cause(), one.camera), (Some(Cause::ClockStep), Some(0)), "{}", one.note);
            let apart_ns = stepped[0].stamps_ns.iter().zip(&sound).map(|(a, b)| (a - b).abs()).max();
            assert!(apart_ns < Some(1_000_000), "{by_ms} ms: {apart_ns:?} ns");
        }
    }

    /// A step of nearly whole frames was taken for frames that are missing: the aircraft was centimetres from where it was said
    /// to be. Of a film whose frames come to the nanosecond, a twentieth of a frame is no missing frame.
    #[test]
    fn a_camera_set_by_nearly_whole_frames_is_left_out_where_nothing_shows_it() {
        let mut resting = at_rest();
        resting[1].move_stamps(70, 31_600_000);
        let findings = found(&mut resting);
        let [one] = &findings[..] else { panic!("{findings:?}") };
        assert_eq!(one.causes, [Cause::ClockStep, Cause::CameraPaused], "{}", one.note);
        assert_eq!(resting[1].stamps_ns.len(), 70);
        // Of a film whose frames come a twentieth of their time late by turns, it may be one.
        let mut irregular = at_rest();
        let late = |k: usize| if k % 3 == 1 { 1_500_000 } else { 0 };
        irregular[1].stamps_ns.iter_mut().enumerate().for_each(|(k, t)| *t += late(k));
        irregular[1].move_stamps(70, 31_600_000);
        assert_eq!(found(&mut irregular), vec![]);
    }

    /// Three cameras before an aircraft that does not move.
    fn at_rest() -> Vec<Stream> {
        let mut resting = streams();
        for stream in &mut resting {
            let first: Vec<_> = stream.detections[..4].to_vec();
            let rest = |(k, d): (usize, &mut crate::stream::StoredDetection)| {
                d.pixel = first[k % 4].pixel + (d.pixel - first[k % 4].pixel) * 1e-4;
            };
            stream.detections.iter_mut().enumerate().for_each(rest);
        }
        resting
    }

    /// Before a flight at rest nothing shows whether a clock was set back by whole frames: its stamps were taken as they were.
    #[test]
    fn a_camera_whose_stamps_went_back_by_whole_frames_is_left_out_where_nothing_shows_why() {
        let mut resting = at_rest();
        let backward_ns = resting[1].stamps_ns[65..70].to_vec();
        resting[1] = with_frames(&resting[1], 1, |k| !(70..75).contains(&k));
        backward_ns.iter().for_each(|t| resting[1].add_backward(*t));
        let by_ns = resting[1].stamps_ns[70] - resting[1].stamps_ns[69];
        assert!(by_ns > 190_000_000, "{by_ns}");
        resting[1].move_stamps(70, -166_666_667);
        let findings = found(&mut resting);
        let [one] = &findings[..] else { panic!("{findings:?}") };
        assert_eq!((one.cause(), one.camera), (Some(Cause::ClockStep), Some(1)), "{}", one.note);
        assert!(one.note.contains("or frames were written twice"), "{}", one.note);
        assert_eq!(resting[1].stamps_ns.len(), 70);
        // Frames that are missing are that, and no more.
        let mut missing = streams();
        missing[1] = with_frames(&missing[1], 1, |k| !(70..75).contains(&k));
        assert_eq!(found(&mut missing), vec![]);
    }

    #[test]
    fn a_camera_that_paused_and_frames_that_are_missing_are_no_clock_that_was_set() {
        let mut streams = streams();
        streams[2] = with_frames(&streams[2], 2, |k| !(90..95).contains(&k));
        // From the pause on it exposes between the others' frames.
        let whole = stream(1, CameraClock::default(), 90.0, 0..540);
        streams[1] = with_frames(&whole, 1, |k| if k < 240 { k % 3 == 0 } else { k > 280 && k % 3 == 1 });
        assert_eq!(found(&mut streams), vec![]);
    }
}
