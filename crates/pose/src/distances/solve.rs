//! The adjustment of a network.

use super::refusal::DistanceRefusal;
use super::{MeasuredBetween, NetworkMeasurement, points_of};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Matrix4, UnitQuaternion, Vector2, Vector3, Vector4};

/// An adjusted network, its axes wherever the start had them.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    pub(super) points_m: Vec<Vector3<f64>>,
    pub(super) covariance_m2: DMatrix<f64>,
    pub(super) residuals_m: Vec<f64>,
    pub(super) redundancy: usize,
    pub(super) chi_square: f64,
}

/// Starts that are tried: the first is by the distances, the others are shaken, for networks with many gaps.
const STARTS: usize = 4;
/// Steps of Levenberg and Marquardt.
const STEPS: usize = 100;
/// Part of the network's extent from which on a combination of coordinates counts as free: the linear law of
/// errors does not hold so far.
const FREE: f64 = 0.1;

/// Residual of a measurement, m.
pub(super) fn residual_m(points_m: &[Vector3<f64>], measured: &NetworkMeasurement) -> f64 {
    match measured.between {
        MeasuredBetween::Distance(a, b) => measured.value_m - (points_m[a] - points_m[b]).norm(),
        MeasuredBetween::Height(a) => measured.value_m - points_m[a].z,
        MeasuredBetween::Plumb(a, b) => {
            let apart = points_m[b] - points_m[a];
            if apart.x.abs() > apart.y.abs() { apart.x } else { apart.y }
        }
    }
}

/// Residuals over standard deviations, and their slopes.
fn equations(points_m: &[Vector3<f64>], measured: &[NetworkMeasurement]) -> (DVector<f64>, DMatrix<f64>) {
    let rows: usize =
        measured.iter().map(|m| if matches!(m.between, MeasuredBetween::Plumb(..)) { 2 } else { 1 }).sum();
    let (mut right, mut slopes) = (DVector::zeros(rows), DMatrix::zeros(rows, 3 * points_m.len()));
    let mut row = 0;
    for m in measured {
        let weight = 1.0 / m.std_m;
        match m.between {
            MeasuredBetween::Distance(a, b) => {
                let apart = points_m[a] - points_m[b];
                let along = apart / apart.norm().max(f64::MIN_POSITIVE);
                right[row] = weight * (m.value_m - apart.norm());
                for k in 0..3 {
                    slopes[(row, 3 * a + k)] = weight * along[k];
                    slopes[(row, 3 * b + k)] = -weight * along[k];
                }
                row += 1;
            }
            MeasuredBetween::Height(a) => {
                right[row] = weight * (m.value_m - points_m[a].z);
                slopes[(row, 3 * a + 2)] = weight;
                row += 1;
            }
            MeasuredBetween::Plumb(a, b) => {
                for k in 0..2 {
                    right[row] = -weight * (points_m[a][k] - points_m[b][k]);
                    slopes[(row, 3 * a + k)] = weight;
                    slopes[(row, 3 * b + k)] = -weight;
                    row += 1;
                }
            }
        }
    }
    (right, slopes)
}

/// Adjusts a network.
pub(super) fn solve(names: &[String], measured: &[NetworkMeasurement]) -> Result<Solved, DistanceRefusal> {
    let is_measured = |k: &usize| measured.iter().any(|m| points_of(m.between).contains(&Some(*k)));
    let lonely: Vec<&str> = (0..names.len()).filter(|k| !is_measured(k)).map(|k| names[k].as_str()).collect();
    if !lonely.is_empty() || names.len() < 4 {
        let loose = if names.len() < 4 { "fewer than four points".to_owned() } else { lonely.join(", ") };
        return Err(DistanceRefusal::Loose { loose, more: 1 });
    }
    let first = start(names.len(), measured);
    let (extent_m, ups) = (spread_m(&first), directions_of_up(&first, measured));
    let mut best: Option<(bool, f64, Vec<Vector3<f64>>)> = None;
    for (shake, up) in (0..STARTS).flat_map(|shake| ups.iter().map(move |up| (shake, up))) {
        let turn_up = turn_to_z(up);
        let shaken = |(k, p): (usize, &Vector3<f64>)| {
            let turn = |j: usize| ((7 * k + 3 * j + 11 * shake) as f64).sin();
            let by_m = if shake == 0 { 1e-6 } else { 0.3 } * extent_m;
            turn_up * p + by_m * Vector3::new(turn(0), turn(1), turn(2))
        };
        let (cost, points) = descend(first.iter().enumerate().map(shaken).collect(), measured);
        let on_head = is_on_its_head(&points, measured);
        let is_better = best.as_ref().is_none_or(|(other, least, _)| {
            (on_head, *other) == (false, true) || (on_head == *other && cost < 0.99 * least)
        });
        if is_better {
            best = Some((on_head, cost, points));
        }
    }
    let (_, chi_square, points_m) = best.unwrap_or_default();
    let (_, slopes) = equations(&points_m, measured);
    let open = open_motions(&points_m, measured);
    let eigen = (slopes.transpose() * &slopes).symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let floor = (FREE * spread_m(&points_m)).powi(-2);
    let free: Vec<usize> = order.iter().copied().filter(|k| eigen.eigenvalues[*k] < floor).collect();
    if free.len() > open {
        return Err(loose(names, &free, open, &eigen.eigenvectors));
    }
    let mut covariance_m2 = DMatrix::zeros(3 * names.len(), 3 * names.len());
    for k in &order[open..] {
        let v = eigen.eigenvectors.column(*k);
        covariance_m2 += v * v.transpose() / eigen.eigenvalues[*k];
    }
    refuse_flat(&points_m, &covariance_m2, measured)?;
    let residuals_m = measured.iter().map(|m| residual_m(&points_m, m)).collect();
    let redundancy = (slopes.nrows() + open).saturating_sub(slopes.ncols());
    Ok(Solved { points_m, covariance_m2, residuals_m, redundancy, chi_square })
}

/// Refuses points near one plane. A distance changes there by the square of what a point moves out of the plane: where that
/// is not small against the standard deviation of a distance, and the points are no further out than the law of errors reaches,
/// noise alone lifts them out, and their covariance says nothing.
fn refuse_flat(
    points_m: &[Vector3<f64>],
    covariance_m2: &DMatrix<f64>,
    measured: &[NetworkMeasurement],
) -> Result<(), DistanceRefusal> {
    let count = points_m.len().max(1) as f64;
    let middle = points_m.iter().sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points_m.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
    let eigen = (spread / count).symmetric_eigen();
    let across = eigen.eigenvalues.imin();
    let (normal, thickness_m) =
        (eigen.eigenvectors.column(across), eigen.eigenvalues[across].max(0.0).sqrt());
    let var_m2 = |k: usize| (normal.transpose() * covariance_m2.fixed_view::<3, 3>(3 * k, 3 * k) * normal).x;
    let std_m = ((0..points_m.len()).map(var_m2).sum::<f64>() / count).sqrt();
    let is_distance = |m: &&NetworkMeasurement| matches!(m.between, MeasuredBetween::Distance(..));
    let tape_std_m = measured.iter().filter(is_distance).map(|m| m.std_m).fold(f64::INFINITY, f64::min);
    let bends = std_m * std_m > FREE * spread_m(points_m) * tape_std_m;
    if bends && std_m > FREE * thickness_m {
        return Err(DistanceRefusal::Flat { thickness_m, std_m, tape_std_m });
    }
    Ok(())
}

/// The points that can move: those of the largest parts in what is free beyond shifts and turns of the whole.
fn loose(names: &[String], free: &[usize], open: usize, vectors: &DMatrix<f64>) -> DistanceRefusal {
    let of_point =
        |k: usize| -> f64 { free.iter().map(|v| vectors.fixed_view::<3, 1>(3 * k, *v).norm_squared()).sum() };
    // Shifts and turns of the whole are spread over all points.
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by(|a, b| of_point(*b).total_cmp(&of_point(*a)));
    let loose: Vec<&str> = order.iter().take(3).map(|k| names[*k].as_str()).collect();
    DistanceRefusal::Loose { loose: loose.join(", "), more: free.len() - open }
}

/// How many shifts and turns of the whole change no measurement: two shifts and the turn about the vertical always,
/// the shift up and down without a height, and tilts as far as neither plumb lines nor heights know the vertical.
fn open_motions(points_m: &[Vector3<f64>], measured: &[NetworkMeasurement]) -> usize {
    let level: Vec<Vector2<f64>> = measured
        .iter()
        .filter_map(
            |m| if let MeasuredBetween::Height(a) = m.between { Some(points_m[a].xy()) } else { None },
        )
        .collect();
    let tilts = if measured.iter().any(|m| matches!(m.between, MeasuredBetween::Plumb(..))) {
        0
    } else {
        let count = level.len().max(1) as f64;
        let middle = level.iter().sum::<Vector2<f64>>() / count;
        let spread: Matrix2<f64> =
            level.iter().map(|p| (p - middle) * (p - middle).transpose()).sum::<Matrix2<f64>>() / count;
        let least_m2 = (1e-3 * spread_m(points_m)).powi(2);
        spread.symmetric_eigenvalues().iter().filter(|v| **v < least_m2).count()
    };
    3 + usize::from(level.is_empty()) + tilts
}

/// Whether a solution stands on its head: a ball far below the floor, or one below what it hangs above.
fn is_on_its_head(points_m: &[Vector3<f64>], measured: &[NetworkMeasurement]) -> bool {
    let below_m = -FREE * spread_m(points_m);
    measured.iter().any(|m| match m.between {
        MeasuredBetween::Height(_) => points_m.iter().any(|p| p.z < below_m),
        MeasuredBetween::Plumb(a, b) => points_m[a].z < points_m[b].z,
        MeasuredBetween::Distance(..) => false,
    })
}

/// Root mean square distance of points from their middle.
fn spread_m(points_m: &[Vector3<f64>]) -> f64 {
    let count = points_m.len().max(1) as f64;
    let middle = points_m.iter().sum::<Vector3<f64>>() / count;
    (points_m.iter().map(|p| (p - middle).norm_squared()).sum::<f64>() / count).sqrt()
}

/// Steps of Levenberg and Marquardt down to the least square sum near a start.
fn descend(mut points: Vec<Vector3<f64>>, measured: &[NetworkMeasurement]) -> (f64, Vec<Vector3<f64>>) {
    let (mut right, mut slopes) = equations(&points, measured);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let normal = slopes.transpose() * &slopes;
        let gradient = slopes.transpose() * &right;
        let scale = normal.trace() / normal.nrows().max(1) as f64;
        let damped = normal + DMatrix::identity(slopes.ncols(), slopes.ncols()) * (damping * scale);
        let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
            damping *= 10.0;
            continue;
        };
        let moved: Vec<Vector3<f64>> =
            points.iter().enumerate().map(|(k, p)| p + step.fixed_rows::<3>(3 * k)).collect();
        let (next, next_slopes) = equations(&moved, measured);
        if next.norm_squared() <= right.norm_squared() {
            let is_done = step.norm() < 1e-10 || right.norm_squared() - next.norm_squared() < 1e-12;
            (points, right, slopes, damping) = (moved, next, next_slopes, (0.1 * damping).max(1e-12));
            if is_done {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e9 {
                break;
            }
        }
    }
    (right.norm_squared(), points)
}

/// Points by classical scaling of the distances (Torgerson 1952), those that were not measured taken along the others.
fn start(count: usize, measured: &[NetworkMeasurement]) -> Vec<Vector3<f64>> {
    let mut apart = DMatrix::from_element(count, count, f64::INFINITY);
    apart.fill_diagonal(0.0);
    for m in measured {
        if let MeasuredBetween::Distance(a, b) = m.between {
            apart[(a, b)] = m.value_m;
            apart[(b, a)] = m.value_m;
        }
    }
    for via in 0..count {
        for a in 0..count {
            for b in 0..count {
                let around: f64 = apart[(a, via)] + apart[(via, b)];
                if around < apart[(a, b)] {
                    apart[(a, b)] = around;
                }
            }
        }
    }
    let known = apart.iter().copied().filter(|d: &f64| d.is_finite()).fold(0.0, f64::max);
    let squares = apart.map(|d| if d.is_finite() { d * d } else { known * known });
    let rows: Vec<f64> = squares.row_iter().map(|r| r.mean()).collect();
    let all = squares.mean();
    let gram = DMatrix::from_fn(count, count, |a, b| -0.5 * (squares[(a, b)] - rows[a] - rows[b] + all));
    let eigen = gram.symmetric_eigen();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let coordinate = |k: usize, axis: usize| {
        let of = order[axis];
        eigen.eigenvalues[of].max(0.0).sqrt() * eigen.eigenvectors[(k, of)]
    };
    (0..count).map(|k| Vector3::from_fn(|axis, _| coordinate(k, axis))).collect()
}

/// Directions that may be up: the one that fits heights and plumb lines best, and the one across the points whose
/// heights are known, which may all be at one; each with its opposite. z where nothing is known.
fn directions_of_up(points: &[Vector3<f64>], measured: &[NetworkMeasurement]) -> Vec<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    let mut known = Vec::new();
    for m in measured {
        let (row, value_m) = match m.between {
            MeasuredBetween::Height(a) => (points[a].push(1.0), m.value_m),
            MeasuredBetween::Plumb(a, b) => {
                let apart = points[a] - points[b];
                (apart.push(0.0), apart.norm())
            }
            MeasuredBetween::Distance(..) => continue,
        };
        if let MeasuredBetween::Height(a) = m.between {
            known.push(points[a]);
        }
        normal += row * row.transpose();
        right += row * value_m;
    }
    // Where few heights leave the direction open, the smallest that fits.
    let solved = normal.pseudo_inverse(1e-9).unwrap_or_default() * right;
    let fitting = solved.fixed_rows::<3>(0).into_owned();
    let middle = known.iter().sum::<Vector3<f64>>() / known.len().max(1) as f64;
    let spread: Matrix3<f64> =
        known.iter().map(|p| (p - middle) * (p - middle).transpose()).sum::<Matrix3<f64>>();
    let eigen = spread.symmetric_eigen();
    let across = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let candidates = [fitting, across].into_iter().filter_map(|up| up.try_normalize(1e-9));
    let mut all: Vec<Vector3<f64>> = candidates.flat_map(|up| [up, -up]).collect();
    if right == Vector4::zeros() && known.is_empty() {
        all = vec![Vector3::z()];
    }
    all
}

fn turn_to_z(up: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(up, &Vector3::z())
        .unwrap_or_else(|| UnitQuaternion::new(Vector3::x() * std::f64::consts::PI))
}
