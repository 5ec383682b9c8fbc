//! Visibility of a ball in a camera.

use crate::aircraft::{Aircraft, Part};
use crate::film::Film;
use crate::occluders::{Occluders, first_hit};
use crate::shapes::{Ray, Shape};
use nalgebra::{Isometry3, Point3, Vector3};

const RAYS: usize = 48;

impl Film<'_> {
    /// Share of a ball's face that this camera sees: neither outside the image nor behind the room, people or
    /// another part of the aircraft, nor under a veil that fills more than two fifths of a pixel, beyond
    /// which no colour is left.
    pub fn visible_share(
        &self,
        ball_in_body_m: &Vector3<f64>,
        radius_m: f64,
        aircraft: &Aircraft,
        world_from_body: &Isometry3<f64>,
        occluders: &Occluders,
    ) -> f64 {
        let centre = (world_from_body * Point3::from(*ball_in_body_m)).coords;
        let camera = &self.camera;
        let Ok(seen) = camera.project_ball(&centre, radius_m) else { return 0.0 };
        if occluders.black || !camera.size.contains(&seen.pixel, 0.0) || occluders.veil(&seen.pixel) > 0.4 {
            return 0.0;
        }
        let from = camera.centre_in_world();
        let people = occluders.parts();
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
            first_hit(&people, &ray).is_none_or(|(_, hit)| hit.distance_m > reach_m)
                && hull.filter_map(|p| p.shape.meet(&turned)).all(|hit| hit.distance_m > reach_m)
                && !self.room.hides(&from, &(from + direction * reach_m))
        };
        (0..RAYS).filter(clear).count() as f64 / RAYS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PaintedBall, Person, Room, Sensor, Veil};
    use mavsight_geometry::{Camera, ImageSize, Intrinsics};

    /// The helicopter was drawn whatever flew, and its hull hid the balls of others.
    #[test]
    fn a_hub_with_arms_hides_little_of_the_balls_that_it_carries() {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 0.9);
        let camera = Camera::looking_at(Vector3::new(1.2, -4.2, 1.6), Vector3::new(0.0, 0.0, 1.2), k, size);
        let balls = [[0.2, 0.0], [0.0, 0.2], [-0.2, 0.0], [0.0, -0.2]].map(|[x, y]| PaintedBall {
            centre_m: Vector3::new(x, y, 0.0),
            radius_m: 0.015,
            linear: [0.7, 0.0, 0.0],
        });
        let room = Room::meeting_room();
        let film = Film::new(&room, camera, Sensor { noise: false, ..Sensor::default() });
        let pose = Isometry3::translation(0.0, 0.0, 1.2);
        let least = |aircraft: &Aircraft| {
            let share = |b: &PaintedBall| {
                film.visible_share(&b.centre_m, b.radius_m, aircraft, &pose, &Occluders::default())
            };
            balls.iter().map(share).fold(1.0, f64::min)
        };
        let (arms, hull) = (least(&Aircraft::hub_with_arms(&balls)), least(&Aircraft::helicopter(&balls)));
        assert!(arms > 0.8 && hull < 0.5, "{arms} with arms, {hull} before the hull");
    }

    /// A person half way hides a ball and not the one next to it, and is as dark as their clothes.
    #[test]
    fn a_person_hides_the_ball_behind() {
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
        let way = Occluders { people: vec![person], ..Occluders::default() };
        let share = |ball: usize, way: &Occluders| {
            film.visible_share(&balls[ball].centre_m, 0.1, &aircraft, &pose, way)
        };
        assert!(share(0, &way) > 0.9 && share(1, &way) == 0.0, "{} {}", share(0, &way), share(1, &way));
        let red = |way: &Occluders| {
            let frame = film.frame_with(0, &aircraft, |_| pose, way);
            let at = |u: f64, v: f64| usize::from(frame[3 * (v.round() as usize * 96 + u.round() as usize)]);
            [0, 1].map(|ball| {
                let seen =
                    camera.project(&(balls[ball].centre_m + Vector3::new(0.0, 0.0, 1.2))).unwrap().pixel;
                at(seen.x, seen.y)
            })
        };
        let (with, without) = (red(&way), red(&Occluders::default()));
        assert!(with[0].abs_diff(without[0]) < 3 && with[1] < 60 && without[1] > 120, "{with:?} {without:?}");
        let black = Occluders { black: true, ..Occluders::default() };
        assert!(red(&black) == [0, 0] && share(0, &black) == 0.0);
        let seen = camera.project(&Vector3::new(0.0, 0.0, 1.2)).unwrap().pixel;
        let veil = Veil { pixel: seen, radius_px: 8.0, strength: 1.5 };
        let glare = Occluders { veils: vec![veil], ..Occluders::default() };
        assert!(red(&glare)[1] == 255 && share(1, &glare) == 0.0 && share(0, &glare) > 0.5);
    }
}
