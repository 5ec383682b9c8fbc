//! Cameras from moved objects, alone or together with control points.

use super::adjust::{Fit, adjust};
use super::choose::{choose, most_probable, start_camera, start_cameras};
use super::link::{add_others, linked};
use super::model::{CameraModel, Lens};
use super::moved::{Moved, MovedObject, names_of};
use super::problem::Problem;
use super::rig::CameraControl;
use super::snoop::{Cleaned, clean};
use super::start::MIN_POINTS;
use crate::PoseError;
use crate::moving::{Instant, Shared};
use crate::reprojection::PointObservation;
use crate::statistics::median;
use mavsight_geometry::camera_parameters::INTRINSICS;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Vector2, Vector3, rigid_fit, triangulate};

/// Robust standard deviations beyond which an observation is dropped: one in a million of normal noise.
const BEYOND: f64 = 5.3;
const ROUNDS: usize = 3;
/// Least factor on covariances: a thousandth of a stated standard deviation is rounding.
const LEAST_FACTOR: f64 = 1e-6;
/// Control points from which a camera is started: what the linear transformation needs.
pub(super) const ENOUGH_POINTS: usize = 6;
const AXES: usize = 3;
/// A focal length with a larger relative standard deviation is undetermined.
const UNDETERMINED: f64 = 0.05;
/// Objects with residuals above this part of the width do not have the stated size or colours.
const GROSS: f64 = 0.005;

/// Adjusts cameras to control points and moved objects together.
pub(super) fn with_objects(
    controls: &[CameraControl],
    objects: &[MovedObject],
) -> Result<(Problem, Cleaned), PoseError> {
    let mut problem = Problem::new(controls)?;
    let objects: Vec<Moved> =
        objects.iter().map(|o| Moved::new(o, controls.len())).collect::<Result<_, _>>()?;
    let has = |points: usize| controls.iter().all(|c| c.points.len() >= points);
    let known = if has(ENOUGH_POINTS) { Ok(None) } else { by_the_others(&problem, &objects) };
    let cameras = if let Ok(Some(cameras)) = known {
        cameras
    } else if has(MIN_POINTS) {
        start_cameras(problem.with(&problem.all()))?
    } else if let (Err(refused), true) = (known, objects.iter().all(Moved::is_free)) {
        return Err(refused);
    } else {
        let alone = from_objects(&problem, &objects)?;
        if problem.points.is_empty() {
            return chosen_of(alone);
        }
        in_world(&problem, &alone.fit)?
    };
    problem.moved = objects.iter().map(|o| o.placed(&cameras)).collect();
    problem.start = Some(cameras);
    let Adjusted { problem, fit } = without_outliers(problem)?;
    // First, so that a bad object does not make the control points suspect.
    refuse(&problem, &fit)?;
    let problem = Problem { start: Some(fit.state.cameras), ..problem };
    let cleaned = clean(&problem)?;
    refuse(&problem, &cleaned.chosen.best)?;
    Ok((problem, cleaned))
}

/// Cameras that see enough control points, and from those each of the others by the places of an object that two of them
/// see; `None` where fewer than two see enough.
fn by_the_others(problem: &Problem, objects: &[Moved]) -> Result<Option<Vec<Camera>>, PoseError> {
    let choice = problem.all();
    let data = problem.with(&choice);
    let points = |camera: usize| data.used_by(camera).count();
    let mut set = vec![None; problem.sizes.len()];
    for camera in (0..set.len()).filter(|c| points(*c) >= ENOUGH_POINTS) {
        set[camera] = Some(start_camera(data, camera)?);
    }
    if set.iter().flatten().count() < 2 {
        return Ok(None);
    }
    objects.iter().for_each(|object| add_others(object, &mut set, &problem.sizes));
    if let Some(camera) = set.iter().position(Option::is_none) {
        let joint = |place: &&Instant| {
            let seen_by = |c: usize| place.observations.iter().filter(|o| o.camera == c).count();
            seen_by(camera) > 0 && (0..set.len()).filter(|c| set[*c].is_some() && seen_by(*c) > 0).count() > 1
        };
        return Err(PoseError::FewControlPoints {
            camera: problem.names[camera].clone(),
            points: points(camera),
            objects: names_of(objects),
            places: objects.iter().map(|o| o.places.iter().filter(joint).count()).sum(),
            needed: ENOUGH_POINTS,
        });
    }
    Ok(Some(set.into_iter().flatten().collect()))
}

/// A problem with the observations that agree, and its adjustment.
struct Adjusted {
    problem: Problem,
    fit: Fit,
}

/// The objects alone, in the axes of the first camera.
fn from_objects(problem: &Problem, objects: &[Moved]) -> Result<Adjusted, PoseError> {
    let sets = linked(objects, &problem.names, &problem.sizes)?;
    let mut best = None;
    for cameras in sets {
        let alone = Problem {
            points: Vec::new(),
            observations: Vec::new(),
            moved: objects.iter().map(|o| o.placed(&cameras)).collect(),
            held: Some(0),
            start: Some(cameras),
            ..problem.clone()
        };
        let Ok(found) = without_outliers(alone) else { continue };
        // Per coordinate: starts differ in the places that they keep.
        if best.as_ref().is_none_or(|b: &Adjusted| b.fit.variance_factor > found.fit.variance_factor) {
            best = Some(found);
        }
    }
    best.ok_or_else(|| problem.undetermined())
}

/// The most probable models of an adjustment of objects alone.
fn chosen_of(Adjusted { problem, fit }: Adjusted) -> Result<(Problem, Cleaned), PoseError> {
    let choice = problem.all();
    let chosen = choose(problem.with(&choice), &fit.state.cameras).ok_or_else(|| problem.undetermined())?;
    refuse(&problem, &chosen.best)?;
    Ok((problem, Cleaned { chosen, choice, left_out: Vec::new() }))
}

/// An adjustment of the least model, then of a bent lens, without observations that disagree beyond chance, each object's at
/// the scale of its own residuals.
fn without_outliers(mut problem: Problem) -> Result<Adjusted, PoseError> {
    let (choice, n) = (problem.all(), problem.sizes.len());
    let start = problem.start.clone().unwrap_or_default();
    let bent = CameraModel { lens: Lens::K1K2, ..CameraModel::PINHOLE };
    let mut fit = adjust(problem.with(&choice), &vec![CameraModel::PINHOLE; n], &start);
    for _ in 0..ROUNDS {
        let near = fit.as_ref().map_or(&start, |f| &f.state.cameras);
        let wide = adjust(problem.with(&choice), &vec![bent; n], near);
        fit = most_probable(fit.into_iter().chain(wide));
        let Some(now) = &fit else { break };
        if drop_outliers(&mut problem, now) == 0 {
            break;
        }
        fit = adjust(problem.with(&choice), &now.models, &now.state.cameras);
    }
    let fit = fit.ok_or_else(|| problem.undetermined())?;
    scale_by_residuals(&mut problem, &fit);
    let fit = adjust(problem.with(&choice), &fit.models, &fit.state.cameras);
    let fit = fit.ok_or_else(|| problem.undetermined())?;
    Ok(Adjusted { problem, fit })
}

/// Brings the covariances of each object's observations to what its residuals show, so that they are about one beside those of the
/// control points: corners of a board are measured in another way than balls, and there are thousands of them.
fn scale_by_residuals(problem: &mut Problem, fit: &Fit) {
    for (k, object) in problem.moved.iter_mut().enumerate() {
        let squares = squares(object, fit, k).concat();
        let coordinates = 2.0 * squares.len() as f64;
        let freedom = coordinates - (object.pose_parameters() * object.places.len()) as f64;
        if freedom < 1.0 {
            continue;
        }
        let factor = (variance(squares) * coordinates / freedom).max(LEAST_FACTOR);
        object.places.iter_mut().flat_map(|p| &mut p.observations).for_each(|o| *o = o.scaled(factor));
    }
}

/// Squares of the whitened residuals of an object's observations at each of its places.
fn squares(object: &Moved, fit: &Fit, k: usize) -> Vec<Vec<f64>> {
    let shared = object.adjusted(&fit.state, k);
    let of = |(place, (pose, lags_s)): (&Instant, (&Isometry3<f64>, &Vec<f64>))| {
        let own = Shared { lags_s: lags_s.clone(), ..shared.clone() };
        let square = |o: &PointObservation| {
            own.residual_px(o, pose).map_or(f64::INFINITY, |r| (o.whitener * r).norm_squared())
        };
        place.observations.iter().map(square).collect()
    };
    object.places.iter().zip(fit.state.poses[k].iter().zip(&fit.state.lags_s[k])).map(of).collect()
}

/// Robust variance of residuals by their squares: the median of a chi-square with two degrees of freedom is 2 ln 2.
fn variance(squares: Vec<f64>) -> f64 {
    median(squares).unwrap_or(f64::NAN) / (2.0 * 2f64.ln())
}

/// Drops observations that are far off and places without redundancy; the number of dropped observations.
fn drop_outliers(problem: &mut Problem, fit: &Fit) -> usize {
    let mut dropped = 0;
    for (k, object) in problem.moved.iter_mut().enumerate() {
        let squares = squares(object, fit, k);
        let variance = variance(squares.concat());
        let kept = |(place, (squares, pose)): (&Instant, (&Vec<f64>, &Isometry3<f64>))| {
            let own = place.observations.iter().zip(squares);
            let near = own.filter(|(_, square)| **square <= BEYOND * BEYOND * variance);
            let observations: Vec<_> = near.map(|(o, _)| *o).collect();
            dropped += place.observations.len() - observations.len();
            Instant { observations, world_from_body: *pose }
        };
        let is_redundant = |p: &Instant| 2 * p.observations.len() > object.pose_parameters();
        let states = squares.iter().zip(&fit.state.poses[k]);
        object.places = object.places.iter().zip(states).map(kept).filter(is_redundant).collect();
    }
    dropped
}

/// The cameras in the world of the control points, of which three or more are in view of two cameras.
fn in_world(problem: &Problem, fit: &Fit) -> Result<Vec<Camera>, PoseError> {
    let cameras = &fit.state.cameras;
    let mut pairs = Vec::new();
    for (k, point) in problem.points.iter().enumerate() {
        let own = problem.observations.iter().filter(|o| o.point == k);
        let images: Vec<_> = own.map(|o| o.in_image(&cameras[o.camera])).collect();
        if let Ok(seen) = triangulate(&images) {
            pairs.push((point.in_world_m, seen.point_in_world_m));
        }
    }
    let axes = PoseError::WorldAxes { found: pairs.len(), needed: AXES };
    let move_by = rigid_fit(pairs).map_err(|_| axes)?;
    let moved = |c: &Camera| Camera { cam_from_world: c.cam_from_world * move_by, ..*c };
    Ok(cameras.iter().map(moved).collect())
}

/// Refuses objects that contradict what is stated of them, and undetermined focal lengths.
fn refuse(problem: &Problem, fit: &Fit) -> Result<(), PoseError> {
    let covariance = fit.camera_covariance();
    for (camera, name) in problem.names.iter().enumerate() {
        let residuals = fit.object_residuals(problem, camera);
        let rms_px = (residuals.squares_px2 / f64::max(2.0 * residuals.observations, 1.0)).sqrt();
        let gate_px = GROSS * f64::from(problem.sizes[camera].width_px);
        let objects = names_of(&problem.moved);
        if rms_px > gate_px {
            return Err(PoseError::ObjectMisfit { camera: name.clone(), objects, rms_px, gate_px });
        }
        let at = CAMERA_PARAMETERS * camera + INTRINSICS;
        let share = covariance[(at, at)].max(0.0).sqrt() / fit.state.cameras[camera].intrinsics.fx_px;
        if share > UNDETERMINED {
            let views = views_of(problem, fit, camera);
            return Err(PoseError::FocalUndetermined {
                camera: name.clone(),
                percent: 100.0 * share,
                objects,
                places: views.places,
                tilt_deg: views.tilt_rad.to_degrees(),
                covered_percent: 100.0 * views.covered,
            });
        }
    }
    Ok(())
}

#[derive(Default)]
struct Views {
    places: usize,
    /// Largest angle between the objects' attitudes.
    tilt_rad: f64,
    covered: f64,
}

fn views_of(problem: &Problem, fit: &Fit, camera: usize) -> Views {
    let mut out = Views::default();
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for (object, poses) in problem.moved.iter().zip(&fit.state.poses) {
        let axis = if object.is_line() { Vector3::x() } else { Vector3::z() };
        let mut axes: Vec<Vector3<f64>> = Vec::new();
        for (place, pose) in object.places.iter().zip(poses) {
            let mut own = place.observations.iter().filter(|o| o.camera == camera).peekable();
            if own.peek().is_some() {
                axes.push(pose.rotation * axis);
            }
            own.for_each(|o| (low, high) = (low.inf(&o.pixel), high.sup(&o.pixel)));
        }
        out.places += axes.len();
        for (k, a) in axes.iter().enumerate() {
            axes[k..].iter().for_each(|b| out.tilt_rad = out.tilt_rad.max(a.angle(b)));
        }
    }
    if out.places > 0 {
        let area_px2 = (high - low).product();
        out.covered = (area_px2 / problem.sizes[camera].area_px() as f64).min(1.0);
    }
    out
}
