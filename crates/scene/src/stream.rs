//! A camera that films fast enough for a flight in real time.

use crate::Film;
use crate::aircraft::Aircraft;
use crate::render::{Composer, Moving, PART_SAMPLES, Region, exposure, region_of};
use crate::shapes::Shape;
use nalgebra::Isometry3;

/// Coded frames of the empty room, after which the noise outside the aircraft repeats.
const BACKGROUNDS: u64 = 8;

/// Samples that one ray represents, each way, near a ball, whose centre is then true to a hundredth of a
/// pixel. The hull has one ray a pixel and no lens blur.
const BALL_STRIDE: usize = 2;

/// Films the aircraft in the empty room like [`Film::frame`], with fewer rays, and outside the aircraft with
/// one of eight noise patterns made beforehand.
pub struct FilmStream<'a> {
    film: Film<'a>,
    backgrounds: Vec<Vec<u8>>,
    /// The room's light, with the aircraft in a region of it.
    light: Vec<[f32; 3]>,
    touched: Option<Region>,
}

impl<'a> FilmStream<'a> {
    /// Codes the empty room.
    pub fn new(film: Film<'a>) -> Self {
        let backgrounds = (0..BACKGROUNDS).map(|k| film.coder.code(&film.blurred, k)).collect();
        let light = film.blurred.clone();
        Self { film, backgrounds, light, touched: None }
    }

    /// Writes one frame as packed sRGB bytes of the camera's size; a buffer of another length is left
    /// unchanged.
    ///
    /// `index` and `pose_at` are those of [`Film::frame`].
    pub fn frame_into(
        &mut self,
        index: u64,
        aircraft: &Aircraft,
        pose_at: impl Fn(f64) -> Isometry3<f64>,
        out: &mut [u8],
    ) {
        let background = &self.backgrounds[(index % BACKGROUNDS) as usize];
        if out.len() != background.len() {
            return;
        }
        out.copy_from_slice(background);
        let width = self.film.camera.size.width_px as usize;
        if let Some(Region { x, y }) = self.touched.take() {
            for row in y.0..y.1 {
                let span = row * width + x.0..row * width + x.1;
                self.light[span.clone()].copy_from_slice(&self.film.blurred[span]);
            }
        }
        let poses = exposure(pose_at);
        let margin_px = 2.0 + 2.0 * self.film.lens.reach as f64;
        let parts = &aircraft.parts;
        let Some(region) = region_of(parts, &poses, &self.film.camera, margin_px) else { return };
        let light = self.film.light_on(parts, &poses[PART_SAMPLES / 2]);
        let moving = Moving { parts, poses: &poses, light: &light };
        let composer = Composer::new(&moving, &self.film.camera, &self.film.plate);
        let coarse = composer.clone().with_stride(PART_SAMPLES);
        for row in region.y.0..region.y.1 {
            let span = row * width + region.x.0..row * width + region.x.1;
            coarse.over(row, region.x, &mut self.light[span]);
        }
        let fine = composer.with_stride(BALL_STRIDE);
        for ball in parts.iter().filter(|p| matches!(p.shape, Shape::Ball { .. })) {
            let own = std::slice::from_ref(ball);
            let Some(around) = region_of(own, &poses, &self.film.camera, margin_px) else { continue };
            self.film
                .soften_into(&mut self.light, around, |y, columns, samples| fine.row(y, columns, samples));
        }
        for row in region.y.0..region.y.1 {
            let (from, to) = (row * width + region.x.0, row * width + region.x.1);
            self.film.coder.code_into(&self.light[from..to], from, index, &mut out[3 * from..3 * to]);
        }
        self.touched = Some(region);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PaintedBall, Room, Sensor};
    use mavsight_geometry::{Camera, ImageSize, Intrinsics, Vector3};

    /// Beside the film's own frames, without noise: the ball's centre, and all else but for single rims.
    #[test]
    fn it_is_the_film() {
        let size = ImageSize { width_px: 96, height_px: 72 };
        let k = Intrinsics::from_horizontal_fov(size, 0.5);
        let camera = Camera::looking_at(Vector3::new(2.5, -2.5, 1.5), Vector3::new(0.0, 0.0, 1.5), k, size);
        let ball =
            PaintedBall { centre_m: Vector3::new(0.2, 0.2, 0.1), radius_m: 0.05, linear: [0.9, 0.05, 0.05] };
        let (room, aircraft) = (Room::meeting_room(), Aircraft::helicopter(&[ball]));
        let sensor = Sensor { noise: false, ..Sensor::default() };
        let film = Film::new(&room, camera, sensor);
        let mut stream = FilmStream::new(Film::new(&room, camera, sensor));
        let mut out = vec![0; 3 * size.area_px()];
        for index in 0..3 {
            let pose = |share: f64| {
                let at = Vector3::new(0.1 * index as f64 - 0.1 + 0.01 * share, 0.0, 1.5);
                Isometry3::new(at, Vector3::x() * std::f64::consts::PI)
            };
            stream.frame_into(index, &aircraft, pose, &mut out);
            let want = film.frame(index, &aircraft, pose);
            let apart: u64 = out.iter().zip(&want).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            assert!((apart as f64) < want.len() as f64, "frame {index}: {apart}");
            let redness = |rgb: &[u8]| {
                let mut sums = [0.0; 3];
                for (k, c) in rgb.chunks_exact(3).enumerate() {
                    let weight = f64::from(c[0]) - f64::from(c[1].max(c[2]));
                    let weight = if weight > 60.0 { weight } else { 0.0 };
                    let place = [(k % 96) as f64, (k / 96) as f64, 1.0];
                    (0..3).for_each(|i| sums[i] += weight * place[i]);
                }
                assert!(sums[2] > 0.0, "no ball in frame {index}");
                [sums[0] / sums[2], sums[1] / sums[2]]
            };
            let (a, b) = (redness(&out), redness(&want));
            // The hull beside a ball has one ray a pixel.
            assert!((a[0] - b[0]).abs() < 0.15 && (a[1] - b[1]).abs() < 0.15, "{a:?} {b:?}");
        }
        let mut short = [7; 3];
        stream.frame_into(0, &aircraft, |_| Isometry3::identity(), &mut short);
        assert_eq!(short, [7; 3]);
    }
}
