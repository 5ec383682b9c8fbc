//! Gaps that are too long for what the rest of the flight shows.

use crate::PoseSample;
use crate::smoother::rates::Rates;
use crate::statistics::median;
use std::ops::Range;

/// Chance with which the motion in a gap may be more lively than all that the flight shows. Twice that of intervals of 95 %, since
/// a motion that is a little more lively is still inside them.
const BEYOND_ALL: f64 = 0.1;
/// Steps between poses that are longer than this many usual ones are gaps.
pub(crate) const LONGER: f64 = 1.5;

/// Times of the last pose before and of the first behind each gap whose motion is not known although the smoother crosses it.
///
/// The jerk in a gap is taken from the rest of the flight. Of n + 1 stretches of one length between which nothing distinguishes,
/// each is the most lively with a chance of 1/(n + 1) (Laplace's rule of succession; Vovk, Gammerman & Shafer 2005, chapter 2):
/// a gap whose length the poses show fewer than nine times may hide the flight's only manoeuvre. Rates that were measured
/// throughout show whether it does.
pub(crate) fn hidden_gaps(
    poses: &[PoseSample],
    parts: &[Range<usize>],
    rates: Option<&Rates>,
) -> Vec<(i64, i64)> {
    let measured = |part: &Range<usize>| {
        poses[part.clone()].iter().filter(|p| p.estimate.is_ok()).map(|p| p.t_ns).collect::<Vec<i64>>()
    };
    let steps: Vec<(i64, i64)> = parts
        .iter()
        .map(measured)
        .flat_map(|t| t.windows(2).map(|w| (w[0], w[1])).collect::<Vec<_>>())
        .collect();
    let length_ns = |(from_ns, to_ns): &(i64, i64)| (to_ns - from_ns) as f64;
    let Some(usual_ns) = median(steps.iter().map(length_ns).collect()) else { return Vec::new() };
    let is_gap = |step: &(i64, i64)| length_ns(step) > LONGER * usual_ns;
    let shown_ns: f64 = steps.iter().filter(|step| !is_gap(step)).map(length_ns).sum();
    // As long as n + 1 times the chance is one.
    let longest_ns = shown_ns / (1.0 / BEYOND_ALL - 1.0);
    let is_bridged =
        |step: &(i64, i64)| rates.is_some_and(|r| r.bridge(step.0, step.1, (LONGER * usual_ns) as i64));
    steps
        .into_iter()
        .filter(|step| is_gap(step) && length_ns(step) > longest_ns && !is_bridged(step))
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::smoother::smooth::tests::{GRAVITY, pose};
    use crate::{PoseError, PoseSample, smooth};
    use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3};
    use mavsight_random::Random;

    fn hovering(poses: i64) -> Vec<PoseSample> {
        let mut random = Random::new(9, 0);
        let mut noise = |std: f64| Vector3::from(random.normals()) * std;
        (0..poses)
            .map(|k| {
                let turn = UnitQuaternion::from_scaled_axis(noise(2e-3));
                pose(k * 33_333_333, Isometry3::from_parts(noise(1e-3).into(), turn), (1e-3, 2e-3))
            })
            .collect()
    }

    /// A gap that hid a whole manoeuvre was bridged with claims of a millimetre, as the rest of the flight was hover.
    #[test]
    fn a_gap_that_the_flight_shows_less_than_nine_times_is_not_known() {
        for (gap_s, is_known) in [(0.4, true), (1.0, false)] {
            let mut poses = hovering(180);
            let (first, behind) = (60, 60 + (gap_s * 30.0) as usize);
            for sample in &mut poses[first..behind] {
                sample.estimate = Err(PoseError::NotMeasured);
            }
            let motion = smooth(&poses, GRAVITY).unwrap();
            let hidden = [(poses[first - 1].t_ns, poses[behind].t_ns)];
            assert_eq!(motion.doubts.hidden_ns, hidden[usize::from(is_known)..], "{gap_s}");
            let unknown = if is_known { 0 } else { behind - first };
            assert_eq!((motion.unknown_ns.len(), motion.samples.len()), (unknown, 180 - unknown), "{gap_s}");
            assert_eq!(motion.doubts.words().len(), usize::from(!is_known), "{gap_s}");
        }
        // A flight of twice the length shows it often enough.
        let mut poses = hovering(360);
        poses[60..90].iter_mut().for_each(|sample| sample.estimate = Err(PoseError::NotMeasured));
        assert_eq!(smooth(&poses, GRAVITY).unwrap().samples.len(), 360);
    }
}
