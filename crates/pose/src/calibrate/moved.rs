//! Objects of known shape that were moved in view of the cameras: a wand, a board.

use crate::moving::{Instant, Shared};
use crate::reprojection::{PointObservation, Scene};
use crate::three_points::pose_in_view;
use crate::{BodyMarker, MarkerObservation, PoseError};
use mavsight_geometry::{Camera, Isometry3, UnitQuaternion, Vector3, rigid_fit, triangulate};
use nalgebra::Translation3;

/// An object of known shape, observed at many places.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedObject {
    /// Name in messages.
    pub name: String,
    /// Points of the object, in axes of its own.
    pub points: Vec<BodyMarker>,
    /// Standard deviation of its size, relative to that of the points; 0 for exact.
    pub scale_std: f64,
    /// Observations of its points; those of one time belong to one place of the object.
    pub observations: Vec<MarkerObservation>,
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
        Self { name: "wand".to_owned(), points, scale_std: length_std_m / length_m, observations }
    }

    /// The inner corners of a chessboard, row by row in the plane z = 0: x along a row, y from row to row.
    pub fn board(columns: usize, rows: usize, square_m: f64, observations: Vec<MarkerObservation>) -> Self {
        let corner = |k: usize| BodyMarker {
            name: format!("corner {} {}", k % columns + 1, k / columns + 1),
            marker_in_body_m: Vector3::new((k % columns) as f64, (k / columns) as f64, 0.0) * square_m,
            radius_m: 0.0,
        };
        let points = (0..columns * rows).map(corner).collect();
        Self { name: "board".to_owned(), points, scale_std: 0.0, observations }
    }
}

/// Places of an object that enter, spread over all: a hundred reduce noise below the systematic errors.
const MOST_PLACES: usize = 100;

/// A moved object as the adjustment has it.
#[derive(Clone)]
pub(super) struct Moved {
    pub(super) name: String,
    pub(super) body: Vec<BodyMarker>,
    pub(super) scale_std: f64,
    /// With approximate poses, once cameras are known.
    pub(super) places: Vec<Instant>,
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
        let mut order: Vec<&MarkerObservation> = object.observations.iter().collect();
        order.sort_by_key(|o| o.t_ns);
        let place = |seen: &[&MarkerObservation]| {
            let own = seen.iter().map(|o| PointObservation::of(o, cameras, object.points.len()));
            let world_from_body = Isometry3::identity();
            Ok(Instant { observations: own.collect::<Result<_, _>>()?, world_from_body })
        };
        let places = order.chunk_by(|a, b| a.t_ns == b.t_ns).map(place).collect::<Result<_, PoseError>>()?;
        let (name, body) = (object.name.clone(), object.points.clone());
        Ok(Self { name, body, scale_std: object.scale_std, places })
    }

    pub(super) fn is_seen_by(&self, camera: usize) -> bool {
        self.places.iter().flat_map(|p| &p.observations).any(|o| o.camera == camera)
    }

    pub(super) fn is_line(&self) -> bool {
        let first = self.body[0].marker_in_body_m;
        let along = (self.body[1].marker_in_body_m - first).normalize();
        self.body.iter().all(|p| (p.marker_in_body_m - first).cross(&along).norm() < 1e-9)
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
        out.free_points = self.scale_std > 0.0;
        out
    }

    /// The object at the places that these cameras determine with redundancy, thinned out.
    pub(super) fn placed(&self, cameras: &[Camera]) -> Self {
        let shared = self.shared(cameras, 1.0);
        let every = self.places.len().div_ceil(MOST_PLACES).max(1);
        let place = |Instant { observations, .. }: &Instant| {
            let near = self.approximate_pose(observations, cameras)?;
            let world_from_body = shared.best_pose(observations, &near, f64::INFINITY)?;
            Some(Instant { observations: observations.clone(), world_from_body })
        };
        let is_redundant = |p: &&Instant| 2 * p.observations.len() > self.pose_parameters();
        let places = self.places.iter().step_by(every).filter(is_redundant).filter_map(place).collect();
        Self { places, ..self.clone() }
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
