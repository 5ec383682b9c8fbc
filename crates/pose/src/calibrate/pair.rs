//! Two cameras from a wand that both saw: the essential matrix for guessed focal lengths, judged by the
//! wand's length.

use super::moved::Moved;
use crate::moving::Instant;
use crate::statistics::median;
use mavsight_geometry::attitude::rotation_of;
use mavsight_geometry::{
    Camera, ImagePoint, ImageSize, Intrinsics, Isometry3, Matrix2, Matrix3, Vector2, Vector3,
    centroid_and_spread, jacobi_svd, triangulate,
};
use nalgebra::{DMatrix, Translation3};

/// Fields of view that are tried for each camera, across the width.
const FIELDS_RAD: [f64; 6] = [0.35, 0.55, 0.8, 1.1, 1.45, 1.9];
/// Matches that a fundamental matrix needs: twice the eight of the linear method.
pub(super) const MIN_MATCHES: usize = 16;
/// Rounds in which matches that are far from their epipolar lines are dropped.
const ROUNDS: usize = 6;
/// A match is dropped beyond so many robust standard deviations.
const BEYOND: f64 = 4.0;

type Match = (Vector2<f64>, Vector2<f64>);

/// Pairs of cameras in the axes of the first, those under which the wand's length varies least first.
pub(super) fn pairs(wand: &Moved, (a, b): (usize, usize), sizes: &[ImageSize]) -> Vec<(Camera, Camera)> {
    let length_m = (wand.body[1].marker_in_body_m - wand.body[0].marker_in_body_m).norm();
    let both = seen_by_both(wand, (a, b));
    let matches: Vec<Match> = both.iter().flatten().copied().collect();
    if matches.len() < MIN_MATCHES {
        return Vec::new();
    }
    let to_unit = |size: ImageSize| {
        let width = f64::from(size.width_px);
        let middle = Vector2::new((width - 1.0) / 2.0, (f64::from(size.height_px) - 1.0) / 2.0);
        move |p: &Vector2<f64>| (p - middle) / width
    };
    let (first, second) = (to_unit(sizes[a]), to_unit(sizes[b]));
    let scaled: Vec<Match> = matches.iter().map(|(p, q)| (first(p), second(q))).collect();
    let Some(fundamental) = fundamental(&scaled) else { return Vec::new() };
    let mut found: Vec<(f64, (Camera, Camera))> = Vec::new();
    for field_a in FIELDS_RAD {
        for field_b in FIELDS_RAD {
            let (fa, fb) = (0.5 / (field_a / 2.0).tan(), 0.5 / (field_b / 2.0).tan());
            let essential = Matrix3::from_diagonal(&Vector3::new(fb, fb, 1.0))
                * fundamental
                * Matrix3::from_diagonal(&Vector3::new(fa, fa, 1.0));
            let camera = |size, field, cam_from_world| {
                Camera::undistorted(cam_from_world, Intrinsics::from_horizontal_fov(size, field), size)
            };
            let one = camera(sizes[a], field_a, Isometry3::identity());
            let scaled = |pose| {
                let mut other = camera(sizes[b], field_b, pose);
                let (spread, median_m) = length_spread(&both, &one, &other)?;
                other.cam_from_world.translation.vector *= length_m / median_m;
                Some((spread, (one, other)))
            };
            let best = poses(&essential).into_iter().filter_map(scaled).min_by(|x, y| x.0.total_cmp(&y.0));
            found.extend(best);
        }
    }
    found.sort_by(|x, y| x.0.total_cmp(&y.0));
    found.into_iter().map(|f| f.1).collect()
}

/// Both balls in both cameras, by place.
pub(super) fn seen_by_both(wand: &Moved, (a, b): (usize, usize)) -> Vec<[Match; 2]> {
    let place = |Instant { observations, .. }: &Instant| {
        let of = |camera, point| {
            observations.iter().find(|o| o.camera == camera && o.point == point).map(|o| o.pixel)
        };
        let ball = |p| Some((of(a, p)?, of(b, p)?));
        Some([ball(0)?, ball(1)?])
    };
    wand.places.iter().filter_map(place).collect()
}

/// The fundamental matrix by the normalised eight-point method (Hartley 1997), without outliers.
fn fundamental(matches: &[Match]) -> Option<Matrix3<f64>> {
    let mut kept: Vec<Match> = matches.to_vec();
    let mut answer = linear(&kept)?;
    for _ in 0..ROUNDS {
        // The median of a chi-square with one degree of freedom is 0.455.
        let variance = median(kept.iter().map(|m| sampson(&answer, m)).collect())? / 0.455;
        let within: Vec<Match> =
            matches.iter().filter(|m| sampson(&answer, m) <= BEYOND * BEYOND * variance).copied().collect();
        if within.len() < MIN_MATCHES {
            return None;
        }
        let same = within.len() == kept.len();
        kept = within;
        answer = linear(&kept)?;
        if same {
            break;
        }
    }
    Some(answer)
}

fn linear(matches: &[Match]) -> Option<Matrix3<f64>> {
    let normaliser = |(middle, spread): (Vector2<f64>, f64)| {
        (spread > 0.0).then(|| Matrix3::new_translation(&-middle).append_scaling(1.0 / spread))
    };
    let first = normaliser(centroid_and_spread(matches.iter().map(|m| m.0)))?;
    let second = normaliser(centroid_and_spread(matches.iter().map(|m| m.1)))?;
    let mut rows = DMatrix::zeros(matches.len().max(9), 9);
    for (i, (p, q)) in matches.iter().enumerate() {
        let products = first * p.push(1.0) * (second * q.push(1.0)).transpose();
        rows.row_mut(i).copy_from_slice(products.as_slice());
    }
    let f = jacobi_svd(&rows).v.column(8).into_owned();
    let svd = jacobi_svd(&DMatrix::from_row_slice(3, 3, f.as_slice()));
    let (u, v, values) =
        (svd.u.fixed_view::<3, 3>(0, 0), svd.v.fixed_view::<3, 3>(0, 0), svd.singular_values);
    let rank_two = u * Matrix3::from_diagonal(&Vector3::new(values[0], values[1], 0.0)) * v.transpose();
    let out = second.transpose() * rank_two * first;
    out.iter().all(|x| x.is_finite()).then_some(out)
}

/// Squared distance from the epipolar geometry to first order (Sampson 1982).
fn sampson(f: &Matrix3<f64>, (p, q): &Match) -> f64 {
    let (p, q) = (p.push(1.0), q.push(1.0));
    let (line, back) = (f * p, f.transpose() * q);
    q.dot(&line).powi(2) / (line.xy().norm_squared() + back.xy().norm_squared()).max(f64::MIN_POSITIVE)
}

/// The four poses of the second camera that have an essential matrix (Hartley & Zisserman 2004, result 9.19).
fn poses(essential: &Matrix3<f64>) -> Vec<Isometry3<f64>> {
    let svd = jacobi_svd(&DMatrix::from_column_slice(3, 3, essential.as_slice()));
    let [mut u, mut v] = [&svd.u, &svd.v].map(|m| Matrix3::from_column_slice(m.as_slice()));
    // Proper rotations, so that the four poses are.
    u.set_column(2, &u.column(0).cross(&u.column(1)));
    v.set_column(2, &v.column(0).cross(&v.column(1)));
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let at: Vector3<f64> = u.column(2).into_owned();
    [u * w * v.transpose(), u * w.transpose() * v.transpose()]
        .into_iter()
        .flat_map(|turn| [at, -at].map(|at| Isometry3::from_parts(Translation3::from(at), rotation_of(turn))))
        .collect()
}

/// Relative spread of the wand's length and its median; `None` if a quarter of the places is out of view.
fn length_spread(both: &[[Match; 2]], one: &Camera, other: &Camera) -> Option<(f64, f64)> {
    let image = |camera, pixel| ImagePoint { camera, pixel, covariance_px2: Matrix2::identity() };
    let at = |(p, q): &Match| Some(triangulate(&[image(one, *p), image(other, *q)]).ok()?.point_in_world_m);
    let every = both.len().div_ceil(100).max(1);
    let tried = both.len().div_ceil(every);
    let mut lengths: Vec<f64> =
        both.iter().step_by(every).filter_map(|b| Some((at(&b[0])? - at(&b[1])?).norm())).collect();
    if 4 * lengths.len() < 3 * tried || lengths.len() < 3 {
        return None;
    }
    // Quartiles are not moved by a wrong ball.
    lengths.sort_by(f64::total_cmp);
    let at = |share: f64| lengths[((lengths.len() - 1) as f64 * share).round() as usize];
    let spread = (at(0.75) - at(0.25)) / at(0.5);
    spread.is_finite().then_some((spread, at(0.5)))
}
