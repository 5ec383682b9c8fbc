//! The axes of a network, put through its first points.

use super::refusal::DistanceRefusal;
use super::solve::Solved;
use super::{MeasuredBetween, NetworkMeasurement, PointNetwork};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Part of a distance below which a point counts as on the line or in the plane of others.
const BESIDE: f64 = 1e-3;

/// Puts the axes: a turn, a mirror where the third point demands one, and a shift.
pub(super) fn put(solved: Solved, measured: &[NetworkMeasurement]) -> Result<PointNetwork, DistanceRefusal> {
    let has_height = measured.iter().any(|m| matches!(m.between, MeasuredBetween::Height(_)));
    let has_up = has_height || measured.iter().any(|m| matches!(m.between, MeasuredBetween::Plumb(..)));
    let points = &solved.points_m;
    let loose = || DistanceRefusal::Loose { loose: "points in one line".into(), more: 1 };
    let turn = if has_up {
        about_the_vertical(points).ok_or_else(loose)?
    } else {
        through_the_first(points).ok_or_else(loose)?
    };
    let mut shift = -(turn * points[0]);
    if has_height {
        shift.z = 0.0;
    }
    let points_m = points.iter().map(|p| turn * p + shift).collect();
    let count = points.len();
    let mut all = DMatrix::zeros(3 * count, 3 * count);
    for k in 0..count {
        all.fixed_view_mut::<3, 3>(3 * k, 3 * k).copy_from(&turn);
    }
    Ok(PointNetwork {
        points_m,
        covariance_m2: &all * solved.covariance_m2 * all.transpose(),
        residuals_m: solved.residuals_m,
        redundancy: solved.redundancy,
        chi_square: solved.chi_square,
        left_out: None,
    })
}

/// z is kept: x through the first two points seen from above, y to the side of the first point that is beside them.
fn about_the_vertical(points: &[Vector3<f64>]) -> Option<Matrix3<f64>> {
    let level = |v: Vector3<f64>| Vector3::new(v.x, v.y, 0.0);
    let away = |k: usize| level(points[k] - points[0]);
    let second = (1..points.len()).find(|k| away(*k).norm() > BESIDE * (points[*k] - points[0]).norm())?;
    let x = away(second).try_normalize(0.0)?;
    let beside = (1..points.len()).map(away).find(|v| (v - x * v.dot(&x)).norm() > BESIDE * v.norm())?;
    let y = (beside - x * beside.dot(&x)).try_normalize(0.0)?;
    Some(Matrix3::from_rows(&[x.transpose(), y.transpose(), Vector3::z().transpose()]))
}

/// x through the first two points, y to the side of the first that is beside them, z to that of the first outside of
/// their plane.
fn through_the_first(points: &[Vector3<f64>]) -> Option<Matrix3<f64>> {
    let away = |k: usize| points[k] - points[0];
    let x = away(1).try_normalize(0.0)?;
    let beside = (2..points.len()).map(away).find(|v| (v - x * v.dot(&x)).norm() > BESIDE * v.norm())?;
    let y = (beside - x * beside.dot(&x)).try_normalize(0.0)?;
    let normal = x.cross(&y);
    let outside = (2..points.len()).map(away).find(|v| v.dot(&normal).abs() > BESIDE * v.norm())?;
    let z = normal * outside.dot(&normal).signum();
    Some(Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]))
}
