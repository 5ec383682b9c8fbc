//! Stills and frames of one camera.

use crate::aircraft::{Aircraft, ControlFrame, Part};
use crate::light::IrradianceMap;
use crate::occluders::Occluders;
use crate::render::{Composer, Moving, PART_SAMPLES, Plate, Region, exposure, region_of, room_plate};
use crate::sensor::Coder;
use crate::{Room, Sensor};
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Point3, Vector2};

/// A camera in a room, ready to film.
pub struct Film<'a> {
    pub(crate) room: &'a Room,
    pub(crate) camera: Camera,
    pub(crate) plate: Plate,
    pub(crate) blurred: Vec<[f32; 3]>,
    pub(crate) lens: Lens,
    pub(crate) coder: Coder,
}

/// Noise stream of the stills, apart from that of the frames.
const STILL_FRAME: u64 = u64::MAX;

impl<'a> Film<'a> {
    /// Renders the room once for this camera. Pixels outside the field where the lens distortion can be
    /// undone are black.
    pub fn new(room: &'a Room, camera: Camera, sensor: Sensor) -> Self {
        let plate = room_plate(room, &camera);
        let lens = Lens::new(sensor.lens_blur_px);
        let mut film = Self { room, camera, plate, blurred: Vec::new(), lens, coder: Coder::new(sensor) };
        let (width, height) = film.size();
        film.blurred = blur(&film.plate.light, width, height, &film.lens.coarse);
        film
    }

    fn size(&self) -> (usize, usize) {
        (self.camera.size.width_px as usize, self.camera.size.height_px as usize)
    }

    /// The room as this camera sees it, with the control frame where one is given: packed sRGB bytes.
    pub fn still(&self, control: Option<&ControlFrame>) -> Vec<u8> {
        let pose = [Isometry3::identity()];
        let light = match control {
            Some(frame) => self.with_parts(&frame.parts, &pose, &self.plate, &self.blurred),
            None => self.blurred.clone(),
        };
        self.coder.code(&light, STILL_FRAME)
    }

    /// One frame of the aircraft: packed sRGB bytes.
    ///
    /// `pose_at` gives world_from_body at a share of the exposure, from -0.5 (shutter opens) to 0.5 (it
    /// closes); 0 is the time stamp of the frame. `index` chooses the noise.
    pub fn frame(&self, index: u64, aircraft: &Aircraft, pose_at: impl Fn(f64) -> Isometry3<f64>) -> Vec<u8> {
        self.frame_with(index, aircraft, pose_at, &Occluders::default())
    }

    /// Films the aircraft with people, veils or darkness before the camera.
    pub fn frame_with(
        &self,
        index: u64,
        aircraft: &Aircraft,
        pose_at: impl Fn(f64) -> Isometry3<f64>,
        occluders: &Occluders,
    ) -> Vec<u8> {
        if occluders.black {
            return vec![0; 3 * self.plate.light.len()];
        }
        let poses = exposure(pose_at);
        let (width, height) = self.size();
        let mut light = match occluders.over(&self.plate, &self.camera, &self.room.lamps) {
            Some(plate) => {
                let blurred = blur(&plate.light, width, height, &self.lens.coarse);
                self.with_parts(&aircraft.parts, &poses, &plate, &blurred)
            }
            None => self.with_parts(&aircraft.parts, &poses, &self.plate, &self.blurred),
        };
        if !occluders.veils.is_empty() {
            for (k, pixel) in light.iter_mut().enumerate() {
                let veil = occluders.veil(&Vector2::new((k % width) as f64, (k / width) as f64)) as f32;
                pixel.iter_mut().for_each(|c| *c += veil);
            }
        }
        self.coder.code(&light, index)
    }

    /// One frame by a rolling shutter, whose rows are each exposed later than the one above by `row_share` of
    /// the exposure; the middle row is exposed as in [`Film::frame`].
    pub fn rolling_frame(
        &self,
        index: u64,
        aircraft: &Aircraft,
        row_share: f64,
        pose_at: impl Fn(f64) -> Isometry3<f64>,
    ) -> Vec<u8> {
        let rows = self.size().1;
        let late = |row: usize| row_share * (row as f64 - (rows as f64 - 1.0) / 2.0);
        let of_rows = (0..=8).map(|k| pose_at(late(k * (rows - 1) / 8)));
        let all: Vec<Isometry3<f64>> = of_rows.chain(exposure(&pose_at)).collect();
        let margin_px = 3.0 + 2.0 * self.lens.reach as f64;
        let mut out = self.blurred.clone();
        if let Some(region) = region_of(&aircraft.parts, &all, &self.camera, margin_px) {
            let light = self.light_on(&aircraft.parts, &pose_at(0.0));
            self.soften_into(&mut out, region, |y, columns, samples| {
                let poses = exposure(|share| pose_at(share + late(y)));
                let moving = Moving { parts: &aircraft.parts, poses: &poses, light: &light };
                Composer::new(&moving, &self.camera, &self.plate).row(y, columns, samples);
            });
        }
        self.coder.code(&out, index)
    }

    pub(crate) fn light_on(&self, parts: &[Part], pose: &Isometry3<f64>) -> Vec<IrradianceMap> {
        let at =
            |part: &Part| IrradianceMap::at(&(pose * Point3::from(part.bound.0)).coords, &self.room.lamps);
        parts.iter().map(at).collect()
    }

    /// Linear light of the room with parts before it, behind the lens.
    fn with_parts(
        &self,
        parts: &[Part],
        poses: &[Isometry3<f64>],
        plate: &Plate,
        blurred: &[[f32; 3]],
    ) -> Vec<[f32; 3]> {
        let margin_px = 2.0 + 2.0 * self.lens.reach as f64;
        let mut out = blurred.to_vec();
        let Some(region) = region_of(parts, poses, &self.camera, margin_px) else { return out };
        let light = self.light_on(parts, &poses[poses.len() / 2]);
        let moving = Moving { parts, poses, light: &light };
        let composer = Composer::new(&moving, &self.camera, plate);
        self.soften_into(&mut out, region, |y, columns, samples| composer.row(y, columns, samples));
        out
    }

    /// Puts a region with moving parts behind the lens in its place. Pixels within the lens's reach of its
    /// border, where it is not the image's, see no part.
    pub(crate) fn soften_into(
        &self,
        out: &mut [[f32; 3]],
        region: Region,
        compose: impl Fn(usize, (usize, usize), &mut [[f32; 3]]),
    ) {
        let (width, height) = self.size();
        let columns = region.x.1 - region.x.0;
        let mut samples = vec![[0.0; 3]; columns * PART_SAMPLES * PART_SAMPLES];
        let mut line = vec![[0.0; 3]; columns];
        let mut sums = vec![([0.0_f32; 3], 0.0_f32); columns * (region.y.1 - region.y.0)];
        let reach = self.lens.reach;
        for y in region.y.0..region.y.1 {
            compose(y, region.x, &mut samples);
            for (j, row) in samples.chunks_exact(columns * PART_SAMPLES).enumerate() {
                self.lens.across(row, &mut line);
                for target in y.saturating_sub(reach).max(region.y.0)..(y + reach + 1).min(region.y.1) {
                    let weight = self.lens.fine[(y + reach - target) * PART_SAMPLES + j];
                    let sums = &mut sums[(target - region.y.0) * columns..][..columns];
                    for ((sum, total), light) in sums.iter_mut().zip(&line) {
                        (0..3).for_each(|c| sum[c] += weight * light[c]);
                        *total += weight;
                    }
                }
            }
        }
        let inner = |(from, to): (usize, usize), size: usize| {
            let from = if from == 0 { 0 } else { from + reach };
            from..if to == size { size } else { to.saturating_sub(reach) }
        };
        for row in inner(region.y, height) {
            for column in inner(region.x, width) {
                let (sum, total) = sums[(row - region.y.0) * columns + column - region.x.0];
                out[row * width + column] = sum.map(|c| c / total);
            }
        }
    }
}

/// Parts of a pixel in the mean of the lens's blur over it.
const PIXEL_PARTS: usize = 64;

/// A lens's Gaussian blur and a pixel's area together, as weights.
pub(crate) struct Lens {
    /// Pixels to either side that light may come from.
    pub(crate) reach: usize,
    /// Weight of each sample row or column, [`PART_SAMPLES`] to a pixel.
    fine: Vec<f32>,
    /// Weight of each whole pixel: the same for light that is uniform within pixels.
    coarse: Vec<f32>,
}

impl Lens {
    fn new(blur_px: f64) -> Self {
        let reach = if blur_px > 0.0 { (4.0 * blur_px).ceil() as usize } else { 0 };
        let count = PART_SAMPLES * (2 * reach + 1);
        let offset_px = |k: usize| (k as f64 + 0.5) / PART_SAMPLES as f64 - reach as f64 - 0.5;
        // The Gaussian's mean over the pixel around each sample; without blur all samples count alike.
        let weight = |k: usize| {
            let within = |part: usize| offset_px(k) + (part as f64 + 0.5) / PIXEL_PARTS as f64 - 0.5;
            (0..PIXEL_PARTS).map(|part| (-0.5 * (within(part) / blur_px).powi(2)).exp()).sum::<f64>()
        };
        let weights: Vec<f64> = (0..count).map(|k| if reach == 0 { 1.0 } else { weight(k) }).collect();
        let sum: f64 = weights.iter().sum();
        let fine: Vec<f32> = weights.iter().map(|w| (w / sum) as f32).collect();
        let coarse = fine.chunks_exact(PART_SAMPLES).map(|w| w.iter().sum()).collect();
        Self { reach, fine, coarse }
    }

    /// One row of samples into pixels; beyond its ends nothing counts.
    fn across(&self, row: &[[f32; 3]], line: &mut [[f32; 3]]) {
        let reach = self.reach * PART_SAMPLES;
        for (x, out) in line.iter_mut().enumerate() {
            let first = (x * PART_SAMPLES).saturating_sub(reach);
            let last = ((x + 1) * PART_SAMPLES + reach).min(row.len());
            let weights = &self.fine[first + reach - x * PART_SAMPLES..];
            let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
            for (light, weight) in row[first..last].iter().zip(weights) {
                (0..3).for_each(|c| sum[c] += weight * light[c]);
                total += weight;
            }
            *out = sum.map(|c| c / total);
        }
    }
}

/// A sum of light with the weights of a kernel.
fn weighted(kernel: &[f32], light: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0_f32; 3];
    for (tap, weight) in kernel.iter().enumerate() {
        let from = light(tap);
        (0..3).for_each(|c| sum[c] += weight * from[c]);
    }
    sum
}

/// Separable convolution; beyond the border the border's pixels repeat.
fn blur(light: &[[f32; 3]], width: usize, height: usize, kernel: &[f32]) -> Vec<[f32; 3]> {
    let reach = kernel.len() / 2;
    let clip = |k: usize, tap: usize, size: usize| (k + tap).saturating_sub(reach).min(size - 1);
    let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let across: Vec<[f32; 3]> =
        pixels().map(|(x, y)| weighted(kernel, |tap| light[y * width + clip(x, tap, width)])).collect();
    pixels().map(|(x, y)| weighted(kernel, |tap| across[clip(y, tap, height) * width + x])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Gaussian of variance σ² over a pixel of variance 1/12 has the sum of both, wherever light falls
    /// within the pixel.
    #[test]
    fn the_lens_spreads_light_alike_from_every_place_of_a_pixel() {
        let (blur_px, pixels) = (0.5, 9);
        let lens = Lens::new(blur_px);
        assert!((lens.coarse.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        for place in 0..PART_SAMPLES {
            let mut row = vec![[0.0; 3]; pixels * PART_SAMPLES];
            let from = pixels / 2 * PART_SAMPLES + place;
            row[from] = [1.0; 3];
            let mut line = vec![[0.0; 3]; pixels];
            lens.across(&row, &mut line);
            let sum: f64 = line.iter().map(|l| f64::from(l[0])).sum();
            let moment = |power: i32, about: f64| {
                let term = |(k, l): (usize, &[f32; 3])| f64::from(l[0]) * (k as f64 - about).powi(power);
                line.iter().enumerate().map(term).sum::<f64>() / sum
            };
            let true_px = (from as f64 + 0.5) / PART_SAMPLES as f64 - 0.5;
            let mean_px = moment(1, 0.0);
            assert!((mean_px - true_px).abs() < 0.005, "{place}: {mean_px} for {true_px}");
            let variance_px2 = moment(2, mean_px);
            assert!((variance_px2 - blur_px * blur_px - 1.0 / 12.0).abs() < 0.02, "{place}: {variance_px2}");
            // Every place sends the same amount of light.
            assert!((sum - 1.0 / PART_SAMPLES as f64).abs() < 0.001, "{place}: {sum}");
        }
    }

    #[test]
    fn without_blur_a_pixel_is_the_mean_of_its_samples() {
        let lens = Lens::new(0.0);
        let row: Vec<[f32; 3]> = (0..2 * PART_SAMPLES).map(|k| [k as f32; 3]).collect();
        let mut line = [[0.0; 3]; 2];
        lens.across(&row, &mut line);
        let first = (PART_SAMPLES as f32 - 1.0) / 2.0;
        assert!((line[0][0] - first).abs() < 1e-4 && (line[1][0] - first - PART_SAMPLES as f32).abs() < 1e-4);
    }
}
