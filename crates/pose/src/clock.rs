//! Clocks of cameras that were not started together: how late, how fast, and how slowly their rows are read.

mod compare;
mod equations;
mod path;
mod search;
#[cfg(test)]
mod tests;
mod types;

pub use compare::{StampOdds, odds_of_stamps};
pub use path::{GAP_INTERVALS, PathPoint, PathVelocity, PixelPath};
pub use types::{
    CameraClock, CameraStream, ClockEstimate, ClockPrior, ClockVerdict, QUARTZ_DRIFT_STD, image_middle,
};

use crate::{BodyMarker, Rig};
use equations::Problem;

/// Stretches of time of which the observations are enough for [`estimate_clocks`], for recordings that span
/// `from_ns..=to_ns` by their presumed clocks: all of a flight of up to four minutes, else sixty of four
/// seconds, evenly spread.
///
/// The estimation looks at 2000 instants wherever they lie. Sixty stretches see the clocks drift apart over
/// the same span; errors that last through a stretch are in the scatter between parts of the flight, which
/// standard deviations allow for. A stretch is as long as it takes for clocks that are a second apart to
/// share three of its seconds.
pub fn informative_stretches_ns((from_ns, to_ns): (i64, i64)) -> Vec<(i64, i64)> {
    let span_ns = to_ns.saturating_sub(from_ns);
    if span_ns <= STRETCHES * STRETCH_NS {
        return vec![(from_ns, to_ns)];
    }
    let begin = |k: i64| from_ns + ((span_ns - STRETCH_NS) as f64 * k as f64 / (STRETCHES - 1) as f64) as i64;
    (0..STRETCHES).map(|k| (begin(k), begin(k) + STRETCH_NS)).collect()
}

const STRETCHES: i64 = 60;
const STRETCH_NS: i64 = 4_000_000_000;

/// The clocks of all cameras from one flight of a rigid body.
///
/// The poses that fit all cameras best at the instants of the fastest camera leave reprojection errors;
/// offsets, drifts and line times are what makes these least, by Gauss and Newton with the markers' image
/// velocities as derivatives, the poses and a systematic error of each centre eliminated, and long residuals
/// bounded (Huber 1981). An offset of which nothing is known is first sought within ± 1 s. Standard
/// deviations allow for noise beyond what is claimed and for errors that last over a twenty-fourth of the
/// flight. The first camera's clock is the reference.
///
/// What the flight shows is gone by where it is significant and matters ([`ClockVerdict`]).
pub fn estimate_clocks(rig: &Rig, markers: &[BodyMarker], streams: &[CameraStream]) -> Vec<ClockEstimate> {
    let mut out: Vec<ClockEstimate> = streams.iter().map(|s| ClockEstimate::as_given(&s.prior)).collect();
    out.iter_mut().take(1).for_each(|first| first.verdict = ClockVerdict::Reference);
    if streams.len() != rig.cameras.len() {
        return out;
    }
    search::solve(&mut Problem::new(rig, markers, streams), &mut out);
    out
}

/// The clocks by which all cameras agree best, whether the flight determines them or not; `None` where no instant is seen
/// by two cameras. For comparing what recordings may be: [`estimate_clocks`] without its judgement, at a fifth of its cost.
pub fn fitting_clocks(
    rig: &Rig,
    markers: &[BodyMarker],
    streams: &[CameraStream],
) -> Option<Vec<CameraClock>> {
    if streams.len() != rig.cameras.len() {
        return None;
    }
    search::fitted(&mut Problem::new(rig, markers, streams))
}
