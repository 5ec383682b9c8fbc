//! The steps of an output-error fit: down to the minimum along flights without gaps.

use super::fitter::Fitter;
use super::shooting::{Evaluation, Point};

/// Damping of a step that closes gaps and little else: all that is measured counts a hundred times as much as
/// it weighs.
const RESTORING: f64 = 100.0;
/// Damping below this is none.
const LEAST_DAMPING: f64 = 1e-3;
const LARGEST_DAMPING: f64 = 1e8;

/// Where a step began that has raised the squares.
struct Watched {
    point: Point,
    at: Evaluation,
    merit: f64,
    promise: f64,
}

impl Fitter<'_> {
    /// Gauss-Newton steps with the damping of Levenberg and Marquardt where one fails.
    ///
    /// A step along the constraint opens the gaps by its square, which a tight penalty punishes: a step that
    /// raises the squares may stand (the watchdog of Chamberlain, Powell, Lemarechal & Pedersen 1982) if
    /// further ones, which close the gaps and hold the rest (the second-order correction of Fletcher 1982),
    /// each leave less than half of what was too much and end below the squares before. Without holding the
    /// rest they would go on along the constraint, where cameras, markers and start can move together, and
    /// open the gaps again.
    pub(super) fn converge(&mut self, tightness: f64, promised: f64) {
        let mut damping: f64 = 0.0;
        let mut watched: Option<Watched> = None;
        self.converged = false;
        while self.iterations < self.limit {
            self.iterations += 1;
            let merit = self.at.merit(tightness);
            let reference = watched.as_ref().map_or(merit, |w| w.merit);
            let enough = |merit: f64| promised.max(1e-9 * merit);
            let held = if watched.is_some() { RESTORING * damping.max(1.0) } else { damping };
            let tried = self.step(tightness, held);
            let negligible = tried.is_some() && self.promise < enough(merit);
            if negligible && watched.is_none() {
                // A damped step may promise little far from the minimum.
                let whole = damping == 0.0 || self.step(tightness, 0.0).is_some();
                if whole && self.promise < enough(merit) {
                    self.converged = true;
                    break;
                }
            }
            let tried = tried
                .filter(|point| point.model.is_physical())
                .and_then(|point| Some((self.problem.evaluate(&point).ok()?, point)));
            match tried {
                Some((at, point)) if at.merit(tightness) <= reference => {
                    let promise = watched.take().map_or(self.promise, |w| w.promise);
                    damping = relaxed(damping, (reference - at.merit(tightness)) / promise);
                    (self.point, self.at) = (point, at);
                }
                Some((at, point)) if watched.is_none() => {
                    let point = std::mem::replace(&mut self.point, point);
                    let at = std::mem::replace(&mut self.at, at);
                    watched = Some(Watched { point, at, merit, promise: self.promise });
                }
                Some((at, point)) if at.merit(tightness) - reference < 0.5 * (merit - reference) => {
                    (self.point, self.at) = (point, at);
                }
                _ => {
                    let negligible = watched.take().map_or(negligible, |w| {
                        (self.point, self.at) = (w.point, w.at);
                        w.promise < enough(w.merit)
                    });
                    if negligible || damping > LARGEST_DAMPING {
                        self.converged = negligible;
                        break;
                    }
                    damping = (damping * 8.0).max(LEAST_DAMPING);
                }
            }
        }
        if let Some(w) = watched {
            (self.point, self.at, self.promise) = (w.point, w.at, w.promise);
        }
    }

    /// The point after a step; `promise` becomes the predicted decrease of the squares.
    fn step(&mut self, tightness: f64, damping: f64) -> Option<Point> {
        let condensed = self.condensed(tightness, damping).ok()?;
        let (step, left) = condensed.minimum()?;
        self.promise = self.at.merit(tightness) - left;
        Some(self.point.moved(&step, &condensed.starts))
    }
}

/// The share of the predicted decrease that a step achieved shows how far the quadratic model holds
/// (Marquardt 1963).
fn relaxed(damping: f64, kept: f64) -> f64 {
    let factor = [(0.75, 0.1), (0.25, 0.5)].into_iter().find(|(bound, _)| kept > *bound);
    let next = damping * factor.map_or(2.0, |(_, factor)| factor);
    if next < LEAST_DAMPING { 0.0 } else { next }
}
