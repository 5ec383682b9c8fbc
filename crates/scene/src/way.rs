//! Occluders between a camera and the aircraft: people, stray light, darkness.

use crate::aircraft::{Aircraft, Part};
use crate::film::Film;
use crate::light::IrradianceMap;
use crate::render::{EXPOSURE, Plate, ray_at, region_of};
use crate::shapes::{Ray, Shape};
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use std::f64::consts::PI;

/// The occluders of one camera at one instant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InTheWay {
    /// People, who stand still over the exposure.
    pub people: Vec<Person>,
    /// Stray light.
    pub veils: Vec<Veil>,
    /// Whether the image is black.
    pub black: bool,
}

/// A person of 1.75 m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Person {
    /// Where, world x and y.
    pub at_m: [f64; 2],
    /// Colour of the clothes in linear light.
    pub linear: [f64; 3],
}

/// A round veil of white light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Veil {
    /// Its middle.
    pub pixel: Vector2<f64>,
    /// Distance at which it is weaker by e^-½.
    pub radius_px: f64,
    /// Light in the middle; 1 fills a pixel.
    pub strength: f64,
}

impl Veil {
    /// Light at a pixel.
    pub fn light(&self, pixel: &Vector2<f64>) -> f64 {
        self.strength * (-0.5 * (pixel - self.pixel).norm_squared() / self.radius_px.powi(2)).exp()
    }
}

impl InTheWay {
    /// Light that all veils put on a pixel.
    pub(crate) fn veil(&self, pixel: &Vector2<f64>) -> f64 {
        self.veils.iter().map(|v| v.light(pixel)).sum()
    }

    fn parts(&self) -> Vec<Part> {
        let capsule = |[x, y]: [f64; 2], from: f64, to: f64, radius: f64| Shape::Capsule {
            from: Vector3::new(x, y, from),
            to: Vector3::new(x, y, to),
            radius,
        };
        let skin = [0.45, 0.25, 0.17];
        self.people
            .iter()
            .flat_map(|p| {
                let clothes = |shape| Part::new(shape, p.linear, 0.0, 0.0);
                let head = Shape::Ball { centre: Vector3::new(p.at_m[0], p.at_m[1], 1.58), radius: 0.11 };
                [
                    clothes(capsule(p.at_m, 0.1, 0.75, 0.14)),
                    clothes(capsule(p.at_m, 0.9, 1.25, 0.22)),
                    Part::new(head, skin, 0.0, 0.0),
                ]
            })
            .collect()
    }
}

impl Film<'_> {
    /// The room's plate with people in it; none without people in view.
    pub(crate) fn peopled(&self, way: &InTheWay) -> Option<Plate> {
        let parts = way.parts();
        let region = region_of(&parts, &[Isometry3::identity()], &self.camera, 2.0)?;
        let light: Vec<IrradianceMap> =
            parts.iter().map(|p| IrradianceMap::at(&p.bound.0, &self.room.lamps)).collect();
        let mut plate = self.plate.clone();
        for y in region.y.0..region.y.1 {
            for x in region.x.0..region.x.1 {
                let k = y * self.camera.size.width_px as usize + x;
                let (behind, wall_m) = (plate.light[k], f64::from(plate.distance_m[k]));
                let (mut sum, mut near_m) = ([0.0_f32; 3], None);
                for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    let ray = ray_at(&self.camera, x as f64 + dx, y as f64 + dy);
                    let hit =
                        ray.and_then(|ray| first(&parts, &ray)).filter(|(_, hit)| hit.distance_m < wall_m);
                    let seen = hit.map_or(behind, |(part, hit)| {
                        near_m = Some(hit.distance_m as f32);
                        let irradiance = light[part].of(&hit.normal);
                        parts[part].linear.map(|c| (c * irradiance / PI * EXPOSURE) as f32)
                    });
                    (0..3).for_each(|c| sum[c] += 0.25 * seen[c]);
                }
                plate.light[k] = sum;
                plate.distance_m[k] = near_m.unwrap_or(plate.distance_m[k]);
            }
        }
        Some(plate)
    }

    /// Share of a ball's face that this camera sees: neither outside the image nor behind the room, people or
    /// another part of the aircraft, nor under a veil that fills more than two fifths of a pixel, beyond
    /// which no colour is left.
    pub fn visible_share(
        &self,
        (ball_in_body_m, radius_m): (&Vector3<f64>, f64),
        aircraft: &Aircraft,
        world_from_body: &Isometry3<f64>,
        way: &InTheWay,
    ) -> f64 {
        let centre = (world_from_body * Point3::from(*ball_in_body_m)).coords;
        let camera: &Camera = &self.camera;
        let Ok(seen) = camera.project_ball(&centre, radius_m) else { return 0.0 };
        if way.black || !camera.size.contains(&seen.pixel, 0.0) || way.veil(&seen.pixel) > 0.4 {
            return 0.0;
        }
        let from = camera.centre_in_world();
        let people = way.parts();
        let into_body = world_from_body.inverse();
        let view = (centre - from).normalize();
        let side = view.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
        let up = side.cross(&view);
        let clear = |k: &usize| {
            // Points of a disc by the golden angle.
            let (r, angle) =
                (((*k as f64 + 0.5) / RAYS as f64).sqrt() * 0.95 * radius_m, *k as f64 * 2.399_963);
            let aim = centre + side * (r * angle.cos()) + up * (r * angle.sin());
            let direction = (aim - from).normalize();
            let ray = Ray { origin: from, direction };
            let ball = Shape::Ball { centre, radius: radius_m };
            let Some(own) = ball.meet(&ray) else { return false };
            let reach_m = own.distance_m - 1e-3;
            let turned = Ray {
                origin: (into_body * Point3::from(from)).coords,
                direction: into_body.rotation * direction,
            };
            let is_self =
                |p: &Part| matches!(p.shape, Shape::Ball { centre, .. } if centre == *ball_in_body_m);
            let hull = aircraft.parts.iter().filter(|p| p.passes < 0.5 && !is_self(p));
            first(&people, &ray).is_none_or(|(_, hit)| hit.distance_m > reach_m)
                && hull.filter_map(|p| p.shape.meet(&turned)).all(|hit| hit.distance_m > reach_m)
                && !self.room.hides(&from, &(from + direction * reach_m))
        };
        (0..RAYS).filter(clear).count() as f64 / RAYS as f64
    }
}

/// Rays to a ball's face.
const RAYS: usize = 48;

fn first(parts: &[Part], ray: &Ray) -> Option<(usize, crate::shapes::Hit)> {
    let hits = parts.iter().enumerate().filter_map(|(k, p)| Some((k, p.shape.meet(ray)?)));
    hits.min_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PaintedBall, Room, Sensor};
    use mavsight_geometry::{ImageSize, Intrinsics};

    /// A person half way hides a ball, leaves the ball beside alone, and is as dark as their clothes.
    #[test]
    fn a_person_hides_what_is_behind() {
        let size = ImageSize { width_px: 96, height_px: 72 };
        let k = Intrinsics::from_horizontal_fov(size, 0.9);
        let camera = Camera::looking_at(Vector3::new(0.0, -4.5, 1.2), Vector3::new(0.0, 0.0, 1.2), k, size);
        let balls = [-0.6, 0.0].map(|x| PaintedBall {
            centre_m: Vector3::new(x, 0.0, 0.0),
            radius_m: 0.1,
            linear: [0.7, 0.0, 0.0],
        });
        let (room, aircraft) = (Room::meeting_room(), Aircraft::helicopter(&balls));
        let film = Film::new(&room, camera, Sensor { noise: false, ..Sensor::default() });
        let pose = Isometry3::translation(0.0, 0.0, 1.2);
        let person = Person { at_m: [0.0, -2.2], linear: [0.01; 3] };
        let way = InTheWay { people: vec![person], ..InTheWay::default() };
        let share = |ball: usize, way: &InTheWay| {
            film.visible_share((&balls[ball].centre_m, 0.1), &aircraft, &pose, way)
        };
        assert!(share(0, &way) > 0.9 && share(1, &way) == 0.0, "{} {}", share(0, &way), share(1, &way));
        let red = |way: &InTheWay| {
            let frame = film.frame_with(0, &aircraft, |_| pose, way);
            let at = |u: f64, v: f64| usize::from(frame[3 * (v.round() as usize * 96 + u.round() as usize)]);
            [0, 1].map(|ball| {
                let seen =
                    camera.project(&(balls[ball].centre_m + Vector3::new(0.0, 0.0, 1.2))).unwrap().pixel;
                at(seen.x, seen.y)
            })
        };
        let (with, without) = (red(&way), red(&InTheWay::default()));
        assert!(with[0].abs_diff(without[0]) < 3 && with[1] < 60 && without[1] > 120, "{with:?} {without:?}");
        let black = InTheWay { black: true, ..InTheWay::default() };
        assert!(red(&black) == [0, 0] && share(0, &black) == 0.0);
        let seen = camera.project(&Vector3::new(0.0, 0.0, 1.2)).unwrap().pixel;
        let veil = Veil { pixel: seen, radius_px: 8.0, strength: 1.5 };
        let glare = InTheWay { veils: vec![veil], ..InTheWay::default() };
        assert!(red(&glare)[1] == 255 && share(1, &glare) == 0.0 && share(0, &glare) > 0.5);
    }
}
