//! Cameras from moved objects, alone or together with control points.

use super::adjust::{Fit, adjust};
use super::choose::{Chosen, choose, start_cameras};
use super::link::linked;
use super::moved::{Moved, MovedObject};
use super::problem::{Choice, Problem};
use super::snoop::{Cleaned, clean};
use super::start::MIN_POINTS;
use super::{CameraControl, CameraModel};
use crate::PoseError;
use mavsight_geometry::camera_parameters::INTRINSICS;
use mavsight_geometry::{
    CAMERA_PARAMETERS, Camera, GeometryError, ImagePoint, Isometry3, Vector3, rigid_fit, triangulate,
};

/// A sight is dropped beyond so many robust standard deviations: of normal noise one in a million is.
const BEYOND: f64 = 5.3;
/// Rounds of dropping.
const ROUNDS: usize = 3;
/// Points that fix the world's axes.
const AXES: usize = 3;
/// A focal length less certain than this is none.
const UNDETERMINED: f64 = 0.05;
/// Objects that miss by more than this part of the width are not what they are said to be.
const GROSS: f64 = 0.005;

/// Adjusts cameras to control points and moved objects together.
///
/// # Errors
/// As [`super::calibrate`].
pub(super) fn with_objects(
    controls: &[CameraControl],
    objects: &[MovedObject],
) -> Result<(Problem, Cleaned), PoseError> {
    let mut problem = Problem::new(controls)?;
    let objects: Vec<Moved> =
        objects.iter().map(|o| Moved::new(o, controls.len())).collect::<Result<_, _>>()?;
    let cameras = if controls.iter().all(|c| c.points.len() >= MIN_POINTS) {
        start_cameras(&problem, &problem.all()).map_err(|(camera, source)| PoseError::Calibration {
            camera: problem.names[camera].clone(),
            source,
        })?
    } else {
        let alone = from_objects(&problem, &objects)?;
        if problem.points.is_empty() {
            return finished(alone);
        }
        in_world(&problem, &alone.1)?
    };
    problem.moved = objects.iter().map(|o| o.placed(&cameras)).collect();
    problem.start = Some(cameras);
    let all = problem.all();
    let (problem, fit) = without_strays(problem, &all)?;
    // Before the control points are suspected of what an object does to them.
    refuse(&problem, &fit)?;
    let problem = Problem { start: Some(fit.cameras), ..problem };
    let cleaned = clean(&problem)?;
    refuse(&problem, &cleaned.chosen.best)?;
    Ok((problem, cleaned))
}

/// The objects alone, in the axes of the first camera.
fn from_objects(problem: &Problem, objects: &[Moved]) -> Result<(Problem, Fit), PoseError> {
    let sets = linked(objects, &problem.names, &problem.sizes)?;
    let mut best: Option<(Problem, Fit)> = None;
    for cameras in sets {
        let alone = Problem {
            names: problem.names.clone(),
            sizes: problem.sizes.clone(),
            points: Vec::new(),
            sights: Vec::new(),
            moved: objects.iter().map(|o| o.placed(&cameras)).collect(),
            held: Some(0),
            start: Some(cameras),
        };
        let choice = alone.all();
        if let Ok((alone, fit)) = without_strays(alone, &choice) {
            // Per coordinate: starts differ in the places that they keep.
            let better = |b: &(Problem, Fit)| b.1.variance_factor > fit.variance_factor;
            if best.as_ref().is_none_or(better) {
                best = Some((alone, fit));
            }
        }
    }
    best.ok_or_else(|| undetermined(problem))
}

fn undetermined(problem: &Problem) -> PoseError {
    let source = GeometryError::UndeterminedCamera { condition: f64::INFINITY };
    PoseError::Calibration { camera: problem.names.join(", "), source }
}

fn finished((problem, fit): (Problem, Fit)) -> Result<(Problem, Cleaned), PoseError> {
    let choice = problem.all();
    let chosen: Chosen = choose(&problem, &choice, &fit.cameras).ok_or_else(|| undetermined(&problem))?;
    refuse(&problem, &chosen.best)?;
    Ok((problem, Cleaned { chosen, choice, left_out: Vec::new() }))
}

/// An adjustment of the least model and then of one with a bent lens, without sights that disagree beyond chance and places
/// that have too few left.
fn without_strays(mut problem: Problem, choice: &Choice) -> Result<(Problem, Fit), PoseError> {
    let start = problem.start.clone().unwrap_or_default();
    let n = problem.sizes.len();
    let bent = CameraModel { lens: super::Lens::K1K2, ..CameraModel::PINHOLE };
    let mut fit = adjust(&problem, choice, &vec![CameraModel::PINHOLE; n], &start);
    for _ in 0..ROUNDS {
        let near = fit.as_ref().map_or(&start, |f| &f.cameras);
        let wide = adjust(&problem, choice, &vec![bent; n], near);
        fit = fit.into_iter().chain(wide).max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
        let Some(now) = &fit else { break };
        let dropped = drop_strays(&mut problem, now);
        if dropped == 0 {
            break;
        }
        fit = adjust(&problem, choice, &now.models.clone(), &now.cameras.clone());
    }
    let fit = fit.ok_or_else(|| undetermined(&problem))?;
    Ok((problem, fit))
}

/// Drops sights that are far off, and places that do not contradict any camera any more; how many sights went.
fn drop_strays(problem: &mut Problem, fit: &Fit) -> usize {
    let mut dropped = 0;
    for (k, object) in problem.moved.iter_mut().enumerate() {
        let shared = object.shared(&fit.cameras, fit.scales[k]);
        let square = |s: &crate::moving::PointSight, pose: &Isometry3<f64>| {
            shared.whitened(s, pose).map_or(f64::INFINITY, |r| r.norm_squared())
        };
        let places = || object.sights.iter().zip(&fit.poses[k]);
        let mut squares: Vec<f64> =
            places().flat_map(|(sights, pose)| sights.iter().map(move |s| square(s, pose))).collect();
        if squares.is_empty() {
            continue;
        }
        let middle = squares.len() / 2;
        // The median of a chi-square with two degrees of freedom is 2 ln 2.
        let variance = *squares.select_nth_unstable_by(middle, f64::total_cmp).1 / (2.0 * 2f64.ln());
        let (mut sights, mut start) = (Vec::new(), Vec::new());
        for (place, pose) in places() {
            let kept: Vec<_> =
                place.iter().filter(|s| square(s, pose) <= BEYOND * BEYOND * variance).copied().collect();
            dropped += place.len() - kept.len();
            if 2 * kept.len() > object.pose_parameters() {
                sights.push(kept);
                start.push(*pose);
            }
        }
        (object.sights, object.start) = (sights, start);
    }
    dropped
}

/// The cameras in the world of the control points, of which three or more are seen by two cameras.
fn in_world(problem: &Problem, fit: &Fit) -> Result<Vec<Camera>, PoseError> {
    let (mut surveyed, mut found) = (Vec::new(), Vec::new());
    for (k, point) in problem.points.iter().enumerate() {
        let rays: Vec<_> = problem
            .sights
            .iter()
            .filter(|s| s.point == k)
            .map(|s| ImagePoint {
                camera: &fit.cameras[s.camera],
                pixel: s.pixel,
                covariance_px2: s.covariance_px2,
            })
            .collect();
        if let Ok(seen) = triangulate(&rays) {
            surveyed.push(point.in_world_m);
            found.push(seen.point_in_world_m);
        }
    }
    let axes = PoseError::WorldAxes { found: found.len(), needed: AXES };
    if found.len() < AXES {
        return Err(axes);
    }
    let fit_of_axes = rigid_fit(&surveyed, &found, &vec![1.0; found.len()]).map_err(|_| axes)?;
    let move_by = fit_of_axes.world_from_body;
    let moved = |c: &Camera| Camera { cam_from_world: c.cam_from_world * move_by, ..*c };
    Ok(fit.cameras.iter().map(moved).collect())
}

/// Objects that are not seen as they are said to be, and focal lengths that they do not show.
fn refuse(problem: &Problem, fit: &Fit) -> Result<(), PoseError> {
    let covariance = fit.camera_covariance();
    for (camera, name) in problem.names.iter().enumerate() {
        let (squares_px2, sights, _) = problem.moved_residuals(fit, camera);
        let rms_px = (squares_px2 / f64::max(2.0 * sights, 1.0)).sqrt();
        let gate_px = GROSS * f64::from(problem.sizes[camera].width_px);
        let objects = problem.moved.iter().map(|m| m.name.as_str()).collect::<Vec<_>>().join(" and ");
        if rms_px > gate_px {
            return Err(PoseError::ObjectMisfit { camera: name.clone(), objects, rms_px, gate_px });
        }
        let at = CAMERA_PARAMETERS * camera + INTRINSICS;
        let share = covariance[(at, at)].max(0.0).sqrt() / fit.cameras[camera].intrinsics.fx_px;
        if share > UNDETERMINED {
            let (places, tilt_deg, covered) = seen_of(problem, fit, camera);
            return Err(PoseError::FocalUndetermined {
                camera: name.clone(),
                percent: 100.0 * share,
                objects,
                places,
                tilt_deg,
                covered_percent: 100.0 * covered,
            });
        }
    }
    Ok(())
}

/// Places that a camera saw, the largest angle between the objects' attitudes there, and the part of the image that they cover.
fn seen_of(problem: &Problem, fit: &Fit, camera: usize) -> (usize, f64, f64) {
    let size = problem.sizes[camera];
    let (mut places, mut tilt_rad) = (0, 0.0_f64);
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for (object, poses) in problem.moved.iter().zip(&fit.poses) {
        let axis = if object.is_line() { Vector3::x() } else { Vector3::z() };
        let mut axes: Vec<Vector3<f64>> = Vec::new();
        for (sights, pose) in object.sights.iter().zip(poses) {
            let own: Vec<_> = sights.iter().filter(|s| s.camera == camera).collect();
            if own.is_empty() {
                continue;
            }
            places += 1;
            axes.push(pose.rotation * axis);
            for s in own {
                for k in 0..2 {
                    (low[k], high[k]) = (low[k].min(s.pixel[k]), high[k].max(s.pixel[k]));
                }
            }
        }
        for (k, a) in axes.iter().enumerate() {
            axes[k..].iter().for_each(|b| tilt_rad = tilt_rad.max(a.angle(b)));
        }
    }
    let area = (high[0] - low[0]).max(0.0) * (high[1] - low[1]).max(0.0);
    (places, tilt_rad.to_degrees(), if places > 0 { (area / size.area_px() as f64).min(1.0) } else { 0.0 })
}
