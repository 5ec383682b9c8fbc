//! Occluders between a camera and the aircraft: people, stray light, darkness.

use crate::aircraft::Part;
use crate::light::{IrradianceMap, Lamp};
use crate::render::{EXPOSURE, Plate, ray_at, region_of};
use crate::shapes::{Hit, Ray, Shape};
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Vector2, Vector3};
use std::f64::consts::PI;

/// The occluders of one camera at one instant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Occluders {
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
    /// Position, world x and y.
    pub at_m: [f64; 2],
    /// Colour of the clothes in linear light.
    pub linear: [f64; 3],
}

/// A round veil of white light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Veil {
    /// Middle of the veil.
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

impl Occluders {
    /// Light that all veils put on a pixel.
    pub(crate) fn veil(&self, pixel: &Vector2<f64>) -> f64 {
        self.veils.iter().map(|v| v.light(pixel)).sum()
    }

    pub(crate) fn parts(&self) -> Vec<Part> {
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

    /// A room's plate with the people in it; none without people in view.
    pub(crate) fn over(&self, plate: &Plate, camera: &Camera, lamps: &[Lamp]) -> Option<Plate> {
        let parts = self.parts();
        let region = region_of(&parts, &[Isometry3::identity()], camera, 2.0)?;
        let light: Vec<IrradianceMap> = parts.iter().map(|p| IrradianceMap::at(&p.bound.0, lamps)).collect();
        let mut plate = plate.clone();
        for y in region.y.0..region.y.1 {
            for x in region.x.0..region.x.1 {
                let k = y * camera.size.width_px as usize + x;
                let (background, wall_m) = (plate.light[k], f64::from(plate.distance_m[k]));
                let (mut sum, mut near_m) = ([0.0_f32; 3], None);
                for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    let ray = ray_at(camera, x as f64 + dx, y as f64 + dy);
                    let hit = ray
                        .and_then(|ray| first_hit(&parts, &ray))
                        .filter(|(_, hit)| hit.distance_m < wall_m);
                    let seen = hit.map_or(background, |(part, hit)| {
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
}

/// The first hit of a ray, with the index of its part.
pub(crate) fn first_hit(parts: &[Part], ray: &Ray) -> Option<(usize, Hit)> {
    let hits = parts.iter().enumerate().filter_map(|(k, p)| Some((k, p.shape.meet(ray)?)));
    hits.min_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m))
}
