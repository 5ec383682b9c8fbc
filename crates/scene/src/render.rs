//! Rays through pixels: the room once, and moving parts over it.

use crate::aircraft::Part;
use crate::light::{IrradianceMap, ambient_irradiance};
use crate::outline::Outline;
use crate::room::Room;
use crate::sensor::{mix, unit};
use crate::shapes::{Footprint, Hit, Ray, Shape};
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixel value per unit of light: a white surface under the lamps is just below full well.
pub(crate) const EXPOSURE: f64 = 0.85;
const ROOM_SAMPLES: u32 = 3;
/// Samples across a pixel of what moves, each way; their 64 rows and columns are all different, so that an
/// edge along an axis is met in 64 steps too. Balls cover a sample's cell in part, so that a disc's centroid
/// is true to a ten-thousandth of a pixel.
pub(crate) const PART_SAMPLES: usize = 8;

/// A rendered room: linear light of each pixel, and the distance along its middle ray.
#[derive(Clone)]
pub(crate) struct Plate {
    pub light: Vec<[f32; 3]>,
    pub distance_m: Vec<f32>,
}

pub(crate) fn ray_at(camera: &Camera, u: f64, v: f64) -> Option<Ray> {
    let direction = camera.ray(&Vector2::new(u, v)).ok()?;
    Some(Ray { origin: camera.centre_in_world(), direction })
}

/// Renders the room with soft shadows and contact shadows.
pub(crate) fn room_plate(room: &Room, camera: &Camera) -> Plate {
    let width = camera.size.width_px as usize;
    let rows: Vec<Vec<([f32; 3], f32)>> = (0..camera.size.height_px as usize)
        .into_par_iter()
        .map(|y| (0..width).map(|x| room_pixel(room, camera, x, y)).collect())
        .collect();
    let (light, distance_m) = rows.into_iter().flatten().unzip();
    Plate { light, distance_m }
}

fn room_pixel(room: &Room, camera: &Camera, x: usize, y: usize) -> ([f32; 3], f32) {
    let mut sum = [0.0; 3];
    let n = ROOM_SAMPLES * ROOM_SAMPLES;
    for s in 0..n {
        let (sx, sy) = (f64::from(s % ROOM_SAMPLES), f64::from(s / ROOM_SAMPLES));
        let across = |k: f64| (k + 0.5) / f64::from(ROOM_SAMPLES) - 0.5;
        let Some(ray) = ray_at(camera, x as f64 + across(sx), y as f64 + across(sy)) else { continue };
        let seed = mix(((y * 65_536 + x) as u64) << 8 | u64::from(s));
        let light = room_light(room, &ray, s as usize, seed);
        for (sum, light) in sum.iter_mut().zip(light) {
            *sum += light;
        }
    }
    let middle = ray_at(camera, x as f64, y as f64).and_then(|ray| room.distance_m(&ray, f64::MAX));
    let distance_m = middle.map_or(f32::MAX, |d| d as f32);
    (sum.map(|c| (c / f64::from(n)) as f32), distance_m)
}

fn room_light(room: &Room, ray: &Ray, sample: usize, seed: u64) -> [f64; 3] {
    let Some((hit, color, glow)) = room.meet(ray) else { return [0.0; 3] };
    if glow > 0.0 && ray.direction.z > 0.0 {
        return [glow * EXPOSURE; 3];
    }
    let at = ray.origin + ray.direction * (hit.distance_m - 1e-4) + hit.normal * 1e-3;
    let mut irradiance = 0.0;
    // Each sample of a pixel looks at a third of the lamps, and the nine at each lamp three times.
    for (k, lamp) in room.lamps.iter().enumerate().filter(|(k, _)| (k + sample).is_multiple_of(3)) {
        let counter = seed ^ ((k as u64) << 33);
        let third = (sample / 3) % 3;
        let within = |third: usize, counter: u64| (third as f64 + unit(counter)) / 3.0;
        let point = lamp.point(within(third, counter), within((third + k) % 3, counter ^ 0x5bd1_e995));
        let light = lamp.unhidden_irradiance(&at, &hit.normal);
        if light > 0.0 && !room.hides(&at, &point) {
            irradiance += 3.0 * light;
        }
    }
    irradiance += ambient_irradiance(&hit.normal) * openness(room, &at, &hit.normal, sample, seed);
    color.map(|c| c * irradiance / PI * EXPOSURE)
}

/// Share of the light from all sides that nothing within half a metre keeps away.
fn openness(room: &Room, at: &Vector3<f64>, normal: &Vector3<f64>, sample: usize, seed: u64) -> f64 {
    const REACH_M: f64 = 0.5;
    let within = |third: usize, counter: u64| ((third % 3) as f64 + unit(counter)) / 3.0;
    let (a, b) = (within(sample, seed ^ 0x1234_5678), within(sample / 3, seed ^ 0x9abc_def0));
    let (angle, z) = (2.0 * PI * a, 2.0 * b - 1.0);
    let flat = (1.0 - z * z).sqrt();
    let sphere = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
    let direction = (normal + sphere * 0.999).normalize();
    let near_m = room.distance_m(&Ray { origin: *at, direction }, REACH_M).unwrap_or(REACH_M);
    0.45 + 0.55 * near_m / REACH_M
}

/// A rectangle of pixels, ends not included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Region {
    pub x: (usize, usize),
    pub y: (usize, usize),
}

/// The pixels that parts may touch at any of the poses, with a margin; `None` when they are out of view.
pub(crate) fn region_of(
    parts: &[Part],
    poses: &[Isometry3<f64>],
    camera: &Camera,
    margin_px: f64,
) -> Option<Region> {
    let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
    for part in parts {
        for pose in poses {
            let centre = pose * Point3::from(part.bound.0);
            let depth_m = (camera.cam_from_world * centre).z;
            let Ok(seen) = camera.project(&centre.coords) else { continue };
            let reach =
                part.bound.1 * camera.intrinsics.fx_px / (depth_m - part.bound.1).max(0.05) * 1.3 + margin_px;
            low = low.inf(&seen.pixel.add_scalar(-reach));
            high = high.sup(&seen.pixel.add_scalar(reach));
        }
    }
    let clip = |v: f64, size: u32| v.clamp(0.0, f64::from(size)) as usize;
    let x = (clip(low.x.floor(), camera.size.width_px), clip(high.x.ceil() + 1.0, camera.size.width_px));
    let y = (clip(low.y.floor(), camera.size.height_px), clip(high.y.ceil() + 1.0, camera.size.height_px));
    (x.0 < x.1 && y.0 < y.1).then_some(Region { x, y })
}

/// Poses at evenly spread times of an exposure, whose shares are -0.5 to 0.5.
pub(crate) fn exposure(pose_at: impl Fn(f64) -> Isometry3<f64>) -> [Isometry3<f64>; PART_SAMPLES] {
    std::array::from_fn(|k| pose_at((k as f64 + 0.5) / PART_SAMPLES as f64 - 0.5))
}

pub(crate) struct Moving<'a> {
    pub parts: &'a [Part],
    /// Poses at evenly spread times of the exposure; one for what stands still.
    pub poses: &'a [Isometry3<f64>],
    /// Light on each part.
    pub light: &'a [IrradianceMap],
}

/// The data of rays through a region, computed once a frame.
#[derive(Clone)]
pub(crate) struct Composer<'a> {
    moving: &'a Moving<'a>,
    camera: &'a Camera,
    plate: &'a Plate,
    inverses: Vec<Isometry3<f64>>,
    origins: Vec<Vector3<f64>>,
    outlines: Vec<Outline>,
    /// The camera's axes across its view.
    sides: Vec<[Vector3<f64>; 2]>,
    /// Samples that one ray stands for, each way.
    stride: usize,
}

/// A surface that a ray meets: of which part, how far away and with which normal in body axes, and how much
/// of the ray's cell it covers.
type Met = (usize, Hit, f64);

#[derive(Clone, Copy)]
struct Background {
    light: [f64; 3],
    distance_m: f64,
}

/// A cell of a pixel, in body axes: a ray somewhere in it, and one through its middle where a ball may be.
struct Cell {
    somewhere: Ray,
    middle: Option<Ray>,
}

impl<'a> Composer<'a> {
    pub(crate) fn new(moving: &'a Moving<'a>, camera: &'a Camera, plate: &'a Plate) -> Self {
        let inverses: Vec<Isometry3<f64>> = moving.poses.iter().map(Isometry3::inverse).collect();
        let origins = inverses.iter().map(|i| (i * Point3::from(camera.centre_in_world())).coords).collect();
        let outlines = moving.parts.iter().map(|p| Outline::of(p, moving.poses, camera)).collect();
        let world_from_cam = camera.cam_from_world.rotation.inverse();
        let across = [Vector3::x(), Vector3::y()].map(|axis| world_from_cam * axis);
        let sides = inverses.iter().map(|i| across.map(|axis| i.rotation * axis)).collect();
        Self { moving, camera, plate, inverses, origins, outlines, sides, stride: 1 }
    }

    /// Lets one ray represent `stride` samples each way, a divisor of [`PART_SAMPLES`].
    pub(crate) fn with_stride(self, stride: usize) -> Self {
        Self { stride, ..self }
    }

    #[cfg(test)]
    pub(crate) fn trying_all(mut self) -> Self {
        self.outlines.fill(Outline::ALL);
        self
    }

    /// Samples of one row of pixels with the moving parts over the plate, [`PART_SAMPLES`] squared a pixel.
    pub(crate) fn row(&self, y: usize, columns: (usize, usize), samples: &mut [[f32; 3]]) {
        let width = (columns.1 - columns.0) * PART_SAMPLES;
        for x in columns.0..columns.1 {
            let k = y * self.camera.size.width_px as usize + x;
            let light = self.plate.light[k].map(f64::from);
            self.pixel((x, y), self.background(k, light), |i, j, light| {
                samples[j * width + (x - columns.0) * PART_SAMPLES + i] = light.map(|c| c as f32);
            });
        }
    }

    /// The moving parts over a row of light, one ray a pixel, without a lens.
    pub(crate) fn over(&self, y: usize, columns: (usize, usize), light: &mut [[f32; 3]]) {
        for (x, pixel) in (columns.0..columns.1).zip(light) {
            let k = y * self.camera.size.width_px as usize + x;
            let background = self.background(k, pixel.map(f64::from));
            self.pixel((x, y), background, |_, _, light| *pixel = light.map(|c| c as f32));
        }
    }

    fn background(&self, pixel: usize, light: [f64; 3]) -> Background {
        Background { light, distance_m: f64::from(self.plate.distance_m[pixel]) }
    }

    fn pixel(
        &self,
        (x, y): (usize, usize),
        background: Background,
        mut each: impl FnMut(usize, usize, [f64; 3]),
    ) {
        const N: usize = PART_SAMPLES;
        let (near, mut hits) = (self.near_parts(x as f64, y as f64), Vec::new());
        let near_ball = near.iter().any(|k| matches!(self.moving.parts[*k].shape, Shape::Ball { .. }));
        // The canonical multi-jittered arrangement (Chiu, Shirley & Wang 1994).
        let n_parts = (N / self.stride) as f64;
        let across = |k: usize, other: f64| (k as f64 + (other + 0.5) / n_parts) / n_parts - 0.5;
        let n = N / self.stride;
        for s in 0..n * n {
            let (i, j) = (s % n, s / n);
            // Times are dealt over the square so that each row, column and quarter sees the whole exposure.
            let pose = (i * 5 + j * 3 + (x + 2 * y)) % N * self.inverses.len() / N;
            let ray = |in_i: f64, in_j: f64| {
                let pixel = Vector2::new(x as f64 + across(i, in_i), y as f64 + across(j, in_j));
                let direction = self.inverses[pose].rotation * self.camera.ray(&pixel).ok()?;
                Some(Ray { origin: self.origins[pose], direction })
            };
            let somewhere = if near.is_empty() { None } else { ray(j as f64, i as f64) };
            let light = somewhere.map_or(background.light, |somewhere| {
                let half = 0.5 * (n_parts - 1.0);
                let middle = if near_ball { ray(half, half) } else { None };
                self.sample(&near, &mut hits, &Cell { somewhere, middle }, pose, background)
            });
            for k in 0..self.stride * self.stride {
                each(i * self.stride + k % self.stride, j * self.stride + k / self.stride, light);
            }
        }
    }

    fn sample(
        &self,
        near: &[usize],
        hits: &mut Vec<Met>,
        cell: &Cell,
        pose: usize,
        background: Background,
    ) -> [f64; 3] {
        let moving = self.moving;
        let width_rad = self.stride as f64 / (PART_SAMPLES as f64 * self.camera.intrinsics.fx_px.abs());
        let footprint = Footprint { sides: self.sides[pose], width_rad };
        hits.clear();
        let met = near.iter().filter_map(|k| match (&moving.parts[*k].shape, &cell.middle) {
            (Shape::Ball { centre, radius }, Some(middle)) => {
                middle.cover_by_ball(centre, *radius, &footprint).map(|(hit, covered)| (*k, hit, covered))
            }
            (shape, _) => shape.meet(&cell.somewhere).map(|hit| (*k, hit, 1.0)),
        });
        hits.extend(met.filter(|(_, hit, _)| hit.distance_m < background.distance_m));
        hits.sort_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m));
        let (mut light, mut passes) = ([0.0; 3], 1.0);
        for (k, hit, covered) in hits.iter() {
            let part = &moving.parts[*k];
            let in_world = moving.poses[pose].rotation * hit.normal;
            let seen_from = moving.poses[pose].rotation * cell.somewhere.direction;
            let irradiance = moving.light[*k].of(&in_world);
            let mirrored = seen_from - in_world * (2.0 * seen_from.dot(&in_world));
            let shine = part.gloss * mirrored.z.max(0.0).powi(12);
            let kept = covered * (1.0 - part.passes);
            for (light, color) in light.iter_mut().zip(part.linear) {
                *light += passes * kept * (color * irradiance / PI + shine) * EXPOSURE;
            }
            passes *= 1.0 - kept;
            if passes < 1e-3 {
                return light;
            }
        }
        for (light, background) in light.iter_mut().zip(background.light) {
            *light += passes * background;
        }
        light
    }

    /// The parts that a pixel may see at some time of the exposure.
    fn near_parts(&self, u: f64, v: f64) -> Vec<usize> {
        let Ok(middle) = self.camera.ray(&Vector2::new(u, v)) else { return vec![] };
        let ahead = self.camera.cam_from_world.rotation * middle;
        let place = ahead.xy() / ahead.z;
        // A pixel's corners are 0.7 of a pixel from its middle, and more where a lens compresses.
        let margin = 1.5 / self.camera.intrinsics.fx_px.abs().min(self.camera.intrinsics.fy_px.abs());
        let may = |k: &usize| ahead.z < 1e-3 || self.outlines[*k].may_be_at(&place, margin);
        (0..self.outlines.len()).filter(may).collect()
    }
}
