//! Observations between which a path leaps: of something else than the marker.

use super::equations::Problem;
use super::types::CameraClock;

/// A path that is so many times as fast as the poses let its marker move, at the time and on the whole, does
/// not show the marker.
const LEAP: f64 = 3.0;

impl Problem<'_> {
    /// Leaves out observations whose paths move much faster than the poses.
    ///
    /// A path through a few frames of another object has a hundred times the marker's speed, and the
    /// information on a clock goes with the square of that; bounded residuals do not help, as observations
    /// next to a leap have none (leverage points, Rousseeuw & Leroy 1987).
    pub(super) fn leave_out_leaps(&mut self, clocks: &[CameraClock]) {
        let paths = self.paths(clocks);
        let all: Vec<usize> = (0..self.cameras.len()).collect();
        let apart_s = self.streams.iter().map(|s| s.interval_s).fold(f64::INFINITY, f64::min);
        let (mut views, mut beside) = (Vec::new(), Vec::new());
        // Of each view: which it is, its speed, and that of the pose.
        let mut speeds: Vec<((usize, usize, usize), f64, f64)> = Vec::new();
        for k in 0..self.instants.len() {
            let Some(near) = self.poses[k] else { continue };
            let mut pose_at = |t_s: f64| {
                self.views(&paths, t_s, &all, &mut beside);
                (beside.len() > 3).then(|| Some(self.fitted_pose(&beside, &near)?.world_from_body)).flatten()
            };
            let t_s = self.instants[k];
            let (before, after) = (pose_at(t_s - 0.5 * apart_s), pose_at(t_s + 0.5 * apart_s));
            let Some((before, after)) = before.zip(after) else { continue };
            self.views(&paths, t_s, &all, &mut views);
            for v in &views {
                let seen = |pose| self.scene().at(&v.seen, pose).ok().map(|at| at.projection.pixel);
                let Some((from, to)) = seen(&before).zip(seen(&after)) else { continue };
                let of_pose = (to - from).norm() / apart_s;
                speeds.push(((v.seen.camera, v.seen.point, v.index), v.velocity.px_s.norm(), of_pose));
            }
        }
        for camera in 0..self.cameras.len() {
            let own = || speeds.iter().filter(|s| s.0.0 == camera);
            let mut usual: Vec<f64> = own().map(|s| s.2).collect();
            usual.sort_by(f64::total_cmp);
            // Nine tenths of the flight is slower; the rest may be what wrong observations do to poses.
            let Some(fast) = usual.get(usual.len() * 9 / 10).copied() else { continue };
            let leaps = own().filter(|s| s.1 > LEAP * (s.2 + fast)).map(|s| s.0);
            self.leaping.extend(leaps);
        }
    }
}
