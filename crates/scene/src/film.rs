//! Stills and frames of one camera.

use crate::aircraft::{Aircraft, ControlFrame, Part};
use crate::light::IrradianceMap;
use crate::render::{Moving, PART_SAMPLES, Plate, Region, compose, region_of, room_plate};
use crate::sensor::Coder;
use crate::{Room, Sensor};
use mavsight_geometry::Camera;
use nalgebra::{Isometry3, Point3};

/// A camera in a room, ready to film.
pub struct Film<'a> {
    room: &'a Room,
    camera: Camera,
    plate: Plate,
    blurred: Vec<[f32; 3]>,
    kernel: Vec<f32>,
    coder: Coder,
}

/// Noise stream of the stills, apart from that of the frames.
const STILL_FRAME: u64 = u64::MAX;

impl<'a> Film<'a> {
    /// Renders the room once for this camera. Pixels outside the field where the lens distortion can be undone are black.
    pub fn new(room: &'a Room, camera: Camera, sensor: Sensor) -> Self {
        let plate = room_plate(room, &camera);
        let kernel = gaussian(sensor.lens_blur_px);
        let mut film = Self { room, camera, plate, blurred: Vec::new(), kernel, coder: Coder::new(sensor) };
        let (width, height) = film.size();
        film.blurred = blur(&film.plate.light, width, height, &film.kernel);
        film
    }

    fn size(&self) -> (usize, usize) {
        (self.camera.size.width_px as usize, self.camera.size.height_px as usize)
    }

    /// The room as this camera sees it, with the control frame where one is given: packed sRGB bytes.
    pub fn still(&self, control: Option<&ControlFrame>) -> Vec<u8> {
        let pose = [Isometry3::identity()];
        let light = match control {
            Some(frame) => self.with_parts(&frame.parts, &pose),
            None => self.blurred.clone(),
        };
        self.coder.code(&light, STILL_FRAME)
    }

    /// One frame of the aircraft: packed sRGB bytes.
    ///
    /// `pose_at` gives world_from_body at a share of the exposure, from -0.5 (shutter opens) to 0.5 (it closes); 0 is
    /// the time stamp of the frame. `index` chooses the noise.
    pub fn frame(&self, index: u64, aircraft: &Aircraft, pose_at: impl Fn(f64) -> Isometry3<f64>) -> Vec<u8> {
        let poses: Vec<Isometry3<f64>> =
            (0..PART_SAMPLES).map(|k| pose_at((k as f64 + 0.5) / PART_SAMPLES as f64 - 0.5)).collect();
        self.coder.code(&self.with_parts(&aircraft.parts, &poses), index)
    }

    /// Linear light of the room with parts before it, behind the lens.
    fn with_parts(&self, parts: &[Part], poses: &[Isometry3<f64>]) -> Vec<[f32; 3]> {
        let reach = self.kernel.len() / 2;
        let mut out = self.blurred.clone();
        let Some(region) = region_of(parts, poses, &self.camera, 2.0 + reach as f64) else { return out };
        let light: Vec<IrradianceMap> = parts
            .iter()
            .map(|part| {
                let centre = poses[poses.len() / 2] * Point3::from(part.bound.0);
                IrradianceMap::at(&centre.coords, &self.room.lamps)
            })
            .collect();
        let moving = Moving { parts, poses, light: &light };
        let sharp = compose(&moving, &self.camera, &self.plate, region);
        self.blur_into(&mut out, &sharp, region);
        out
    }

    /// Blurs a sharp region with the plate around it, and puts it in its place.
    fn blur_into(&self, out: &mut [[f32; 3]], sharp: &[[f32; 3]], region: Region) {
        let (width, height) = self.size();
        let reach = self.kernel.len() / 2;
        let around = Region {
            x: (region.x.0.saturating_sub(reach), (region.x.1 + reach).min(width)),
            y: (region.y.0.saturating_sub(reach), (region.y.1 + reach).min(height)),
        };
        let (w, h) = (around.x.1 - around.x.0, around.y.1 - around.y.0);
        let mut patch = Vec::with_capacity(w * h);
        for y in around.y.0..around.y.1 {
            patch.extend_from_slice(&self.plate.light[y * width + around.x.0..y * width + around.x.1]);
        }
        let region_width = region.x.1 - region.x.0;
        for (row, y) in (region.y.0..region.y.1).enumerate() {
            let at = (y - around.y.0) * w + region.x.0 - around.x.0;
            patch[at..at + region_width]
                .copy_from_slice(&sharp[row * region_width..(row + 1) * region_width]);
        }
        let soft = blur(&patch, w, h, &self.kernel);
        for y in region.y.0..region.y.1 {
            let at = (y - around.y.0) * w + region.x.0 - around.x.0;
            out[y * width + region.x.0..y * width + region.x.1].copy_from_slice(&soft[at..at + region_width]);
        }
    }
}

fn gaussian(std_px: f64) -> Vec<f32> {
    if std_px.is_nan() || std_px <= 0.0 {
        return vec![1.0];
    }
    let reach = (4.0 * std_px).ceil() as i32;
    let weights: Vec<f64> =
        (-reach..=reach).map(|k| (-0.5 * (f64::from(k) / std_px).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

/// Separable convolution; beyond the border the border's pixels repeat.
fn blur(light: &[[f32; 3]], width: usize, height: usize, kernel: &[f32]) -> Vec<[f32; 3]> {
    let reach = kernel.len() / 2;
    let mut across = vec![[0.0; 3]; light.len()];
    let mut down = vec![[0.0; 3]; light.len()];
    let clip = |k: usize, tap: usize, size: usize| (k + tap).saturating_sub(reach).min(size - 1);
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0.0_f32; 3];
            for (tap, weight) in kernel.iter().enumerate() {
                let from = light[y * width + clip(x, tap, width)];
                (0..3).for_each(|c| sum[c] += weight * from[c]);
            }
            across[y * width + x] = sum;
        }
    }
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0.0_f32; 3];
            for (tap, weight) in kernel.iter().enumerate() {
                let from = across[clip(y, tap, height) * width + x];
                (0..3).for_each(|c| sum[c] += weight * from[c]);
            }
            down[y * width + x] = sum;
        }
    }
    down
}
