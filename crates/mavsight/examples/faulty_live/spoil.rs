//! What faults do to pictures.

use crate::faults::{Fault, Kind};
use crate::film::{Film, SIZE};
use mavsight::random::Random;
use mavsight::vision::{Frame, Pixels};

const WIDTH: usize = SIZE.width_px as usize;
const NORMALS: usize = 1 << 16;

/// Spoils pictures of one camera.
pub(crate) struct Spoiler {
    normals: Vec<f32>,
    random: Random,
    row: Vec<u8>,
}

impl Spoiler {
    pub(crate) fn new(random: Random) -> Self {
        let mut random = random;
        Self { normals: (0..NORMALS).map(|_| random.normal() as f32).collect(), random, row: Vec::new() }
    }

    /// Spoils a picture by a fault, where it does that.
    pub(crate) fn spoil(&mut self, fault: &Fault, bar: Option<Bar>, frame: &mut Frame) {
        let Pixels::Rgb(rgb) = &mut frame.pixels else { return };
        let strength = fault.strength;
        match fault.kind {
            // From closed to a third of the light, and from twice to thirty times as much.
            Kind::Dark if fault.is_other_way => lit(rgb, 0.0),
            Kind::Dark => lit(rgb, 0.3 * strength),
            Kind::Overexposed => lit(rgb, 2.0 * 15_f64.powf(strength)),
            Kind::Noisy => self.noise(rgb, (5.0 + 55.0 * strength) as f32),
            // The noise of an encoder, which changes a code now and then.
            Kind::Frozen if fault.is_other_way => self.noise(rgb, 0.4),
            Kind::Blurred => self.blur(rgb, 1 + (5.0 * strength) as usize),
            Kind::Hidden => bar.iter().for_each(|bar| self.hide(rgb, *bar)),
            _ => {}
        }
    }

    fn noise(&mut self, rgb: &mut [u8], std: f32) {
        for row in rgb.chunks_exact_mut(3 * WIDTH) {
            let from = (self.random.uniform() * (NORMALS - 3 * WIDTH) as f64) as usize;
            for (sample, normal) in row.iter_mut().zip(&self.normals[from..]) {
                *sample = (f32::from(*sample) + std * normal + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
    }

    /// The mean over a square of pixels.
    fn blur(&mut self, rgb: &mut [u8], radius: usize) {
        let height = SIZE.height_px as usize;
        let mut line = std::mem::take(&mut self.row);
        for y in 0..height {
            Row { first: 3 * WIDTH * y, step: 3, count: WIDTH }.average(rgb, radius, &mut line);
        }
        for x in 0..WIDTH {
            Row { first: 3 * x, step: 3 * WIDTH, count: height }.average(rgb, radius, &mut line);
        }
        self.row = line;
    }

    fn hide(&self, rgb: &mut [u8], bar: Bar) {
        let column = |at_px: f64| (at_px.max(0.0) as usize).min(WIDTH);
        let (from, to) = (column(bar.middle_px - bar.half_px), column(bar.middle_px + bar.half_px));
        for row in rgb.chunks_exact_mut(3 * WIDTH) {
            row[3 * from..3 * to].iter_mut().zip(&self.normals).for_each(|(sample, normal)| {
                *sample = (104.0 + 3.0 * normal) as u8;
            });
        }
    }
}

/// A grey bar that goes across the balls.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bar {
    middle_px: f64,
    half_px: f64,
    pub(crate) touches_a_ball: bool,
}

impl Bar {
    pub(crate) fn of(fault: &Fault, film: &Film, camera: usize, frame: u64) -> Self {
        let all = || film.balls(camera, frame);
        let radius_px = all().map(|b| b.1).fold(0.0, f64::max);
        let low_px = all().map(|b| b.0.x).fold(f64::INFINITY, f64::min) - 2.0 * radius_px;
        let high_px = all().map(|b| b.0.x).fold(f64::NEG_INFINITY, f64::max) + 2.0 * radius_px;
        let length = (fault.frames.1 - fault.frames.0).max(1) as f64;
        let share = frame.saturating_sub(fault.frames.0) as f64 / length;
        let along = if fault.is_other_way { 1.0 - share } else { share };
        let middle_px = low_px + along * (high_px - low_px);
        let half_px = 2.0 + 0.5 * fault.strength * (high_px - low_px);
        // A lens spreads a rim over two pixels.
        let touches_a_ball = all().any(|(at, radius)| (at.x - middle_px).abs() < half_px + radius + 2.0);
        Self { middle_px, half_px, touches_a_ball }
    }
}

/// As with so much of the light, by the curve of sRGB.
fn lit(rgb: &mut [u8], gain: f64) {
    let linear = |code: f64| if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) };
    let coded =
        |light: f64| if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    let table: Vec<u8> = (0..=255)
        .map(|code| (255.0 * coded((gain * linear(f64::from(code) / 255.0)).min(1.0))).round() as u8)
        .collect();
    rgb.iter_mut().for_each(|sample| *sample = table[usize::from(*sample)]);
}

/// Pixels along a line of a picture: the first one's first sample, and how many samples on the next begins.
struct Row {
    first: usize,
    step: usize,
    count: usize,
}

impl Row {
    /// Replaces the pixels by their running mean, channel by channel.
    fn average(&self, rgb: &mut [u8], radius: usize, line: &mut Vec<u8>) {
        let &Self { first, step, count } = self;
        for channel in first..first + 3 {
            line.clear();
            line.extend((0..count).map(|k| rgb[channel + k * step]));
            let at = |k: usize| u32::from(line[k.min(count - 1)]);
            let mut sum: u32 = (0..radius).map(at).sum::<u32>() + (radius as u32 + 1) * at(0);
            for k in 0..count {
                sum += at(k + radius);
                sum -= at(k.saturating_sub(radius + 1));
                rgb[channel + k * step] = (sum / (2 * radius as u32 + 1)) as u8;
            }
        }
    }
}
