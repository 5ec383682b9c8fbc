//! Where the estimation of a clock of which nothing else is known starts: a flash that all cameras saw, or a
//! clap that all heard.

use crate::feed::Clap;
use crate::stream::Stream;
use mavsight_pose::Rig;
use mavsight_vision::{Frame, Pixels};

/// Every so many pixels along a row and down a column are looked at: the mean of a few thousand is steadier
/// than any light.
const STRIDE: usize = 8;

/// A jump of brightness that is a flash is larger than all others by this factor: of two that are about as
/// large, neither is one.
const ALONE: f64 = 2.0;

/// Frames that must be seen before anything stands out.
const LEAST_FRAMES: usize = 10;

/// Mean brightness of a frame.
pub(crate) fn brightness(frame: &Frame) -> f32 {
    let (width, step) = (frame.size.width_px as usize, STRIDE);
    let (samples, channels) = match &frame.pixels {
        Pixels::Rgb(rgb) => (rgb, 3),
        Pixels::Yuv420 { y, .. } => (y, 1),
    };
    let rows = samples.chunks_exact((channels * width).max(1)).step_by(step);
    let (mut sum, mut count) = (0_u64, 0_u32);
    for value in rows.flat_map(|row| row.iter().step_by(channels * step)) {
        (sum, count) = (sum + u64::from(*value), count + 1);
    }
    (sum as f64 / f64::from(count.max(1))) as f32
}

/// The stamp of the frame whose brightness rises most over that of the frame before it, in seconds; none
/// where another changes by half as much.
pub(crate) fn flash_s(stamps_ns: &[i64], brightness: &[f32]) -> Option<f64> {
    if brightness.len() < LEAST_FRAMES || stamps_ns.len() != brightness.len() {
        return None;
    }
    let rises = || brightness.windows(2).enumerate().map(|(k, w)| (k + 1, f64::from(w[1] - w[0])));
    let (at, rise) = rises().max_by(|a, b| a.1.total_cmp(&b.1))?;
    // A flash that two frames share rises twice, and goes out within the next two.
    let others = rises().filter(|(k, _)| *k + 1 < at || *k > at + 3).map(|(_, r)| r.abs());
    let largest = others.fold(0.0, f64::max);
    (rise > ALONE * largest && rise > 0.0).then(|| stamps_ns[at] as f64 * 1e-9)
}

/// Speed of sound in a room of 20 °C.
const SOUND_M_S: f64 = 343.0;

/// A recording's sound comes between 5 ms before and 15 ms after its picture (EBU R37, 2007, at the
/// source): a width of 20 ms.
const SOUND_AND_PICTURE_S: f64 = 0.02;

/// Starts each clock of which nothing is known from the flash that its camera and the first saw. A frame
/// shows a flash of any moment between it and the frame before: on average half an interval before its stamp,
/// so that a start is known to the root of a twelfth of both intervals' squares. Says what was found, and what
/// was not.
pub(crate) fn start_by_flash(streams: &mut [Stream]) -> Vec<String> {
    if streams.first().is_none_or(|first| first.brightness.is_none()) {
        return Vec::new();
    }
    let missing = "shows no flash that stands out";
    let remedy = "Flash once, at all cameras, from where it lights the room.";
    let seen = |s: &Stream| {
        let stamp_s = s.brightness.as_ref().and_then(|b| flash_s(&s.stamps_ns, b)).ok_or(missing)?;
        Ok(stamp_s - 0.5 * s.interval_s())
    };
    start_clocks(streams, "flash", remedy, seen, |_, first, stream| {
        (first.interval_s().powi(2) + stream.interval_s().powi(2)) / 12.0
    })
}

/// Starts each clock of which no more is known from the clap that its camera and the first heard. From
/// wherever it came, it had not to go further to one camera than to the other by more than they are apart;
/// that and how far apart sound and picture of each may be are taken as evenly spread. Says what was found,
/// and what was not.
pub(crate) fn start_by_clap(streams: &mut [Stream], rig: &Rig) -> Vec<String> {
    if streams.first().is_none_or(|first| first.clap.is_none()) {
        return Vec::new();
    }
    let remedy = "Clap once, loudly, in the middle between the cameras.";
    let heard = |s: &Stream| match s.clap {
        Some(Clap::At(t_s)) => Ok(t_s),
        Some(Clap::None) => Err("has no clap that stands out"),
        Some(Clap::Silent) | None => Err("has no sound"),
    };
    let centre = |k: usize| rig.cameras.get(k).map(|c| c.camera.centre_in_world());
    start_clocks(streams, "clap", remedy, heard, |k, _, _| {
        let apart_m = centre(0).zip(centre(k)).map_or(0.0, |(a, b)| (a - b).norm());
        // Evenly spread over a width w is w/√12.
        ((2.0 * apart_m / SOUND_M_S).powi(2) + 2.0 * SOUND_AND_PICTURE_S.powi(2)) / 12.0
    })
}

/// Starts each clock of which no more is known from what its camera and the first noticed together, with the
/// variance of a start by the camera's number.
fn start_clocks(
    streams: &mut [Stream],
    what: &str,
    remedy: &str,
    noticed: impl Fn(&Stream) -> Result<f64, &'static str>,
    variance_s2: impl Fn(usize, &Stream, &Stream) -> f64,
) -> Vec<String> {
    let Some((first, others)) = streams.split_first_mut() else { return Vec::new() };
    let mut notes = Vec::new();
    for (k, stream) in others.iter_mut().enumerate().filter(|(_, s)| s.clock.offset_std_s > 0.0) {
        let by = |s: &Stream| noticed(s).map_err(|why| format!("{} {why}", s.name));
        match by(first).and_then(|here_s| Ok((here_s, by(stream)?))) {
            Ok((here_s, there_s)) => {
                let std_s = variance_s2(k + 1, first, stream).sqrt();
                notes.extend(stream.start_clock(first, what, here_s, there_s, std_s));
            }
            Err(why) => {
                let own = &stream.name;
                notes.push(format!("{why}: the clock of {own} is estimated without. {remedy}"));
            }
        }
    }
    notes
}

#[cfg(test)]
mod clap_tests {
    use super::*;
    use crate::testing::rig;
    use mavsight_geometry::Vector2;
    use mavsight_pose::{CameraClock, ClockPrior};

    fn heard(name: &str, clap: Clap, prior: ClockPrior) -> Stream {
        let mut stream = Stream::new(0, name.into(), prior, Vector2::y());
        stream.clap = Some(clap);
        stream
    }

    #[test]
    fn a_clap_is_where_an_unknown_clock_starts_and_a_known_one_is_kept() {
        let known = ClockPrior::known(CameraClock::default());
        let of_b = heard("b", Clap::At(2.75), ClockPrior::unknown());
        let mut streams = [heard("a", Clap::At(1.25), known), of_b, heard("c", Clap::At(9.0), known)];
        let notes = start_by_clap(&mut streams, &rig());
        let b = streams[1].clock;
        // The cameras are 9 m apart: 26 ms of sound either way.
        let std_s = ((2.0 * 9.0 / 343.0_f64).powi(2) / 12.0 + 2.0 * 0.02_f64.powi(2) / 12.0).sqrt();
        assert!(
            (b.clock.offset_s - 1.5).abs() < 1e-9 && (b.offset_std_s / std_s - 1.0).abs() < 0.02,
            "{b:?}"
        );
        assert_eq!(streams[2].clock, known);
        assert!(notes.len() == 1 && notes[0].contains("puts b 1500.0 ± 17"), "{notes:?}");
    }

    #[test]
    fn who_heard_none_is_named_and_nothing_is_said_where_none_is_listened_for() {
        let known = ClockPrior::known(CameraClock::default());
        let at = |clap| [heard("a", Clap::At(1.0), known), heard("b", clap, ClockPrior::unknown())];
        for (clap, words) in [(Clap::None, "b has no clap that stands out"), (Clap::Silent, "b has no sound")]
        {
            let mut streams = at(clap);
            let notes = start_by_clap(&mut streams, &rig());
            assert!(notes.len() == 1 && notes[0].starts_with(words), "{notes:?}");
            assert_eq!(streams[1].clock, ClockPrior::unknown());
        }
        let mut streams = at(Clap::At(2.0));
        streams[0].clap = Some(Clap::None);
        assert!(start_by_clap(&mut streams, &rig())[0].starts_with("a has no clap"));
        streams.iter_mut().for_each(|s| s.clap = None);
        assert!(start_by_clap(&mut streams, &rig()).is_empty());
    }
}

#[cfg(test)]
mod flash_tests {
    use super::*;
    use mavsight_geometry::Vector2;
    use mavsight_pose::{CameraClock, ClockPrior};

    fn stream(name: &str, flash_at: usize, prior: ClockPrior) -> Stream {
        let mut stream = Stream::new(0, name.into(), prior, Vector2::y());
        stream.stamps_ns = stamps(100);
        let light = |k: usize| 100.0 + 0.3 * (k % 3) as f32 + if k == flash_at { 40.0 } else { 0.0 };
        stream.brightness = Some((0..100).map(light).collect());
        stream
    }

    #[test]
    fn a_flash_is_where_an_unknown_clock_starts_and_a_known_one_is_kept() {
        let known = ClockPrior::known(CameraClock::default());
        let mut streams =
            [stream("a", 20, known), stream("b", 70, ClockPrior::unknown()), stream("c", 70, known)];
        let notes = start_by_flash(&mut streams);
        let b = streams[1].clock;
        assert!((b.clock.offset_s - 2.0).abs() < 1e-9, "{b:?}");
        assert!((b.offset_std_s - 0.04 / 6f64.sqrt()).abs() < 1e-9, "{b:?}");
        assert_eq!(streams[2].clock, known);
        assert!(notes.len() == 1 && notes[0].contains("puts b 2000.0 ± 16.3 ms late"), "{notes:?}");
    }

    /// Half of the difference of their intervals was taken for a part of the offset.
    #[test]
    fn a_flash_in_cameras_of_unlike_rates_is_half_an_interval_before_the_frame_of_each() {
        let mut slow = stream("b", 10, ClockPrior::unknown());
        slow.stamps_ns.iter_mut().for_each(|t| *t *= 2);
        let mut streams = [stream("a", 20, ClockPrior::known(CameraClock::default())), slow];
        start_by_flash(&mut streams);
        // Between 0.76 and 0.80 s of the first camera, 0.72 and 0.80 s of the second.
        let offset_s = streams[1].clock.clock.offset_s;
        assert!((offset_s - (0.76 - 0.78)).abs() < 1e-9, "{offset_s}");
    }

    #[test]
    fn a_camera_without_a_flash_is_named_and_nothing_is_said_where_none_is_looked_for() {
        let known = ClockPrior::known(CameraClock::default());
        let mut streams = [stream("a", 20, known), stream("b", 1000, ClockPrior::unknown())];
        let notes = start_by_flash(&mut streams);
        assert!(notes.len() == 1 && notes[0].starts_with("b shows no flash"), "{notes:?}");
        assert_eq!(streams[1].clock, ClockPrior::unknown());
        streams.iter_mut().for_each(|s| s.brightness = None);
        assert!(start_by_flash(&mut streams).is_empty());
    }
    use mavsight_vision::ImageSize;

    fn stamps(count: i64) -> Vec<i64> {
        (0..count).map(|k| k * 40_000_000).collect()
    }

    #[test]
    fn the_brightness_of_both_kinds_of_frame_is_their_mean() {
        let size = ImageSize { width_px: 32, height_px: 16 };
        assert_eq!(brightness(&Frame::from_rgb(size, vec![70; 3 * 512]).unwrap()), 70.0);
        let planes = [vec![90; 512], vec![128; 128], vec![128; 128]];
        let yuv = Frame::from_yuv420(size, planes, true, mavsight_vision::YuvMatrix::Bt601).unwrap();
        assert_eq!(brightness(&yuv), 90.0);
    }

    #[test]
    fn a_flash_is_found_in_noise_and_drifting_light_and_a_lamp_switched_on_too() {
        let light = |k: i64| 100.0 + 5.0 * (0.02 * k as f32).sin() + 0.2 * (k * 7 % 5) as f32;
        let flash: Vec<f32> = (0..200).map(|k| light(k) + if k == 130 { 30.0 } else { 0.0 }).collect();
        assert!((flash_s(&stamps(200), &flash).unwrap() - 5.2).abs() < 1e-9);
        let lamp: Vec<f32> = (0..200).map(|k| light(k) + if k >= 60 { 30.0 } else { 0.0 }).collect();
        assert!((flash_s(&stamps(200), &lamp).unwrap() - 2.4).abs() < 1e-9);
    }

    #[test]
    fn what_does_not_stand_out_is_none() {
        let two: Vec<f32> = (0..200).map(|k| if k == 50 || k == 130 { 130.0 } else { 100.0 }).collect();
        assert_eq!(flash_s(&stamps(200), &two), None);
        assert_eq!(flash_s(&stamps(200), &[100.0; 200]), None);
        assert_eq!(flash_s(&stamps(3), &[1.0, 9.0, 1.0]), None);
        assert_eq!(flash_s(&stamps(20), &[1.0; 19]), None);
    }
}
