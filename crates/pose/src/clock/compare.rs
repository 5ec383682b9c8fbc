//! Which of two readings of one camera's time stamps the other cameras agree with.

use super::equations::{MOST_INSTANTS, Problem};
use super::search;
use super::types::{CameraClock, CameraStream};
use crate::{BodyMarker, Rig};

/// How much what all cameras saw speaks for one of two readings of a camera's time stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampOdds {
    /// Twice the logarithm of the odds of the second against the first.
    pub lead: f64,
    /// Chi-square of what the better one leaves.
    pub chi_square: f64,
}

/// How much what all cameras saw speaks for the second of two readings of one camera's time stamps. None where
/// either reading lets two cameras see too little of the flight.
///
/// Each reading is given the clocks, the poses and the systematic errors of the centres that fit it best, over the whole flight.
/// What is compared is the chi-square of the reprojection errors that remain, at instants of the other cameras that both
/// readings explain, in units of what the better one leaves where that is more than is claimed. The speed of a ball
/// in its image is not used: in a slow flight it is lost in noise, and a step that is one of few needs no derivative.
pub fn odds_of_stamps(
    rig: &Rig,
    markers: &[BodyMarker],
    camera: usize,
    [first, second]: [&[CameraStream]; 2],
) -> Option<StampOdds> {
    if first.len() != rig.cameras.len() || second.len() != rig.cameras.len() {
        return None;
    }
    let of = |streams| fitted(rig, markers, camera, streams);
    let ((mut by_first, first_clocks), (mut by_second, second_clocks)) = (of(first)?, of(second)?);
    // What leaps by one of them counts for neither, and both bound their errors alike.
    by_first.leaping.extend(&by_second.leaping);
    by_second.leaping.clone_from(&by_first.leaping);
    let first_clocks = search::refitted(&mut by_first, first_clocks)?;
    let second_clocks = search::refitted(&mut by_second, second_clocks)?;
    let scale = by_first.scale.min(by_second.scale).max(1.0);
    (by_first.scale, by_second.scale) = (scale, scale);
    let remain = std::iter::zip(by_first.losses(&first_clocks), by_second.losses(&second_clocks));
    let both: Vec<(f64, f64)> = remain.filter_map(|(a, b)| a.zip(b)).collect();
    let (first, second) = both.iter().fold((0.0, 0.0), |sum, (a, b)| (sum.0 + a, sum.1 + b));
    let odds = || StampOdds { lead: (first - second) / scale, chi_square: first.min(second) / scale };
    (both.len() >= LEAST_INSTANTS).then(odds)
}

/// At fewer instants a median says little of the noise.
const LEAST_INSTANTS: usize = 10;

/// A flight by some time stamps at the instants of the other cameras, and the clocks that fit it best.
fn fitted<'a>(
    rig: &Rig,
    markers: &[BodyMarker],
    camera: usize,
    streams: &'a [CameraStream],
) -> Option<(Problem<'a>, Vec<CameraClock>)> {
    let others = streams.iter().enumerate().filter(|(k, _)| *k != camera).map(|(_, stream)| stream);
    let mut problem = Problem::new(rig, markers, streams);
    problem.look_at(others.max_by_key(|stream| stream.observations.len())?);
    let clocks = search::fitted(&mut problem)?;
    Some((problem, clocks))
}

impl Problem<'_> {
    /// Looks at the instants of one camera alone.
    fn look_at(&mut self, stream: &CameraStream) {
        let mut instants: Vec<f64> =
            stream.observations.iter().map(|o| stream.prior.clock.time_s(o.t_ns, 0.0)).collect();
        instants.dedup();
        let stride = instants.len().div_ceil(MOST_INSTANTS).max(1);
        self.instants = instants.into_iter().step_by(stride).collect();
        self.poses = vec![None; self.instants.len()];
    }
}
