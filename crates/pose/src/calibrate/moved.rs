//! Objects of known shape that were moved in view of the cameras: a wand, a board.

use super::layout::State;
use super::rig::ImagesUsed;
use crate::moving::{Instant, Shared};
use crate::reprojection::{PointObservation, Scene};
use crate::three_points::pose_in_view;
use crate::{BodyMarker, MarkerObservation, PoseError};
use mavsight_geometry::{
    Camera, Isometry3, Matrix2, UnitQuaternion, Vector2, Vector3, rigid_fit, triangulate,
};
use nalgebra::Translation3;
use std::collections::BTreeMap;

/// An object of known shape, observed at many places.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedObject {
    /// Name in messages.
    pub name: String,
    /// Points of the object, in axes of its own.
    pub points: Vec<BodyMarker>,
    /// Standard deviation of its size, relative to that of the points; 0 for exact.
    pub scale_std: f64,
    /// What is not exact of its points and their images; all zero for exact.
    pub doubt: ObjectDoubt,
    /// Observations of its points; those of one time belong to one place of the object.
    pub observations: Vec<MarkerObservation>,
    /// Where cameras are not in step: what the observations of one time then have in common.
    pub lags: Option<ObjectLags>,
    /// Images that were looked at, for what is said of their use.
    pub images: Vec<ObjectImages>,
}

/// Images of one camera in which an object was looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObjectImages {
    /// Index of the camera.
    pub camera: usize,
    /// All of them.
    pub images: usize,
    /// Those that do not show it.
    pub unseen: usize,
    /// How late their time stamps were, which is taken off: by the motion of the object.
    pub late_ns: i64,
}

/// Errors of an object's points and images that all its places share, with which it is adjusted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ObjectDoubt {
    /// Standard deviation of each coordinate of each point.
    pub points_std_m: f64,
    /// Standard deviation of a constant error of each point's image in each camera.
    pub centres_std_px: f64,
}

/// Frames of one time that were not taken at one time, while the object moved.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectLags {
    /// Standard deviation of each camera's lag behind a common clock, of each time by itself.
    pub std_s: f64,
    /// Velocity of the image of each observation, in the order of [`MovedObject::observations`].
    pub velocities_px_s: Vec<Vector2<f64>>,
}

impl MovedObject {
    /// Two balls on a stick with the distance of their centres, its standard deviation, and their names and
    /// diameters.
    pub fn wand(
        length_m: f64,
        length_std_m: f64,
        balls: [(&str, f64); 2],
        observations: Vec<MarkerObservation>,
    ) -> Self {
        let ball = |(name, diameter_m): (&str, f64), side: f64| BodyMarker {
            name: name.to_owned(),
            marker_in_body_m: Vector3::new(0.5 * side * length_m, 0.0, 0.0),
            radius_m: 0.5 * diameter_m,
        };
        let points = vec![ball(balls[0], -1.0), ball(balls[1], 1.0)];
        Self {
            name: "wand".to_owned(),
            points,
            scale_std: length_std_m / length_m,
            doubt: ObjectDoubt::default(),
            observations,
            lags: None,
            images: Vec::new(),
        }
    }

    /// The inner corners of a chessboard, row by row in the plane z = 0: x along a row, y from row to row.
    pub fn board(columns: usize, rows: usize, square_m: f64, observations: Vec<MarkerObservation>) -> Self {
        let corner = |k: usize| BodyMarker {
            name: format!("corner {} {}", k % columns + 1, k / columns + 1),
            marker_in_body_m: Vector3::new((k % columns) as f64, (k / columns) as f64, 0.0) * square_m,
            radius_m: 0.0,
        };
        let points = (0..columns * rows).map(corner).collect();
        let width_m = columns.max(rows) as f64 * square_m;
        Self {
            name: "board".to_owned(),
            points,
            scale_std: 0.0,
            doubt: ObjectDoubt { points_std_m: BOARD_STD * width_m, ..ObjectDoubt::default() },
            observations,
            lags: None,
            images: Vec::new(),
        }
    }
}

/// Standard deviation of a board's corners, in each direction, as a part of its longer side: a sheet on cardboard bows by a
/// millimetre in a metre. With it the corners' places are estimated too (Lavest, Viala & Dhome 1998; Strobl & Hirzinger 2011).
const BOARD_STD: f64 = 1e-3;

/// Places of an object that enter, spread over all: a hundred reduce noise below the systematic errors.
const MOST_PLACES: usize = 100;
/// Views whose middles lie in one of so many squares across the image are in one part of it: a lens changes little within.
const CELLS: f64 = 4.0;

/// A moved object as the adjustment has it.
#[derive(Clone)]
pub(super) struct Moved {
    pub(super) name: String,
    pub(super) body: Vec<BodyMarker>,
    pub(super) scale_std: f64,
    pub(super) doubt: ObjectDoubt,
    /// Standard deviation of a camera's lag at a place; 0 for cameras in step.
    pub(super) lag_std_s: f64,
    /// Views of each camera when the places were chosen.
    placed_views: Vec<usize>,
    /// With approximate poses, once cameras are known.
    pub(super) places: Vec<Instant>,
}

/// What makes views alike: the cameras that see the object and, of the one that sees most of it, where in the image,
/// how large and how tilted.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    seen_by: u64,
    cell: (i64, i64),
    octave: i64,
    tilt: [i64; 4],
}

impl Kind {
    /// `None` for fewer than four points in the camera that sees most.
    fn of(seen: &[PointObservation], body: &[BodyMarker], cameras: &[Camera]) -> Option<Self> {
        let seen_by = seen.iter().fold(0, |all, o| all | 1 << o.camera.min(63));
        let count = |camera: usize| seen.iter().filter(|o| o.camera == camera).count();
        let best = seen.iter().map(|o| o.camera).max_by_key(|c| count(*c))?;
        let own: Vec<&PointObservation> = seen.iter().filter(|o| o.camera == best).collect();
        let n = own.len() as f64;
        let mean = own.iter().map(|o| o.pixel).sum::<Vector2<f64>>() / n;
        let place = |o: &PointObservation| body[o.point].marker_in_body_m;
        let middle = own.iter().map(|o| place(o)).sum::<Vector3<f64>>() / n;
        // The affine part of the view: pixels by places on the plane.
        let (mut spread, mut moved) = (Matrix2::zeros(), Matrix2::zeros());
        for o in &own {
            let at = (place(o) - middle).xy();
            spread += at * at.transpose();
            moved += (o.pixel - mean) * at.transpose();
        }
        let affine: Matrix2<f64> = moved * spread.try_inverse()?;
        let size_px_m = affine.determinant().abs().sqrt();
        // A tilt by 35° shortens one way by a fifth.
        let shape = affine * affine.transpose() / (size_px_m * size_px_m);
        let tilt = [shape[(0, 0)], shape[(0, 1)], shape[(1, 1)], affine[(0, 0)] / size_px_m];
        let part = |x: f64, of: f64| (x / of).floor() as i64;
        let cell_px = f64::from(cameras.get(best)?.size.width_px) / CELLS;
        let is_finite = n >= 4.0 && size_px_m > 0.0 && tilt.iter().all(|t| t.is_finite());
        is_finite.then(|| Self {
            seen_by,
            cell: (part(mean.x, cell_px), part(mean.y, cell_px)),
            octave: part(size_px_m.log2(), 1.0),
            tilt: tilt.map(|t| part(t, 0.5)),
        })
    }
}

pub(super) fn names_of(objects: &[Moved]) -> String {
    objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>().join(" and ")
}

impl Moved {
    /// Refuses cameras and points that do not exist, numbers that are not finite, points that make no shape.
    pub(super) fn new(object: &MovedObject, cameras: usize) -> Result<Self, PoseError> {
        let bad = |detail| PoseError::BadObject { object: object.name.clone(), detail };
        let numbers = object.points.iter().flat_map(|p| p.marker_in_body_m.iter().chain([&p.radius_m]));
        if !numbers.chain([&object.scale_std]).all(|x| x.is_finite()) || object.scale_std < 0.0 {
            return Err(bad("its points, radii or the standard deviation of its size are not finite"));
        }
        let place = |k: usize| object.points[k].marker_in_body_m;
        let is_double = |k: usize| (0..k).any(|other| place(other) == place(k));
        if object.points.len() < 2 || (0..object.points.len()).any(is_double) {
            return Err(bad(
                "it needs two points or more, each at its own place: check its length or its squares",
            ));
        }
        let ObjectDoubt { points_std_m, centres_std_px } = object.doubt;
        if ![points_std_m, centres_std_px].iter().all(|std| (0.0..1e9).contains(std)) {
            return Err(bad("the standard deviations of its points or centres are not finite"));
        }
        let lag_std_s = object.lags.as_ref().map_or(0.0, |lags| lags.std_s);
        let velocities_px_s = object.lags.as_ref().map_or(&[][..], |lags| &lags.velocities_px_s);
        let is_whole = object.lags.is_none() || velocities_px_s.len() == object.observations.len();
        if !is_whole
            || !(0.0..1e9).contains(&lag_std_s)
            || velocities_px_s.iter().flatten().any(|v| !v.is_finite())
        {
            return Err(bad(
                "the lags of its cameras need a standard deviation, and a velocity for each observation",
            ));
        }
        let mut order: Vec<(usize, &MarkerObservation)> = object.observations.iter().enumerate().collect();
        order.sort_by_key(|(_, o)| o.t_ns);
        let observation = |(k, o): &(usize, &MarkerObservation)| {
            let seen = PointObservation::of(o, cameras, object.points.len())?;
            let velocity_px_s = velocities_px_s.get(*k).copied().unwrap_or_else(Vector2::zeros);
            Ok(PointObservation { velocity_px_s, ..seen })
        };
        let place = |seen: &[(usize, &MarkerObservation)]| {
            let world_from_body = Isometry3::identity();
            let observations = seen.iter().map(observation).collect::<Result<_, PoseError>>()?;
            Ok(Instant { observations, world_from_body })
        };
        let places = order.chunk_by(|a, b| a.1.t_ns == b.1.t_ns).map(place);
        let places = places.collect::<Result<_, PoseError>>()?;
        let (name, body) = (object.name.clone(), object.points.clone());
        Ok(Self {
            name,
            body,
            scale_std: object.scale_std,
            doubt: object.doubt,
            lag_std_s,
            placed_views: Vec::new(),
            places,
        })
    }

    /// What became of the images that were looked at.
    pub(super) fn images<'a>(
        &'a self,
        object: &'a MovedObject,
        names: &'a [String],
    ) -> impl Iterator<Item = ImagesUsed> + 'a {
        object.images.iter().map(|&ObjectImages { camera, images, unseen, late_ns }| {
            let used = self.views(camera);
            let placed = self.placed_views.get(camera).copied().unwrap_or(0);
            ImagesUsed {
                camera: names[camera].clone(),
                object: self.name.clone(),
                images,
                used,
                unseen,
                late_ns,
                spare: (images - unseen.min(images)).saturating_sub(placed),
                contradicting: placed.saturating_sub(used),
            }
        })
    }

    /// Places at which a camera sees it.
    fn views(&self, camera: usize) -> usize {
        self.places.iter().filter(|p| p.observations.iter().any(|o| o.camera == camera)).count()
    }

    pub(super) fn is_seen_by(&self, camera: usize) -> bool {
        self.places.iter().flat_map(|p| &p.observations).any(|o| o.camera == camera)
    }

    pub(super) fn is_line(&self) -> bool {
        let first = self.body[0].marker_in_body_m;
        let along = (self.body[1].marker_in_body_m - first).normalize();
        self.body.iter().all(|p| (p.marker_in_body_m - first).cross(&along).norm() < 1e-9)
    }

    /// Whether it neither lies on a line nor on the plane z = 0, as a wand and a board do.
    pub(super) fn is_free(&self) -> bool {
        !self.is_line() && !self.is_board()
    }

    /// Whether they lie on the plane z = 0, four or more of them and not on a line.
    pub(super) fn is_board(&self) -> bool {
        self.body.len() >= 4 && self.body.iter().all(|p| p.marker_in_body_m.z == 0.0) && !self.is_line()
    }

    /// Parameters of a pose that its points determine.
    pub(super) fn pose_parameters(&self) -> usize {
        if self.is_line() { 5 } else { 6 }
    }

    /// The object at a size, in view of cameras.
    pub(super) fn shared(&self, cameras: &[Camera], scale: f64) -> Shared {
        let mut body = self.body.clone();
        body.iter_mut().for_each(|p| p.marker_in_body_m *= scale);
        let mut out = Shared::new(cameras.to_vec(), body);
        out.free_points = self.scale_std > 0.0 || self.doubt.points_std_m > 0.0;
        out.free_offsets = self.doubt.centres_std_px > 0.0;
        out.free_lags = self.lag_std_s > 0.0;
        out
    }

    /// The object as an adjustment has it.
    pub(super) fn adjusted(&self, state: &State, k: usize) -> Shared {
        let mut out = self.shared(&state.cameras, state.scales[k]);
        out.points.iter_mut().zip(&state.shapes_m[k]).for_each(|(p, change)| p.marker_in_body_m += change);
        out.offsets_px.clone_from(&state.offsets_px[k]);
        out
    }

    /// The object at the places that these cameras determine with redundancy, thinned out.
    pub(super) fn placed(&self, cameras: &[Camera]) -> Self {
        let shared = self.shared(cameras, 1.0);
        let chosen = self.chosen(cameras);
        let place = |Instant { observations, .. }: &Instant| {
            let near = self.approximate_pose(observations, cameras)?;
            let world_from_body = shared.best_pose(observations, &near, f64::INFINITY)?;
            Some(Instant { observations: observations.clone(), world_from_body })
        };
        let is_redundant = |p: &&Instant| 2 * p.observations.len() > self.pose_parameters();
        let places =
            chosen.into_iter().map(|k| &self.places[k]).filter(is_redundant).filter_map(place).collect();
        let mut out = Self { places, ..self.clone() };
        out.placed_views = (0..cameras.len()).map(|camera| out.views(camera)).collect();
        out
    }

    /// The places that enter, in their order. Of a board those that are sharpest, by turns from all parts of the
    /// images, tilts and sizes that there are; of other objects every so many.
    fn chosen(&self, cameras: &[Camera]) -> Vec<usize> {
        let n = self.places.len();
        if n <= MOST_PLACES || !self.is_board() {
            return (0..n).step_by(n.div_ceil(MOST_PLACES).max(1)).collect();
        }
        let mut kinds: BTreeMap<Kind, Vec<(f64, usize)>> = BTreeMap::new();
        for (k, place) in self.places.iter().enumerate() {
            let information = place.observations.iter().map(|o| 1.0 / o.covariance_px2.trace()).sum();
            if let Some(kind) = Kind::of(&place.observations, &self.body, cameras) {
                kinds.entry(kind).or_default().push((information, k));
            }
        }
        kinds.values_mut().for_each(|own| own.sort_by(|a, b| b.0.total_cmp(&a.0)));
        let most = kinds.values().map(Vec::len).max().unwrap_or(0);
        let by_turns = (0..most).flat_map(|turn| kinds.values().filter_map(move |own| own.get(turn)));
        let mut out: Vec<usize> = by_turns.map(|(_, k)| *k).take(MOST_PLACES).collect();
        out.sort_unstable();
        out
    }

    fn approximate_pose(&self, place: &[PointObservation], cameras: &[Camera]) -> Option<Isometry3<f64>> {
        let pair = |p: usize| {
            let own = place.iter().filter(|o| o.point == p).map(|o| o.in_image(&cameras[o.camera]));
            let found = triangulate(&own.collect::<Vec<_>>()).ok()?;
            Some((self.body[p].marker_in_body_m, found.point_in_world_m))
        };
        let pairs: Vec<_> = (0..self.body.len()).filter_map(pair).collect();
        if self.is_line() {
            let ([first, .., last], n) = (pairs.as_slice(), pairs.len() as f64) else { return None };
            let turn = UnitQuaternion::rotation_between(&(last.0 - first.0), &(last.1 - first.1));
            // Any half turn will do where the line is seen reversed.
            let turn = turn
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
            let at: Vector3<f64> = pairs.iter().map(|(body, world)| world - turn * body).sum();
            return Some(Isometry3::from_parts(Translation3::from(at / n), turn));
        }
        if let Ok(pose) = rigid_fit(pairs) {
            return Some(pose);
        }
        let seen_by = |camera: usize| place.iter().filter(|o| o.camera == camera).count();
        let best = (0..cameras.len()).max_by_key(|c| seen_by(*c))?;
        let own: Vec<PointObservation> = place.iter().filter(|o| o.camera == best).copied().collect();
        Some(pose_in_view(Scene { cameras, points: &self.body }, &own)?.world_from_body)
    }
}
