//! Cameras to start from where moved objects link them, in the axes of the first.

use super::moved::{Moved, names_of};
use super::pair::{MIN_MATCHES, pairs, seen_by_both};
use super::plane::pinhole_of_planes;
use super::start::{MIN_POINTS, starts};
use crate::PoseError;
use crate::moving::Instant;
use crate::reprojection::{PointObservation, Scene};
use crate::three_points::pose_in_view;
use mavsight_geometry::attitude::rotation_of;
use mavsight_geometry::{Camera, ControlPoint, ImageSize, Isometry3, Matrix2, Matrix3, triangulate};

/// Starts of a pair that are followed: those whose wand changes its length least.
const FOLLOWED: usize = 4;

/// Sets of cameras near those that saw the objects, in the axes of the first camera: x to its right, y
/// forward, z up.
pub(super) fn linked(
    objects: &[Moved],
    names: &[String],
    sizes: &[ImageSize],
) -> Result<Vec<Vec<Camera>>, PoseError> {
    let mut sets: Vec<Vec<Option<Camera>>> =
        objects.iter().find(|o| o.is_board()).map(|board| of_board(board, sizes)).into_iter().collect();
    if let Some(wand) = objects.iter().find(|o| o.is_line())
        && sets.iter().all(|s| s.iter().flatten().count() < 2)
    {
        sets = of_wand(wand, sizes);
    }
    let mut out = Vec::new();
    let mut missing = None;
    for mut set in sets {
        for object in objects {
            add_others(object, &mut set, sizes);
        }
        match set.iter().position(Option::is_none) {
            Some(camera) => missing = missing.or(Some(camera)),
            None => out.push(in_axes_of_first(set.into_iter().flatten().collect())),
        }
    }
    if !out.is_empty() {
        return Ok(out);
    }
    let camera = missing.unwrap_or(sizes.len() - 1);
    let shared = |object: &Moved| {
        let is_both = |place: &&Instant| {
            let own = place.observations.iter().filter(|o| o.camera == camera).count();
            own > 0 && own < place.observations.len()
        };
        object.places.iter().filter(is_both).count()
    };
    Err(PoseError::NotLinked {
        camera: names[camera].clone(),
        objects: names_of(objects),
        places: objects.iter().map(shared).sum(),
        needed: MIN_MATCHES / 2,
    })
}

/// The cameras in the world's axes that the first camera has if it is held level.
fn in_axes_of_first(mut cameras: Vec<Camera>) -> Vec<Camera> {
    let level = rotation_of(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0));
    let cam_from_new = Isometry3::from_parts(Default::default(), level);
    let old_from_new = cameras[0].cam_from_world.inverse() * cam_from_new;
    cameras.iter_mut().for_each(|c| c.cam_from_world *= old_from_new);
    cameras
}

/// Cameras that saw a board, those that are joined to the first of them by boards that both saw.
fn of_board(board: &Moved, sizes: &[ImageSize]) -> Vec<Option<Camera>> {
    let own = |place: &Instant, camera: usize| -> Vec<PointObservation> {
        place.observations.iter().filter(|o| o.camera == camera).copied().collect()
    };
    let pinhole = |camera: usize| {
        let views: Vec<_> = board.places.iter().map(|p| own(p, camera)).collect();
        pinhole_of_planes(sizes[camera], &board.body, &views)
    };
    let pinholes: Vec<Camera> = (0..sizes.len()).map(pinhole).collect();
    let scene = Scene { cameras: &pinholes, points: &board.body };
    let in_camera = |place, camera| Some(pose_in_view(scene, &own(place, camera))?.world_from_body);
    let mut out: Vec<Option<Camera>> = vec![None; sizes.len()];
    let Some(first) = (0..sizes.len()).find(|c| board.is_seen_by(*c)) else { return out };
    out[first] = Some(pinholes[first]);
    loop {
        // The place with most corners in view of a known and an unknown camera.
        let mut best: Option<(usize, usize, Camera)> = None;
        for place in &board.places {
            for known in 0..sizes.len() {
                let Some(camera) = out[known] else { continue };
                for unknown in (0..sizes.len()).filter(|c| out[*c].is_none()) {
                    let points = own(place, known).len().min(own(place, unknown).len());
                    if best.as_ref().is_some_and(|b| b.0 >= points) {
                        continue;
                    }
                    let (Some(a), Some(b)) = (in_camera(place, known), in_camera(place, unknown)) else {
                        continue;
                    };
                    let cam_from_world = b * a.inverse() * camera.cam_from_world;
                    best = Some((points, unknown, Camera { cam_from_world, ..pinholes[unknown] }));
                }
            }
        }
        let Some((_, unknown, camera)) = best else { return out };
        out[unknown] = Some(camera);
    }
}

/// The pair that saw the wand most often, in several guesses.
fn of_wand(wand: &Moved, sizes: &[ImageSize]) -> Vec<Vec<Option<Camera>>> {
    let all = (0..sizes.len()).flat_map(|a| (a + 1..sizes.len()).map(move |b| (a, b)));
    let Some((a, b)) = all.max_by_key(|pair| seen_by_both(wand, *pair).len()) else { return Vec::new() };
    let guesses = pairs(wand, (a, b), sizes);
    let set = |(one, other): (Camera, Camera)| {
        let mut set = vec![None; sizes.len()];
        (set[a], set[b]) = (Some(one), Some(other));
        set
    };
    guesses.into_iter().take(FOLLOWED).map(set).collect()
}

/// Cameras that see points which the known ones have triangulated.
pub(super) fn add_others(object: &Moved, set: &mut [Option<Camera>], sizes: &[ImageSize]) {
    for camera in 0..sizes.len() {
        if set[camera].is_some() {
            continue;
        }
        let mut points = Vec::new();
        for place in object.places.iter().map(|p| &p.observations) {
            for s in place.iter().filter(|o| o.camera == camera) {
                let same = place.iter().filter(|o| o.point == s.point);
                let ray = |o: &PointObservation| Some(o.with_variance(1.0).in_image(set[o.camera].as_ref()?));
                let found = triangulate(&same.filter_map(ray).collect::<Vec<_>>());
                points.extend(found.map(|found| ControlPoint {
                    name: String::new(),
                    point_in_world_m: found.point_in_world_m,
                    pixel: s.pixel,
                    pixel_cov_px2: Matrix2::identity(),
                }));
            }
        }
        let every = points.len().div_ceil(100).max(1);
        let some: Vec<ControlPoint> = points.into_iter().step_by(every).collect();
        if some.len() >= MIN_POINTS
            && let Ok(found) = starts(&some, sizes[camera])
        {
            let miss = |c: &Camera, p: &ControlPoint| {
                c.project(&p.point_in_world_m).map_or(1e6, |seen| (seen.pixel - p.pixel).norm())
            };
            let error = |c: &Camera| some.iter().map(|p| miss(c, p)).sum::<f64>();
            set[camera] = found.into_iter().min_by(|a, b| error(a).total_cmp(&error(b)));
        }
    }
}
