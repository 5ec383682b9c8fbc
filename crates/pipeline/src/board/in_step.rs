//! By how much the films of a board are out of step.
//!
//! Where two cameras see points that rest or are seen at one time, all pairs of their images fulfil one epipolar constraint. Of a
//! board that moves, they do if one film is shifted by its lag, and by no other time (Albl, Kukelova, Fitzgibbon, Heller, Smid &
//! Pajdla 2017).

use super::{Film, View};
use mavsight_geometry::{Vector2, Vector3};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

/// Lags that are tried: who presses two buttons one after the other is no further apart.
const FURTHEST_S: f64 = 2.0;
/// Steps of the search in the interval of the slower film: the corners move evenly from frame to frame, so that a minimum is
/// about an interval wide.
const STEPS: f64 = 4.0;
/// Views at each lag that is tried: a fundamental matrix needs eight points of several places of the board.
const LEAST_VIEWS: usize = 10;
/// How much more likely the lag must be than none: chi-square with one degree of freedom, by chance once in a thousand over five
/// hundred lags. A view counts once, as its corners move together.
const EVIDENCE: f64 = 22.6;
/// Images of a point that are nearer than that to fulfilling the constraint say nothing of the lag: noise of a corner.
const CORNER_PX: f64 = 0.1;

type Matrix9 = SMatrix<f64, 9, 9>;
type Pair = [Vector2<f64>; 2];

/// How late the stamps of a film are by those of another, by the motion of the board; `None` where that does not show it.
pub(super) fn late_ns(reference: &Film, own: &Film) -> Option<i64> {
    let step_ns = reference.step_ns.max(own.step_ns);
    let tried_ns = step_ns as f64 / STEPS;
    let count = (1e9 * FURTHEST_S / tried_ns).min(1e3) as i64;
    let cost = |k: i64| cost_of(reference, own, (tried_ns * k as f64) as i64);
    let costs: Vec<Option<Cost>> = (-count..=count).into_par_iter().map(cost).collect();
    let at = |k: i64| costs.get(usize::try_from(k + count).ok()?).copied().flatten();
    let none = at(0)?;
    let best =
        (-count..=count).filter_map(|k| Some((k, at(k)?))).min_by(|a, b| a.1.log.total_cmp(&b.1.log))?;
    let views = none.views.min(best.1.views) as f64;
    if views * (none.log - best.1.log) < EVIDENCE {
        return None;
    }
    // A parabola through the neighbours.
    let (k, Cost { log, .. }) = best;
    let (before, after) = (at(k - 1)?.log, at(k + 1)?.log);
    let bend = before - 2.0 * log + after;
    let part = if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some((tried_ns * (k as f64 + part)) as i64)
}

/// How the constraint is fulfilled at a lag.
#[derive(Clone, Copy)]
struct Cost {
    /// Logarithm of the mean square of the distances to it, px².
    log: f64,
    views: usize,
}

fn cost_of(reference: &Film, own: &Film, late_ns: i64) -> Option<Cost> {
    let mut views = 0;
    let mut pairs = Vec::new();
    for view in &own.views {
        let before = pairs.len();
        pairs_of(reference, view, late_ns, &mut pairs);
        views += usize::from(pairs.len() > before);
    }
    if views < LEAST_VIEWS {
        return None;
    }
    let square = mean_square_px2(&pairs)? + CORNER_PX * CORNER_PX;
    square.is_finite().then_some(Cost { log: square.ln(), views })
}

/// Corners of a view, each with where the other camera saw it at that time: between two frames that are near, on a line.
fn pairs_of(reference: &Film, view: &View, late_ns: i64, out: &mut Vec<Pair>) {
    let t_ns = view.t_ns - late_ns;
    let after = reference.views.partition_point(|v| v.t_ns < t_ns);
    let (Some(from), Some(to)) =
        (after.checked_sub(1).map(|k| &reference.views[k]), reference.views.get(after))
    else {
        return;
    };
    let span_ns = to.t_ns - from.t_ns;
    if span_ns as f64 > super::NEAR_INTERVALS * reference.step_ns as f64 {
        return;
    }
    let share = (t_ns - from.t_ns) as f64 / span_ns as f64;
    let of = |view: &View, corner: usize| Some(view.corners.iter().find(|c| c.0 == corner)?.1.pixel);
    out.extend(view.corners.iter().filter_map(|(corner, seen)| {
        let (a, b) = (of(from, *corner)?, of(to, *corner)?);
        Some([a + (b - a) * share, seen.pixel])
    }));
}

/// Mean square of the pairs' distances to the epipolar constraint that fits them best, to first order (Sampson 1982), with the
/// fundamental matrix by the eight points of Hartley (1997).
fn mean_square_px2(pairs: &[Pair]) -> Option<f64> {
    let scales = [0, 1].map(|camera| Scale::of(pairs, camera));
    let mut normal = Matrix9::zeros();
    for pair in pairs {
        let [a, b] = [0, 1].map(|camera| scales[camera].apply(&pair[camera]));
        let row = SVector::<f64, 9>::from_fn(|k, _| b[k / 3] * a[k % 3]);
        normal.ger(1.0, &row, &row, 1.0);
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let fundamental = nalgebra::Matrix3::from_row_slice(least.as_slice());
    let distance = |pair: &Pair| {
        let [a, b] = [0, 1].map(|camera| scales[camera].apply(&pair[camera]));
        let (of_a, of_b) = (fundamental * a, fundamental.tr_mul(&b));
        // Each camera's slope by its own pixels.
        let slope = of_a.xy().norm_squared() * scales[1].per_px.powi(2)
            + of_b.xy().norm_squared() * scales[0].per_px.powi(2);
        b.dot(&of_a).powi(2) / slope
    };
    let mean = pairs.iter().map(distance).sum::<f64>() / pairs.len() as f64;
    mean.is_finite().then_some(mean)
}

/// Pixels about their mean, over their spread.
struct Scale {
    mean: Vector2<f64>,
    per_px: f64,
}

impl Scale {
    fn of(pairs: &[Pair], camera: usize) -> Self {
        let mean = pairs.iter().map(|p| p[camera]).sum::<Vector2<f64>>() / pairs.len() as f64;
        let square =
            pairs.iter().map(|p| (p[camera] - mean).norm_squared()).sum::<f64>() / pairs.len() as f64;
        Self { mean, per_px: (2.0 / square).sqrt() }
    }

    fn apply(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        ((pixel - self.mean) * self.per_px).push(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Camera, ImageSize, Intrinsics};
    use mavsight_random::Random;
    use mavsight_vision::{BoardCorner, Matrix2};
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};

    const INTERVAL_NS: i64 = 100_000_000;

    /// A board that is waved, or rests after two seconds, seen by a camera whose stamps are late.
    fn film(centre: [f64; 3], late_s: f64, waved: f64, random: &mut Random) -> Film {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 60f64.to_radians());
        let camera = Camera::looking_at(Vector3::from(centre), Vector3::zeros(), k, size);
        let view = |frame: i64| {
            let t = 1e-9 * (frame * INTERVAL_NS) as f64 - late_s;
            let turn =
                Vector3::new(0.5 * (1.3 * t).sin(), 0.4 * (1.9 * t).cos(), 0.6 * (0.7 * t).sin()) * waved;
            let place =
                Vector3::new(0.3 * (1.1 * t).sin(), 0.2 * (0.8 * t).cos(), 0.2 * (1.7 * t).sin()) * waved;
            let there =
                Isometry3::from_parts(Translation3::from(place), UnitQuaternion::from_scaled_axis(turn));
            let corner = |k: usize| {
                let on_board = nalgebra::Point3::new(0.05 * (k % 5) as f64, 0.0, 0.05 * (k / 5) as f64);
                let seen = camera.project(&(there * on_board).coords).unwrap().pixel;
                let pixel = seen + Vector2::new(random.normal(), random.normal()) * 0.1;
                (k, BoardCorner { pixel, covariance_px2: Matrix2::identity() * 0.01 })
            };
            View { t_ns: frame * INTERVAL_NS, corners: (0..20).map(corner).collect(), velocities_px_s: None }
        };
        let views: Vec<View> = (0..100).map(view).collect();
        let stamps_ns = views.iter().map(|v| v.t_ns).collect();
        Film {
            is_film: true,
            has_true_clock: false,
            late_ns: 0,
            stamps_ns,
            views,
            interval_ns: INTERVAL_NS,
            step_ns: INTERVAL_NS,
        }
    }

    #[test]
    fn a_film_that_began_late_is_found_to_be() {
        let mut random = Random::new(71, 0);
        let first = film([1.0, -2.0, 0.3], 0.0, 1.0, &mut random);
        for late_s in [-0.73, -0.124, 0.03, 0.25, 1.5] {
            let own = film([-1.0, -2.0, 0.5], late_s, 1.0, &mut random);
            let found_s = 1e-9 * late_ns(&first, &own).unwrap() as f64;
            assert!((found_s - late_s).abs() < 5e-3, "{found_s} of {late_s}");
        }
    }

    #[test]
    fn in_step_or_at_rest_nothing_is_moved() {
        let mut random = Random::new(71, 1);
        for waved in [1.0, 0.0] {
            let films = [[1.0, -2.0, 0.3], [-1.0, -2.0, 0.5]].map(|at| film(at, 0.0, waved, &mut random));
            let found = late_ns(&films[0], &films[1]);
            assert!(found.is_none_or(|ns| ns.abs() < INTERVAL_NS / 50), "{found:?}");
        }
    }
}
