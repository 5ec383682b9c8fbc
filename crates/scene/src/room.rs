//! The meeting room: 10 × 7 m, with a ceiling of 3.2 m so that a control frame of 3 m stands in it.

use crate::light::Lamp;
use crate::sensor::unit;
use crate::shapes::{Hit, Ray, Shape};
use crate::tree::{Bounds, Tree};
use nalgebra::Vector3;

type V = Vector3<f64>;

const LEFT_M: f64 = -5.0;
const RIGHT_M: f64 = 5.0;
const FRONT_M: f64 = -4.75;
const BACK_M: f64 = 2.25;
const HEIGHT_M: f64 = 3.2;
/// The floor lies below the world's origin, so that a control ball at the origin's height stands free of it.
const FLOOR_M: f64 = -0.06;

#[derive(Debug, Clone, Copy)]
pub(crate) enum Paint {
    Plain([f64; 3]),
    Glow(f64),
    Carpet,
    CeilingTiles,
    Wood,
    Board,
    Poster,
}

pub(crate) struct Item {
    pub shape: Shape,
    pub paint: Paint,
}

/// The furnished room with its lamps.
pub struct Room {
    pub(crate) items: Vec<Item>,
    pub(crate) lamps: Vec<Lamp>,
    tree: Tree,
}

impl Room {
    /// Two desks, four chairs, a cupboard, a board, a bin, a door and a poster under six lamps.
    pub fn meeting_room() -> Self {
        let mut room = Self { items: Vec::new(), lamps: Vec::new(), tree: Tree::default() };
        for x in [-3.4, 0.0, 3.4] {
            for y in [-3.0, 0.4] {
                room.lamp(x, y);
            }
        }
        room.desk(-2.9, 1.75, 0.0);
        room.desk(3.9, -0.2, 90.0);
        room.chair(-3.2, 1.15, 10.0);
        room.chair(-2.5, 1.2, -15.0);
        room.chair(3.2, -0.5, 95.0);
        room.chair(3.25, 0.3, 80.0);
        let wood_dark = [0.045, 0.035, 0.03];
        room.block([-4.72, 0.0, 0.95], [0.5, 1.2, 1.9], 0.0, Paint::Plain(wood_dark));
        room.block([-4.465, 0.0, 0.95], [0.01, 0.015, 1.86], 0.0, Paint::Plain([0.01; 3]));
        room.block([1.2, BACK_M - 0.02, 1.45], [2.4, 0.03, 1.2], 0.0, Paint::Board);
        room.block([1.2, BACK_M - 0.045, 0.83], [2.4, 0.09, 0.03], 0.0, Paint::Plain([0.35; 3]));
        room.block([-1.0, BACK_M - 0.012, 1.6], [0.6, 0.02, 0.85], 0.0, Paint::Poster);
        room.block([4.985, -2.6, 1.03], [0.03, 0.95, 2.06], 0.0, Paint::Plain([0.36, 0.35, 0.33]));
        room.block([4.96, -2.25, 1.0], [0.05, 0.12, 0.03], 0.0, Paint::Plain([0.5; 3]));
        room.block([0.1, 1.95, 0.16], [0.26, 0.26, 0.32], 20.0, Paint::Plain([0.03, 0.035, 0.04]));
        room.block([0.0, BACK_M - 0.01, 0.05], [10.0, 0.02, 0.1], 0.0, Paint::Plain([0.16, 0.15, 0.14]));
        room.block([LEFT_M + 0.01, -1.2, 0.05], [0.02, 7.0, 0.1], 0.0, Paint::Plain([0.16, 0.15, 0.14]));
        room.block([RIGHT_M - 0.01, -1.2, 0.05], [0.02, 7.0, 0.1], 0.0, Paint::Plain([0.16, 0.15, 0.14]));
        room
    }

    /// Adds a ball of a colour in linear light that stands in the room, world axes.
    pub fn add_ball(&mut self, ball: &crate::PaintedBall) {
        let shape = Shape::Ball { centre: ball.centre_m, radius: ball.radius_m };
        self.push(Item { shape, paint: Paint::Plain(ball.linear) });
    }

    /// Adds an upright block of a colour in linear light, its centre in world axes, turned from +X towards
    /// +Y.
    pub fn add_block(&mut self, centre_m: [f64; 3], size_m: [f64; 3], yaw_deg: f64, linear: [f64; 3]) {
        let [x, y, z] = centre_m;
        self.block([x, y, z - FLOOR_M], size_m, yaw_deg, Paint::Plain(linear));
    }

    fn block(&mut self, centre: [f64; 3], size: [f64; 3], yaw_deg: f64, paint: Paint) {
        let [x, y, above_floor_m] = centre;
        let shape = Shape::block([x, y, above_floor_m + FLOOR_M], size, yaw_deg);
        self.push(Item { shape, paint });
    }

    fn push(&mut self, item: Item) {
        self.items.push(item);
        let bounds: Vec<_> = self.items.iter().map(|item| Bounds::of(&item.shape)).collect();
        self.tree = Tree::of(&bounds);
    }

    fn lamp(&mut self, x: f64, y: f64) {
        let radiance = 7.0;
        let size = (1.2, 0.6);
        self.lamps.push(Lamp { centre: V::new(x, y, FLOOR_M + HEIGHT_M - 0.011), size, radiance });
        self.block([x, y, HEIGHT_M], [size.0, size.1, 0.02], 0.0, Paint::Glow(radiance));
        self.block([x, y, HEIGHT_M], [size.0 + 0.06, size.1 + 0.06, 0.012], 0.0, Paint::Plain([0.4; 3]));
    }

    fn desk(&mut self, x: f64, y: f64, yaw_deg: f64) {
        let metal = Paint::Plain([0.22; 3]);
        self.block([x, y, 0.735], [1.5, 0.7, 0.03], yaw_deg, Paint::Wood);
        for (dx, dy) in [(-0.7, -0.3), (-0.7, 0.3), (0.7, -0.3), (0.7, 0.3)] {
            self.block(beside([x, y], [dx, dy, 0.36], yaw_deg), [0.04, 0.04, 0.72], yaw_deg, metal);
        }
        let (screen, papers) = ([-0.3, 0.15, 0.93], [0.35, 0.0, 0.765]);
        let (black, white) = (Paint::Plain([0.02; 3]), Paint::Plain([0.7, 0.69, 0.66]));
        self.block(beside([x, y], screen, yaw_deg), [0.48, 0.03, 0.3], yaw_deg + 8.0, black);
        self.block(beside([x, y], papers, yaw_deg), [0.21, 0.3, 0.03], yaw_deg - 12.0, white);
    }

    fn chair(&mut self, x: f64, y: f64, yaw_deg: f64) {
        let (cloth, metal) = (Paint::Plain([0.025, 0.035, 0.055]), Paint::Plain([0.3; 3]));
        self.block([x, y, 0.45], [0.44, 0.42, 0.05], yaw_deg, cloth);
        self.block(beside([x, y], [0.0, -0.2, 0.72], yaw_deg), [0.42, 0.035, 0.32], yaw_deg, cloth);
        for (dx, dy) in [(-0.19, -0.18), (-0.19, 0.18), (0.19, -0.18), (0.19, 0.18)] {
            self.block(beside([x, y], [dx, dy, 0.22], yaw_deg), [0.025, 0.025, 0.44], yaw_deg, metal);
        }
    }

    /// The first surface along a ray, and its paint's colour there with the light it sends out by itself.
    pub(crate) fn meet(&self, ray: &Ray) -> Option<(Hit, [f64; 3], f64)> {
        self.first(ray, f64::MAX).map(|(hit, paint)| {
            let at = ray.origin + ray.direction * hit.distance_m;
            let glow = if let Paint::Glow(radiance) = paint { radiance } else { 0.0 };
            (hit, color(paint, &(at - V::z() * FLOOR_M)), glow)
        })
    }

    /// Distance along a ray to the first surface, if it is within a limit.
    pub(crate) fn distance_m(&self, ray: &Ray, within_m: f64) -> Option<f64> {
        self.first(ray, within_m).map(|(hit, _)| hit.distance_m)
    }

    fn first(&self, ray: &Ray, within_m: f64) -> Option<(Hit, Paint)> {
        let mut best = shell(ray).filter(|(hit, _)| hit.distance_m <= within_m);
        let mut reach_m = best.map_or(within_m, |b| b.0.distance_m);
        // Of surfaces that coincide the shell's is seen, otherwise the first that was built.
        let mut of = None;
        self.tree.along(ray, reach_m, |k| {
            if let Some(hit) = self.items[k].shape.meet(ray)
                && (hit.distance_m < reach_m || hit.distance_m == reach_m && of.is_some_and(|of| k < of))
            {
                reach_m = hit.distance_m;
                (best, of) = (Some((hit, self.items[k].paint)), Some(k));
            }
            reach_m
        });
        best
    }

    pub(crate) fn hides(&self, from: &V, to: &V) -> bool {
        const END: f64 = f64::NEG_INFINITY;
        let way = to - from;
        let length = way.norm();
        let ray = Ray { origin: *from, direction: way / length };
        let mut is_hidden = false;
        self.tree.along(&ray, length, |k| {
            let item = &self.items[k];
            is_hidden |= !matches!(item.paint, Paint::Glow(_))
                && item.shape.meet(&ray).is_some_and(|hit| hit.distance_m < length - 0.02);
            if is_hidden { END } else { length }
        });
        is_hidden
    }
}

/// The place at a height and an offset, in the axes of a piece of furniture, from its middle.
fn beside([x, y]: [f64; 2], [dx, dy, height]: [f64; 3], yaw_deg: f64) -> [f64; 3] {
    let (s, c) = yaw_deg.to_radians().sin_cos();
    [x + (c * dx - s * dy), y + (s * dx + c * dy), height]
}

/// Walls, floor and ceiling, seen from inside.
fn shell(ray: &Ray) -> Option<(Hit, Paint)> {
    let wall = Paint::Plain([0.60, 0.575, 0.52]);
    let planes = [
        (V::x(), LEFT_M, wall),
        (-V::x(), -RIGHT_M, wall),
        (V::y(), FRONT_M, wall),
        (-V::y(), -BACK_M, wall),
        (V::z(), FLOOR_M, Paint::Carpet),
        (-V::z(), -HEIGHT_M - FLOOR_M, Paint::CeilingTiles),
    ];
    let met = planes.into_iter().filter_map(|(normal, offset, paint)| {
        let towards = normal.dot(&ray.direction);
        let distance_m = (offset - normal.dot(&ray.origin)) / towards;
        (towards < 0.0 && distance_m > 0.0).then_some((Hit { distance_m, normal }, paint))
    });
    met.min_by(|a, b| a.0.distance_m.total_cmp(&b.0.distance_m))
}

/// The paint's colour at a place whose height is counted from the floor.
fn color(paint: Paint, p: &V) -> [f64; 3] {
    match paint {
        Paint::Plain(c) => c,
        Paint::Glow(_) => [0.8; 3],
        Paint::Carpet => {
            let grain = 1.0 + 0.10 * noise(p.x * 90.0, p.y * 90.0) + 0.08 * noise(p.x * 7.0, p.y * 7.0);
            [0.150 * grain, 0.125 * grain, 0.105 * grain]
        }
        Paint::CeilingTiles => {
            let gap = |x: f64| (x / 0.6 - (x / 0.6).round()).abs() * 0.6 < 0.012;
            if gap(p.x) || gap(p.y) { [0.33, 0.32, 0.30] } else { [0.66, 0.63, 0.58] }
        }
        Paint::Wood => {
            let ring = noise(p.x * 3.0 + 0.6 * noise(p.y * 9.0, p.x), p.y * 45.0);
            let k = 1.0 + 0.18 * ring;
            [0.24 * k, 0.12 * k, 0.05 * k]
        }
        Paint::Board => board(p),
        Paint::Poster => poster(p),
    }
}

fn board(p: &V) -> [f64; 3] {
    let (x, z) = (p.x - 1.2, p.z - 1.45);
    if x.abs() > 1.17 || z.abs() > 0.57 {
        return [0.28, 0.28, 0.29];
    }
    let line = (z / 0.13).floor();
    let in_line = (z / 0.13 - line - 0.4).abs() < 0.09;
    let word = unit((x * 22.0).floor().to_bits() ^ line.to_bits().rotate_left(17)) > 0.35;
    if in_line && word && x > -0.95 && x < 0.25 + 0.3 * unit(line.to_bits()) && z.abs() < 0.42 {
        return [0.05, 0.05, 0.07];
    }
    [0.78, 0.78, 0.77]
}

fn poster(p: &V) -> [f64; 3] {
    let (x, z) = (p.x + 1.0, p.z - 1.6);
    if x.abs() > 0.27 || z.abs() > 0.395 {
        return [0.7, 0.69, 0.66];
    }
    let hill = 0.08 * noise(x * 5.0, 3.0) - 0.1;
    if z > hill { [0.30 + 0.2 * z, 0.38 + 0.15 * z, 0.45] } else { [0.16, 0.17, 0.11] }
}

/// Value noise in -1..1.
fn noise(x: f64, y: f64) -> f64 {
    let (ix, iy) = (x.floor(), y.floor());
    let (fx, fy) = (x - ix, y - iy);
    let at = |dx: f64, dy: f64| unit((ix + dx).to_bits() ^ (iy + dy).to_bits().rotate_left(29)) * 2.0 - 1.0;
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (ex, ey) = (ease(fx), ease(fy));
    let low = at(0.0, 0.0) * (1.0 - ex) + at(1.0, 0.0) * ex;
    let high = at(0.0, 1.0) * (1.0 - ex) + at(1.0, 1.0) * ex;
    low * (1.0 - ey) + high * ey
}
