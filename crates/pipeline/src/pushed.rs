//! Cameras that were pushed between two frames.
//!
//! A body has no way to be elsewhere at once: through the frames before a time and through those after it, its images lie on
//! two curves that meet. Where they do not in one camera, and do in the others, that camera was pushed. It takes no pose, and
//! finds which of two cameras it was, which what both see together does not show.

use crate::clock_step::DECISIVE;
use crate::markers::MarkerColors;
use crate::stream::Stream;
use crate::{Cause, Finding};
use mavsight_pose::LONGEST_APART_NS;
use std::collections::VecDeque;
use step::{LONGEST, LoneBalls, WINDOWS, step_before};

mod live;
mod step;

pub use live::{FrameTime, Push, PushWatch};

/// Steps of two cameras are of one time where they are within this many intervals: what happens between frames shows in the next
/// one of each, which are up to one interval apart; half of one is for uneven stamps.
const TOGETHER_INTERVALS: f64 = 1.5;

/// Probability that noise alone steps as clearly anywhere in a recording, in which a camera is then taken for pushed.
const BY_CHANCE: f64 = 1e-3;

/// A step of a camera's images before a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    frame: usize,
    t_ns: i64,
    by_px: f64,
    /// Its square in standard deviations.
    square: f64,
}

/// Leaves out what cameras filmed after they were pushed, and says which.
pub(crate) fn leave_out(streams: &mut [Stream], colors: &MarkerColors) -> Vec<Finding> {
    let stepped = least_square(streams.iter().map(|s| s.stamps_ns.len()).sum());
    let rival = stepped - DECISIVE;
    let all: Vec<Vec<Step>> = streams.iter().map(|s| steps(s, colors, rival)).collect();
    let mut findings = Vec::new();
    for camera in 0..streams.len() {
        let is_apart = |other: usize, step: &Step, own: &Step| {
            let is_known = [camera, other].iter().all(|k| streams[*k].clock.offset_std_s == 0.0);
            let apart_ns = (TOGETHER_INTERVALS * 1e9 * streams[camera].interval_s()) as i64;
            let near_ns = apart_ns + if is_known { 0 } else { LONGEST_APART_NS };
            (step.t_ns - own.t_ns).abs() > near_ns
        };
        // What steps in two cameras was done to the aircraft, or to both.
        let is_own = |own: &&Step| {
            let is_rival = |step: &Step| step.square > (own.square - DECISIVE).min(stepped);
            (0..streams.len())
                .filter(|other| *other != camera)
                .all(|other| all[other].iter().all(|step| is_apart(other, step, own) || !is_rival(step)))
        };
        let is_clear = |step: &&Step| step.square >= stepped;
        let Some(step) = all[camera].iter().filter(is_clear).find(is_own) else { continue };
        let note = format!(
            "{} was moved at {:.3} s: the aircraft jumps in its image by {:.1} px from one frame to the next, and in that of no \
             other camera. It is left out from then on; fix it and calibrate again to use what it filmed.",
            streams[camera].name,
            step.t_ns as f64 * 1e-9,
            step.by_px
        );
        streams[camera].end_before(step.frame);
        findings.push(Finding::of(Cause::CameraMoved, Some(camera), note));
    }
    findings
}

/// Square of a step, in standard deviations, that is none by chance: the quantile of chi-square of two degrees of freedom,
/// for as many steps as a recording has frames and windows (Bonferroni).
fn least_square(frames: usize) -> f64 {
    2.0 * ((frames.max(1) * WINDOWS.len()) as f64 / BY_CHANCE).ln()
}

/// Steps of a camera's images whose squares are at least so large, each the clearest among its neighbours.
fn steps(stream: &Stream, colors: &MarkerColors, least: f64) -> Vec<Step> {
    let all = all_steps(stream, &colors.counts(), least);
    let mut out: Vec<Step> = Vec::new();
    for (frame, (by_px, square)) in all.iter().enumerate() {
        if f64::from(*square) < least {
            continue;
        }
        let near = &all[frame.saturating_sub(2 * LONGEST)..all.len().min(frame + 2 * LONGEST)];
        let square = f64::from(*square) / usual(near.iter().map(|step| step.1));
        let t_ns = stream.clock.clock.time_ns(stream.stamps_ns[frame]);
        let step = Step { frame, t_ns, by_px: f64::from(*by_px), square };
        match out.last_mut() {
            Some(last) if frame - last.frame <= LONGEST => {
                if square > last.square {
                    *last = step;
                }
            }
            _ => out.push(step),
        }
    }
    out.retain(|step| step.square >= least);
    out
}

/// What the squares of steps are usually, in parts of what noise makes of them: more where the motion is no parabola.
fn usual(near: impl Iterator<Item = f32>) -> f64 {
    let mut squares: Vec<f32> = near.filter(|square| *square > 0.0).collect();
    squares.sort_by(f32::total_cmp);
    // The median of chi-square of two degrees of freedom is 2 ln 2.
    let median = squares.get(squares.len() / 2).copied().unwrap_or_default();
    (f64::from(median) / (2.0 * std::f64::consts::LN_2)).max(1.0)
}

/// The step before each frame, and its square in standard deviations; zero where there is none.
fn all_steps(stream: &Stream, counts: &[usize], least: f64) -> Vec<(f32, f32)> {
    let interval_ns = stream.interval_s() * 1e9;
    let mut near: VecDeque<LoneBalls> = VecDeque::with_capacity(2 * LONGEST + 2);
    let mut out = vec![(0.0, 0.0); stream.stamps_ns.len()];
    let mut add = |near: &VecDeque<LoneBalls>, at: usize, first: usize| {
        if let Some(step) = step_before(near, at, interval_ns, least) {
            out[first + at] = (step.by_px.norm() as f32, step.square as f32);
        }
    };
    // The frame in the middle has as many before it as after it; at the ends there are fewer.
    let middle = LONGEST + 1;
    let mut first = 0;
    for (stamp_ns, seen) in stream.frames() {
        if near.len() == 2 * middle {
            near.pop_front();
            first += 1;
        }
        let mut balls = LoneBalls::default();
        balls.take(stamp_ns, seen.iter().map(|s| (s.color(), s.pixel, s.variance_px2())), counts);
        near.push_back(balls);
        if near.len() == 2 * middle {
            let from = if first == 0 { 1 } else { middle };
            (from..=middle).for_each(|at| add(&near, at, first));
        }
    }
    let from = if near.len() == 2 * middle { middle + 1 } else { 1 };
    (from..near.len()).for_each(|at| add(&near, at, first));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{rig, stream, with_frames};
    use mavsight_flight::Vehicle;
    use mavsight_geometry::Vector2;
    use mavsight_pose::CameraClock;

    fn streams(cameras: usize) -> Vec<Stream> {
        (0..cameras).map(|camera| stream(camera, CameraClock::default(), 30.0, 0..120)).collect()
    }

    fn found(streams: &mut [Stream]) -> Vec<(Option<Cause>, Option<usize>)> {
        let findings = leave_out(streams, &MarkerColors::of(&Vehicle::paper()));
        findings.iter().map(|f| (f.cause(), f.camera)).collect()
    }

    fn push(stream: &mut Stream, from: usize, by_px: Vector2<f64>) {
        let markers = Vehicle::paper().marker.len();
        stream.detections.iter_mut().skip(markers * from).for_each(|d| d.pixel += by_px);
    }

    /// Of two cameras what both see together does not show which was pushed: poses after it were centimetres off, or by the wrong
    /// one of them.
    #[test]
    fn which_of_two_cameras_was_pushed_is_found_with_its_frame() {
        for (camera, by_px) in
            [(0, Vector2::new(1.0, 0.0)), (1, Vector2::new(0.0, -1.0)), (1, Vector2::new(25.0, 9.0))]
        {
            for at in [8, 60, 112] {
                let mut pushed = streams(2);
                push(&mut pushed[camera], at, by_px);
                assert_eq!(found(&mut pushed), [(Some(Cause::CameraMoved), Some(camera))], "{by_px} at {at}");
                assert_eq!((pushed[camera].stamps_ns.len(), pushed[1 - camera].stamps_ns.len()), (at, 120));
            }
        }
    }

    /// Where a flight bends, the parabolas on both sides of a frame do not meet: that was said to be a push of 0.1 px.
    #[test]
    fn a_bend_of_the_motion_is_no_push() {
        let markers = Vehicle::paper().marker.len();
        for size_px in [32.0, 128.0] {
            let mut bent = streams(2);
            for (k, detection) in bent[0].detections.iter_mut().enumerate() {
                detection.pixel.x += size_px * (0.25 * ((k / markers) as f64 - 59.5)).tanh();
            }
            assert_eq!(found(&mut bent), vec![], "{size_px}");
        }
    }

    #[test]
    fn what_is_no_push_is_left_as_it_is() {
        let mut sound = streams(3);
        assert_eq!(rig().cameras.len(), sound.len());
        assert_eq!(found(&mut sound), vec![]);
        // The aircraft itself is struck: it jumps in all cameras.
        sound.iter_mut().for_each(|s| push(s, 50, Vector2::new(3.0, 2.0)));
        assert_eq!(found(&mut sound), vec![]);
        // One ball is covered in part, and frames are missing.
        let mut covered = streams(3);
        covered[1].detections.iter_mut().skip(200).step_by(4).for_each(|d| d.pixel.x += 1.5);
        covered[2] = with_frames(&covered[2], 2, |k| !(40..47).contains(&k) && k % 9 != 3);
        assert_eq!(found(&mut covered), vec![]);
        // Two frames have each other's time stamps.
        let mut exchanged = streams(2);
        for k in 0..4 {
            let (a, b) = (4 * 70 + k, 4 * 71 + k);
            exchanged[0].detections.swap(a, b);
        }
        assert_eq!(found(&mut exchanged), vec![]);
    }
}
